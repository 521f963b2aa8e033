/* Sixteen floats: AVX-512 F and DQ. The words that the f32_*.inc.h templates are written in. */
#ifndef DVSM_KERNELS_VEC_AVX512_H
#define DVSM_KERNELS_VEC_AVX512_H

#include <immintrin.h>

#include "kernels/bf16.h"
#include "kernels/vec_sse.h"

#define VF_LANES 16

typedef __m512 vf;

static inline vf vf_load(const float *p)
{
	return _mm512_loadu_ps(p);
}

static inline void vf_store(float *p, vf a)
{
	_mm512_storeu_ps(p, a);
}

/** The first n lanes, n < VF_LANES; loads fill the rest with 0. */
static inline vf vf_load_part(const float *p, size_t n)
{
	return _mm512_maskz_loadu_ps((__mmask16)((1u << n) - 1), p);
}

static inline void vf_store_part(float *p, vf a, size_t n)
{
	_mm512_mask_storeu_ps(p, (__mmask16)((1u << n) - 1), a);
}

static inline vf vf_set(float x)
{
	return _mm512_set1_ps(x);
}

static inline vf vf_add(vf a, vf b)
{
	return _mm512_add_ps(a, b);
}

static inline vf vf_sub(vf a, vf b)
{
	return _mm512_sub_ps(a, b);
}

static inline vf vf_mul(vf a, vf b)
{
	return _mm512_mul_ps(a, b);
}

static inline vf vf_div(vf a, vf b)
{
	return _mm512_div_ps(a, b);
}

static inline vf vf_max(vf a, vf b)
{
	return _mm512_max_ps(a, b);
}

static inline vf vf_min(vf a, vf b)
{
	return _mm512_min_ps(a, b);
}

/** a b + c, rounded once. */
static inline vf vf_fma(vf a, vf b, vf c)
{
	return _mm512_fmadd_ps(a, b, c);
}

static inline vf vf_abs(vf a)
{
	return _mm512_abs_ps(a);
}

static inline vf vf_round(vf a)
{
	return _mm512_roundscale_ps(a, _MM_FROUND_TO_NEAREST_INT | _MM_FROUND_NO_EXC);
}

/** a 2^n for whole n in -126..127 and a in [0.5, 2). */
static inline vf vf_scale(vf a, vf n)
{
	return _mm512_scalef_ps(a, n);
}

/** Lanes of a where x < 0, of b elsewhere. */
static inline vf vf_if_negative(vf x, vf a, vf b)
{
	return _mm512_mask_blend_ps(_mm512_cmp_ps_mask(x, _mm512_setzero_ps(), _CMP_LT_OQ), b, a);
}

static inline float vf_sum(vf a)
{
	return _mm512_reduce_add_ps(a);
}

static inline vf vf_load_bf16(const dvsm_bf16 *p)
{
	__m256i halves = _mm256_loadu_si256((const __m256i *)p);

	return _mm512_castsi512_ps(_mm512_slli_epi32(_mm512_cvtepu16_epi32(halves), 16));
}

/** Two bfloat16 a lane: the first of each, and the second. */
static inline void vf_load_pairs(const dvsm_bf16 *p, vf *even, vf *odd)
{
	__m512i pairs = _mm512_loadu_si512(p);

	*even = _mm512_castsi512_ps(_mm512_slli_epi32(pairs, 16));
	*odd = _mm512_castsi512_ps(_mm512_and_si512(pairs, _mm512_set1_epi32(-0x10000)));
}

/* Lanes rounded to bfloat16, which is their upper half; the lower is what it was. */
static inline __m512i vf_bits_bf16(vf a)
{
	__m512i bits = _mm512_castps_si512(a);
	__m512i tie = _mm512_and_si512(_mm512_srli_epi32(bits, 16), _mm512_set1_epi32(1));

	return _mm512_add_epi32(bits, _mm512_add_epi32(tie, _mm512_set1_epi32(0x7fff)));
}

static inline void vf_store_bf16(dvsm_bf16 *p, vf a)
{
#if defined(__AVX512BF16__)
	_mm256_storeu_si256((__m256i *)p, (__m256i)_mm512_cvtneps_pbh(a));
#else
	__m512i bits = _mm512_srli_epi32(vf_bits_bf16(a), 16);

	_mm256_storeu_si256((__m256i *)p, _mm512_cvtepi32_epi16(bits));
#endif
}

/** To the nearest bfloat16, ties to even. */
static inline vf vf_round_bf16(vf a)
{
	return _mm512_castsi512_ps(_mm512_and_si512(vf_bits_bf16(a), _mm512_set1_epi32(-0x10000)));
}

#endif
