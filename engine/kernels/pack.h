/* Weight matrices in the order in which every tier's product reads them. Private to the engine. */
#ifndef DVSM_KERNELS_PACK_H
#define DVSM_KERNELS_PACK_H

#include <stdbool.h>
#include <stddef.h>

#include "kernels/bf16.h"

/** Columns of a weight panel: one 64-byte line of float32. The same for every tier. */
#define DVSM_PANEL 16u

/**
 * W[out][in] as panels: [ceil(out / 16)][in][16], 64-byte aligned, the last filled up with 0; and
 * as bfloat16 pairs: [ceil(out / 16)][ceil(in / 32) * 16][16][2], likewise, with zeros behind `in`.
 * A pair is what one multiply-add instruction takes, 16 of them side by side a vector, 16 rows of
 * pairs a tile of AMX.
 */
struct dvsm_matrix {
	const float *panels;    /* NULL where only another precision's weights are kept */
	const dvsm_bf16 *pairs; /* NULL but in bf16's weights */
	size_t out, in;
	size_t tensor, first_row; /* of the model's file, for model/reader.h */
};

/** Floats that `rows` x `depth` weights take as panels; false when it does not fit. */
bool dvsm_pack_size(size_t rows, size_t depth, size_t *floats);

/** Zeros to where the last panel has no rows; what packs the rows leaves those places alone. */
void dvsm_pack_pad(size_t rows, size_t depth, float *panels);

/**
 * A run of numbers of row-major weights to their places in the panels, so that a matrix can be
 * packed while it is read.
 *
 * numbers  [count], numbers `first` and on of weights whose rows are `depth` long; runs may begin
 *          and end anywhere
 */
void dvsm_pack_run(const float *numbers, size_t first, size_t count, size_t depth, float *panels);

/** Weights [rows][depth] to panels, at once. */
void dvsm_pack_panels(const float *weights, size_t rows, size_t depth, float *panels);

/** Depth of bfloat16 panels: `depth` rounded up to a whole AMX tile. */
static inline size_t dvsm_bf16_depth(size_t depth)
{
	return (depth + 31) / 32 * 32;
}

/** Where weight [row][d] lies in bfloat16 panels. */
static inline size_t dvsm_bf16_place(size_t row, size_t d, size_t depth)
{
	return (row / DVSM_PANEL * dvsm_bf16_depth(depth) + d / 2 * 2) * DVSM_PANEL +
	       row % DVSM_PANEL * 2 + d % 2;
}

/** Rows of a tile of a product's left side, and numbers of each: 1 KB of bfloat16. */
#define DVSM_TILE_ROWS  16u
#define DVSM_TILE_DEPTH 32u

/**
 * Where number [row][d] lies in tiles, the left side as AMX takes it in: strips of 16 rows, and in
 * a strip one tile behind the other.
 */
static inline size_t dvsm_tile_place(size_t row, size_t d, size_t depth)
{
	size_t strip = row / DVSM_TILE_ROWS * dvsm_bf16_depth(depth);

	return (strip + d / DVSM_TILE_DEPTH * DVSM_TILE_DEPTH) * DVSM_TILE_ROWS +
	       row % DVSM_TILE_ROWS * DVSM_TILE_DEPTH + d % DVSM_TILE_DEPTH;
}

/** Numbers that `rows` x `depth` weights take as bfloat16 panels; false when it does not fit. */
bool dvsm_bf16_pack_size(size_t rows, size_t depth, size_t *numbers);

/** Panels of floats to panels of bfloat16, rounded to nearest. */
void dvsm_bf16_pack(const float *panels, size_t rows, size_t depth, dvsm_bf16 *pairs);

#endif
