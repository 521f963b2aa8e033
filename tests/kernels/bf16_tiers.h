/* The bfloat16 tables that this machine can run. */
#ifndef TESTS_KERNELS_BF16_TIERS_H
#define TESTS_KERNELS_BF16_TIERS_H

#include "amx_tiers.h"
#include "kernels/kernels.h"

#define BF16_TIERS 8

/** Fill `tiers` and return how many there are. */
static inline size_t bf16_tiers(const struct dvsm_kernels *tiers[BF16_TIERS])
{
	static const struct dvsm_kernels *const all[] = {
		&dvsm_kernels_bf16_scalar,
#if defined(__x86_64__)
		&dvsm_kernels_bf16_sse2,
		&dvsm_kernels_bf16_avx2,
		&dvsm_kernels_bf16_avx512,
		&dvsm_kernels_bf16_avx512bf16,
		&dvsm_kernels_bf16_amx,
#elif defined(__aarch64__)
		&dvsm_kernels_bf16_neon,
		&dvsm_kernels_bf16_neonbf16,
#endif
	};
	uint32_t present = dvsm_cpu_detect();
	size_t count = 0;

	for (size_t i = 0; i < sizeof(all) / sizeof(all[0]); i++) {
		if (present & all[i]->cpu)
			tiers[count++] = all[i];
	}
#if defined(__x86_64__)
	if (present & DVSM_CPU_AVX512_BF16)
		tiers[count++] = &amx_model_bf16_kernels;
#endif
	return count;
}

#endif
