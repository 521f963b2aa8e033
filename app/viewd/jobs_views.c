/* Jobs about the stored views: keep, reconstruct, save. */
#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "dio/clock.h"
#include "viewd/jobs.h"

#define PROGRESS_STEPS 1000

/* Begin a new set of views. */

struct begin_job {
	struct dio_job job;
	struct dio_camera_model camera;
	char *folder; /* of the new set */
};

static void fail_store(struct dio_viewd *viewd, const struct dio_error *why)
{
	if (viewd->quitting)
		return;
	dio_viewd_tell(viewd, DIO_VIEWD_STORE_FAILED);
	dio_viewd_say(viewd, true, "%s", why->text);
}

static enum dio_status run_begin(struct dio_job *base, struct dio_error *error)
{
	struct begin_job *job = (struct begin_job *)base;
	struct dio_viewd *viewd = base->owner;

	enum dio_status status = dio_store_begin(viewd->store, &job->camera, error);

	if (status == DIO_OK)
		job->folder = strdup(dio_store_get_folder(viewd->store));
	return status;
}

static void done_begin(struct dio_job *base)
{
	struct begin_job *job = (struct begin_job *)base;
	struct dio_viewd *viewd = base->owner;

	if (base->status != DIO_OK) {
		fail_store(viewd, &base->error);
	} else {
		free(viewd->capture_folder);
		viewd->capture_folder = job->folder;
	}
	free(job);
}

void dio_viewd_begin_views(struct dio_viewd *viewd)
{
	struct begin_job *job = dio_viewd_allocate_job(viewd, sizeof *job);

	if (!job)
		return;
	dio_keyframe_clear(&viewd->keyframes);
	viewd->views = 0;
	viewd->views_closed = false;
	viewd->walk_count = 0;
	job->camera = viewd->pinhole;
	dio_viewd_post(viewd, viewd->files, &job->job, run_begin, done_begin);
}

/* Keep a view. */

struct store_job {
	struct dio_job job;
	struct dio_picture picture;
	struct dio_pose pose;
	uint64_t timestamp_ns;
};

static enum dio_status run_store(struct dio_job *base, struct dio_error *error)
{
	struct store_job *job = (struct store_job *)base;
	struct dio_viewd *viewd = base->owner;

	return dio_store_append(viewd->store, &job->picture, &job->pose, job->timestamp_ns, error);
}

static void done_store(struct dio_job *base)
{
	struct store_job *job = (struct store_job *)base;
	struct dio_viewd *viewd = base->owner;

	/* The view was counted when it was chosen, so that the next choice knows of it. */
	if (base->status != DIO_OK) {
		viewd->views -= viewd->views > 0;
		viewd->keyframes.count -= viewd->keyframes.count > 0;
		fail_store(viewd, &base->error);
	}
	dio_picture_deinit(&job->picture);
	free(job);
}

void dio_viewd_store_view(struct dio_viewd *viewd)
{
	struct store_job *job = dio_viewd_allocate_job(viewd, sizeof *job);

	if (!job)
		return;
	/* The tracker makes a new picture where it misses one. */
	job->picture = viewd->tracked.undistorted;
	viewd->tracked.undistorted = (struct dio_picture){0};
	job->pose = viewd->tracked.estimate.pose;
	job->timestamp_ns = viewd->tracked.timestamp_ns;
	viewd->views++;
	dio_viewd_say(viewd, false, "view %u of up to %u kept", viewd->views,
		      viewd->profile->capture.views_max);
	dio_viewd_post(viewd, viewd->files, &job->job, run_store, done_store);
}

/* Reconstruct: the files' thread reads the views, then the engine's makes the scene. */

struct reconstruct_job {
	struct dio_job job;
	struct dio_view_set set;
	struct dio_trajectory walk;
	char *scene_path;
	struct dio_viewd_rig rig; /* of the scene */
	uint64_t start_ns;
};

static void free_reconstruct(struct reconstruct_job *job)
{
	dio_view_set_deinit(&job->set);
	dio_trajectory_deinit(&job->walk);
	free(job->scene_path);
	free(job->rig.poses);
	free(job);
}

