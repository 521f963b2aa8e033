/* Work on the engine's and the files' thread. Every job has its own copy of what it needs; `run`
 * is on the job's thread and touches of the daemon only what its comment names. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "dio/calibration.h"
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
	};
	if (dio_store_has_scene(viewd->store))
		job->scene_path = dio_store_scene_path(viewd->store);
	viewd->engine_opening = true;
	dio_viewd_post(viewd, viewd->engine, &job->job, run_open, done_open);
}

/* Fitting the camera. */

struct fit_job {
	struct dio_job job;
	struct dio_board board;
	struct dio_corners *corners;
	uint32_t count, width, height;
	unsigned number;
	char *path;
	struct dio_calibration calibration;
};

static bool copy_corners(const struct dio_corners *from, struct dio_corners *to)
{
	*to = *from;
	to->ids = malloc(sizeof *to->ids * (from->count + 1u));
	to->image_px = malloc(sizeof *to->image_px * (from->count + 1u));
	to->board_m = malloc(sizeof *to->board_m * (from->count + 1u));
	if (!to->ids || !to->image_px || !to->board_m)
		return false;
	memcpy(to->ids, from->ids, sizeof *to->ids * from->count);
	memcpy(to->image_px, from->image_px, sizeof *to->image_px * from->count);
	memcpy(to->board_m, from->board_m, sizeof *to->board_m * from->count);
	return true;
}

static void free_fit(struct fit_job *job)
{
	for (uint32_t i = 0; job->corners && i < job->count; i++) {
		free(job->corners[i].ids);
		free(job->corners[i].image_px);
		free(job->corners[i].board_m);
	}
	free(job->corners);
	free(job->path);
	dio_calibration_deinit(&job->calibration);
	free(job);
}

/* On the engine's thread, as the whole fit. */
static bool is_fit_wanted(void *context)
{
	const struct fit_job *job = context;
	struct dio_viewd *viewd = job->job.owner;

	return atomic_load(&viewd->fit_number) == job->number;
}

static enum dio_status run_fit(struct dio_job *base, struct dio_error *error)
{
	struct fit_job *job = (struct fit_job *)base;
	struct dio_calibration_options options;
	enum dio_status status;

	dio_calibration_defaults(&options);
	options.keep_going = is_fit_wanted;
	options.context = job;
	/* One that is cancelled leaves the file of the last as it is. */
	status = dio_calibrate(&job->board, job->corners, job->count, job->width, job->height,
			       &options, &job->calibration, error);
	if (status == DIO_OK)
		status = dio_camera_model_write(job->path, DIO_CAMERA_FILE_OPENCV,
						&job->calibration.model, &job->calibration, error);
	return status;
}

static void done_fit(struct dio_job *base)
{
	struct fit_job *job = (struct fit_job *)base;
	struct dio_viewd *viewd = job->job.owner;
	const struct dio_calibration *fit = &job->calibration;
	enum dio_status status = job->job.status;

	/* Cancelled, or begun anew, meanwhile. */
	if (viewd->quitting || job->number != viewd->fit_number ||
	    viewd->machine.state != DIO_VIEWD_CALIBRATE) {
		free_fit(job);
		return;
	}
	if (status == DIO_OK)
		status = dio_viewd_set_camera(viewd, &fit->model, fit->layout, &job->job.error);
	if (status == DIO_OK) {
		dio_viewd_tell(viewd, DIO_VIEWD_FITTED);
		dio_viewd_say(viewd, false, "calibrated from %u views: error %.2f px",
			      fit->views_used, fit->rms_px);
	} else {
		dio_viewd_tell(viewd, DIO_VIEWD_FIT_REFUSED);
		dio_viewd_say(viewd, true, "%s", job->job.error.text);
	}
	dio_viewd_refresh(viewd);
	free_fit(job);
}

void dio_viewd_fit(struct dio_viewd *viewd)
{
	const struct dio_board_views *views = &viewd->gathered;
	struct fit_job *job = dio_viewd_allocate_job(viewd, sizeof *job);
	bool whole = job != NULL;

	if (!job)
		return;
	job->board = views->board;
	job->width = views->width;
	job->height = views->height;
	job->number = viewd->fit_number;
	job->path = strdup(viewd->camera_file);
	job->corners = calloc(views->count + 1u, sizeof *job->corners);
	whole = job->path && job->corners;
	for (uint32_t i = 0; whole && i < views->count; i++) {
		whole = copy_corners(&views->corners[i], &job->corners[i]);
		job->count = i + 1;
	}
	if (!whole) {
		dio_viewd_say(viewd, true, "out of memory");
		free_fit(job);
		return;
	}
	dio_viewd_say(viewd, false, "fitting the camera to %u views", views->count);
	dio_viewd_post(viewd, viewd->engine, &job->job, run_fit, done_fit);
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
