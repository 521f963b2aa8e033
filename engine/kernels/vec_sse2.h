/* Four floats: SSE2, the base of x86-64. The words that the f32_*.inc.h templates are written in.
 */
#ifndef DVSM_KERNELS_VEC_SSE2_H
#define DVSM_KERNELS_VEC_SSE2_H

#include <emmintrin.h>

#include "kernels/bf16.h"
#include "kernels/vec_sse.h"

#define VF_LANES 4

typedef __m128 vf;

static inline vf vf_load(const float *p)
{
	return _mm_loadu_ps(p);
}

static inline void vf_store(float *p, vf a)
{
	_mm_storeu_ps(p, a);
}

/** The first n lanes, n < VF_LANES; loads fill the rest with 0. */
static inline vf vf_load_part(const float *p, size_t n)
{
	float lanes[VF_LANES] = {0};

	for (size_t i = 0; i < n; i++)
		lanes[i] = p[i];
	return _mm_loadu_ps(lanes);
}

static inline void vf_store_part(float *p, vf a, size_t n)
{
	float lanes[VF_LANES];

	_mm_storeu_ps(lanes, a);
	for (size_t i = 0; i < n; i++)
		p[i] = lanes[i];
}

static inline vf vf_set(float x)
{
	return _mm_set1_ps(x);
}

static inline vf vf_add(vf a, vf b)
{
	return _mm_add_ps(a, b);
}

static inline vf vf_sub(vf a, vf b)
{
	return _mm_sub_ps(a, b);
}

static inline vf vf_mul(vf a, vf b)
{
	return _mm_mul_ps(a, b);
}

static inline vf vf_div(vf a, vf b)
{
	return _mm_div_ps(a, b);
}

static inline vf vf_max(vf a, vf b)
{
	return _mm_max_ps(a, b);
}

static inline vf vf_min(vf a, vf b)
{
	return _mm_min_ps(a, b);
}

/** a b + c, rounded twice: there is no fused instruction. */
static inline vf vf_fma(vf a, vf b, vf c)
{
	return _mm_add_ps(_mm_mul_ps(a, b), c);
}

static inline vf vf_abs(vf a)
{
	return _mm_andnot_ps(_mm_set1_ps(-0.0f), a);
}

/** To the nearest whole number, ties to even, for |a| < 2^31. */
static inline vf vf_round(vf a)
{
	return _mm_cvtepi32_ps(_mm_cvtps_epi32(a));
}

/** a 2^n for whole n in -126..127 and a in [0.5, 2). */
static inline vf vf_scale(vf a, vf n)
{
	__m128i exponent = _mm_slli_epi32(_mm_cvtps_epi32(n), 23);

	return _mm_castsi128_ps(_mm_add_epi32(_mm_castps_si128(a), exponent));
}

/** Lanes of a where x < 0, of b elsewhere. */
static inline vf vf_if_negative(vf x, vf a, vf b)
{
	vf negative = _mm_cmplt_ps(x, _mm_setzero_ps());

	return _mm_or_ps(_mm_and_ps(negative, a), _mm_andnot_ps(negative, b));
}

static inline float vf_sum(vf a)
{
	vf s = _mm_add_ps(a, _mm_movehl_ps(a, a));

	s = _mm_add_ss(s, _mm_shuffle_ps(s, s, 1));
	return _mm_cvtss_f32(s);
}

static inline vf vf_load_bf16(const dvsm_bf16 *p)
{
	__m128i halves = _mm_loadl_epi64((const __m128i *)p);

	return _mm_castsi128_ps(_mm_unpacklo_epi16(_mm_setzero_si128(), halves));
}

/** Two bfloat16 a lane: the first of each, and the second. */
static inline void vf_load_pairs(const dvsm_bf16 *p, vf *even, vf *odd)
{
	__m128i pairs = _mm_loadu_si128((const __m128i *)p);

	*even = _mm_castsi128_ps(_mm_slli_epi32(pairs, 16));
	*odd = _mm_castsi128_ps(_mm_and_si128(pairs, _mm_set1_epi32(-0x10000)));
}

/* Lanes rounded to bfloat16, which is their upper half; the lower is what it was. */
static inline __m128i vf_bits_bf16(vf a)
{
	__m128i bits = _mm_castps_si128(a);
	__m128i tie = _mm_and_si128(_mm_srli_epi32(bits, 16), _mm_set1_epi32(1));

	return _mm_add_epi32(bits, _mm_add_epi32(tie, _mm_set1_epi32(0x7fff)));
}

static inline void vf_store_bf16(dvsm_bf16 *p, vf a)
{
	/* Signed, or the pack would saturate. */
	__m128i bits = _mm_srai_epi32(vf_bits_bf16(a), 16);

	_mm_storel_epi64((__m128i *)p, _mm_packs_epi32(bits, bits));
}

/** To the nearest bfloat16, ties to even. */
static inline vf vf_round_bf16(vf a)
{
	return _mm_castsi128_ps(_mm_and_si128(vf_bits_bf16(a), _mm_set1_epi32(-0x10000)));
}

#endif
