/* The fixed-point kernels for every aarch64: products of bytes widened to 16 bits. */
#include <arm_neon.h>

#include "kernels/fixed.h"
#include "kernels/fixed_neon_rows.h"

enum { dot_rows = 2 };

/* Two groups of a row, each repeated for four columns. */
struct deep {
	int8x16_t first, second;
};

static inline struct deep load_deep(const int8_t *a)
{
	const int32x2_t both = vreinterpret_s32_s8(vld1_s8(a));

	return (struct deep){vreinterpretq_s8_s32(vdupq_lane_s32(both, 0)),
			     vreinterpretq_s8_s32(vdupq_lane_s32(both, 1))};
}

/* Eight numbers of each of four columns: pairs of them in 16 bits, added to 32. */
static inline void add_deep(int32x4_t sums[2], struct deep a, int8x16_t first, int8x16_t second)
{
	int16x8_t low = vmull_s8(vget_low_s8(a.first), vget_low_s8(first));
	int16x8_t high = vmull_high_s8(a.first, first);

	low = vmlal_s8(low, vget_low_s8(a.second), vget_low_s8(second));
	high = vmlal_high_s8(high, a.second, second);
	sums[0] = vpadalq_s16(sums[0], low);
	sums[1] = vpadalq_s16(sums[1], high);
}

static inline void dot_tile(const int8_t *const a[dot_rows], const int8_t *b, size_t b_step,
			    size_t groups, int32_t *out)
{
	int32x4_t sums[dot_rows][4][2];

	for (int i = 0; i < dot_rows; i++)
		for (int j = 0; j < 4; j++)
			sums[i][j][0] = sums[i][j][1] = vdupq_n_s32(0);
	for (size_t group = 0; group < groups; group += 2, b += 2 * b_step) {
		const struct deep top = load_deep(a[0] + 4 * group);
		const struct deep bottom = load_deep(a[1] + 4 * group);

		for (int j = 0; j < 4; j++) {
			const int8x16_t first = vld1q_s8(b + 16 * j);
			const int8x16_t second = vld1q_s8(b + b_step + 16 * j);

			add_deep(sums[0][j], top, first, second);
			add_deep(sums[1][j], bottom, first, second);
		}
	}
	for (int i = 0; i < dot_rows; i++)
		for (int j = 0; j < 4; j++)
			vst1q_s32(out + 16 * i + 4 * j, vpaddq_s32(sums[i][j][0], sums[i][j][1]));
}

#include "kernels/fixed_neon.inc.h"

const struct dvsm_fixed_kernels dvsm_fixed_kernels_neon = {
	.cpu = DVSM_CPU_NEON,
	.name = "neon",
	.gemm = gemm,
	.norm = dvsm_fixed_neon_norm,
	.quantise = dvsm_fixed_neon_quantise,
	.queries = dvsm_fixed_neon_queries,
	.keys = dvsm_fixed_neon_keys,
	.range = dvsm_fixed_neon_range,
	.pack_keys = dvsm_fixed_neon_pack_keys,
	.pack_values = dvsm_fixed_neon_pack_values,
	.attention = attention,
};
