/* Weight matrices in the order in which every tier's product reads them. Private to the engine. */
#ifndef DVSM_KERNELS_PACK_H
#define DVSM_KERNELS_PACK_H

#include <stdbool.h>
#include <stddef.h>

/** Columns of a weight panel: one 64-byte line of float32. The same for every tier. */
#define DVSM_PANEL 16u

/** W[out][in] as panels: [ceil(out / 16)][in][16], 64-byte aligned, the last filled up with 0. */
struct dvsm_matrix {
	const float *panels;
	size_t out, in;
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

#endif
