#include "kernels/kernels.h"

#if defined(__x86_64__)

#include <cpuid.h>

#define XCR0_AVX    0x06u /* SSE and AVX state */
#define XCR0_AVX512 0xe6u /* these, opmask, upper halves of zmm0-15, zmm16-31 */

/* SSE2 is part of the x86-64 base. CPUID tells what more there is; XCR0 tells which registers the
 * system saves. */
static uint32_t read_xcr0(void)
{
	uint32_t low, high;

	__asm__ volatile("xgetbv" : "=a"(low), "=d"(high) : "c"(0));
	return low;
}

uint32_t dvsm_cpu_detect(void)
{
	uint32_t mask = DVSM_CPU_SCALAR | DVSM_CPU_SSE2;
	uint32_t eax, ebx, ecx, edx, xcr0;

	if (!__get_cpuid(1, &eax, &ebx, &ecx, &edx) || !(ecx & bit_OSXSAVE))
		return mask;
	bool fma = ecx & bit_FMA;

	if (!__get_cpuid_count(7, 0, &eax, &ebx, &ecx, &edx))
		return mask;
	xcr0 = read_xcr0();
	if (fma && (ebx & bit_AVX2) && (xcr0 & XCR0_AVX) == XCR0_AVX)
		mask |= DVSM_CPU_AVX2;

	const uint32_t avx512 = bit_AVX512F | bit_AVX512BW | bit_AVX512DQ | bit_AVX512VL;

	if ((mask & DVSM_CPU_AVX2) && (ebx & avx512) == avx512 &&
	    (xcr0 & XCR0_AVX512) == XCR0_AVX512)
		mask |= DVSM_CPU_AVX512;
	return mask;
}

#elif defined(__aarch64__)

/* Advanced SIMD is part of the aarch64 base. */
uint32_t dvsm_cpu_detect(void)
{
	return DVSM_CPU_SCALAR | DVSM_CPU_NEON;
}

#else

uint32_t dvsm_cpu_detect(void)
{
	return DVSM_CPU_SCALAR;
}

#endif

/* Best first; the scalar set is what remains. */
static const struct dvsm_kernels *const tiers[] = {
#if defined(__x86_64__)
	&dvsm_kernels_avx512,
	&dvsm_kernels_avx2,
	&dvsm_kernels_sse2,
#elif defined(__aarch64__)
	&dvsm_kernels_neon,
#endif
	&dvsm_kernels_scalar,
};

#define TIER_COUNT (sizeof(tiers) / sizeof(tiers[0]))

const struct dvsm_kernels *dvsm_kernels_choose(uint32_t mask)
{
	mask &= dvsm_cpu_detect();
	for (size_t i = 0; i + 1 < TIER_COUNT; i++) {
		if (mask & tiers[i]->cpu)
			return tiers[i];
	}
	return tiers[TIER_COUNT - 1];
}

const char *dvsm_cpu_name(uint32_t mask)
{
	for (size_t i = 0; i + 1 < TIER_COUNT; i++) {
		if (mask & tiers[i]->cpu)
			return tiers[i]->name;
	}
	return tiers[TIER_COUNT - 1]->name;
}
