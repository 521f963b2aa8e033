/* AVX-512 BF16: sixteen floats that take two products of bfloat16 each. */
#ifndef DVSM_KERNELS_VEC_AVX512BF16_H
#define DVSM_KERNELS_VEC_AVX512BF16_H

#include "kernels/vec_avx512.h"

/** A pair of bfloat16 a lane. */
typedef __m512bh vp;

static inline vp vp_load(const dvsm_bf16 *p)
{
	return (vp)_mm512_loadu_si512(p);
}

static inline void vp_store(dvsm_bf16 *p, vp a)
{
	_mm512_storeu_si512(p, (__m512i)a);
}

/** The pair p[0], p[1] in every lane. */
static inline vp vp_set(const dvsm_bf16 *p)
{
	int pair;

	memcpy(&pair, p, sizeof(pair));
	return (vp)_mm512_set1_epi32(pair);
}

/** The pair p[0], 0 in every lane. */
static inline vp vp_set_half(const dvsm_bf16 *p)
{
	return (vp)_mm512_set1_epi32(*p);
}

/** The pair 1, 1 in every lane. */
static inline vp vp_ones(void)
{
	return (vp)_mm512_set1_epi32(0x3f803f80);
}

/** Lanes of two vectors, rounded to nearest, as pairs. */
static inline vp vp_zip(vf first, vf second)
{
	const __m512i odd_and_even =
		_mm512_set_epi16(31, 15, 30, 14, 29, 13, 28, 12, 27, 11, 26, 10, 25, 9, 24, 8, 23,
				 7, 22, 6, 21, 5, 20, 4, 19, 3, 18, 2, 17, 1, 16, 0);
	__m512i halves = (__m512i)_mm512_cvtne2ps_pbh(second, first);

	return (vp)_mm512_permutexvar_epi16(odd_and_even, halves);
}

/** Lanes of two vectors, rounded to nearest, one vector after the other. */
static inline vp vp_join(vf first, vf second)
{
	return (vp)_mm512_cvtne2ps_pbh(second, first);
}

/** sums + the two products of every lane. The intrinsic makes gcc 12 move and spill sums in loops.
 */
static inline vf vp_dot(vf sums, vp a, vp b)
{
	__asm__("vdpbf16ps %2, %1, %0" : "+v"(sums) : "v"(a), "v"(b));
	return sums;
}

#endif
