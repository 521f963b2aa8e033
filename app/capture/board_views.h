/* Pictures of a board, gathered for a calibration: corners found, and why pictures were left. */
#ifndef DIO_CAPTURE_BOARD_VIEWS_H
#define DIO_CAPTURE_BOARD_VIEWS_H

#include <stdbool.h>
#include <stdint.h>

#include "capture/input.h"
#include "dio/board.h"
#include "dio/calibration.h"
#include "dio/status.h"

/** The picture is cut into so many cells a side for the coverage. */
#define DIO_BOARD_CELLS 8

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
	bool cells[DIO_BOARD_CELLS * DIO_BOARD_CELLS]; /* with a corner, row by row */
	double coverage;                               /* share of them */

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

/** What became of a stream's frame. */
enum dio_board_offer {
	DIO_OFFER_TAKEN,
	DIO_OFFER_NO_BOARD, /* too few corners to be of use */
	DIO_OFFER_NOT_NEW,  /* the board stands where a view before had it */
};

/**
 * Offer the corners of a stream's next frame; it becomes a view when it shows the board elsewhere
 * than all views before. Counts what became of it.
 *
 * views    its width and height are the frame's
 * corners  taken over and left empty when they become a view
 */
enum dio_status dio_board_views_offer(struct dio_board_views *views, const char *name,
				      struct dio_corners *corners, enum dio_board_offer *offer,
				      struct dio_error *error);

#endif
