#include "capture/board_page.h"

#include <math.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>

/* The strip along each edge that common printers cannot reach is 4.2 mm wide. */
#define UNPRINTABLE_MM 4.2
#define CAPTION_MIN_MM 2.0
#define CAPTION_MAX_MM 9.0

/* Pixels a square when the board is drawn to be read back: a marker module is many pixels wide. */
#define SAMPLE_SQUARE_PX 240u

static const struct dio_paper PAPERS[] = {
	{"A5", 148.0, 210.0},     {"A4", 210.0, 297.0},    {"A3", 297.0, 420.0},
	{"A2", 420.0, 594.0},     {"A1", 594.0, 841.0},    {"A0", 841.0, 1189.0},
	{"letter", 215.9, 279.4}, {"legal", 215.9, 355.6}, {"tabloid", 279.4, 431.8},
};
#define PAPER_COUNT (sizeof PAPERS / sizeof PAPERS[0])

enum dio_status dio_paper_parse(const char *name, struct dio_paper *paper, struct dio_error *error)
{
	for (size_t i = 0; i < PAPER_COUNT; i++) {
		if (strcasecmp(name, PAPERS[i].name) == 0) {
			*paper = PAPERS[i];
			return DIO_OK;
		}
	}
	return dio_fail(error, DIO_BAD_ARG,
			"paper '%s' is not known: use A0 to A5, letter, legal or tabloid", name);
}

/* A chessboard is specified by its inner corners, a ChArUco board by its squares. */
static void count_squares(const struct dio_board *board, uint32_t *across, uint32_t *down)
{
	uint32_t border = board->kind == DIO_BOARD_CHESSBOARD ? 1 : 0;

	*across = board->cols + border;
	*down = board->rows + border;
}

/* Modules along a marker's side, its black border included. */
static uint32_t count_modules(const struct dio_board *board)
{
	static const struct {
		const char *prefix;
		uint32_t bits;
	} KINDS[] = {{"DICT_4X4", 4},
		     {"DICT_5X5", 5},
		     {"DICT_6X6", 6},
		     {"DICT_7X7", 7},
		     {"DICT_ARUCO_ORIGINAL", 5},
		     {"DICT_APRILTAG_16", 4},
		     {"DICT_APRILTAG_25", 5},
		     {"DICT_APRILTAG_36", 6}};

	for (size_t i = 0; i < sizeof KINDS / sizeof KINDS[0]; i++)
		if (strncmp(board->dictionary_name, KINDS[i].prefix, strlen(KINDS[i].prefix)) == 0)
			return KINDS[i].bits + 2;
	return 0;
}

static bool fits(const struct dio_board_page *page, double page_width, double page_height)
{
	return page->board.width <= page_width - 2 * UNPRINTABLE_MM &&
	       page->board.height <= page_height - 2 * UNPRINTABLE_MM - CAPTION_MIN_MM;
}

/* The largest square, in whole tenths of a millimetre, with which the board would fit. */
static double largest_square_mm(const struct dio_paper *paper, uint32_t across, uint32_t down)
{
	double best = 0;

	for (int turn = 0; turn < 2; turn++) {
		double w = turn ? paper->height_mm : paper->width_mm;
		double h = turn ? paper->width_mm : paper->height_mm;
		double square = fmin((w - 2 * UNPRINTABLE_MM) / across,
				     (h - 2 * UNPRINTABLE_MM - CAPTION_MIN_MM) / down);

		best = fmax(best, floor(square * 10) / 10);
	}
	return best;
}

static enum dio_status refuse(const struct dio_board_page *page, const struct dio_paper *paper,
			      uint32_t across, uint32_t down, struct dio_error *error)
{
	for (size_t i = 0; i < PAPER_COUNT; i++) {
		const struct dio_paper *other = &PAPERS[i];

		if (fits(page, other->width_mm, other->height_mm) ||
		    fits(page, other->height_mm, other->width_mm))
			return dio_fail(error, DIO_REFUSED,
					"board of %.1f x %.1f mm does not fit on %s paper: use "
					"--paper %s, or squares of at most %.4f m",
					page->board.width, page->board.height, paper->name,
					other->name, largest_square_mm(paper, across, down) / 1000);
	}
	return dio_fail(error, DIO_REFUSED,
			"board of %.1f x %.1f mm does not fit on any paper known: use squares of "
			"at most %.4f m for %s",
			page->board.width, page->board.height,
			largest_square_mm(paper, across, down) / 1000, paper->name);
}

