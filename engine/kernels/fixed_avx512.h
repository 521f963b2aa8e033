/* What the fixed-point kernels of AVX-512 share: the one rounding of 64-bit products. Private. */
#ifndef DVSM_KERNELS_FIXED_AVX512_H
#define DVSM_KERNELS_FIXED_AVX512_H

#include <immintrin.h>

#include "kernels/fixed_math.h"

/** As it is: a constant that stays in its register, where the compiler would make it anew at each
 * use. */
static inline __m512i keep(__m512i a)
{
	__asm__("" : "+v"(a));
	return a;
}

/** What a pack made of two vectors, a quarter of each in turns: one vector behind the other. */
static inline __m512i in_order_of_two(__m512i packed)
{
	return _mm512_permutexvar_epi64(_mm512_setr_epi64(0, 2, 4, 6, 1, 3, 5, 7), packed);
}

/** What two packs made of four, of which each quarter has four numbers of each. */
static inline __m512i order_of_four(void)
{
	return _mm512_setr_epi32(0, 4, 8, 12, 1, 5, 9, 13, 2, 6, 10, 14, 3, 7, 11, 15);
}

static inline __m512i in_order_of_four(__m512i packed)
{
	return _mm512_permutexvar_epi32(order_of_four(), packed);
}

/** Sixteen numbers of 64 bits: those of the even lanes and those of the odd ones. */
struct wide {
	__m512i even, odd;
};

static inline __m512i odd_lanes(__m512i a)
{
	return _mm512_srli_epi64(a, 32);
}

/** R(a b, shift) in every lane, shift 1..62; |a b| is below 2^62. */
static inline struct wide round_products(__m512i a, __m512i b, __m512i shift)
{
	const __m512i one = _mm512_set1_epi64(1), low = _mm512_set1_epi64(0xffffffff);
	__m512i even_shift = _mm512_and_si512(shift, low), odd_shift = odd_lanes(shift);
	__m512i even = _mm512_mul_epi32(a, b), odd = _mm512_mul_epi32(odd_lanes(a), odd_lanes(b));

	/* floor((x 2^-(s - 1) + 1) / 2) is floor(x 2^-s + 1/2). */
	even = _mm512_srav_epi64(even, _mm512_sub_epi64(even_shift, one));
	odd = _mm512_srav_epi64(odd, _mm512_sub_epi64(odd_shift, one));
	return (struct wide){
		_mm512_srai_epi64(_mm512_add_epi64(even, one), 1),
		_mm512_srai_epi64(_mm512_add_epi64(odd, one), 1),
	};
}

/** The lower 32 bits of each. */
static inline __m512i wide_low(struct wide a)
{
	return _mm512_mask_blend_epi32(0xaaaa, a.even, _mm512_slli_epi64(a.odd, 32));
}

/** Each saturated to -limit .. limit - 1, which 32 bits hold. */
static inline __m512i wide_saturate(struct wide a, int64_t limit)
{
	const __m512i top = _mm512_set1_epi64(limit - 1), bottom = _mm512_set1_epi64(-limit);

	a.even = _mm512_max_epi64(_mm512_min_epi64(a.even, top), bottom);
	a.odd = _mm512_max_epi64(_mm512_min_epi64(a.odd, top), bottom);
	return wide_low(a);
}

/** Shifts clamped to 1..62. */
static inline __m512i clamp_shift(__m512i shift)
{
	return _mm512_max_epi32(_mm512_min_epi32(shift, _mm512_set1_epi32(62)),
				_mm512_set1_epi32(1));
}

/** The first n of sixteen lanes. */
static inline __mmask16 first_lanes(size_t n)
{
	return n >= 16 ? 0xffff : (__mmask16)((1u << n) - 1);
}

/** The first n of 32 lanes. */
static inline __mmask32 first_words(size_t n)
{
	return n >= 32 ? 0xffffffffu : (1u << n) - 1;
}

#endif
