#include "capture/posing.h"

#include <inttypes.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "capture/posing_roles.h"
#include "core/log.h"
#include "core/progress.h"

/* Before a live camera, the next picture is taken once it has moved or turned this much: share of
 * its distance from the board's centre, and radians. */
#define MOVED_SHARE 0.06
#define TURNED_RAD  0.06

/* What posing one input needs. */
struct posing {
	struct dio_input *input;
	const struct dio_camera_model *model;
	const struct dio_posing_options *options;
	struct dio_board_detector *detector;
	struct dio_undistorter *undistorter;
	struct dio_posing *result;
	enum dio_input_kind kind;
	uint64_t stride;
	uint32_t other_size;
};

void dio_posing_defaults(struct dio_posing_options *options)
{
	*options = (struct dio_posing_options){.frames = 60, .seconds = 60};
}

static void choose_size(const struct dio_camera_model *model,
			const struct dio_posing_options *options, uint32_t *width, uint32_t *height)
{
	double aspect = (double)model->width / model->height;

	*width = options->width;
	*height = options->height;
	if (*width == 0 && *height == 0) {
		*width = aspect >= 1 ? DIO_ENGINE_SIDE_PX
				     : (uint32_t)lround(DIO_ENGINE_SIDE_PX * aspect);
		*height = aspect >= 1 ? (uint32_t)lround(DIO_ENGINE_SIDE_PX / aspect)
				      : DIO_ENGINE_SIDE_PX;
	} else if (*height == 0) {
		*height = (uint32_t)lround(*width / aspect);
	} else if (*width == 0) {
		*width = (uint32_t)lround(*height * aspect);
	}
	*width = *width > 0 ? *width : 1;
	*height = *height > 0 ? *height : 1;
}

/* A new entry, or NULL when memory is short. */
static struct dio_posed_view *append(struct dio_posing *result, const struct dio_input_frame *about)
{
	struct dio_posed_view *view;

	if (result->count == result->capacity) {
		uint32_t capacity = result->capacity ? result->capacity * 2 : 32;
		struct dio_posed_view *grown =
			realloc(result->views, capacity * sizeof *result->views);

		if (!grown)
			return NULL;
		result->views = grown;
		result->capacity = capacity;
	}
	view = &result->views[result->count];
	*view = (struct dio_posed_view){.name = strdup(about->name),
					.timestamp_ns = about->timestamp_ns,
					.index = about->index};
	if (!view->name)
		return NULL;
	result->count++;
	return view;
}

static void drop_last(struct dio_posing *result)
{
	struct dio_posed_view *last = &result->views[--result->count];

	free(last->name);
	dio_picture_deinit(&last->picture);
}

/* Share of the distance that the camera moved, or radians that it turned, whichever is more. */
static bool has_moved(const double from[16], const double to[16])
{
	double moved = hypot(hypot(to[3] - from[3], to[7] - from[7]), to[11] - from[11]);
	double reach = hypot(hypot(from[3], from[7]), from[11]);
	double trace = 0;

	for (int row = 0; row < 3; row++)
		for (int col = 0; col < 3; col++)
			trace += from[4 * row + col] * to[4 * row + col];
	return moved > MOVED_SHARE * reach || acos(fmax(-1, fmin(1, (trace - 1) / 2))) > TURNED_RAD;
}

/* A live camera shows much the same for many frames: only what adds a viewpoint is kept. */
static bool is_repeat(const struct posing *p, const struct dio_posed_view *view)
{
	if (p->kind != DIO_INPUT_LIVE)
		return false;
	if (view->use == DIO_POSED_NO_BOARD || view->use == DIO_POSED_REFUSED)
		return true;
	for (uint32_t i = 0; i + 1 < p->result->count; i++)
		if (!has_moved(p->result->views[i].estimate.pose.world_from_camera,
			       view->estimate.pose.world_from_camera))
			return true;
	return false;
}

/* Pose one picture; `view` says what came of it. Only a fault of the machine is an error. */
static enum dio_status pose(struct posing *p, const struct dio_picture *picture,
			    struct dio_posed_view *view, struct dio_error *error)
{
	struct dio_corners corners = {0};
	struct dio_error why = {""};
	enum dio_status status;

	if (picture->width != p->model->width || picture->height != p->model->height) {
		view->use = DIO_POSED_REFUSED;
		snprintf(view->reason, sizeof view->reason,
			 "%u x %u pixels, the camera was calibrated at %u x %u", picture->width,
			 picture->height, p->model->width, p->model->height);
		p->other_size++;
		return DIO_OK;
	}
	status = dio_board_detect(p->detector, picture, &corners, error);
	if (status != DIO_OK)
		return status;
	if (corners.count == 0) {
		view->use = DIO_POSED_NO_BOARD;
		snprintf(view->reason, sizeof view->reason, "no board in view");
		goto out;
	}
	status = dio_pose_from_corners(dio_board_detector_get_board(p->detector), p->model,
				       &corners, &view->estimate, &why);
	if (status == DIO_REFUSED) {
		view->use = DIO_POSED_REFUSED;
		snprintf(view->reason, sizeof view->reason, "%.150s", why.text);
		status = DIO_OK;
		goto out;
	}
	if (status != DIO_OK) {
		dio_fail(error, status, "%s: %s", view->name, why.text);
		goto out;
	}
	view->use = DIO_POSED_SPARE;
	status = dio_undistorter_apply(p->undistorter, picture, &view->picture, error);
out:
	dio_corners_deinit(&corners);
	return status;
}

