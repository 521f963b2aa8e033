/* What is put on the display: a picture fitted to it, and the overlay over it. */
#ifndef DIO_VIEWD_SCREEN_H
#define DIO_VIEWD_SCREEN_H

#include <stdbool.h>
#include <stdint.h>

#include "capture/board_views.h"
#include "dio/fit.h"
#include "dio/frame.h"
#include "dio/status.h"

#define DIO_OVERLAY_TEXT    160
#define DIO_OVERLAY_CORNERS 256

/** What the overlay says. Empty texts take no room. */
struct dio_overlay {
	char state[32];                  /* top left, large */
	char lines[3][DIO_OVERLAY_TEXT]; /* below it */
	char figures[DIO_OVERLAY_TEXT];  /* top right: rate and latency */
	char message[DIO_OVERLAY_TEXT];  /* at the foot */
	bool alarm;                      /* the message tells of a fault */
	double progress;                 /* a bar above the message; below 0: none */
	bool show_cells;                 /* where corners of the board were seen so far */
	bool cells[DIO_BOARD_CELLS * DIO_BOARD_CELLS];
	float corners[DIO_OVERLAY_CORNERS][2]; /* of the board now, share of width and height */
	uint32_t corner_count;
};

/** What composing needs: zero-initialise; release with dio_screen_deinit(). */
struct dio_screen {
	struct dio_picture canvas; /* the composed picture */
	struct dio_fit fit;
};

/**
 * Fit a picture into width x height, proportions kept, black around, and draw the overlay.
 *
 * picture   NULL, or without pixels: black
 * smooth    bilinear; otherwise the nearest pixel
 * overlay   NULL: none
 */
enum dio_status dio_screen_compose(struct dio_screen *screen, const struct dio_picture *picture,
				   uint32_t width, uint32_t height, bool smooth,
				   const struct dio_overlay *overlay, struct dio_error *error);
void dio_screen_deinit(struct dio_screen *screen);

#endif
