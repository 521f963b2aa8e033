/* A calibration board on a sheet of paper: where it lies, in millimetres, and what is black. */
#ifndef DIO_CAPTURE_BOARD_PAGE_H
#define DIO_CAPTURE_BOARD_PAGE_H

#include <stdint.h>

#include "dio/board.h"
#include "dio/status.h"

/** A paper size, upright. */
struct dio_paper {
	const char *name;
	double width_mm, height_mm;
};

/** Find a paper by name, letter case aside. DIO_BAD_ARG lists the names known. */
enum dio_status dio_paper_parse(const char *name, struct dio_paper *paper, struct dio_error *error);

/** A rectangle from the page's top left corner. */
struct dio_rect_mm {
	double x, y, width, height;
};

/** A page ready to be drawn. Release with dio_board_page_deinit(). */
struct dio_board_page {
	double width_mm,
		height_mm;        /* as the paper lies: upright or across, whichever fits better */
	struct dio_rect_mm board; /* all squares */
	struct dio_rect_mm caption; /* one line of text and a ruler, under the board */
	char text[256];
	struct dio_rect_mm *ink; /* [ink_count] black rectangles: squares and marker modules */
	uint32_t ink_count;
};

/**
 * Place a board on a paper and list its black rectangles at their exact places.
 *
 * page  zero-initialised
 *
 * DIO_REFUSED  the board is larger than the paper can print; the text says what would fit
 */
enum dio_status dio_board_page_init(struct dio_board_page *page, const struct dio_board *board,
				    const struct dio_paper *paper, struct dio_error *error);
void dio_board_page_deinit(struct dio_board_page *page);

#endif
