/* AVX-512 pieces: bfloat16, exponential, GELU, and the packings that tiles want. */
#pragma once

#include <immintrin.h>
#include <stddef.h>
#include <stdint.h>

static inline __m512 load_bf16(const uint16_t *p)
{
	__m512i wide = _mm512_cvtepu16_epi32(_mm256_loadu_si256((const __m256i *)p));
	return _mm512_castsi512_ps(_mm512_slli_epi32(wide, 16));
}

#ifdef __AVX512BF16__

/* 32 values, rounded to the nearest bfloat16. */
static inline __m512i round_bf16(__m512 low, __m512 high)
{
	return (__m512i)_mm512_cvtne2ps_pbh(high, low);
}

static inline void store_bf16_16(uint16_t *p, __m512 x)
{
	_mm256_storeu_si256((__m256i *)p, (__m256i)_mm512_cvtneps_pbh(x));
}

#else

/* The nearest bfloat16 in the upper half of each word, ties to even; what is below is left over. */
static inline __m512i round_words(__m512 x)
{
	__m512i bits = _mm512_castps_si512(x), one = _mm512_set1_epi32(1);
	__m512i odd = _mm512_and_si512(_mm512_srli_epi32(bits, 16), one);
	return _mm512_add_epi32(bits, _mm512_add_epi32(odd, _mm512_set1_epi32(0x7fff)));
}

/* 32 values, rounded to the nearest bfloat16. */
static inline __m512i round_bf16(__m512 low, __m512 high)
{
	static const uint16_t upper[32] = {1,  3,  5,  7,  9,  11, 13, 15, 17, 19, 21,
					   23, 25, 27, 29, 31, 33, 35, 37, 39, 41, 43,
					   45, 47, 49, 51, 53, 55, 57, 59, 61, 63};
	return _mm512_permutex2var_epi16(round_words(low), _mm512_loadu_si512(upper),
					 round_words(high));
}

static inline void store_bf16_16(uint16_t *p, __m512 x)
{
	__m512i words = _mm512_srli_epi32(round_words(x), 16);
	_mm256_storeu_si256((__m256i *)p, _mm512_cvtepi32_epi16(words));
}

#endif

static inline void store_bf16(uint16_t *p, __m512 low, __m512 high)
{
	_mm512_storeu_si512(p, round_bf16(low, high));
}

static inline void to_bf16(const float *x, size_t count, uint16_t *out)
{
	for (size_t i = 0; i < count; i += 32) {
		store_bf16(out + i, _mm512_loadu_ps(x + i), _mm512_loadu_ps(x + i + 16));
	}
}

/* e^x, relative error under 3e-7; 0 below -87. */
static inline __m512 exponential(__m512 x)
{
	x = _mm512_max_ps(x, _mm512_set1_ps(-104.0f));
	__m512 t = _mm512_mul_ps(x, _mm512_set1_ps(1.44269504f));
	__m512 n = _mm512_roundscale_ps(t, _MM_FROUND_TO_NEAREST_INT | _MM_FROUND_NO_EXC);
	__m512 f = _mm512_fnmadd_ps(n, _mm512_set1_ps(0.693145752f), x);
	f = _mm512_fnmadd_ps(n, _mm512_set1_ps(1.42860677e-6f), f);
	__m512 p = _mm512_set1_ps(1.0f / 720);
	p = _mm512_fmadd_ps(p, f, _mm512_set1_ps(1.0f / 120));
	p = _mm512_fmadd_ps(p, f, _mm512_set1_ps(1.0f / 24));
	p = _mm512_fmadd_ps(p, f, _mm512_set1_ps(1.0f / 6));
	p = _mm512_fmadd_ps(p, f, _mm512_set1_ps(0.5f));
	p = _mm512_fmadd_ps(p, f, _mm512_set1_ps(1.0f));
	p = _mm512_fmadd_ps(p, f, _mm512_set1_ps(1.0f));
	return _mm512_scalef_ps(p, n);
}

/* Exact (erf) GELU and its derivative; erf by Abramowitz and Stegun 7.1.26, error under 2e-7. */
static inline void gelu_both(__m512 x, __m512 *value, __m512 *slope)
{
	const __m512 one = _mm512_set1_ps(1.0f);
	__m512 z = _mm512_mul_ps(_mm512_abs_ps(x), _mm512_set1_ps(0.70710678f));
	__m512 bell = exponential(_mm512_mul_ps(_mm512_mul_ps(x, x), _mm512_set1_ps(-0.5f)));
	__m512 below = _mm512_fmadd_ps(z, _mm512_set1_ps(0.3275911f), one);
	__m512 t = _mm512_rcp14_ps(below);
	t = _mm512_mul_ps(t, _mm512_fnmadd_ps(below, t, _mm512_set1_ps(2.0f)));
	__m512 p = _mm512_set1_ps(0.5f * 1.061405429f);
	p = _mm512_fmadd_ps(p, t, _mm512_set1_ps(0.5f * -1.453152027f));
	p = _mm512_fmadd_ps(p, t, _mm512_set1_ps(0.5f * 1.421413741f));
	p = _mm512_fmadd_ps(p, t, _mm512_set1_ps(0.5f * -0.284496736f));
	p = _mm512_fmadd_ps(p, t, _mm512_set1_ps(0.5f * 0.254829592f));
	__m512 tail = _mm512_mul_ps(_mm512_mul_ps(p, t), bell); /* share of the bell beyond |x| */
	__mmask16 negative = _mm512_movepi32_mask(_mm512_castps_si512(x));
	__m512 share = _mm512_mask_mov_ps(_mm512_sub_ps(one, tail), negative, tail);
	*value = _mm512_mul_ps(x, share);
	*slope = _mm512_fmadd_ps(_mm512_mul_ps(x, bell), _mm512_set1_ps(0.39894228f), share);
}

