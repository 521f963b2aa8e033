#include "kernels/kernels.h"

#if defined(__x86_64__)

#include <cpuid.h>
#include <sys/syscall.h>
#include <unistd.h>

#define XCR0_AVX    0x00006u /* SSE and AVX state */
#define XCR0_AVX512 0x000e6u /* these, opmask, upper halves of zmm0-15, zmm16-31 */
#define XCR0_AMX    0x60000u /* tile configuration and tile data */

/* Linux keeps the large tile state out of a process until it asks (arch/x86/kernel/fpu/xstate.c).
 */
#define REQUEST_STATE_PERMISSION 0x1023
#define TILE_DATA_STATE          18

/* CPUID leaf 7, subleaf 0 and 1; cpuid.h of older compilers does not name them all. */
#define LEAF7_ECX_AVX512_VBMI2  (1u << 6)
#define LEAF7_ECX_VNNI          (1u << 11)
#define LEAF7_EDX_AMX_BF16      (1u << 22)
#define LEAF7_EDX_AMX_TILE      (1u << 24)
#define LEAF7_EDX_AMX_INT8      (1u << 25)
#define LEAF7_1_EAX_AVX_VNNI    (1u << 4)
#define LEAF7_1_EAX_AVX512_BF16 (1u << 5)

/* SSE2 is part of the x86-64 base. CPUID tells what more there is; XCR0 tells which registers the
 * system saves. */
static uint32_t read_xcr0(void)
{
	uint32_t low, high;

	__asm__ volatile("xgetbv" : "=a"(low), "=d"(high) : "c"(0));
	return low;
}

static bool may_use_tiles(uint32_t xcr0)
{
	return (xcr0 & XCR0_AMX) == XCR0_AMX &&
	       syscall(SYS_arch_prctl, REQUEST_STATE_PERMISSION, TILE_DATA_STATE) == 0;
}

/* What builds on AVX-512: each tier only with the one below it. */
static uint32_t detect_beyond_avx512(uint32_t ecx, uint32_t edx, uint32_t eax1, uint32_t xcr0)
{
	uint32_t mask = 0;

	if (ecx & LEAF7_ECX_VNNI)
		mask |= DVSM_CPU_VNNI;
	if (eax1 & LEAF7_1_EAX_AVX512_BF16)
		mask |= DVSM_CPU_AVX512_BF16;
	if (!(edx & LEAF7_EDX_AMX_TILE) || !may_use_tiles(xcr0))
		return mask;
	if ((mask & DVSM_CPU_VNNI) && (edx & LEAF7_EDX_AMX_INT8))
		mask |= DVSM_CPU_AMX_INT8;
	if ((mask & DVSM_CPU_AVX512_BF16) && (ecx & LEAF7_ECX_AVX512_VBMI2) &&
	    (edx & LEAF7_EDX_AMX_BF16))
		mask |= DVSM_CPU_AMX_BF16;
	return mask;
}

uint32_t dvsm_cpu_detect(void)
{
	uint32_t mask = DVSM_CPU_SCALAR | DVSM_CPU_SSE2;
	uint32_t eax, ebx, ecx, edx, xcr0;
	uint32_t eax1 = 0, ebx1, ecx1, edx1;

	if (!__get_cpuid(1, &eax, &ebx, &ecx, &edx))
		return mask;
	if ((ecx & bit_SSSE3) && (ecx & bit_SSE4_1))
		mask |= DVSM_CPU_SSE4;
	if (!(ecx & bit_OSXSAVE) || !(mask & DVSM_CPU_SSE4))
		return mask;
	bool fma = ecx & bit_FMA;

	if (!__get_cpuid_count(7, 0, &eax, &ebx, &ecx, &edx))
		return mask;
	xcr0 = read_xcr0();
	if (!fma || !(ebx & bit_AVX2) || (xcr0 & XCR0_AVX) != XCR0_AVX)
		return mask;
	mask |= DVSM_CPU_AVX2;
	if (__get_cpuid_count(7, 1, &eax1, &ebx1, &ecx1, &edx1) && (eax1 & LEAF7_1_EAX_AVX_VNNI))
		mask |= DVSM_CPU_AVX_VNNI;

	const uint32_t avx512 = bit_AVX512F | bit_AVX512BW | bit_AVX512DQ | bit_AVX512VL;

	if ((ebx & avx512) == avx512 && (xcr0 & XCR0_AVX512) == XCR0_AVX512)
		mask |= DVSM_CPU_AVX512 | detect_beyond_avx512(ecx, edx, eax1, xcr0);
	return mask;
}

#elif defined(__aarch64__)

#include <sys/auxv.h>

/* arch/arm64/include/uapi/asm/hwcap.h; older C libraries do not name them all. */
#define CAP_ASIMDDP (1ul << 20)
#define CAP2_I8MM   (1ul << 13)
#define CAP2_BF16   (1ul << 14)

/* Advanced SIMD is part of the aarch64 base. */
uint32_t dvsm_cpu_detect(void)
{
	uint32_t mask = DVSM_CPU_SCALAR | DVSM_CPU_NEON;
	unsigned long cap = getauxval(AT_HWCAP), cap2 = getauxval(AT_HWCAP2);

	if (!(cap & CAP_ASIMDDP))
		return mask;
	mask |= DVSM_CPU_NEON_DOTPROD;
	if (cap2 & CAP2_I8MM)
		mask |= DVSM_CPU_NEON_I8MM;
	if (cap2 & CAP2_BF16)
		mask |= DVSM_CPU_NEON_BF16;
	return mask;
}

#else

uint32_t dvsm_cpu_detect(void)
{
	return DVSM_CPU_SCALAR;
}

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
