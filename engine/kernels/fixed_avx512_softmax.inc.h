/*
 * Template: fixed-point attention of AVX-512 beside its products. Included by each tier after
 *
 *   SCORE_STEP   numbers from sixteen scores of a query to its next sixteen
 *   WEIGHT_STEP  bytes from 64 weights of a query, of either plane, to its next 64
 */
#include "kernels/fixed_avx512.h"
#include "kernels/tier.h"

/* What all scores of a query meet. */
struct slope {
	int32_t factor; /* twice, in both words */
	int32_t down, up;
};

static inline struct slope slope_make(struct dvsm_fixed_scale scale)
{
	const struct dvsm_fixed_slope slope = dvsm_fixed_slope_make(scale);

	return (struct slope){
		.factor = (int32_t)(slope.factor * 0x10001u), .down = slope.down, .up = slope.up};
}

static inline __m512i largest_lanes(const int32_t *scores, size_t count)
{
	__m512i largest = _mm512_set1_epi32(INT32_MIN), other = largest;
	size_t key = 0;

	for (; key + 32 <= count; key += 32, scores += 2 * SCORE_STEP) {
		largest = _mm512_max_epi32(largest, _mm512_load_si512(scores));
		other = _mm512_max_epi32(other, _mm512_load_si512(scores + SCORE_STEP));
	}
	for (; key < count; key += 16, scores += SCORE_STEP)
		other = _mm512_mask_max_epi32(other, first_lanes(count - key), other,
					      _mm512_load_si512(scores));
	return _mm512_max_epi32(largest, other);
}

/* dvsm_fixed_exp2() of 32 numbers, which `up` has been applied to. */
static inline __m512i exp2_lanes(__m512i x)
{
	const __m512i zero = _mm512_setzero_si512();
	__m512i whole = _mm512_avg_epu16(_mm512_srli_epi16(x, 10), zero);
	__m512i t = _mm512_slli_epi16(x, 5), r = _mm512_set1_epi16(DVSM_FIXED_EXP2_C);

	r = _mm512_sub_epi16(_mm512_set1_epi16(DVSM_FIXED_EXP2_B), _mm512_mulhrs_epi16(t, r));
	r = _mm512_sub_epi16(_mm512_set1_epi16(DVSM_FIXED_EXP2_A), _mm512_mulhrs_epi16(t, r));
	r = _mm512_sub_epi16(_mm512_set1_epi16((int16_t)DVSM_FIXED_EXP2_ONE),
			     _mm512_mulhrs_epi16(t, r));
	return _mm512_avg_epu16(_mm512_srlv_epi16(r, whole), zero);
}

/* A slope in all lanes. */
struct slope_lanes {
	__m512i top, factor, down, limit;
	__m128i up;
};

/* Weights of 32 keys, as vpackusdw leaves them: four of the first sixteen, four of the others. */
DVSM_INLINE __m512i weigh_pair(const bool up, const struct slope_lanes *slope,
			       const int32_t *scores)
{
	__m512i a = _mm512_sub_epi32(slope->top, _mm512_load_si512(scores));
	__m512i b = _mm512_sub_epi32(slope->top, _mm512_load_si512(scores + SCORE_STEP));

	if (!up) {
		a = _mm512_srav_epi32(a, slope->down);
		b = _mm512_srav_epi32(b, slope->down);
	}

	__m512i x = _mm512_mulhi_epu16(_mm512_packus_epi32(a, b), slope->factor);

	if (up) {
		__mmask32 beyond = _mm512_cmpgt_epu16_mask(x, slope->limit);

		x = _mm512_mask_mov_epi16(_mm512_sll_epi16(x, slope->up), beyond,
					  _mm512_set1_epi16(-1));
	}
	return exp2_lanes(x);
}

/* Those of the weights of weigh_pair() whose key is below count. */
static inline __mmask32 pair_lanes(size_t count)
{
	const __m512i keys =
		_mm512_set_epi16(31, 30, 29, 28, 15, 14, 13, 12, 27, 26, 25, 24, 11, 10, 9, 8, 23,
				 22, 21, 20, 7, 6, 5, 4, 19, 18, 17, 16, 3, 2, 1, 0);

	return _mm512_cmplt_epi16_mask(keys, _mm512_set1_epi16((int16_t)(count < 32 ? count : 32)));
}

/* Scores to planes of weights, 64 keys at a time, zeros behind the last; returns their sums. */
DVSM_INLINE __m512i weigh_keys(const bool up, const struct slope *query, int32_t top,
			       const int32_t *scores, uint8_t *high, uint8_t *low, size_t count)
{
	const struct slope_lanes slope = {
		.top = _mm512_set1_epi32(top),
		.factor = _mm512_set1_epi32(query->factor),
		.down = _mm512_set1_epi32(query->down),
		.limit = _mm512_set1_epi16((int16_t)(65535u >> query->up)),
		.up = _mm_cvtsi32_si128(query->up),
	};
	const __m512i ones = _mm512_set1_epi16(1);
	const __m512i apart = _mm512_set4_epi32(0x0e0c0a08, 0x06040200, 0x0f0d0b09, 0x07050301);
	__m512i sum = _mm512_setzero_si512(), other = sum;

	for (size_t key = 0; key < count; key += 64, scores += 4 * SCORE_STEP) {
		const size_t left = count - key;
		__m512i p = weigh_pair(up, &slope, scores);
		__m512i r = weigh_pair(up, &slope, scores + 2 * SCORE_STEP);

		if (left < 64) {
			p = _mm512_maskz_mov_epi16(pair_lanes(left), p);
			r = _mm512_maskz_mov_epi16(pair_lanes(left > 32 ? left - 32 : 0), r);
		}
		sum = _mm512_dpwssd_epi32(sum, p, ones);
		other = _mm512_dpwssd_epi32(other, r, ones);

		/* In each quarter the high bytes, then the low ones. */
		p = _mm512_shuffle_epi8(p, apart);
		r = _mm512_shuffle_epi8(r, apart);
		_mm512_store_si512(high, in_order_of_four(_mm512_unpacklo_epi64(p, r)));
		_mm512_store_si512(low, in_order_of_four(_mm512_unpackhi_epi64(p, r)));
		high += WEIGHT_STEP;
		low += WEIGHT_STEP;
	}
	return _mm512_add_epi32(sum, other);
}

/* Likewise, where the scores are worth so much that they have to grow. */
static __attribute__((noinline)) __m512i weigh_steep(const struct slope *query, int32_t top,
						     const int32_t *scores, uint8_t *high,
						     uint8_t *low, size_t count)
{
	return weigh_keys(true, query, top, scores, high, low, count);
}

/* Of scores of which `top` is the largest, over all spans and tiles. */
DVSM_INLINE __m512i weigh_scores(const struct slope *query, int32_t top, const int32_t *scores,
				 uint8_t *high, uint8_t *low, size_t count)
{
	if (query->up > 0)
		return weigh_steep(query, top, scores, high, low, count);
	return weigh_keys(false, query, top, scores, high, low, count);
}

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
