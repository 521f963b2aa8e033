/*
 * What the fixed-point kernels of AVX2 share. Private.
 *
 * vpmaddubsw multiplies unsigned by signed bytes: the sizes of A by the columns, which take A's
 * signs over. Two products fit its 16 bits, for a column has no -128.
 *
 * Weights of 15 bits are multiplied as words. Four packed bytes of a column are two words of even
 * and two of odd place; weights come as words in the order 0 2 1 3, so that each of the two
 * vpmaddwd meets its two in one broadcast of 32 bits.
 */
#ifndef DVSM_KERNELS_FIXED_AVX2_H
#define DVSM_KERNELS_FIXED_AVX2_H

#include <immintrin.h>

#include "kernels/fixed_math.h"
#include "kernels/tier.h"

/** Rows that meet sixteen columns at a time: 8 sums, 4 words of columns, 2 broadcasts. */
#define DVSM_AVX2_ROWS 4

/** 0 1 2 3 to 0 2 1 3, in every four words. */
static inline __m256i order_words(__m256i words)
{
	const __m256i order = _mm256_broadcastsi128_si256(
		_mm_setr_epi8(0, 1, 4, 5, 2, 3, 6, 7, 8, 9, 12, 13, 10, 11, 14, 15));

	return _mm256_shuffle_epi8(words, order);
}

/** Sizes of `count` bytes, a multiple of 16. */
static inline void size_bytes(const int8_t *bytes, size_t count, uint8_t *sizes)
{
	for (size_t i = 0; i < count; i += 16) {
		__m128i a = _mm_loadu_si128((const __m128i *)(bytes + i));

		_mm_storeu_si128((__m128i *)(sizes + i), _mm_abs_epi8(a));
	}
}

static inline __m256i broadcast_bytes(const void *four)
{
	int bits;

	memcpy(&bits, four, sizeof(bits));
	return _mm256_set1_epi32(bits);
}

/** Bytes of the rows that meet sixteen columns, and their sizes. */
struct rows {
	const int8_t *bytes[DVSM_AVX2_ROWS];
	const uint8_t *sizes[DVSM_AVX2_ROWS];
};

/** sums += `steps` times four numbers of each row with sixteen packed columns, 64 bytes a step. */
DVSM_INLINE void dot_bytes(const int rows, const struct rows *a, const int8_t *columns,
			   size_t steps, __m256i sums[DVSM_AVX2_ROWS][2])
{
	const __m256i ones = _mm256_set1_epi16(1);

	for (size_t at = 0; at < 4 * steps; at += 4, columns += 64) {
		const __m256i left = _mm256_load_si256((const __m256i *)columns);
		const __m256i right = _mm256_load_si256((const __m256i *)(columns + 32));

		DVSM_UNROLL
		for (int i = 0; i < rows; i++) {
			__m256i x = broadcast_bytes(a->bytes[i] + at);
			__m256i size = broadcast_bytes(a->sizes[i] + at);
			__m256i l = _mm256_maddubs_epi16(size, _mm256_sign_epi8(left, x));
			__m256i r = _mm256_maddubs_epi16(size, _mm256_sign_epi8(right, x));

			sums[i][0] = _mm256_add_epi32(sums[i][0], _mm256_madd_epi16(l, ones));
			sums[i][1] = _mm256_add_epi32(sums[i][1], _mm256_madd_epi16(r, ones));
		}
	}
}

static inline __m256i broadcast_words(const int16_t *words)
{
	int pair;

	memcpy(&pair, words, sizeof(pair));
	return _mm256_set1_epi32(pair);
}

/**
 * sums += `steps` times four numbers of each row with sixteen packed columns.
 *
 * words    of each row, ordered, 4 a step
 * columns  64 bytes a step, `step_bytes` apart
 */
