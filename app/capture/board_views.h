/* Pictures of a board, gathered for a calibration: corners found, and why pictures were left. */
#ifndef DIO_CAPTURE_BOARD_VIEWS_H
#define DIO_CAPTURE_BOARD_VIEWS_H

#include <stdint.h>

#include "capture/input.h"
#include "dio/board.h"
#include "dio/calibration.h"
#include "dio/status.h"

/** When to stop. */
struct dio_gather_options {
	uint32_t views;  /* enough views, once the coverage is there too; twice as many at most */
	double coverage; /* share of the picture that corners should have reached */
	double seconds;  /* longest time before a camera, by its timestamps */
};

/** Views with a board; of photos also those without. Release with dio_board_views_deinit(). */
struct dio_board_views {
	struct dio_board board; /* with the layout decided */
	uint32_t width, height;
	char **names;                /* [count] */
	struct dio_corners *corners; /* [count]; contiguous, as dio_calibrate() wants them */
	uint32_t count, capacity;
	double coverage; /* share of picture cells with a corner */

	/* Frames looked at, and what became of those that are no views. */
	uint64_t frames, without_board, not_new, other_size, unreadable;
};

/**
 * Look for the board in the pictures of an input.
 *
 * Of photos every picture becomes a view. Of a stream only frames that show the board elsewhere
 * than all views before, and a camera is read until there is enough.
 *
 * views  zero-initialised; holds what was gathered when DIO_GONE or DIO_NO_SIGNAL is returned
 */
enum dio_status dio_board_views_gather(struct dio_input *input, const struct dio_board *board,
				       const struct dio_gather_options *options,
				       struct dio_board_views *views, struct dio_error *error);
void dio_board_views_deinit(struct dio_board_views *views);

#endif
