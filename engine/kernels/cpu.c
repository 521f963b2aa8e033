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
