#include "capture/calibrating.h"

#include <stdlib.h>

#include "core/log.h"

/* Before a camera: how often a refused answer is met by looking on. */
#define ROUNDS_MAX 4

void dio_calibrating_defaults(struct dio_calibrating_options *options)
{
	*options = (struct dio_calibrating_options){
		.gather = {.views = 30, .coverage = 0.7, .seconds = 120},
	};
	dio_calibration_defaults(&options->fit);
}

/* A camera that went away leaves what it gave: that may be enough. */
static enum dio_status gather(struct dio_input *input, const struct dio_board *board,
			      const struct dio_gather_options *options,
			      struct dio_board_views *views, bool *ended, struct dio_error *error)
{
	struct dio_error why = {""};
	enum dio_status status = dio_board_views_gather(input, board, options, views, &why);

	*ended = status != DIO_OK;
	if ((status == DIO_GONE || status == DIO_NO_SIGNAL) && views->count > 0) {
		dio_log_warn("%s; going on with the %u views before", why.text, views->count);
		return DIO_OK;
	}
	return status == DIO_OK ? DIO_OK : dio_fail(error, status, "%s", why.text);
}

static enum dio_status fit(const struct dio_calibrating_options *options,
			   struct dio_calibrating *result, struct dio_error *error)
{
	const struct dio_board_views *views = &result->views;

	dio_calibration_deinit(&result->calibration);
	return dio_calibrate(&views->board, views->corners, views->count, views->width,
			     views->height, &options->fit, &result->calibration, error);
}

/* Of the simulated camera: turn the board about, one picture each time the hand rests. */
static enum dio_status open_input(const char *spec, const struct dio_camera_options *camera,
				  struct dio_input **input, struct dio_error *error)
{
	char *told = dio_input_instruct(spec, "style=dance&fps=0.66667");
	enum dio_status status = told ? dio_input_open(told, camera, input, error)
				      : dio_fail(error, DIO_NO_MEM, "%s: no memory", spec);

	free(told);
	return status;
}

enum dio_status dio_calibrating_run(const char *input_spec, const struct dio_board *board,
				    const struct dio_calibrating_options *options,
				    struct dio_calibrating *result, struct dio_error *error)
{
	struct dio_gather_options more = options->gather;
	struct dio_board known = *board;
	struct dio_input *input;
	bool live, ended = false;
	enum dio_status status = open_input(input_spec, &options->camera, &input, error);

	if (status != DIO_OK)
		return status;
	live = dio_input_get_kind(input) == DIO_INPUT_LIVE;
	for (int round = 0; round < ROUNDS_MAX; round++) {
		status = gather(input, &known, &more, &result->views, &ended, error);
		if (status != DIO_OK)
			break;
		if (result->views.frames == 0) {
			status = dio_fail(error, DIO_REFUSED, "%s: no picture can be read",
					  input_spec);
			break;
		}
		status = fit(options, result, error);
		if (status != DIO_REFUSED || !live || ended)
			break;
		known = result->views.board;
		more.views += options->gather.views / 2;
	}
	dio_input_close(input);
	return status;
}

void dio_calibrating_deinit(struct dio_calibrating *result)
{
	dio_calibration_deinit(&result->calibration);
	dio_board_views_deinit(&result->views);
}

struct dio_board dio_calibrating_get_board(const struct dio_calibrating *result)
{
	struct dio_board board = result->views.board;

	if (result->calibration.layout != DIO_LAYOUT_AUTO)
		board.layout = result->calibration.layout;
	return board;
}