static double share_done(const struct posing *p, const struct dio_input_frame *about)
{
	uint64_t length = dio_input_get_length(p->input);

	if (length > 0)
		return (double)(about->index + 1) / (double)length;
	return (double)p->result->count / p->options->frames;
}

static enum dio_status pose_all(struct posing *p, struct dio_error *error)
{
	struct dio_picture picture = {0};
	struct dio_input_frame about;
	struct dio_progress progress;
	struct dio_posed_view *view;
	uint64_t start_ns = 0;
	enum dio_status status;

	dio_progress_init(&progress, "finding poses");
	while ((status = dio_input_next(p->input, &picture, &about, error)) == DIO_OK) {
		if (start_ns == 0)
			start_ns = about.timestamp_ns;
		if (about.index % p->stride != 0)
			continue;
		view = append(p->result, &about);
		status = view ? pose(p, &picture, view, error)
			      : dio_fail(error, DIO_NO_MEM, "%s: no memory for its view",
					 about.name);
		if (status != DIO_OK)
			break;
		if (is_repeat(p, view))
			drop_last(p->result);
		dio_progress_update(&progress, share_done(p, &about));
		if (p->kind == DIO_INPUT_LIVE &&
		    (p->result->count >= p->options->frames ||
		     (double)(about.timestamp_ns - start_ns) * 1e-9 > p->options->seconds))
			break;
	}
	dio_progress_done(&progress);
	dio_picture_deinit(&picture);
	return status == DIO_END ? DIO_OK : status;
}

/* Open what is needed and go through the input. */
static enum dio_status prepare(struct posing *p, const char *input, const struct dio_board *board,
			       struct dio_error *error)
{
	uint32_t width, height;
	/* Of the simulated camera: a walk round the scene in some 40 pictures. */
	char *told = dio_input_instruct(input, "style=walk&fps=1");
	enum dio_status status = told ? dio_input_open(told, &p->options->camera, &p->input, error)
				      : dio_fail(error, DIO_NO_MEM, "%s: no memory", input);

	free(told);
	if (status != DIO_OK)
		return status;
	p->kind = dio_input_get_kind(p->input);
	p->stride = 1;
	if (p->kind == DIO_INPUT_RECORDING && p->options->frames > 0)
		p->stride = (dio_input_get_length(p->input) + p->options->frames - 1) /
			    p->options->frames;
	status = dio_board_detector_create(board, &p->detector, error);
	if (status != DIO_OK)
		return status;
	choose_size(p->model, p->options, &width, &height);
	return dio_undistorter_create(p->model, width, height, &p->result->pinhole, &p->undistorter,
				      error);
}

/* A camera that went away leaves what it gave. */
static enum dio_status go_on_without(const struct posing *p, enum dio_status status,
				     const struct dio_error *why, struct dio_error *error)
{
	if ((status == DIO_GONE || status == DIO_NO_SIGNAL) && p->result->count > 0) {
		dio_log_warn("%s; going on with the %u pictures before", why->text,
			     p->result->count);
		return DIO_OK;
	}
	return dio_fail(error, status, "%s", why->text);
}

enum dio_status dio_posing_run(const char *input, const struct dio_camera_model *model,
			       const struct dio_board *board,
			       const struct dio_posing_options *options, struct dio_posing *result,
			       struct dio_error *error)
{
	struct posing p = {.model = model, .options = options, .result = result};
	struct dio_error why = {""};
	enum dio_status status = prepare(&p, input, board, error);

	if (status != DIO_OK)
		goto out;
	status = pose_all(&p, &why);
	if (status != DIO_OK)
		status = go_on_without(&p, status, &why, error);
	if (status != DIO_OK)
		goto out;
	dio_posing_mark_outliers(result);
	dio_posing_assign_roles(result, options);
	if (result->posed == 0 && p.other_size > 0 && p.other_size == result->count)
		status = dio_fail(error, DIO_REFUSED,
				  "%s: no picture has the %u x %u pixels that the camera was "
				  "calibrated at: calibrate at their size",
				  input, model->width, model->height);
	else if (result->posed == 0)
		status = dio_fail(error, DIO_REFUSED,
				  "%s: no pose: none of %u pictures shows the board well enough",
				  input, result->count);
out:
	dio_undistorter_destroy(p.undistorter);
	dio_board_detector_destroy(p.detector);
	dio_input_close(p.input);
	return status;
}

void dio_posing_deinit(struct dio_posing *result)
{
	while (result->count > 0)
		drop_last(result);
	free(result->views);
	*result = (struct dio_posing){0};
}
