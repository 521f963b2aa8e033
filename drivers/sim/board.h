/* The printed ChArUco board: how white the paper is at a point. */
#ifndef DIO_SIM_BOARD_H
#define DIO_SIM_BOARD_H

#include "markers.h"
#include "scene.h"

/* Box filter over a lattice of cells of side 1: the two cells that a filter of `width` centred at
 * x may touch are `cell` and `cell` + 1, the second with the weight returned. */
DIO_SIM_FN float lattice_split(float x, float width, int32_t *cell)
{
	*cell = floor_int(x - 0.5f);
	return saturate((x - (float)(*cell + 1)) / (width + 1e-9f) + 0.5f);
}

/* One cell of a marker with its black border; 1 is white. */
DIO_SIM_FN float marker_cell(uint64_t bits, int32_t column, int32_t row)
{
	uint32_t place;

	if (column < 0 || row < 0 || column >= SIM_MARKER_SIDE + 2 || row >= SIM_MARKER_SIDE + 2)
		return 1;
	if (column < 1 || row < 1 || column > SIM_MARKER_SIDE || row > SIM_MARKER_SIDE)
		return 0;
	place = (uint32_t)(SIM_MARKER_SIDE * (row - 1) + column - 1);
	return (float)(bits >> (SIM_MARKER_SIDE * SIM_MARKER_SIDE - 1 - place) & 1);
}

/* Squares with even column + row are black, from the top left, except that OpenCV before 4.6 began
 * with white when the rows were even (it counted from the bottom). */
DIO_SIM_FN bool board_square_is_black(const struct dio_sim_board *b, int32_t column, int32_t row)
{
	int32_t first_white = b->legacy && b->rows % 2 == 0;

	return ((column + row) & 1) == first_white;
}

/* Markers are numbered along the rows from the top left, white squares only. */
DIO_SIM_FN uint32_t board_marker_at(const struct dio_sim_board *b, int32_t column, int32_t row)
{
	uint32_t before = 0;

	for (int32_t r = 0; r < row; r++) {
		uint32_t starts_black = board_square_is_black(b, 0, r);

		before += (b->cols + 1 - starts_black) / 2;
	}
	before += ((uint32_t)column + (board_square_is_black(b, 0, row) ? 0 : 1)) / 2;
	return before;
}

/* Inside of one square; u, v in squares from its top left corner. */
DIO_SIM_FN float square_white(const struct dio_sim_board *b, int32_t column, int32_t row, float u,
			      float v, float width)
{
	float share = (float)(b->marker_m / b->square_m), cell = share / (SIM_MARKER_SIDE + 2);
	float margin = 0.5f * (1 - share), sx, sy, top, bottom;
	uint32_t id;
	int32_t x, y;
	uint64_t bits;

	if (column < 0 || row < 0 || column >= (int32_t)b->cols || row >= (int32_t)b->rows)
		return 1;
	if (board_square_is_black(b, column, row))
		return 0;
	id = board_marker_at(b, column, row);
	if (id >= SIM_MARKER_COUNT)
		return 1;
	bits = sim_markers[id];
	sx = lattice_split((u - margin) / cell, width / cell, &x);
	sy = lattice_split((v - margin) / cell, width / cell, &y);
	top = mixf(marker_cell(bits, x, y), marker_cell(bits, x + 1, y), sx);
	bottom = mixf(marker_cell(bits, x, y + 1), marker_cell(bits, x + 1, y + 1), sx);
	return mixf(top, bottom, sy);
}

/* White share in [0, 1] at a point on the table, metres from the board's centre; `width` is the
 * size of a pixel there. The board reads upright with x to the right and y up. */
DIO_SIM_FN float board_white(const struct dio_sim_board *b, float x, float y, float width)
{
	float square = (float)b->square_m, sx, sy, sum = 0;
	float u = x / square + 0.5f * (float)b->cols, v = 0.5f * (float)b->rows - y / square;
	int32_t column, row;

	width /= square;
	sx = lattice_split(u, width, &column);
	sy = lattice_split(v, width, &row);
	for (int32_t i = 0; i < 4; i++) {
		int32_t c = column + (i & 1), r = row + (i >> 1);
		float weight = (i & 1 ? sx : 1 - sx) * (i >> 1 ? sy : 1 - sy);

		if (weight > 0)
			sum += weight * square_white(b, c, r, u - (float)c, v - (float)r, width);
	}
	return sum;
}

#endif
