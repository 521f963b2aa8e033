/* The packing, the tables of the fixed-point path, and the choice among its kernels. */
#include <string.h>

#include "kernels/fixed_math.h"
#include "kernels/fixed_tiers.h"

const uint16_t dvsm_fixed_rsqrt_guess[96] = {
	65030, 64052, 63117, 62222, 61363, 60540, 59748, 58987, 58254, 57548, 56867, 56210,
	55574, 54960, 54366, 53791, 53233, 52693, 52169, 51660, 51165, 50685, 50218, 49763,
	49321, 48890, 48470, 48061, 47663, 47273, 46894, 46523, 46161, 45807, 45462, 45124,
	44793, 44470, 44153, 43843, 43540, 43243, 42951, 42666, 42386, 42112, 41843, 41579,
	41320, 41065, 40816, 40571, 40330, 40093, 39861, 39632, 39408, 39187, 38970, 38756,
	38546, 38340, 38136, 37936, 37739, 37545, 37354, 37166, 36980, 36798, 36618, 36441,
	36266, 36093, 35924, 35756, 35591, 35428, 35267, 35109, 34953, 34798, 34646, 34496,
	34347, 34201, 34056, 33913, 33772, 33633, 33496, 33360, 33225, 33093, 32962, 32832,
};

/* 2^17 a Phi(-a) at a = i / 16: knots of the piecewise linear function nearest to it in the mean
 * square, with both ends held at 0. */
const int16_t dvsm_fixed_gelu_tail[65] = {
	0,     3935,  7408,  10494, 13181, 15486, 17421, 19002, 20247, 21176, 21812, 22178, 22297,
	22194, 21895, 21424, 20806, 20063, 19219, 18296, 17313, 16289, 15241, 14185, 13133, 12098,
	11090, 10116, 9185,  8300,  7466,  6685,  5959,  5289,  4673,  4111,  3601,  3141,  2728,
	2359,  2032,  1742,  1488,  1266,  1072,  904,   760,   635,   529,   439,   363,   299,
	245,   200,   163,   132,   106,   85,    68,    55,    43,    35,    26,    17,    0,
};

void dvsm_fixed_pack_panels(const int8_t *weights, size_t cols, size_t depth, int8_t *panels)
{
	const size_t padded = dvsm_fixed_pad(depth, DVSM_FIXED_DEPTH);

	memset(panels, 0, dvsm_fixed_pad(cols, DVSM_FIXED_PANEL) * padded);
	for (size_t j = 0; j < cols; j++) {
		int8_t *to = panels + j / DVSM_FIXED_PANEL * DVSM_FIXED_PANEL * padded +
			     j % DVSM_FIXED_PANEL * 4;

		for (size_t d = 0; d < depth; d++)
			to[d / 4 * 4 * DVSM_FIXED_PANEL + d % 4] = weights[j * depth + d];
	}
}

/* Best last: each tier replaces what it does better than those before it. */
static const struct dvsm_fixed_kernels *const tiers[] = {
	&dvsm_fixed_kernels_scalar,
#if defined(__x86_64__)
	&dvsm_fixed_kernels_sse4,   &dvsm_fixed_kernels_avx2, &dvsm_fixed_kernels_avxvnni,
	&dvsm_fixed_kernels_avx512, &dvsm_fixed_kernels_vnni, &dvsm_fixed_kernels_amx,
#elif defined(__aarch64__)
	&dvsm_fixed_kernels_neon,
	&dvsm_fixed_kernels_dotprod,
	&dvsm_fixed_kernels_i8mm,
#endif
};

#define OVERLAY(name)                                                                              \
	if (tier->name)                                                                            \
	chosen.name = tier->name

struct dvsm_fixed_kernels dvsm_fixed_kernels_choose(uint32_t mask)
{
	struct dvsm_fixed_kernels chosen = dvsm_fixed_kernels_scalar;

	mask &= dvsm_cpu_detect();
	for (size_t i = 1; i < sizeof(tiers) / sizeof(tiers[0]); i++) {
		const struct dvsm_fixed_kernels *tier = tiers[i];

		if (!(mask & tier->cpu))
			continue;
		chosen.cpu = tier->cpu;
		chosen.name = tier->name;
		OVERLAY(gemm);
		OVERLAY(norm);
		OVERLAY(quantise);
		OVERLAY(split);
		OVERLAY(queries);
		OVERLAY(keys);
		OVERLAY(range);
		OVERLAY(pack_keys);
		OVERLAY(pack_values);
		OVERLAY(attention);
		OVERLAY(attention_queries);
	}
	return chosen;
}
