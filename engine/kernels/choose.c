#include "kernels/kernels.h"

#if defined(__x86_64__)
#include <cpuid.h>
#endif

/* Best first; the scalar set is what remains. */
static const struct dvsm_kernels *const f32_tiers[] = {
#if defined(__x86_64__)
	&dvsm_kernels_avx512,
	&dvsm_kernels_avx2,
	&dvsm_kernels_sse2,
#elif defined(__aarch64__)
	&dvsm_kernels_neon,
#endif
	&dvsm_kernels_scalar,
};

static const struct dvsm_kernels *const bf16_tiers[] = {
#if defined(__x86_64__)
	&dvsm_kernels_bf16_amx,    &dvsm_kernels_bf16_avx512bf16, &dvsm_kernels_bf16_avx512,
	&dvsm_kernels_bf16_avx2,   &dvsm_kernels_bf16_sse2,
#elif defined(__aarch64__)
	&dvsm_kernels_bf16_neonbf16,
	&dvsm_kernels_bf16_neon,
#endif
	&dvsm_kernels_bf16_scalar,
};

static const struct dvsm_kernels *choose(const struct dvsm_kernels *const *tiers, size_t count,
					 uint32_t mask)
{
	for (size_t i = 0; i + 1 < count; i++) {
		if (mask & tiers[i]->cpu)
			return tiers[i];
	}
	return tiers[count - 1];
}

/*
 * AVX-512 BF16 where it wins. AMD's cores take a vector of pairs a cycle, twice what widening to
 * floats gives; Intel's take vdpbf16ps apart, and widening is faster. A rule and no measurement: a
 * processor gives the same bits every time.
 */
#if defined(__x86_64__)
static uint32_t without_slow_tiers(uint32_t mask)
{
	uint32_t eax, ebx = 0, ecx, edx;

	if (__get_cpuid(0, &eax, &ebx, &ecx, &edx) && ebx == signature_INTEL_ebx)
		mask &= ~(uint32_t)DVSM_CPU_AVX512_BF16;
	return mask;
}
#else
static uint32_t without_slow_tiers(uint32_t mask)
{
	return mask;
}
#endif

const struct dvsm_kernels *dvsm_kernels_choose(enum dvsm_precision precision, uint32_t mask)
{
	mask &= dvsm_cpu_detect();
	/* A tier that is asked for alone is given as it is. */
	if (mask & ~(uint32_t)(DVSM_CPU_AVX512_BF16 | DVSM_CPU_SCALAR))
		mask = without_slow_tiers(mask);
	if (precision == DVSM_PRECISION_BF16)
		return choose(bf16_tiers, sizeof(bf16_tiers) / sizeof(bf16_tiers[0]), mask);
	return choose(f32_tiers, sizeof(f32_tiers) / sizeof(f32_tiers[0]), mask);
}

const char *dvsm_cpu_name(uint32_t mask)
{
	static const struct {
		uint32_t tiers;
		const char *name;
	} names[] = {
		{DVSM_CPU_AMX_INT8 | DVSM_CPU_AMX_BF16, "amx"},
		{DVSM_CPU_AVX512_BF16, "avx512bf16"},
		{DVSM_CPU_VNNI, "vnni"},
		{DVSM_CPU_AVX512, "avx512"},
		{DVSM_CPU_AVX_VNNI, "avxvnni"},
		{DVSM_CPU_AVX2, "avx2"},
		{DVSM_CPU_SSE4, "sse4"},
		{DVSM_CPU_SSE2, "sse2"},
		{DVSM_CPU_NEON_BF16, "neonbf16"},
		{DVSM_CPU_NEON_I8MM, "i8mm"},
		{DVSM_CPU_NEON_DOTPROD, "dotprod"},
		{DVSM_CPU_NEON, "neon"},
	};

	for (size_t i = 0; i < sizeof(names) / sizeof(names[0]); i++) {
		if (mask & names[i].tiers)
			return names[i].name;
	}
	return "scalar";
}
