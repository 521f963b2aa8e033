/* Work on the engine's and the files' thread. Every job has its own copy of what it needs; `run`
 * is on the job's thread and touches of the daemon only what its comment names. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "viewd/jobs.h"

#define SECOND_NS 1e9

void dio_viewd_post(struct dio_viewd *viewd, struct dio_worker *worker, struct dio_job *job,
		    enum dio_status (*run)(struct dio_job *, struct dio_error *),
		    void (*done)(struct dio_job *))
{
	job->owner = viewd;
	job->run = run;
	job->done = done;
	dio_worker_post(worker, job);
}

void *dio_viewd_allocate_job(struct dio_viewd *viewd, size_t size)
{
	void *job = calloc(1, size);

	if (!job)
		dio_viewd_say(viewd, true, "out of memory");
	return job;
}

/* Opening model, engine and the last scene. */

struct open_job {
	struct dio_job job;
	struct dio_session_options options;
	struct dio_session *session;
	char *scene_path; /* NULL: there is none */
	struct dio_error scene_fault;
	struct dio_viewd_rig rig;
};

bool dio_viewd_copy_rig(const struct dvsm_scene *scene, struct dio_viewd_rig *rig)
{
	const struct dvsm_camera *cameras = dvsm_scene_get_cameras(scene);

	rig->count = dvsm_scene_get_view_count(scene);
	rig->camera = (struct dio_camera_model){.width = cameras[0].width,
						.height = cameras[0].height,
						.fx = cameras[0].fx,
						.fy = cameras[0].fy,
						.cx = cameras[0].cx,
						.cy = cameras[0].cy};
	rig->poses = calloc(rig->count, sizeof *rig->poses);
	for (uint32_t i = 0; rig->poses && i < rig->count; i++)
		memcpy(rig->poses[i].world_from_camera, cameras[i].world_from_camera,
		       sizeof rig->poses[i].world_from_camera);
	return rig->poses != NULL;
}

static enum dio_status run_open(struct dio_job *base, struct dio_error *error)
{
	struct open_job *job = (struct open_job *)base;
	enum dio_status status = dio_session_open(&job->options, &job->session, error);

	if (status != DIO_OK || !job->scene_path)
		return status;
	/* A scene that does not open is made again from its views. */
	if (dio_session_open_scene(job->session, job->scene_path, &job->scene_fault) == DIO_OK &&
	    !dio_viewd_copy_rig(dio_session_get_scene(job->session), &job->rig))
		dio_fail(&job->scene_fault, DIO_NO_MEM, "no memory for the scene's cameras");
	return DIO_OK;
}

bool dio_viewd_adopt_scene(struct dio_viewd *viewd, const struct dio_viewd_rig *rig,
			   struct dio_trajectory *path)
{
	struct dio_error why = {""};

	if (!rig->poses ||
	    dio_viewpoint_set_scene(&viewd->viewpoint, rig->poses, rig->count, &why) != DIO_OK) {
		dio_viewd_say(viewd, true, "no memory for the scene's path");
		return false;
	}
	if (path->count > 0)
		dio_viewpoint_set_path(&viewd->viewpoint, path);
	viewd->scene_camera = rig->camera;
	viewd->scene_there = true;
	viewd->views_closed = true;
	viewd->shot.is_there = false;
	return true;
}

static void set_pace(struct dio_viewd *viewd)
{
	const struct dio_profile *profile = viewd->profile;
	double rate =
		profile->camera.frames_per_second > 0 ? profile->camera.frames_per_second : 30;
	struct dio_camera_model size = {.width = profile->engine.render_width,
					.height = profile->engine.render_height};

	dio_pace_init(&viewd->pace, size.width, size.height,
		      dio_session_get_patch_render(viewd->session, &size),
		      (uint64_t)(SECOND_NS / rate));
	/* A patch that the profile names is kept, whatever it costs. */
	if (profile->engine.patch_render > 0)
		viewd->pace.rungs = 1;
}

static void done_open(struct dio_job *base)
{
	struct open_job *job = (struct open_job *)base;
	struct dio_viewd *viewd = job->job.owner;
	struct dio_trajectory path = {0};
	struct dio_error ignored;

	viewd->engine_opening = false;
	if (job->job.status == DIO_OK) {
		viewd->session = job->session;
		viewd->engine_ready = true;
		snprintf(viewd->status.model, sizeof viewd->status.model, "%s",
			 dio_session_get_model_path(viewd->session));
		set_pace(viewd);
	} else if (!viewd->quitting) {
		dio_viewd_say(viewd, true, "%s", job->job.error.text);
	}
	if (job->job.status == DIO_OK && job->rig.poses) {
		/* Nothing else uses the store before STARTED. */
		dio_store_read_path(viewd->store, &path, &ignored);
		dio_viewd_adopt_scene(viewd, &job->rig, &path);
	} else if (job->job.status == DIO_OK && job->scene_path) {
		dio_viewd_say(viewd, true, "%s", job->scene_fault.text);
		viewd->due_at_start = true;
	}
	dio_trajectory_deinit(&path);
	free(job->rig.poses);
	free(job->scene_path);
	free(job);
	if (!viewd->quitting)
		dio_viewd_tell(viewd, DIO_VIEWD_STARTED);
}

void dio_viewd_open_engine(struct dio_viewd *viewd)
{
	static const enum dvsm_precision PRECISIONS[] = {
		[DIO_PRECISION_FLOAT32] = DVSM_PRECISION_F32,
		[DIO_PRECISION_BFLOAT16] = DVSM_PRECISION_BF16,
		[DIO_PRECISION_INT8] = DVSM_PRECISION_FIXED,
	};
	static const enum dio_deblock DEBLOCKS[] = {
		[DIO_PROFILE_DEBLOCK_AUTO] = DIO_DEBLOCK_AUTO,
		[DIO_PROFILE_DEBLOCK_ON] = DIO_DEBLOCK_ON,
		[DIO_PROFILE_DEBLOCK_OFF] = DIO_DEBLOCK_OFF,
	};
	const struct dio_profile_engine *engine = &viewd->profile->engine;
	struct open_job *job = dio_viewd_allocate_job(viewd, sizeof *job);

	if (!job)
		return;
	job->options = (struct dio_session_options){
		.model = *engine->model ? engine->model : NULL,
		.threads = engine->threads,
		.patch_recon = engine->patch_recon,
		.patch_render = engine->patch_render,
		.precision = PRECISIONS[engine->precision],
		.deblock = DEBLOCKS[engine->deblock],
	};
	if (dio_store_has_scene(viewd->store))
		job->scene_path = dio_store_scene_path(viewd->store);
	viewd->engine_opening = true;
	dio_viewd_post(viewd, viewd->engine, &job->job, run_open, done_open);
}

uint64_t dio_viewd_scene_bytes(const struct dio_viewd *viewd)
{
	const struct dvsm_model_config *config;
	const struct dio_profile *profile = viewd->profile;
	struct dio_camera_model size = {.width = profile->engine.render_width,
					.height = profile->engine.render_height};
	uint64_t patch, columns, rows;

	if (!viewd->engine_ready)
		return 0;
	config = dvsm_model_get_config(dio_session_get_model(viewd->session));
	patch = dio_session_get_patch_recon(viewd->session, &size);
	columns = (size.width + patch / 2) / patch + 1;
	rows = (size.height + patch / 2) / patch + 1;
	/* Keys and values of every layer, as float32; less in other precisions. */
	return viewd->views * columns * rows * config->layers * 2 * config->dim * sizeof(float);
}
