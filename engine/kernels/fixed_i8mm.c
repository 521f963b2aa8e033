/* The fixed-point kernels with products of 2 x 8 by 8 x 2 bytes (Armv8.6). */
#include <arm_neon.h>

#include "kernels/fixed.h"

enum { dot_rows = 4 };

/* Eight numbers of each of two columns, and of two more: what two groups hold of four columns. */
static inline void load_pairs(const int8_t *b, size_t b_step, int8x16_t pairs[2])
{
	const int32x4_t first = vreinterpretq_s32_s8(vld1q_s8(b));
	const int32x4_t second = vreinterpretq_s32_s8(vld1q_s8(b + b_step));

	pairs[0] = vreinterpretq_s8_s32(vzip1q_s32(first, second));
	pairs[1] = vreinterpretq_s8_s32(vzip2q_s32(first, second));
}

/* sums[k][j]: rows 2 k and 2 k + 1 with columns 2 j and 2 j + 1. */
static inline void dot_tile(const int8_t *const a[dot_rows], const int8_t *b, size_t b_step,
			    size_t groups, int32_t *out)
{
	int32x4_t sums[dot_rows / 2][8];

	for (int k = 0; k < dot_rows / 2; k++)
		for (int j = 0; j < 8; j++)
			sums[k][j] = vdupq_n_s32(0);
	for (size_t group = 0; group < groups; group += 2, b += 2 * b_step) {
		int8x16_t rows[dot_rows / 2], columns[2];

		for (int k = 0; k < dot_rows / 2; k++)
			rows[k] = vcombine_s8(vld1_s8(a[2 * k] + 4 * group),
					      vld1_s8(a[2 * k + 1] + 4 * group));
		for (int j = 0; j < 8; j += 2) {
			load_pairs(b + 8 * j, b_step, columns);
			for (int k = 0; k < dot_rows / 2; k++) {
				sums[k][j] = vmmlaq_s32(sums[k][j], rows[k], columns[0]);
				sums[k][j + 1] = vmmlaq_s32(sums[k][j + 1], rows[k], columns[1]);
			}
		}
	}
	for (int k = 0; k < dot_rows / 2; k++) {
		for (int j = 0; j < 8; j++) {
			vst1_s32(out + 32 * k + 2 * j, vget_low_s32(sums[k][j]));
			vst1_s32(out + 32 * k + 16 + 2 * j, vget_high_s32(sums[k][j]));
		}
	}
}

#include "kernels/fixed_neon.inc.h"

const struct dvsm_fixed_kernels dvsm_fixed_kernels_i8mm = {
	.cpu = DVSM_CPU_NEON_I8MM,
	.name = "i8mm",
	.gemm = gemm,
	.attention = attention,
};
