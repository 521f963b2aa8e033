/* Calibration boards: specification, detection of their corners, and drawing them for print. */
#ifndef DIO_BOARD_H
#define DIO_BOARD_H

#include <stdbool.h>
#include <stdint.h>

#include "dio/frame.h"
#include "dio/status.h"

#ifdef __cplusplus
extern "C" {
#endif

enum dio_board_kind { DIO_BOARD_CHARUCO, DIO_BOARD_CHESSBOARD };
enum dio_board_layout {
	DIO_LAYOUT_AUTO,   /* try both, take the one that fits */
	DIO_LAYOUT_MODERN, /* OpenCV >= 4.6: top-left square black whatever the row count */
	DIO_LAYOUT_LEGACY, /* OpenCV < 4.6: an even number of rows starts with a white square */
};

/**
 * A board, as its specification states it:
 *   charuco:COLSxROWS:SQUARE_M:MARKER_M:DICTIONARY[:legacy|:modern]   squares
 *   chessboard:COLSxROWS:SQUARE_M                                     inner corners
 *
 * Board frame: x along columns, y along rows, z INTO the board (OpenCV's); the origin is the outer
 * corner of a ChArUco board's first square, and the first inner corner of a chessboard. dio_pose
 * uses a world with z up, see dio/pose.h. Lengths in metres.
 *
 * A chessboard whose cols + rows is even looks the same turned by half a turn: its corners are
 * numbered from the end that is more upright in the picture. Calibration does not mind; poses from
 * all round want an odd sum, or a ChArUco board.
 */
struct dio_board {
	enum dio_board_kind kind;
	uint32_t cols, rows;
	double square_m, marker_m;
	int dictionary; /* OpenCV's number; ChArUco only */
	char dictionary_name[32];
	enum dio_board_layout layout; /* AUTO until a picture has decided */
};

/** DIO_BAD_ARG names the part of the specification that cannot be read. */
enum dio_status dio_board_parse(const char *spec, struct dio_board *board, struct dio_error *error);

/** The specification back as text. */
void dio_board_format(const struct dio_board *board, char *spec, uint32_t spec_size);

/** Corners found in one picture. Release with dio_corners_deinit(). */
struct dio_corners {
	uint32_t count;
	uint32_t *ids;                /* index of the corner on the board, row by row */
	float (*image_px)[2];         /* pixel positions */
	double (*board_m)[3];         /* board frame, z = 0 */
	double sharpness_px;          /* edge width over the board, 0 when not measured */
	enum dio_board_layout layout; /* ChArUco: the layout that fits this picture */
	bool by_sector_detector;      /* chessboard: found by the sector-based detector */
};

/** Opaque; holds dictionary and detector state. Thread-bound. */
struct dio_board_detector;
enum dio_status dio_board_detector_create(const struct dio_board *board,
					  struct dio_board_detector **detector,
					  struct dio_error *error);
void dio_board_detector_destroy(struct dio_board_detector *detector);

/** The board with the layout decided so far. */
const struct dio_board *dio_board_detector_get_board(const struct dio_board_detector *detector);

/**
 * Find the board. Chessboards: the classic detector and the sector-based one, the better fit wins;
 * ChArUco: markers, interpolated corners, sub-pixel refinement; a layout of AUTO tries both, keeps
 * the one that fits, and finds nothing where a picture shows too little to tell.
 *
 * corners   zero-initialised, or from an earlier call; count 0 and DIO_OK when there is no board in
 *           the picture
 *
 * DIO_BAD_ARG   a picture below 16 x 16
 */
enum dio_status dio_board_detect(struct dio_board_detector *detector,
				 const struct dio_picture *picture, struct dio_corners *corners,
				 struct dio_error *error);
void dio_corners_deinit(struct dio_corners *corners);

/**
 * Draw the board for print at a whole number of pixels per square; margin on all sides. A layout of
 * AUTO is drawn as MODERN.
 *
 * picture   zero-initialised, or a picture to replace
 *
 * DIO_BAD_ARG   a square below 20 pixels (ChArUco) or 2 (chessboard), a side above 16384
 */
enum dio_status dio_board_draw(const struct dio_board *board, uint32_t square_px,
			       uint32_t margin_px, struct dio_picture *picture,
			       struct dio_error *error);

#ifdef __cplusplus
}
#endif
#endif
