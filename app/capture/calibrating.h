/* Calibration of a camera from an input, as `diorama calibrate` and the demo run it. */
#ifndef DIO_CAPTURE_CALIBRATING_H
#define DIO_CAPTURE_CALIBRATING_H

#include <cjson/cJSON.h>
#include <stdbool.h>
#include <stdint.h>

#include "capture/board_views.h"
#include "dio/calibration.h"

struct dio_calibrating_options {
	struct dio_camera_options camera; /* wishes about size and rate */
	struct dio_gather_options gather;
	struct dio_calibration_options fit;
};

/** What the command line uses. */
void dio_calibrating_defaults(struct dio_calibrating_options *options);

/** Release with dio_calibrating_deinit(). */
struct dio_calibrating {
	struct dio_board_views views;
	struct dio_calibration calibration; /* its views[] are in the order of views.names */
};

/**
 * Gather views of the board from an input and fit the camera. Before a live camera an answer that
 * is refused makes it look on, until options->gather.seconds are over.
 *
 * result  zero-initialised; filled when DIO_REFUSED too, so that a caller can say which pictures
 *         were of use
 *
 * DIO_REFUSED  too few views, too little tilt or coverage, held-out error far above the fit
 */
enum dio_status dio_calibrating_run(const char *input, const struct dio_board *board,
				    const struct dio_calibrating_options *options,
				    struct dio_calibrating *result, struct dio_error *error);
void dio_calibrating_deinit(struct dio_calibrating *result);

/** The board with the layout that the pictures decided. */
struct dio_board dio_calibrating_get_board(const struct dio_calibrating *result);

/** Print views, fit and parameters for a reader. `refused`: leave out what is no answer. */
void dio_calibrating_print(const struct dio_calibrating *result, bool refused);

/** The same as JSON; `refused` is NULL or the reason. NULL when memory is short. */
cJSON *dio_calibrating_json(const struct dio_calibrating *result, const char *refused);

#endif
