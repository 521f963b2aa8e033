/*
 * The bfloat16 kernels for Arm's BF16 extension: products two rows by two columns, four numbers of
 * depth at a time (bfmmla). The rest is widened to floats, as in bf16_neon.c.
 */
#if defined(__aarch64__) /* tools that walk all sources come here on other machines too */

#include "kernels/tier.h"
#include "kernels/vec_neon.h"

/* 32 registers: 24 sums of 2 x 2, 3 pairs of rows, 2 loaded. */
#define GEMM_ROWS         6
#define GEMM_PANELS       1
#define ATTENTION_VECTORS 4
#define ATTENTION_ROWS    6

#include "kernels/math.inc.h"

#include "kernels/number_bf16.inc.h"

#include "kernels/norm.inc.h"

#include "kernels/attention.inc.h"
#include "kernels/gemm_finish.inc.h"

#define ROW_PAIRS    (GEMM_ROWS / 2)
#define COLUMN_PAIRS (DVSM_PANEL / 2)

/* Four numbers of two rows; of one row where there is no second, of `count` where no fourth. */
static inline bfloat16x8_t load_rows(const number *a, const number *second, size_t count)
{
	number four[8] = {0};

	if (count >= 4 && second)
		return vreinterpretq_bf16_u16(vcombine_u16(vld1_u16(a), vld1_u16(second)));
	count = count < 4 ? count : 4;
	memcpy(four, a, count * sizeof(*a));
	if (second)
		memcpy(four + 4, second, count * sizeof(*a));
	return vreinterpretq_bf16_u16(vld1q_u16(four));
}

/* One tile; `rows` is a constant where it is called, `panels` is 1. */
DVSM_INLINE void gemm_tile(const int rows, const int panels, const number *a, size_t a_stride,
			   const number *w, size_t depth, size_t cols, void *c, size_t at,
			   size_t c_stride, enum dvsm_epilogue epilogue)
{
	const int pairs = (rows + 1) / 2;
	float32x4_t squares[ROW_PAIRS][COLUMN_PAIRS];
	vf sums[GEMM_ROWS][TILE_VECTORS];

	(void)panels;
	DVSM_UNROLL
	for (int i = 0; i < pairs; i++) {
		DVSM_UNROLL
		for (int j = 0; j < (int)COLUMN_PAIRS; j++)
			squares[i][j] = vdupq_n_f32(0.0f);
	}
	for (size_t d = 0; d < depth; d += 4, w += 4 * DVSM_PANEL) {
		bfloat16x8_t x[ROW_PAIRS];

		DVSM_UNROLL
		for (int i = 0; i < pairs; i++) {
			const number *first = a + (size_t)(2 * i) * a_stride + d;

			x[i] = load_rows(first, 2 * i + 1 < rows ? first + a_stride : NULL,
					 depth - d);
		}
		/* Pairs of depth of four columns each become fours of depth of two columns each. */
		DVSM_UNROLL
		for (int j = 0; j < (int)COLUMN_PAIRS; j += 2) {
			uint32x4_t low = vreinterpretq_u32_u16(vld1q_u16(w + 4 * j));
			uint32x4_t high =
				vreinterpretq_u32_u16(vld1q_u16(w + 2 * DVSM_PANEL + 4 * j));
			bfloat16x8_t left = vreinterpretq_bf16_u32(vzip1q_u32(low, high));
			bfloat16x8_t right = vreinterpretq_bf16_u32(vzip2q_u32(low, high));

			DVSM_UNROLL
			for (int i = 0; i < pairs; i++) {
				squares[i][j] = vbfmmlaq_f32(squares[i][j], x[i], left);
				squares[i][j + 1] = vbfmmlaq_f32(squares[i][j + 1], x[i], right);
			}
		}
	}
	DVSM_UNROLL
	for (int i = 0; i < rows; i++) {
		DVSM_UNROLL
		for (int j = 0; j < TILE_VECTORS; j++) {
			float64x2_t l = vreinterpretq_f64_f32(squares[i / 2][2 * j]);
			float64x2_t r = vreinterpretq_f64_f32(squares[i / 2][2 * j + 1]);

			sums[i][j] =
				vreinterpretq_f32_f64(i % 2 ? vzip2q_f64(l, r) : vzip1q_f64(l, r));
		}
	}
	finish_tile(rows, TILE_VECTORS, sums, cols, c, at, c_stride, epilogue);
}

#include "kernels/gemm_walk.inc.h"

const struct dvsm_kernels dvsm_kernels_bf16_neonbf16 = {
	.cpu = DVSM_CPU_NEON_BF16,
	.name = "neonbf16",
	DVSM_KERNEL_FUNCTIONS,
};

#endif
