/*
 * Template: matrix product of bfloat16 with packed weights, for machines that multiply floats only.
 * Included once by each bf16_<tier>.c, after number_bf16.inc.h and after GEMM_ROWS and GEMM_PANELS
 * as in f32_gemm.inc.h.
 *
 * A panel holds the weights of depth d and d + 1 side by side: one load gives both, the even ones
 * by a shift, the odd ones by a mask. The rows of A are widened a chunk at a time, before the tile
 * reads them 16 x GEMM_PANELS times. Each sum is one chain of multiply-adds over the depth.
 */

#include "kernels/gemm_finish.inc.h"

/* Depth that is widened at a time: even. */
#define GEMM_CHUNK 128

struct gemm_chunk {
	float rows[GEMM_ROWS][GEMM_CHUNK];
};

/* One tile; `rows` and `panels` are constants where it is called. `cols` may cut the last panel. */
DVSM_INLINE void gemm_tile(const int rows, const int panels, const number *a, size_t a_stride,
			   const number *w, size_t depth, size_t cols, void *c, size_t at,
			   size_t c_stride, enum dvsm_epilogue epilogue)
{
	const int vectors = panels * PANEL_VECTORS;
	const size_t panel_numbers = DVSM_PANEL * PANEL_DEPTH(depth);
	vf sums[GEMM_ROWS][TILE_VECTORS];
	struct gemm_chunk chunk;

	clear_tile(rows, vectors, sums);
	for (size_t first = 0; first < depth; first += GEMM_CHUNK) {
		size_t count = depth - first < GEMM_CHUNK ? depth - first : GEMM_CHUNK;

		for (int i = 0; i < rows; i++) {
			num_floats(a + (size_t)i * a_stride + first, count, chunk.rows[i]);
			if (count % 2)
				chunk.rows[i][count] = 0.0f;
		}
		for (size_t d = 0; d < count; d += 2) {
			vf odd[TILE_VECTORS];

			DVSM_UNROLL
			for (int j = 0; j < vectors; j++) {
				size_t panel = (size_t)(j / PANEL_VECTORS);
				size_t part = (size_t)(j % PANEL_VECTORS);
				vf even;

				vf_load_pairs(w + panel * panel_numbers + (first + d) * DVSM_PANEL +
						      2 * part * VF_LANES,
					      &even, &odd[j]);
				DVSM_UNROLL
				for (int i = 0; i < rows; i++)
					sums[i][j] =
						vf_fma(vf_set(chunk.rows[i][d]), even, sums[i][j]);
			}
			DVSM_UNROLL
			for (int i = 0; i < rows; i++) {
				vf x = vf_set(chunk.rows[i][d + 1]);

				DVSM_UNROLL
				for (int j = 0; j < vectors; j++)
					sums[i][j] = vf_fma(x, odd[j], sums[i][j]);
			}
		}
	}
	finish_tile(rows, vectors, sums, cols, c, at, c_stride, epilogue);
}

#include "kernels/gemm_walk.inc.h"