/* On the files' thread: the store is its own. */
static enum dio_status run_prepare(struct dio_job *base, struct dio_error *error)
{
	struct reconstruct_job *job = (struct reconstruct_job *)base;
	struct dio_viewd *viewd = base->owner;
	struct dio_error ignored;
	enum dio_status status = dio_store_load(viewd->store, &job->set, error);

	if (status == DIO_OK)
		status = dio_store_set_due(viewd->store, true, error);
	/* A reconstruction that is taken up again has its path on disk. */
	if (status == DIO_OK && job->walk.count > 0)
		status = dio_store_write_path(viewd->store, &job->walk, error);
	else if (status == DIO_OK)
		dio_store_read_path(viewd->store, &job->walk, &ignored);
	if (status == DIO_OK && !(job->scene_path = dio_store_scene_path(viewd->store)))
		status = dio_fail(error, DIO_NO_MEM, "no memory for the scene's path");
	return status;
}

static enum dio_status run_settle(struct dio_job *base, struct dio_error *error)
{
	struct dio_viewd *viewd = base->owner;

	return dio_store_settle(viewd->store, error);
}

static enum dio_status run_forget_due(struct dio_job *base, struct dio_error *error)
{
	struct dio_viewd *viewd = base->owner;

	return dio_store_set_due(viewd->store, false, error);
}

static void done_quietly(struct dio_job *base)
{
	struct dio_viewd *viewd = base->owner;

	if (base->status != DIO_OK && !viewd->quitting)
		dio_viewd_say(viewd, true, "%s", base->error.text);
	free(base);
}

static void post_to_store(struct dio_viewd *viewd,
			  enum dio_status (*run)(struct dio_job *, struct dio_error *))
{
	struct dio_job *job = dio_viewd_allocate_job(viewd, sizeof *job);

	if (job)
		dio_viewd_post(viewd, viewd->files, job, run, done_quietly);
}

/* On the engine's thread: `progress` and `cancel` are atomic. */
static bool on_progress(void *context, double done)
{
	struct dio_viewd *viewd = context;

	atomic_store(&viewd->progress, (unsigned)(done * PROGRESS_STEPS));
	return !atomic_load(&viewd->cancel);
}

/* On the engine's thread: the session is its own. */
static enum dio_status run_reconstruct(struct dio_job *base, struct dio_error *error)
{
	struct reconstruct_job *job = (struct reconstruct_job *)base;
	struct dio_viewd *viewd = base->owner;
	enum dio_status status;

	if (atomic_load(&viewd->cancel))
		return DIO_END;
	dio_session_set_progress(viewd->session, on_progress, viewd);
	status = dio_session_reconstruct(viewd->session, job->set.context, job->set.context_count,
					 NULL, error);
	if (status == DIO_OK)
		status = dio_session_save_scene(viewd->session, job->scene_path, error);
	if (status == DIO_OK &&
	    !dio_viewd_copy_rig(dio_session_get_scene(viewd->session), &job->rig))
		status = dio_fail(error, DIO_NO_MEM, "no memory for the scene's cameras");
	return status;
}

static void finish_reconstruct(struct reconstruct_job *job)
{
	struct dio_viewd *viewd = job->job.owner;
	enum dio_status status = job->job.status;

	viewd->due_at_start = false;
	if (status == DIO_OK && dio_viewd_adopt_scene(viewd, &job->rig, &job->walk)) {
		post_to_store(viewd, run_settle);
		dio_viewd_tell(viewd, DIO_VIEWD_RECONSTRUCTED);
		dio_viewd_say(viewd, false, "scene of %u views in %.1f s", job->rig.count,
			      (double)(dio_clock_ns() - job->start_ns) * 1e-9);
	} else if (status == DIO_END) {
		post_to_store(viewd, run_forget_due);
		dio_viewd_tell(viewd, DIO_VIEWD_CANCELLED);
		dio_viewd_say(viewd, false, "reconstruction cancelled; its views are kept");
	} else {
		post_to_store(viewd, run_forget_due);
		dio_viewd_tell(viewd, DIO_VIEWD_ENGINE_FAILED);
		dio_viewd_say(viewd, true, "reconstruction failed: %s", job->job.error.text);
	}
}