static inline __m512 gelu(__m512 x)
{
	__m512 value, slope;
	gelu_both(x, &value, &slope);
	return value;
}

/* 16 x 16 words of 32 bits, in place. */
static inline void transpose16(__m512i r[16])
{
	__m512i t[16];
	for (int i = 0; i < 8; i++) {
		t[2 * i] = _mm512_unpacklo_epi32(r[2 * i], r[2 * i + 1]);
		t[2 * i + 1] = _mm512_unpackhi_epi32(r[2 * i], r[2 * i + 1]);
	}
	for (int i = 0; i < 4; i++) {
		r[4 * i] = _mm512_unpacklo_epi64(t[4 * i], t[4 * i + 2]);
		r[4 * i + 1] = _mm512_unpackhi_epi64(t[4 * i], t[4 * i + 2]);
		r[4 * i + 2] = _mm512_unpacklo_epi64(t[4 * i + 1], t[4 * i + 3]);
		r[4 * i + 3] = _mm512_unpackhi_epi64(t[4 * i + 1], t[4 * i + 3]);
	}
	for (int i = 0; i < 4; i++) {
		t[i] = _mm512_shuffle_i32x4(r[i], r[4 + i], 0x88);
		t[4 + i] = _mm512_shuffle_i32x4(r[i], r[4 + i], 0xdd);
		t[8 + i] = _mm512_shuffle_i32x4(r[8 + i], r[12 + i], 0x88);
		t[12 + i] = _mm512_shuffle_i32x4(r[8 + i], r[12 + i], 0xdd);
	}
	for (int i = 0; i < 4; i++) {
		r[i] = _mm512_shuffle_i32x4(t[i], t[8 + i], 0x88);
		r[8 + i] = _mm512_shuffle_i32x4(t[i], t[8 + i], 0xdd);
		r[4 + i] = _mm512_shuffle_i32x4(t[4 + i], t[12 + i], 0x88);
		r[12 + i] = _mm512_shuffle_i32x4(t[4 + i], t[12 + i], 0xdd);
	}
}

/* Two rows' 16 values, interleaved: the upper row in the low half of each word. */
static inline __m512i pair(const uint16_t *upper, const uint16_t *lower)
{
	__m512i a = _mm512_cvtepu16_epi32(_mm256_loadu_si256((const __m256i *)upper));
	__m512i b = _mm512_cvtepu16_epi32(_mm256_loadu_si256((const __m256i *)lower));
	return _mm512_or_si512(a, _mm512_slli_epi32(b, 16));
}

/*
 * The packings. x is [rows][cols] of bfloat16, `stride` apart; rows and cols are multiples of 32. A
 * tile is 512 values; a panel covers 32 columns of a right factor or 16 rows of a left one, its
 * tiles in the order of the inner dimension, whose whole length is `inner`.
 *
 * pairs:       right factor x itself: inner dimension = rows
 * columns:     right factor x^T: inner dimension = cols
 * transposed:  left factor x^T: inner dimension = rows
 *
 * Where x holds only a part of the inner dimension, `out` points into the first panel.
 */
static inline void pack_pairs(const uint16_t *x, int stride, int rows, int cols, uint16_t *out,
			      int inner)
{
	for (int r = 0; r < rows; r += 32) {
		for (int c = 0; c < cols; c += 16) {
			uint16_t *tile =
				out + (size_t)(c / 32) * inner * 32 + (size_t)r * 32 + c % 32 * 32;
			for (int i = 0; i < 16; i++) {
				const uint16_t *at = x + (size_t)(r + 2 * i) * stride + c;
				_mm512_storeu_si512(tile + i * 32, pair(at, at + stride));
			}
		}
	}
}

static inline void pack_columns(const uint16_t *x, int stride, int rows, int cols, uint16_t *out,
				int inner)
{
	__m512i words[16];
	for (int r = 0; r < rows; r += 16) {
		for (int c = 0; c < cols; c += 32) {
			uint16_t *tile =
				out + (size_t)(r / 32) * inner * 32 + (size_t)c * 32 + r % 32 * 32;
			for (int i = 0; i < 16; i++) {
				words[i] = _mm512_loadu_si512(x + (size_t)(r + i) * stride + c);
			}
			transpose16(words);
			for (int i = 0; i < 16; i++) {
				_mm512_storeu_si512(tile + i * 32, words[i]);
			}
		}
	}
}

static inline void pack_transposed(const uint16_t *x, int stride, int rows, int cols, uint16_t *out,
				   int inner)
{
	__m512i words[16];
	for (int r = 0; r < rows; r += 32) {
		for (int c = 0; c < cols; c += 16) {
			uint16_t *tile = out + (size_t)c * inner + (size_t)r * 16;
			for (int i = 0; i < 16; i++) {
				const uint16_t *at = x + (size_t)(r + 2 * i) * stride + c;
				words[i] = pair(at, at + stride);
			}
			transpose16(words);
			for (int i = 0; i < 16; i++) {
				_mm512_storeu_si512(tile + i * 32, words[i]);
			}
		}
	}
}
