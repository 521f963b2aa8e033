/*
 * Fixed-point softmax of AVX-512: scores to words, words to weights in planes, and what comes of
 * the sums. Private to its tiers.
 */
#ifndef DVSM_KERNELS_FIXED_AVX512_SOFTMAX_H
#define DVSM_KERNELS_FIXED_AVX512_SOFTMAX_H

#include "kernels/fixed_avx512.h"
#include "kernels/tier.h"

/* ---- words ---- */

/*
 * Scores of 32 keys to words, as vpackssdw leaves them: four of the first sixteen, four of the
 * others. That is the order of all words here.
 */
static inline __m512i score_words(__m512i first, __m512i second, __m512i shift)
{
	return _mm512_packs_epi32(_mm512_srav_epi32(first, shift),
				  _mm512_srav_epi32(second, shift));
}

/* dvsm_fixed_score_shift() */
static inline int score_shift(const int8_t *q, size_t key_width)
{
	__m512i sum = _mm512_setzero_si512();

	for (size_t d = 0; d < key_width; d += 64) {
		const __mmask16 lanes = first_lanes((key_width - d) / 4);
		const __m512i numbers = _mm512_abs_epi8(_mm512_maskz_loadu_epi32(lanes, q + d));

		sum = _mm512_add_epi64(sum, _mm512_sad_epu8(numbers, _mm512_setzero_si512()));
	}
	return dvsm_fixed_word_shift((uint32_t)_mm512_reduce_add_epi64(sum));
}

/* Of 64 words from `first` on, 0 or 32, those whose key is below count. */
static inline __mmask32 word_lanes(size_t first, size_t count)
{
	const __m512i keys =
		_mm512_set_epi16(31, 30, 29, 28, 15, 14, 13, 12, 27, 26, 25, 24, 11, 10, 9, 8, 23,
				 22, 21, 20, 7, 6, 5, 4, 19, 18, 17, 16, 3, 2, 1, 0);
	const size_t left = count > first ? count - first : 0;

	return _mm512_cmplt_epi16_mask(keys, _mm512_set1_epi16((int16_t)(left < 32 ? left : 32)));
}

/* The larger of each two neighbours, in 32 bits. */
static inline __m512i larger_words(__m512i words)
{
	return _mm512_max_epi32(_mm512_srai_epi32(words, 16),
				_mm512_srai_epi32(_mm512_slli_epi32(words, 16), 16));
}

/* ---- weights ---- */

/* What makes words of a query's scores, and what all of these meet: each twice, in both words of
 * 32 bits. */
struct slope {
	int32_t shift; /* once */
	int32_t top;
	int32_t factor;
	int32_t left, right; /* to the fraction's 16 bits; to twice the whole power */
};

static inline int32_t twice(int32_t word)
{
	return (int32_t)(((uint32_t)word & 0xffff) * 0x10001u);
}

static inline struct slope slope_make(struct dvsm_fixed_scale scale, const int8_t *q,
				      size_t key_width)
{
	const int shift = score_shift(q, key_width);
	const struct dvsm_fixed_slope slope = dvsm_fixed_slope_make(scale, shift);

	return (struct slope){
		.shift = shift,
		.factor = twice(slope.factor),
		.left = twice(16 - slope.fraction),
		.right = twice(slope.fraction - 1),
	};
}

/* What does not change from query to query, in registers. */
struct softmax_lanes {
	__m512i c, b, a, one; /* of the polynomial of 2^-t */
	__m512i zero, ones;
	__m512i apart, order; /* of bytes in quarters, of what two packs made of four */
};

static inline struct softmax_lanes softmax_lanes_make(void)
{
	return (struct softmax_lanes){
		.c = keep(_mm512_set1_epi16(DVSM_FIXED_EXP2_C)),
		.b = keep(_mm512_set1_epi16(DVSM_FIXED_EXP2_B)),
		.a = keep(_mm512_set1_epi16(DVSM_FIXED_EXP2_A)),
		.one = keep(_mm512_set1_epi16((int16_t)DVSM_FIXED_EXP2_ONE)),
		.zero = keep(_mm512_setzero_si512()),
		.ones = keep(_mm512_set1_epi16(1)),
		.apart = keep(_mm512_set4_epi32(0x0e0c0a08, 0x06040200, 0x0f0d0b09, 0x07050301)),
		.order = keep(order_of_four()),
	};
}

/* A slope in all lanes. */
struct slope_lanes {
	__m512i top, factor, left, right;
};

/* Weights of 32 keys. */
DVSM_INLINE __m512i weigh_words(const struct softmax_lanes *lanes, const struct slope_lanes *slope,
				const int16_t *words)
{
	__m512i way = _mm512_sub_epi16(slope->top, _mm512_load_si512(words));
	__m512i x = _mm512_mulhi_epu16(way, slope->factor);
	__m512i whole = _mm512_avg_epu16(_mm512_srlv_epi16(x, slope->right), lanes->zero);
	__m512i t = _mm512_sllv_epi16(x, slope->left), r = lanes->c;

	r = _mm512_sub_epi16(lanes->b, _mm512_mulhrs_epi16(t, r));
	r = _mm512_sub_epi16(lanes->a, _mm512_mulhrs_epi16(t, r));
	r = _mm512_sub_epi16(lanes->one, _mm512_mulhrs_epi16(t, r));
	return _mm512_avg_epu16(_mm512_srlv_epi16(r, whole), lanes->zero);
}

