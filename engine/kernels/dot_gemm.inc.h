/*
 * Template: matrix product of bfloat16 pairs with packed weights. Included once by each tier that
 * multiplies them, after number_bf16.inc.h and after GEMM_ROWS and GEMM_PANELS as in
 * f32_gemm.inc.h: the same tile, two numbers of depth a step.
 */

#include "kernels/gemm_finish.inc.h"

/*
 * The sums of one step: the pair at a of each row, or its first number alone, against the panels'
 * pairs at w. Each row's pair is broadcast as it is needed: all at once they would push sums out of
 * their registers.
 */
DVSM_INLINE void gemm_step(const int rows, const int panels, const bool half, const number *a,
			   size_t a_stride, const number *w, size_t panel_numbers,
			   vf sums[GEMM_ROWS][TILE_VECTORS])
{
	vp b[TILE_VECTORS];

	DVSM_UNROLL
	for (int j = 0; j < panels * PANEL_VECTORS; j++) {
		size_t panel = (size_t)(j / PANEL_VECTORS), part = (size_t)(j % PANEL_VECTORS);

		b[j] = vp_load(w + panel * panel_numbers + 2 * part * VF_LANES);
	}
	DVSM_UNROLL
	for (int i = 0; i < rows; i++) {
		const number *at = a + (size_t)i * a_stride;
		vp x = half ? vp_set_half(at) : vp_set(at);

		DVSM_UNROLL
		for (int j = 0; j < panels * PANEL_VECTORS; j++)
			sums[i][j] = vp_dot(sums[i][j], x, b[j]);
	}
}

/* One tile; `rows` and `panels` are constants where it is called. `cols` may cut the last panel. */
DVSM_INLINE void gemm_tile(const int rows, const int panels, const number *a, size_t a_stride,
			   const number *w, size_t depth, size_t cols, void *c, size_t at,
			   size_t c_stride, enum dvsm_epilogue epilogue)
{
	const size_t panel_numbers = DVSM_PANEL * PANEL_DEPTH(depth);
	vf sums[GEMM_ROWS][TILE_VECTORS];
	size_t d = 0;

	clear_tile(rows, panels * PANEL_VECTORS, sums);
	for (; d + 2 <= depth; d += 2)
		gemm_step(rows, panels, false, a + d, a_stride, w + d * DVSM_PANEL, panel_numbers,
			  sums);
	if (d < depth)
		gemm_step(rows, panels, true, a + d, a_stride, w + d * DVSM_PANEL, panel_numbers,
			  sums);
	finish_tile(rows, panels * PANEL_VECTORS, sums, cols, c, at, c_stride, epilogue);
}

#include "kernels/gemm_walk.inc.h"
