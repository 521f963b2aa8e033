/* The fixed-point kernels with dot products of four bytes (Armv8.2). */
#include <arm_neon.h>

#include "kernels/fixed.h"

enum { dot_rows = 4 };

/* sums += fours of a column times the row's four `lane`. gcc 12 moves sums of the intrinsic. */
#define ADD_DOTS(sums, column, row, lane)                                                          \
	__asm__("sdot %0.4s, %1.16b, %2.4b[" #lane "]" : "+w"(sums) : "w"(column), "w"(row))

static inline void dot_tile(const int8_t *const a[dot_rows], const int8_t *b, size_t b_step,
			    size_t groups, int32_t *out)
{
	int32x4_t sums[dot_rows][4];

	for (int i = 0; i < dot_rows; i++)
		for (int j = 0; j < 4; j++)
			sums[i][j] = vdupq_n_s32(0);

#define GROUP(lane)                                                                                \
	for (int j = 0; j < 4; j++) {                                                              \
		const int8x16_t column = vld1q_s8(b + (lane)*b_step + 16 * j);                     \
                                                                                                   \
		for (int i = 0; i < dot_rows; i++)                                                 \
			ADD_DOTS(sums[i][j], column, row[i], lane);                                \
	}
	for (size_t group = 0; group < groups; group += 4, b += 4 * b_step) {
		int8x16_t row[dot_rows];

		for (int i = 0; i < dot_rows; i++)
			row[i] = vld1q_s8(a[i] + 4 * group);
		GROUP(0)
		GROUP(1)
		GROUP(2)
		GROUP(3)
	}
#undef GROUP
	for (int i = 0; i < dot_rows; i++)
		for (int j = 0; j < 4; j++)
			vst1q_s32(out + 16 * i + 4 * j, sums[i][j]);
}

#include "kernels/fixed_neon.inc.h"

const struct dvsm_fixed_kernels dvsm_fixed_kernels_dotprod = {
	.cpu = DVSM_CPU_NEON_DOTPROD,
	.name = "dotprod",
	.gemm = gemm,
	.attention = attention,
};
