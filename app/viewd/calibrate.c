/* The camera's calibration: gathering views of the board, fitting, adopting what came of it. */
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "dio/calibration.h"
#include "viewd/jobs.h"

/* When there are views of the board enough for a fit, and how many more after one that failed. A
 * board that never comes into some corner is not waited for without end. */
#define FIT_VIEWS    20u
#define FIT_ANYWAY   40u
#define FIT_MORE     6u
#define FIT_COVERAGE 0.7

enum dio_status dio_viewd_set_camera(struct dio_viewd *viewd, const struct dio_camera_model *camera,
				     enum dio_board_layout layout, struct dio_error *error)
{
	const struct dio_profile_engine *engine = &viewd->profile->engine;
	struct dio_undistorter *undistorter = NULL;
	struct dio_camera_model pinhole = {0};
	enum dio_status status = DIO_OK;

	/* The tracker makes its own; this one tells the engine's camera. */
	if (camera)
		status = dio_undistorter_create(camera, engine->render_width, engine->render_height,
						&pinhole, &undistorter, error);
	dio_undistorter_destroy(undistorter);
	if (status != DIO_OK)
		return status;
	viewd->calibrated = camera != NULL;
	if (camera)
		viewd->camera = *camera;
	viewd->pinhole = pinhole;
	/* Views of another camera are not mixed with those to come. */
	if (viewd->store && viewd->views > 0)
		viewd->views_closed = true;
	dio_tracker_set_camera(viewd->tracker, camera, engine->render_width, engine->render_height,
			       layout);
	return DIO_OK;
}

void dio_viewd_begin_gather(struct dio_viewd *viewd)
{
	dio_board_views_deinit(&viewd->gathered);
	viewd->gathered.board = viewd->board;
	viewd->fit_views_due = FIT_VIEWS;
	atomic_fetch_add(&viewd->fit_number, 1);
}

void dio_viewd_gather(struct dio_viewd *viewd)
{
	struct dio_board_views *views = &viewd->gathered;
	struct dio_tracked *tracked = &viewd->tracked;
	struct dio_error why = {""};
	enum dio_board_offer offer;
	char name[32];

	if (views->width != tracked->picture.width || views->height != tracked->picture.height) {
		dio_viewd_begin_gather(viewd);
		views->width = tracked->picture.width;
		views->height = tracked->picture.height;
	}
	snprintf(name, sizeof name, "frame %" PRIu64, tracked->index);
	if (tracked->corners.count > 0)
		views->board.layout = tracked->corners.layout;
	if (dio_board_views_offer(views, name, &tracked->corners, &offer, &why) != DIO_OK) {
		dio_viewd_say(viewd, true, "%s", why.text);
		return;
	}
	if (views->count >= viewd->fit_views_due &&
	    (views->coverage >= FIT_COVERAGE || views->count >= FIT_ANYWAY)) {
		viewd->fit_views_due = views->count + FIT_MORE;
		dio_viewd_tell(viewd, DIO_VIEWD_GATHERED);
	}
}

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
	free_fit(job);
}

void dio_viewd_fit(struct dio_viewd *viewd)
{
	const struct dio_board_views *views = &viewd->gathered;
	struct fit_job *job = dio_viewd_allocate_job(viewd, sizeof *job);
	bool whole;

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
