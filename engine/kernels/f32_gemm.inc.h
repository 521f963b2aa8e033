/*
 * Template: matrix product with packed weights. Included once by each f32_<tier>.c, after
 * number_f32.inc.h and after
 *
 *   GEMM_ROWS     rows of A that a full tile takes
 *   GEMM_PANELS   weight panels that a full tile takes
 *
 * A tile keeps GEMM_ROWS x GEMM_PANELS x 16 sums in registers while it walks the depth: per step it
 * loads the weights once and one number of each row of A. Each sum is one chain of
 * multiply-adds over the depth, whichever tile shape computes it.
 */

#include "kernels/gemm_finish.inc.h"

/* One tile; `rows` and `panels` are constants where it is called. `cols` may cut the last panel. */
DVSM_INLINE void gemm_tile(const int rows, const int panels, const float *a, size_t a_stride,
			   const float *w, size_t depth, size_t cols, void *c, size_t at,
			   size_t c_stride, enum dvsm_epilogue epilogue)
{
	const int vectors = panels * PANEL_VECTORS;
	vf sums[GEMM_ROWS][TILE_VECTORS];

	clear_tile(rows, vectors, sums);
	for (size_t d = 0; d < depth; d++) {
		vf b[TILE_VECTORS];

		DVSM_UNROLL
		for (int j = 0; j < vectors; j++) {
			size_t panel = (size_t)(j / PANEL_VECTORS), part = j % PANEL_VECTORS;

			b[j] = vf_load(w + (panel * depth + d) * DVSM_PANEL + part * VF_LANES);
		}
		DVSM_UNROLL
		for (int i = 0; i < rows; i++) {
			vf x = vf_set(a[(size_t)i * a_stride + d]);

			DVSM_UNROLL
			for (int j = 0; j < vectors; j++)
				sums[i][j] = vf_fma(x, b[j], sums[i][j]);
		}
	}
	finish_tile(rows, vectors, sums, cols, c, at, c_stride, epilogue);
}

#include "kernels/gemm_walk.inc.h"
