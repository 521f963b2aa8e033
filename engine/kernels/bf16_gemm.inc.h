/*
 * Template: matrix product of bfloat16 with packed weights, for machines that multiply floats only.
 * Included once by each bf16_<tier>.c, after number_bf16.inc.h and after GEMM_ROWS and GEMM_PANELS
 * as in f32_gemm.inc.h.
 *
 * A panel holds the weights of depth d and d + 1 side by side: one load gives both, the even ones
 * by a shift, the odd ones by a mask. The rows of A are widened once, before all weights stream
 * past them. Each sum is one chain of multiply-adds over the depth.
 */

#include "kernels/gemm_finish.inc.h"

/* Depth that is widened at a time: even. */
#define GEMM_DEPTH 2048

/* Rows of A; a vector more than the depth, so that not all of them share a few lines of the cache.
 */
struct gemm_strip {
	float rows[GEMM_ROWS][GEMM_DEPTH + 16];
};

static void widen_rows(int rows, const number *a, size_t a_stride, size_t count,
		       struct gemm_strip *strip)
{
	for (int i = 0; i < rows; i++) {
		num_floats(a + (size_t)i * a_stride, count, strip->rows[i]);
		if (count % 2)
			strip->rows[i][count] = 0.0f;
	}
}

/* `count` steps of depth of a tile; `rows` and `panels` are constants where it is called. */
DVSM_INLINE void gemm_chunk(const int rows, const int panels, const struct gemm_strip *strip,
			    const number *w, size_t panel_numbers, size_t count,
			    vf sums[GEMM_ROWS][TILE_VECTORS])
{
	const int vectors = panels * PANEL_VECTORS;

	for (size_t d = 0; d < count; d += 2) {
		vf odd[TILE_VECTORS];

		DVSM_UNROLL
		for (int j = 0; j < vectors; j++) {
			size_t panel = (size_t)(j / PANEL_VECTORS);
			size_t part = (size_t)(j % PANEL_VECTORS);
			vf even;

			vf_load_pairs(w + panel * panel_numbers + d * DVSM_PANEL +
					      2 * part * VF_LANES,
				      &even, &odd[j]);
			DVSM_UNROLL
			for (int i = 0; i < rows; i++)
				sums[i][j] = vf_fma(vf_set(strip->rows[i][d]), even, sums[i][j]);
		}
		DVSM_UNROLL
		for (int i = 0; i < rows; i++) {
			vf x = vf_set(strip->rows[i][d + 1]);

			DVSM_UNROLL
			for (int j = 0; j < vectors; j++)
				sums[i][j] = vf_fma(x, odd[j], sums[i][j]);
		}
	}
}

/* A product on its way. */
struct gemm_job {
	const number *a, *w;
	size_t a_stride, depth, cols, c_stride;
	void *c;
	enum dvsm_epilogue epilogue;
};

/* One tile from row and column `row`, `col` on, both constant sizes where it is called. */
DVSM_INLINE void gemm_tile(const int rows, const int panels, const struct gemm_job *job, size_t row,
			   size_t col, struct gemm_strip *strip)
{
	const int vectors = panels * PANEL_VECTORS;
	const size_t panel_depth = PANEL_DEPTH(job->depth);
	const number *w = job->w + col * panel_depth;
	vf sums[GEMM_ROWS][TILE_VECTORS];

	clear_tile(rows, vectors, sums);
	for (size_t first = 0; first < job->depth; first += GEMM_DEPTH) {
		const size_t left = job->depth - first;
		const size_t count = left < GEMM_DEPTH ? left : GEMM_DEPTH;

		if (job->depth > GEMM_DEPTH)
			widen_rows(rows, job->a + row * job->a_stride + first, job->a_stride, count,
				   strip);
		gemm_chunk(rows, panels, strip, w + first * DVSM_PANEL, DVSM_PANEL * panel_depth,
			   count, sums);
	}
	finish_tile(rows, vectors, sums, job->cols - col, job->c, row * job->c_stride + col,
		    job->c_stride, job->epilogue);
}

/* All columns of `rows` rows. */
DVSM_INLINE void gemm_rows(const int rows, const struct gemm_job *job, size_t row)
{
	struct gemm_strip strip;
	size_t col = 0;

	widen_rows(rows, job->a + row * job->a_stride, job->a_stride,
		   job->depth < GEMM_DEPTH ? job->depth : GEMM_DEPTH, &strip);
	while (col < job->cols) {
		if (job->cols - col > (GEMM_PANELS - 1) * DVSM_PANEL) {
			gemm_tile(rows, GEMM_PANELS, job, row, col, &strip);
			col += GEMM_PANELS * DVSM_PANEL;
		} else {
			gemm_tile(rows, 1, job, row, col, &strip);
			col += DVSM_PANEL;
		}
	}
}

static void gemm(const void *a, size_t a_stride, size_t rows, const void *panels, size_t depth,
		 size_t cols, void *c, size_t c_stride, enum dvsm_epilogue epilogue)
{
	const struct gemm_job job = {a, panels, a_stride, depth, cols, c_stride, c, epilogue};
	size_t row = 0;

	for (; row + GEMM_ROWS <= rows; row += GEMM_ROWS)
		gemm_rows(GEMM_ROWS, &job, row);
	for (; GEMM_ROWS > 4 && row + 4 <= rows; row += 4)
		gemm_rows(4, &job, row);
	for (; row + 2 <= rows; row += 2)
		gemm_rows(2, &job, row);
	for (; row < rows; row++)
		gemm_rows(1, &job, row);
}