static void done_reconstruct(struct dio_job *base)
{
	struct reconstruct_job *job = (struct reconstruct_job *)base;
	struct dio_viewd *viewd = base->owner;

	/* Stopped with the daemon: it stays due, and the next start takes it up. */
	if (!viewd->quitting)
		finish_reconstruct(job);
	free_reconstruct(job);
}

static void done_prepare(struct dio_job *base)
{
	struct dio_viewd *viewd = base->owner;

	if (base->status == DIO_OK && !viewd->quitting)
		dio_viewd_post(viewd, viewd->engine, base, run_reconstruct, done_reconstruct);
	else
		done_reconstruct(base);
}

/* The walk as it is by now; an empty one where memory is short. */
static void copy_walk(const struct dio_viewd *viewd, struct dio_trajectory *copy)
{
	if (viewd->walk_count == 0 || dio_trajectory_init(copy, viewd->walk_count) != DIO_OK)
		return;
	for (uint32_t i = 0; i < viewd->walk_count; i++) {
		copy->poses[i] = viewd->walk.poses[i];
		copy->time_s[i] = viewd->walk.time_s[i] - viewd->walk.time_s[0];
	}
}

void dio_viewd_reconstruct(struct dio_viewd *viewd)
{
	struct reconstruct_job *job = dio_viewd_allocate_job(viewd, sizeof *job);

	if (!job)
		return;
	atomic_store(&viewd->cancel, false);
	atomic_store(&viewd->progress, 0);
	job->start_ns = dio_clock_ns();
	copy_walk(viewd, &job->walk);
	dio_viewd_post(viewd, viewd->files, &job->job, run_prepare, done_prepare);
}

/* Save under a name. */

struct save_job {
	struct dio_job job;
	char name[80];
	struct dio_viewd_shot shot;
	sd_bus_message *call; /* NULL, or who waits for the answer */
	char *folder;
};

static enum dio_status run_save(struct dio_job *base, struct dio_error *error)
{
	struct save_job *job = (struct save_job *)base;
	struct dio_viewd *viewd = base->owner;
	const struct dio_store_shot shot = {
		.picture = &job->shot.picture, .camera = &job->shot.camera, .pose = job->shot.pose};

	return dio_store_save(viewd->store, job->name, job->shot.is_there ? &shot : NULL,
			      &job->folder, error);
}

static void answer(struct save_job *job)
{
	sd_bus_error error = SD_BUS_ERROR_NULL;

	if (job->job.status == DIO_OK) {
		sd_bus_reply_method_return(job->call, "s", job->folder);
	} else {
		dio_bus_set_error(&error, job->job.status, &job->job.error);
		sd_bus_reply_method_error(job->call, &error);
	}
	sd_bus_error_free(&error);
	sd_bus_message_unref(job->call);
}

static void done_save(struct dio_job *base)
{
	struct save_job *job = (struct save_job *)base;
	struct dio_viewd *viewd = base->owner;

	if (base->status == DIO_OK)
		dio_viewd_say(viewd, false, "saved %s", job->folder);
	else
		dio_viewd_say(viewd, true, "%s", base->error.text);
	if (job->call)
		answer(job);
	dio_picture_deinit(&job->shot.picture);
	free(job->folder);
	free(job);
}

static void copy_shot(const struct dio_viewd_shot *from, struct dio_viewd_shot *to)
{
	if (!from->is_there ||
	    dio_picture_init(&to->picture, from->picture.width, from->picture.height) != DIO_OK)
		return;
	memcpy(to->picture.rgb, from->picture.rgb,
	       (size_t)from->picture.width * from->picture.height * 3);
	to->camera = from->camera;
	to->pose = from->pose;
	to->is_there = true;
}

void dio_viewd_save(struct dio_viewd *viewd, const char *name, sd_bus_message *call)
{
	struct save_job *job = dio_viewd_allocate_job(viewd, sizeof *job);

	if (!job) {
		if (call)
			sd_bus_reply_method_errno(call, -ENOMEM, NULL);
		return;
	}
	snprintf(job->name, sizeof job->name, "%s", name);
	job->call = sd_bus_message_ref(call);
	/* A picture of another scene than the stored views' does not belong there. */
	if (viewd->scene_there && viewd->views_closed)
		copy_shot(&viewd->shot, &job->shot);
	dio_viewd_post(viewd, viewd->files, &job->job, run_save, done_save);
}