DVSM_INLINE void dot_words(const int rows, const int16_t *const words[DVSM_AVX2_ROWS],
			   const int8_t *columns, size_t step_bytes, size_t steps,
			   __m256i sums[DVSM_AVX2_ROWS][2])
{
	for (size_t step = 0; step < steps; step++, columns += step_bytes) {
		__m256i even[2], odd[2];

		DVSM_UNROLL
		for (int j = 0; j < 2; j++) {
			__m256i w = _mm256_load_si256((const __m256i *)(columns + 32 * j));

			even[j] = _mm256_srai_epi16(_mm256_slli_epi16(w, 8), 8);
			odd[j] = _mm256_srai_epi16(w, 8);
		}
		DVSM_UNROLL
		for (int i = 0; i < rows; i++) {
			__m256i x = broadcast_words(words[i] + 4 * step);
			__m256i y = broadcast_words(words[i] + 4 * step + 2);

			DVSM_UNROLL
			for (int j = 0; j < 2; j++) {
				__m256i a = _mm256_madd_epi16(x, even[j]);
				__m256i b = _mm256_madd_epi16(y, odd[j]);

				sums[i][j] = _mm256_add_epi32(sums[i][j], _mm256_add_epi32(a, b));
			}
		}
	}
}

/** R(a, shift) of 64-bit lanes, |a| below 2^62, shift 1..62: AVX2 shifts in zeros only. */
static inline __m256i round_wide(__m256i a, __m256i shift)
{
	const __m256i bias = _mm256_set1_epi64x((int64_t)1 << 62), one = _mm256_set1_epi64x(1);
	__m256i half = _mm256_sllv_epi64(one, _mm256_sub_epi64(shift, one));

	a = _mm256_add_epi64(a, _mm256_add_epi64(bias, half));
	return _mm256_sub_epi64(_mm256_srlv_epi64(a, shift), _mm256_srlv_epi64(bias, shift));
}

static inline __m256i saturate_wide(__m256i a, int64_t limit)
{
	const __m256i top = _mm256_set1_epi64x(limit - 1), bottom = _mm256_set1_epi64x(-limit);

	a = _mm256_blendv_epi8(a, top, _mm256_cmpgt_epi64(a, top));
	return _mm256_blendv_epi8(a, bottom, _mm256_cmpgt_epi64(bottom, a));
}

/** R(a b, shift) in 32-bit lanes, shift 1..62, saturated to -limit .. limit - 1, or its lower 32
 * bits where limit is 0. */
static inline __m256i round_products(__m256i a, __m256i b, __m256i shift, int64_t limit)
{
	const __m256i low = _mm256_set1_epi64x(0xffffffff);
	__m256i even = _mm256_mul_epi32(a, b);
	__m256i odd = _mm256_mul_epi32(_mm256_srli_epi64(a, 32), _mm256_srli_epi64(b, 32));

	even = round_wide(even, _mm256_and_si256(shift, low));
	odd = round_wide(odd, _mm256_srli_epi64(shift, 32));
	if (limit) {
		even = saturate_wide(even, limit);
		odd = saturate_wide(odd, limit);
	}
	return _mm256_blend_epi32(even, _mm256_slli_epi64(odd, 32), 0xaa);
}

static inline __m256i clamp_lanes(__m256i a, int low, int high)
{
	return _mm256_max_epi32(_mm256_min_epi32(a, _mm256_set1_epi32(high)),
				_mm256_set1_epi32(low));
}

/** Eight int16 as 32-bit lanes, the first n of them where n is below 8. */
static inline __m256i load_s16(const int16_t *p, size_t n)
{
	int16_t part[8] = {0};

	if (n >= 8)
		return _mm256_cvtepi16_epi32(_mm_loadu_si128((const __m128i *)p));
	memcpy(part, p, n * sizeof(*p));
	return _mm256_cvtepi16_epi32(_mm_loadu_si128((const __m128i *)part));
}

/** Lanes that fit, to int16. */
static inline void store_s16(int16_t *p, __m256i a, size_t n)
{
	__m256i packed = _mm256_permute4x64_epi64(_mm256_packs_epi32(a, a), 0x08);
	__m128i words = _mm256_castsi256_si128(packed);

	if (n >= 8)
		_mm_storeu_si128((__m128i *)p, words);
	else
		memcpy(p, &words, n * sizeof(*p));
}

#endif