static enum dio_status place(struct dio_board_page *page, const struct dio_board *board,
			     const struct dio_paper *paper, struct dio_error *error)
{
	uint32_t across, down;
	bool upright, sideways;

	count_squares(board, &across, &down);
	page->board.width = across * board->square_m * 1000;
	page->board.height = down * board->square_m * 1000;
	upright = fits(page, paper->width_mm, paper->height_mm);
	sideways = fits(page, paper->height_mm, paper->width_mm);
	if (!upright && !sideways)
		return refuse(page, paper, across, down, error);

	/* Where both fit, the paper lies as the board does. */
	if (upright && sideways)
		upright = page->board.height >= page->board.width;
	page->width_mm = upright ? paper->width_mm : paper->height_mm;
	page->height_mm = upright ? paper->height_mm : paper->width_mm;

	double spare = page->height_mm - 2 * UNPRINTABLE_MM - page->board.height;
	page->caption.height = fmin(spare, CAPTION_MAX_MM);
	page->caption.width = page->width_mm - 2 * UNPRINTABLE_MM;
	page->caption.x = UNPRINTABLE_MM;
	page->caption.y = page->height_mm - UNPRINTABLE_MM - page->caption.height;
	page->board.x = (page->width_mm - page->board.width) / 2;
	page->board.y = UNPRINTABLE_MM + (spare - page->caption.height) / 2;
	return DIO_OK;
}

static void write_text(struct dio_board_page *page, const struct dio_board *board)
{
	char spec[128], marker[48] = "";

	dio_board_format(board, spec, sizeof spec);
	if (board->kind == DIO_BOARD_CHARUCO)
		snprintf(marker, sizeof marker, ", marker %.2f mm", board->marker_m * 1000);
	snprintf(page->text, sizeof page->text,
		 "%s: square %.2f mm%s, whole %.1f x %.1f mm. Print at 100 %%, then measure the "
		 "ruler.",
		 spec, board->square_m * 1000, marker, page->board.width, page->board.height);
}

/* The drawn board, read back as black or white at a place given in squares. */
static bool is_black(const struct dio_picture *drawn, double x_squares, double y_squares)
{
	uint32_t x = (uint32_t)(x_squares * SAMPLE_SQUARE_PX);
	uint32_t y = (uint32_t)(y_squares * SAMPLE_SQUARE_PX);

	return drawn->rgb[((size_t)y * drawn->width + x) * 3] < 128;
}

/* One rectangle for each run of black modules in each row of the marker of square (i, j). */
static void ink_marker(struct dio_board_page *page, const struct dio_picture *drawn,
		       const struct dio_board *board, uint32_t i, uint32_t j, uint32_t modules)
{
	double side = board->marker_m / board->square_m / modules; /* of a module, in squares */
	double left = i + (1 - side * modules) / 2, top = j + (1 - side * modules) / 2;
	double scale = board->square_m * 1000;

	for (uint32_t row = 0; row < modules; row++) {
		for (uint32_t start = 0, end; start < modules; start = end + 1) {
			end = start;
			while (end < modules &&
			       is_black(drawn, left + (end + 0.5) * side, top + (row + 0.5) * side))
				end++;
			if (end == start)
				continue;
			page->ink[page->ink_count++] =
				(struct dio_rect_mm){page->board.x + (left + start * side) * scale,
						     page->board.y + (top + row * side) * scale,
						     (end - start) * side * scale, side * scale};
		}
	}
}

static enum dio_status ink(struct dio_board_page *page, const struct dio_board *board,
			   struct dio_error *error)
{
	struct dio_picture drawn = {0};
	uint32_t across, down, modules = 0;
	double square_mm = board->square_m * 1000;
	enum dio_status status;

	if (board->kind == DIO_BOARD_CHARUCO) {
		modules = count_modules(board);
		if (modules == 0)
			return dio_fail(
				error, DIO_UNSUPPORTED,
				"dictionary %s cannot be printed: its marker size is unknown",
				board->dictionary_name);
	}
	status = dio_board_draw(board, SAMPLE_SQUARE_PX, 0, &drawn, error);
	if (status != DIO_OK)
		return status;
	count_squares(board, &across, &down);

	/* Black squares, or at most every second module of every row of a marker. */
	page->ink = calloc((size_t)across * down * (1 + modules * (modules + 1) / 2),
			   sizeof *page->ink);
	if (!page->ink || drawn.width != across * SAMPLE_SQUARE_PX ||
	    drawn.height != down * SAMPLE_SQUARE_PX) {
		status = dio_fail(error, DIO_NO_MEM,
				  "board: no memory for a board of %u x %u squares", across, down);
		goto out;
	}
	for (uint32_t j = 0; j < down; j++) {
		for (uint32_t i = 0; i < across; i++) {
			if (is_black(&drawn, i + 0.04, j + 0.04))
				page->ink[page->ink_count++] = (struct dio_rect_mm){
					page->board.x + i * square_mm,
					page->board.y + j * square_mm, square_mm, square_mm};
			else if (modules)
				ink_marker(page, &drawn, board, i, j, modules);
		}
	}
out:
	dio_picture_deinit(&drawn);
	return status;
}

enum dio_status dio_board_page_init(struct dio_board_page *page, const struct dio_board *board,
				    const struct dio_paper *paper, struct dio_error *error)
{
	struct dio_board_page made = {0};
	enum dio_status status = place(&made, board, paper, error);

	if (status == DIO_OK)
		status = ink(&made, board, error);
	if (status != DIO_OK) {
		dio_board_page_deinit(&made);
		return status;
	}
	write_text(&made, board);
	*page = made;
	return DIO_OK;
}

void dio_board_page_deinit(struct dio_board_page *page)
{
	free(page->ink);
	*page = (struct dio_board_page){0};
}
