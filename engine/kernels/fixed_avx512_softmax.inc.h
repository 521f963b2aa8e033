/*
 * Template: fixed-point attention of AVX-512 beside its products. Included by each tier after
 * QUERIES, the queries that pass over the keys together; behind its score() and mix() the tier
 * includes fixed_avx512_attend.inc.h.
 */
#include "kernels/fixed_avx512.h"

/* A query on its way; the arrays lie in the scratch. */
struct query {
	const int8_t *q;
	struct dvsm_fixed_scale scale;
	struct dvsm_fixed_slope slope;
	int32_t offset; /* -128 times the sum of q */
	int32_t top;
	int64_t sum;
	int32_t *scores; /* [DVSM_FIXED_KEYS] */
	uint8_t *high;   /* [DVSM_FIXED_KEYS] planes of the weights */
	uint8_t *low;
	int32_t *o; /* [head_width] */
};

/* What is behind the last key, up to the whole vectors that weigh() reads, weighs nothing. */
static int32_t largest_score(struct query *query, size_t count)
{
	__m512i largest = _mm512_set1_epi32(INT32_MIN);
	size_t key = 0;

	for (; key + 16 <= count; key += 16)
		largest = _mm512_max_epi32(largest, _mm512_load_si512(query->scores + key));
	if (key < count) {
		__m512i scores = _mm512_mask_loadu_epi32(largest, first_lanes(count - key),
							 query->scores + key);

		largest = _mm512_max_epi32(largest, scores);
	}
	return _mm512_reduce_max_epi32(largest);
}

/* dvsm_fixed_exp2() of 32 numbers. */
static inline __m512i exp2_lanes(__m512i x, int up)
{
	if (up > 0) {
		__mmask32 beyond =
			_mm512_cmpgt_epu16_mask(x, _mm512_set1_epi16((int16_t)(65535u >> up)));

		x = _mm512_mask_mov_epi16(_mm512_sll_epi16(x, _mm_cvtsi32_si128(up)), beyond,
					  _mm512_set1_epi16(-1));
	}

	__m512i t = _mm512_slli_epi16(_mm512_and_si512(x, _mm512_set1_epi16(2047)), 4);
	__m512i r = _mm512_set1_epi16(DVSM_FIXED_EXP2_D);

	r = _mm512_sub_epi16(_mm512_set1_epi16(DVSM_FIXED_EXP2_C), _mm512_mulhrs_epi16(t, r));
	r = _mm512_sub_epi16(_mm512_set1_epi16(DVSM_FIXED_EXP2_B), _mm512_mulhrs_epi16(t, r));
	r = _mm512_sub_epi16(_mm512_set1_epi16(DVSM_FIXED_EXP2_A), _mm512_mulhrs_epi16(t, r));
	r = _mm512_mulhrs_epi16(t, r);

	__m512i power = _mm512_sub_epi16(_mm512_set1_epi16(-1), _mm512_add_epi16(r, r));

	power = _mm512_srlv_epi16(power, _mm512_srli_epi16(x, 11));
	return _mm512_avg_epu16(power, _mm512_setzero_si512());
}

/* Weights of two vectors of scores, as vpackusdw leaves them: quarters of each in turn. */
static inline __m512i weigh_pair(const struct query *query, const int32_t *scores)
{
	const __m512i top = _mm512_set1_epi32(query->top);
	const __m128i down = _mm_cvtsi32_si128(query->slope.down);
	__m512i a = _mm512_sub_epi32(top, _mm512_load_si512(scores));
	__m512i b = _mm512_sub_epi32(top, _mm512_load_si512(scores + 16));
	__m512i x = _mm512_packus_epi32(_mm512_sra_epi32(a, down), _mm512_sra_epi32(b, down));

	x = _mm512_mulhi_epu16(x, _mm512_set1_epi16((int16_t)query->slope.factor));
	return exp2_lanes(x, query->slope.up);
}

/* Scores to planes of weights, and their sum; 64 keys at a time, zeros behind the last. */
static void weigh(struct query *query, size_t count)
{
	const __m512i byte = _mm512_set1_epi16(255), ones = _mm512_set1_epi8(1);
	const __m512i order =
		_mm512_setr_epi32(0, 4, 8, 12, 1, 5, 9, 13, 2, 6, 10, 14, 3, 7, 11, 15);
	__m512i high_sum = _mm512_setzero_si512(), low_sum = high_sum;

	for (size_t key = 0; key < count; key += 64) {
		__mmask64 lanes =
			count - key >= 64 ? ~(__mmask64)0 : ((__mmask64)1 << (count - key)) - 1;
		__m512i p = weigh_pair(query, query->scores + key);
		__m512i r = weigh_pair(query, query->scores + key + 32);
		__m512i high =
			_mm512_packus_epi16(_mm512_srli_epi16(p, 8), _mm512_srli_epi16(r, 8));
		__m512i low =
			_mm512_packus_epi16(_mm512_and_si512(p, byte), _mm512_and_si512(r, byte));

		high = _mm512_maskz_mov_epi8(lanes, _mm512_permutexvar_epi32(order, high));
		low = _mm512_maskz_mov_epi8(lanes, _mm512_permutexvar_epi32(order, low));
		_mm512_store_si512(query->high + key, high);
		_mm512_store_si512(query->low + key, low);
		high_sum = _mm512_dpbusd_epi32(high_sum, high, ones);
		low_sum = _mm512_dpbusd_epi32(low_sum, low, ones);
	}
	query->sum +=
		(int64_t)_mm512_reduce_add_epi32(high_sum) * 256 + _mm512_reduce_add_epi32(low_sum);
}

/* R(o, steps) in place; a shift of 32 and more leaves nothing of 32 bits. */
static void shrink(struct query *query, size_t head_width, int steps)
{
	const __m128i before = _mm_cvtsi32_si128(steps - 1);
	const __m512i one = _mm512_set1_epi32(1);

	query->sum = dvsm_fixed_round(query->sum, steps);
	if (steps == 0)
		return;
	for (size_t d = 0; d < head_width; d += 16) {
		__m512i o = _mm512_load_si512(query->o + d);

		/* An arithmetic shift by 32 or more fills with the sign: -1, and R gives 0. */
		o = _mm512_sra_epi32(o, before);
		o = _mm512_srai_epi32(_mm512_add_epi32(o, one), 1);
		_mm512_store_si512(query->o + d, o);
	}
}