/* Words to planes of weights, 64 keys at a time, zeros behind the last; adds them to `sum`. */
DVSM_INLINE __m512i weigh_keys(const struct softmax_lanes *lanes, const struct slope *query,
			       const int16_t *words, uint8_t *high, uint8_t *low, size_t count,
			       __m512i sum)
{
	const struct slope_lanes slope = {
		.top = _mm512_set1_epi32(query->top),
		.factor = _mm512_set1_epi32(query->factor),
		.left = _mm512_set1_epi32(query->left),
		.right = _mm512_set1_epi32(query->right),
	};

	for (size_t key = 0; key < count; key += 64) {
		const size_t left = count - key;
		__m512i p = weigh_words(lanes, &slope, words + key);
		__m512i r = weigh_words(lanes, &slope, words + key + 32);

		if (left < 64) {
			p = _mm512_maskz_mov_epi16(word_lanes(0, left), p);
			r = _mm512_maskz_mov_epi16(word_lanes(32, left), r);
		}
		sum = _mm512_dpwssd_epi32(sum, p, lanes->ones);
		sum = _mm512_dpwssd_epi32(sum, r, lanes->ones);

		/* In each quarter the high bytes, then the low ones. */
		p = _mm512_shuffle_epi8(p, lanes->apart);
		r = _mm512_shuffle_epi8(r, lanes->apart);
		_mm512_store_si512(high + key, _mm512_permutexvar_epi32(
						       lanes->order, _mm512_unpacklo_epi64(p, r)));
		_mm512_store_si512(low + key, _mm512_permutexvar_epi32(
						      lanes->order, _mm512_unpackhi_epi64(p, r)));
	}
	return sum;
}

/* ---- the output ---- */

/* Sixteen channels of the output: what turns sums of weighted values into them. */
struct channels {
	__mmask16 lanes;
	bool high; /* what is dropped is 33 bits at least: the upper halves of products do */
	__m512i factor, shift, mean;
};

static inline struct channels load_channels(const struct dvsm_fixed_attention *job, size_t d)
{
	const __mmask16 lanes = first_lanes(job->dim - d);
	const __m512i bits = _mm512_set1_epi32(DVSM_FIXED_QUOTIENT_BITS);
	__m512i scale = _mm512_maskz_loadu_epi32(lanes, job->v_scale + d);
	__m512i shift = clamp_shift(_mm512_sub_epi32(bits, _mm512_srai_epi32(scale, 16)));
	const bool high = !_mm512_cmplt_epi32_mask(shift, _mm512_set1_epi32(33));

	return (struct channels){
		.lanes = lanes,
		.high = high,
		.factor = _mm512_and_si512(scale, _mm512_set1_epi32(0x7fff)),
		.shift = high ? _mm512_sub_epi32(shift, _mm512_set1_epi32(33)) : shift,
		.mean = _mm512_cvtepi16_epi32(_mm256_maskz_loadu_epi16(lanes, job->v_mean + d)),
	};
}

/* O' of eight channels: 256 high + low in 64-bit lanes, brought to 24 bits below the sum's. */
static inline __m256i lift_half(__m256i high, __m256i low, int down)
{
	__m512i o = _mm512_add_epi64(_mm512_slli_epi64(_mm512_cvtepi32_epi64(high), 8),
				     _mm512_cvtepi32_epi64(low));

	o = _mm512_sra_epi64(o, _mm_cvtsi32_si128(down - 1));
	o = _mm512_srai_epi64(_mm512_add_epi64(o, _mm512_set1_epi64(1)), 1);
	return _mm512_cvtepi64_epi32(o);
}

/* O' of sixteen, which fits 32 bits; so does O where it has to grow. */
static inline __m512i lift(__m512i high, __m512i low, int up)
{
	if (up >= 0)
		return _mm512_sll_epi32(_mm512_add_epi32(_mm512_slli_epi32(high, 8), low),
					_mm_cvtsi32_si128(up));
	return _mm512_inserti64x4(
		_mm512_castsi256_si512(
			lift_half(_mm512_castsi512_si256(high), _mm512_castsi512_si256(low), -up)),
		lift_half(_mm512_extracti64x4_epi64(high, 1), _mm512_extracti64x4_epi64(low, 1),
			  -up),
		1);
}

/* o / sum of sixteen channels, in the output's units. */
static inline void write_channels(const struct channels *channels,
				  struct dvsm_fixed_quotient quotient, __m512i high, __m512i low,
				  int16_t *out)
{
	const __m512i inverse = _mm512_set1_epi32(quotient.inverse), one = _mm512_set1_epi32(1);
	__m512i o = lift(high, low, quotient.up), r;

	if (channels->high) {
		__m512i even = _mm512_mul_epi32(inverse, channels->factor);
		__m512i odd = _mm512_mul_epi32(inverse, odd_lanes(channels->factor));

		even = _mm512_shuffle_epi32(_mm512_mul_epi32(o, even), _MM_PERM_CDAB);
		odd = _mm512_mul_epi32(odd_lanes(o), odd);
		r = _mm512_srav_epi32(_mm512_mask_mov_epi32(even, 0xaaaa, odd), channels->shift);
		r = _mm512_srai_epi32(_mm512_add_epi32(r, one), 1);
	} else {
		__m512i factor = _mm512_mullo_epi32(inverse, channels->factor);

		r = wide_saturate(round_products(o, factor, channels->shift), 1 << 30);
	}
	r = _mm512_add_epi32(r, channels->mean);
	_mm256_mask_storeu_epi16(out, channels->lanes, _mm512_cvtsepi32_epi16(r));
}

#endif
