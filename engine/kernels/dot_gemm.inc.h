/*
 * Template: matrix product of bfloat16 pairs with packed weights. Included once by each tier that
 * multiplies them, after number_bf16.inc.h and after GEMM_ROWS and GEMM_PANELS as in
 * f32_gemm.inc.h: the same tile, two numbers of depth a step.
 */

#include "kernels/gemm_finish.inc.h"

/* The sums of one step: pair x(i) of each row against the panels' pairs at `depth_at`. */
DVSM_INLINE void gemm_step(const int rows, const int panels, const vp x[GEMM_ROWS], const number *w,
			   size_t panel_numbers, vf sums[GEMM_ROWS][TILE_VECTORS])
{
	vp b[TILE_VECTORS];

	DVSM_UNROLL
	for (int j = 0; j < panels * PANEL_VECTORS; j++) {
		size_t panel = (size_t)(j / PANEL_VECTORS), part = (size_t)(j % PANEL_VECTORS);

		b[j] = vp_load(w + panel * panel_numbers + 2 * part * VF_LANES);
	}
	DVSM_UNROLL
	for (int i = 0; i < rows; i++) {
		DVSM_UNROLL
		for (int j = 0; j < panels * PANEL_VECTORS; j++)
			sums[i][j] = vp_dot(sums[i][j], x[i], b[j]);
	}
}

/* One tile; `rows` and `panels` are constants where it is called. `cols` may cut the last panel. */
DVSM_INLINE void gemm_tile(const int rows, const int panels, const number *a, size_t a_stride,
			   const number *w, size_t depth, size_t cols, void *c, size_t at,
			   size_t c_stride, enum dvsm_epilogue epilogue)
{
	const size_t panel_numbers = DVSM_PANEL * PANEL_DEPTH(depth);
	vf sums[GEMM_ROWS][TILE_VECTORS];
	vp x[GEMM_ROWS];
	size_t d = 0;

	clear_tile(rows, panels * PANEL_VECTORS, sums);
	for (; d + 2 <= depth; d += 2) {
		DVSM_UNROLL
		for (int i = 0; i < rows; i++)
			x[i] = vp_set(a + (size_t)i * a_stride + d);
		gemm_step(rows, panels, x, w + d * DVSM_PANEL, panel_numbers, sums);
	}
	if (d < depth) {
		DVSM_UNROLL
		for (int i = 0; i < rows; i++)
			x[i] = vp_set_half(a + (size_t)i * a_stride + d);
		gemm_step(rows, panels, x, w + d * DVSM_PANEL, panel_numbers, sums);
	}
	finish_tile(rows, panels * PANEL_VECTORS, sums, cols, c, at, c_stride, epilogue);
}

#include "kernels/gemm_walk.inc.h"
