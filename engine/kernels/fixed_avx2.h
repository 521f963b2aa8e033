/*
 * What the fixed-point kernels of AVX2 share, and those of AVX-VNNI, which are the same with its
 * products. Private.
 *
 * Weights of 15 bits are multiplied as words. Four packed bytes of a column are two words of even
 * and two of odd place; weights come as words in the order 0 2 1 3, so that each of the two
 * products of words meets its two in one broadcast of 32 bits.
 */
#ifndef DVSM_KERNELS_FIXED_AVX2_H
#define DVSM_KERNELS_FIXED_AVX2_H

#include <immintrin.h>

#include "kernels/fixed_math.h"
#include "kernels/tier.h"

/** Rows of words that meet sixteen columns at a time: 8 sums, 4 words of columns, 2 broadcasts. */
#define WORD_ROWS 4

/** 0 1 2 3 to 0 2 1 3, in every four words. */
static inline __m256i order_words(__m256i words)
{
	const __m256i order = _mm256_broadcastsi128_si256(
		_mm_setr_epi8(0, 1, 4, 5, 2, 3, 6, 7, 8, 9, 12, 13, 10, 11, 14, 15));

	return _mm256_shuffle_epi8(words, order);
}

static inline __m256i broadcast_bytes(const void *four)
{
	int bits;

	memcpy(&bits, four, sizeof(bits));
	return _mm256_set1_epi32(bits);
}

#if defined(__AVXVNNI__) || defined(DVSM_AVXVNNI_MODEL)

/* Tests compile the same instructions in the encoding that AVX-512 VNNI has for them. */
#if defined(DVSM_AVXVNNI_MODEL)
#define VNNI_ENCODING "%{evex%} "
#define add_bytes_128 _mm_dpbusd_epi32
#else
#define VNNI_ENCODING "%{vex%} "
#define add_bytes_128 _mm_dpbusd_avx_epi32
#endif

/*
 * vpdpbusd multiplies unsigned by signed bytes: the columns are the unsigned ones, 128 too large,
 * and 128 times the sum of the row's bytes is taken off where a sum begins.
 */
struct row_bytes {
	const int8_t *bytes;
	int32_t begin;
};

/** Rows of bytes that meet sixteen columns at a time: 12 sums, 2 columns, 1 broadcast. */
#define BYTE_ROWS 6

/** sums += fours of unsigned times signed bytes. gcc 12 moves and spills sums of the intrinsics. */
static inline __m256i add_bytes(__m256i sums, __m256i unsigned_bytes, __m256i signed_bytes)
{
	__asm__(VNNI_ENCODING "vpdpbusd %2, %1, %0"
		: "+x"(sums)
		: "x"(unsigned_bytes), "x"(signed_bytes));
	return sums;
}

/** sums += pairs of words */
static inline __m256i add_words(__m256i sums, __m256i a, __m256i b)
{
	__asm__(VNNI_ENCODING "vpdpwssd %2, %1, %0" : "+x"(sums) : "x"(a), "x"(b));
	return sums;
}

/** Room that a row of `count` bytes needs beside them. */
#define ROW_ROOM(count) 1

/** `count`, a multiple of 16, bytes of a row, as dot_bytes() takes them. */
static inline struct row_bytes row_prepare(const int8_t *bytes, size_t count, uint8_t *room)
{
	const __m128i ones = _mm_set1_epi8(1);
	__m128i sum = _mm_setzero_si128();

	(void)room;
	for (size_t i = 0; i < count; i += 16)
		sum = add_bytes_128(sum, ones, _mm_loadu_si128((const __m128i *)(bytes + i)));
	sum = _mm_add_epi32(sum, _mm_shuffle_epi32(sum, 0x4e));
	sum = _mm_add_epi32(sum, _mm_shuffle_epi32(sum, 0xb1));
	return (struct row_bytes){bytes, -128 * _mm_cvtsi128_si32(sum)};
}

/** sums += `steps` times four numbers of each row with sixteen packed columns, 64 bytes a step. */
DVSM_INLINE void dot_bytes(const int rows, const struct row_bytes *a, const int8_t *columns,
			   size_t steps, __m256i sums[][2])
{
	const __m256i flip = _mm256_set1_epi8(INT8_MIN);

	for (size_t at = 0; at < 4 * steps; at += 4, columns += 64) {
		__m256i left = _mm256_load_si256((const __m256i *)columns);
		__m256i right = _mm256_load_si256((const __m256i *)(columns + 32));

		left = _mm256_xor_si256(left, flip);
		right = _mm256_xor_si256(right, flip);
		DVSM_UNROLL
		for (int i = 0; i < rows; i++) {
			__m256i x = broadcast_bytes(a[i].bytes + at);

			sums[i][0] = add_bytes(sums[i][0], left, x);
			sums[i][1] = add_bytes(sums[i][1], right, x);
		}
	}
}

#else

#include "kernels/fixed_signs.h"

/* 8 sums, 2 columns, 4 on the way to a sum, ones. */
#define BYTE_ROWS 4

/** sums += a. gcc 12 moves and spills sums of the intrinsic. */
static inline __m256i add_sums(__m256i sums, __m256i a)
{
	__asm__("vpaddd %1, %0, %0" : "+x"(sums) : "x"(a));
	return sums;
}

DVSM_INLINE void dot_bytes(const int rows, const struct row_bytes *a, const int8_t *columns,
			   size_t steps, __m256i sums[][2])
{
	const __m256i ones = _mm256_set1_epi16(1);

	for (size_t at = 0; at < 8 * steps; at += 8, columns += 64) {
		__m256i left = _mm256_load_si256((const __m256i *)columns);
		__m256i right = _mm256_load_si256((const __m256i *)(columns + 32));

		/* In registers: gcc 12 would read them again for each row. */
		__asm__("" : "+x"(left), "+x"(right));
		DVSM_UNROLL
		for (int i = 0; i < rows; i++) {
			__m256i signs = broadcast_bytes(a[i].steps + at);
			__m256i sizes = broadcast_bytes(a[i].steps + at + 4);
			__m256i l = _mm256_maddubs_epi16(sizes, _mm256_xor_si256(left, signs));
			__m256i r = _mm256_maddubs_epi16(sizes, _mm256_xor_si256(right, signs));

			sums[i][0] = add_sums(sums[i][0], _mm256_madd_epi16(l, ones));
			sums[i][1] = add_sums(sums[i][1], _mm256_madd_epi16(r, ones));
		}
	}
}

static inline __m256i add_words(__m256i sums, __m256i a, __m256i b)
{
	return add_sums(sums, _mm256_madd_epi16(a, b));
}

#endif

/** What a sum over the row's bytes begins with. */
static inline __m256i row_begin(const struct row_bytes *row)
{
	return _mm256_set1_epi32(row->begin);
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
DVSM_INLINE void dot_words(const int rows, const int16_t *const words[WORD_ROWS],
			   const int8_t *columns, size_t step_bytes, size_t steps,
			   __m256i sums[][2])
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
				sums[i][j] = add_words(sums[i][j], x, even[j]);
				sums[i][j] = add_words(sums[i][j], y, odd[j]);
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
