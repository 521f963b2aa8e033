/* The fixed-point kernels with products of 2 x 8 by 8 x 2 bytes (Armv8.6). */
#include <arm_neon.h>

#include "kernels/fixed.h"

#define DOT_PACKS

/* Two groups of columns are 128 bytes: the room is that of a piece. */
enum { dot_rows = 4, dot_piece = 1024, dot_room = 64 * dot_piece };

/*
 * Two groups hold eight numbers of each column, in two places: brought together, column by column,
 * once for all rows.
 */
static inline const int8_t *dot_columns(const int8_t *b, size_t *b_step, size_t groups,
					int8_t *room)
{
	for (size_t group = 0; group < groups; group += 2, b += 2 * *b_step) {
		int8_t *to = room + 64 * group;

		for (size_t j = 0; j < 64; j += 16) {
			const int32x4_t first = vreinterpretq_s32_s8(vld1q_s8(b + j));
			const int32x4_t second = vreinterpretq_s32_s8(vld1q_s8(b + *b_step + j));

			vst1q_s8(to + 2 * j, vreinterpretq_s8_s32(vzip1q_s32(first, second)));
			vst1q_s8(to + 2 * j + 16, vreinterpretq_s8_s32(vzip2q_s32(first, second)));
		}
	}
	*b_step = 64;
	return room;
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
		int8x16_t rows[dot_rows / 2];

		for (int k = 0; k < dot_rows / 2; k++)
			rows[k] = vcombine_s8(vld1_s8(a[2 * k] + 4 * group),
					      vld1_s8(a[2 * k + 1] + 4 * group));
		for (int j = 0; j < 8; j++) {
			const int8x16_t columns = vld1q_s8(b + 16 * j);

			for (int k = 0; k < dot_rows / 2; k++)
				sums[k][j] = vmmlaq_s32(sums[k][j], rows[k], columns);
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
