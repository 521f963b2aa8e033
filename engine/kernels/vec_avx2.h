/* Eight floats: AVX2 and FMA. The words that the f32_*.inc.h templates are written in. */
#ifndef DVSM_KERNELS_VEC_AVX2_H
#define DVSM_KERNELS_VEC_AVX2_H

#include <immintrin.h>
#include <stdint.h>

#include "kernels/bf16.h"
#include "kernels/vec_sse.h"

#define VF_LANES 8

typedef __m256 vf;

static inline vf vf_load(const float *p)
{
	return _mm256_loadu_ps(p);
}

static inline void vf_store(float *p, vf a)
{
	_mm256_storeu_ps(p, a);
}

static inline __m256i vf_part_mask(size_t n)
{
	return _mm256_cmpgt_epi32(_mm256_set1_epi32((int)n),
				  _mm256_setr_epi32(0, 1, 2, 3, 4, 5, 6, 7));
}

/** The first n lanes, n < VF_LANES; loads fill the rest with 0. */
static inline vf vf_load_part(const float *p, size_t n)
{
	return _mm256_maskload_ps(p, vf_part_mask(n));
}

static inline void vf_store_part(float *p, vf a, size_t n)
{
	_mm256_maskstore_ps(p, vf_part_mask(n), a);
}

static inline vf vf_set(float x)
{
	return _mm256_set1_ps(x);
}

static inline vf vf_add(vf a, vf b)
{
	return _mm256_add_ps(a, b);
}

static inline vf vf_sub(vf a, vf b)
{
	return _mm256_sub_ps(a, b);
}

static inline vf vf_mul(vf a, vf b)
{
	return _mm256_mul_ps(a, b);
}

static inline vf vf_div(vf a, vf b)
{
	return _mm256_div_ps(a, b);
}

static inline vf vf_max(vf a, vf b)
{
	return _mm256_max_ps(a, b);
}

static inline vf vf_min(vf a, vf b)
{
	return _mm256_min_ps(a, b);
}

/** a b + c, rounded once. */
static inline vf vf_fma(vf a, vf b, vf c)
{
	return _mm256_fmadd_ps(a, b, c);
}

static inline vf vf_abs(vf a)
{
	return _mm256_andnot_ps(_mm256_set1_ps(-0.0f), a);
}

static inline vf vf_round(vf a)
{
	return _mm256_round_ps(a, _MM_FROUND_TO_NEAREST_INT | _MM_FROUND_NO_EXC);
}

/** a 2^n for whole n in -126..127 and a in [0.5, 2). */
static inline vf vf_scale(vf a, vf n)
{
	__m256i exponent = _mm256_slli_epi32(_mm256_cvtps_epi32(n), 23);

	return _mm256_castsi256_ps(_mm256_add_epi32(_mm256_castps_si256(a), exponent));
}

/** Lanes of a where x < 0, of b elsewhere. */
static inline vf vf_if_negative(vf x, vf a, vf b)
{
	return _mm256_blendv_ps(b, a, _mm256_cmp_ps(x, _mm256_setzero_ps(), _CMP_LT_OQ));
}

static inline float vf_sum(vf a)
{
	__m128 s = _mm_add_ps(_mm256_castps256_ps128(a), _mm256_extractf128_ps(a, 1));

	s = _mm_add_ps(s, _mm_movehl_ps(s, s));
	s = _mm_add_ss(s, _mm_movehdup_ps(s));
	return _mm_cvtss_f32(s);
}

static inline vf vf_load_bf16(const dvsm_bf16 *p)
{
	__m128i halves = _mm_loadu_si128((const __m128i *)p);

	return _mm256_castsi256_ps(_mm256_slli_epi32(_mm256_cvtepu16_epi32(halves), 16));
}

/** Two bfloat16 a lane: the first of each, and the second. */
static inline void vf_load_pairs(const dvsm_bf16 *p, vf *even, vf *odd)
{
	__m256i pairs = _mm256_loadu_si256((const __m256i *)p);

	*even = _mm256_castsi256_ps(_mm256_slli_epi32(pairs, 16));
	*odd = _mm256_castsi256_ps(_mm256_and_si256(pairs, _mm256_set1_epi32(-0x10000)));
}

/* Lanes rounded to bfloat16, which is their upper half; the lower is what it was. */
static inline __m256i vf_bits_bf16(vf a)
{
	__m256i bits = _mm256_castps_si256(a);
	__m256i tie = _mm256_and_si256(_mm256_srli_epi32(bits, 16), _mm256_set1_epi32(1));

	return _mm256_add_epi32(bits, _mm256_add_epi32(tie, _mm256_set1_epi32(0x7fff)));
}

static inline void vf_store_bf16(dvsm_bf16 *p, vf a)
{
	__m256i bits = _mm256_srli_epi32(vf_bits_bf16(a), 16);
	__m256i packed = _mm256_packus_epi32(bits, bits);

	_mm_storeu_si128((__m128i *)p,
			 _mm256_castsi256_si128(_mm256_permute4x64_epi64(packed, 0x08)));
}

/** To the nearest bfloat16, ties to even. */
static inline vf vf_round_bf16(vf a)
{
	return _mm256_castsi256_ps(_mm256_and_si256(vf_bits_bf16(a), _mm256_set1_epi32(-0x10000)));
}

#endif
