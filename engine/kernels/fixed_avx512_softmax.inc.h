/*
 * Template: fixed-point attention of AVX-512 beside its products. Included by each tier after
 *
 *   SCORE_STEP   numbers from sixteen scores of a query to its next sixteen
 *   WEIGHT_STEP  bytes from 64 weights of a query, of either plane, to its next 64
 */
#include "kernels/fixed_avx512.h"
#include "kernels/tier.h"

/* A query on its way; the arrays lie in the scratch. */
struct query {
	const int8_t *q;
	struct dvsm_fixed_slope slope;
	int32_t factor; /* the slope's, twice */
	int32_t offset; /* -128 times the sum of q */
	int32_t top;
	int64_t sum;
	int32_t *scores; /* as many as are kept */
	uint8_t *high;   /* [DVSM_FIXED_KEYS] planes of the weights */
	uint8_t *low;
	int32_t *o;     /* [head_width] sums with the high plane */
	int32_t *o_low; /* [head_width] sums with the low one */
};

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

/* What all scores of a query meet. */
struct slope_lanes {
	__m512i top, factor, limit;
	__m128i down, up;
};

static inline struct slope_lanes slope_prepare(const struct query *query)
{
	const struct dvsm_fixed_slope slope = query->slope;

	return (struct slope_lanes){
		.top = _mm512_set1_epi32(query->top),
		.factor = _mm512_set1_epi32(query->factor),
		.limit = _mm512_set1_epi16((int16_t)(65535u >> slope.up)),
		.down = _mm_cvtsi32_si128(slope.down),
		.up = _mm_cvtsi32_si128(slope.up),
	};
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

/* Weights of 32 keys, as vpackusdw leaves them: four of the first sixteen, four of the others. */
DVSM_INLINE __m512i weigh_pair(const bool down, const bool up, const struct slope_lanes *slope,
			       const int32_t *scores)
{
	__m512i a = _mm512_sub_epi32(slope->top, _mm512_load_si512(scores));
	__m512i b = _mm512_sub_epi32(slope->top, _mm512_load_si512(scores + SCORE_STEP));

	if (down) {
		a = _mm512_sra_epi32(a, slope->down);
		b = _mm512_sra_epi32(b, slope->down);
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
DVSM_INLINE __m512i weigh_keys(const bool down, const bool up, const struct query *query,
			       const int32_t *scores, uint8_t *high, uint8_t *low, size_t count)
{
	const struct slope_lanes slope = slope_prepare(query);
	const __m512i byte = _mm512_set1_epi16(255), ones = _mm512_set1_epi16(1);
	const __m512i order =
		_mm512_setr_epi32(0, 4, 8, 12, 1, 5, 9, 13, 2, 6, 10, 14, 3, 7, 11, 15);
	__m512i sum = _mm512_setzero_si512(), other = sum;

	for (size_t key = 0; key < count; key += 64, scores += 4 * SCORE_STEP) {
		const size_t left = count - key;
		__m512i p = weigh_pair(down, up, &slope, scores);
		__m512i r = weigh_pair(down, up, &slope, scores + 2 * SCORE_STEP);

		if (left < 64) {
			p = _mm512_maskz_mov_epi16(pair_lanes(left), p);
			r = _mm512_maskz_mov_epi16(pair_lanes(left > 32 ? left - 32 : 0), r);
		}
		sum = _mm512_dpwssd_epi32(sum, p, ones);
		other = _mm512_dpwssd_epi32(other, r, ones);

		__m512i upper =
			_mm512_packus_epi16(_mm512_srli_epi16(p, 8), _mm512_srli_epi16(r, 8));
		__m512i lower =
			_mm512_packus_epi16(_mm512_and_si512(p, byte), _mm512_and_si512(r, byte));

		_mm512_store_si512(high, _mm512_permutexvar_epi32(order, upper));
		_mm512_store_si512(low, _mm512_permutexvar_epi32(order, lower));
		high += WEIGHT_STEP;
		low += WEIGHT_STEP;
	}
	return _mm512_add_epi32(sum, other);
}

static inline __m512i weigh_scores(const struct query *query, const int32_t *scores, uint8_t *high,
				   uint8_t *low, size_t count)
{
	if (query->slope.up > 0)
		return weigh_keys(false, true, query, scores, high, low, count);
	if (query->slope.down > 0)
		return weigh_keys(true, false, query, scores, high, low, count);
	return weigh_keys(false, false, query, scores, high, low, count);
}

/* O' of eight channels: 256 high + low in 64-bit lanes, brought to 24 bits below the sum's. */
static inline __m512i lift(__m256i high, __m256i low, int up)
{
	__m512i o = _mm512_add_epi64(_mm512_slli_epi64(_mm512_cvtepi32_epi64(high), 8),
				     _mm512_cvtepi32_epi64(low));

	if (up >= 0)
		return _mm512_sll_epi64(o, _mm_cvtsi32_si128(up));
	o = _mm512_sra_epi64(o, _mm_cvtsi32_si128(-up - 1));
	return _mm512_srai_epi64(_mm512_add_epi64(o, _mm512_set1_epi64(1)), 1);
}

/* Likewise of sixteen, in 32. */
static inline __m512i lift_row(const struct query *query, size_t d, int up)
{
	__m512i high = _mm512_load_si512(query->o + d), low = _mm512_load_si512(query->o_low + d);
	__m512i first = lift(_mm512_castsi512_si256(high), _mm512_castsi512_si256(low), up);
	__m512i second =
		lift(_mm512_extracti64x4_epi64(high, 1), _mm512_extracti64x4_epi64(low, 1), up);

	return _mm512_inserti64x4(_mm512_castsi256_si512(_mm512_cvtepi64_epi32(first)),
				  _mm512_cvtepi64_epi32(second), 1);
}

/* o / sum, in the output's units. */
static void write_out(const struct dvsm_fixed_attention *job, const struct query *query,
		      int16_t *out)
{
	const struct dvsm_fixed_quotient quotient = dvsm_fixed_divide((uint64_t)query->sum);
	const __m512i inverse = _mm512_set1_epi32(quotient.inverse);
	const __m512i most = _mm512_set1_epi32(INT16_MAX), least = _mm512_set1_epi32(INT16_MIN);
	const __m512i bits = _mm512_set1_epi32(DVSM_FIXED_QUOTIENT_BITS);

	for (size_t d = 0; d < job->dim; d += 16) {
		__mmask16 lanes = first_lanes(job->dim - d);
		__m512i scale = _mm512_maskz_loadu_epi32(lanes, job->v_scale + d);
		__m512i mean =
			_mm512_cvtepi16_epi32(_mm256_maskz_loadu_epi16(lanes, job->v_mean + d));
		__m512i factor = _mm512_mullo_epi32(
			inverse, _mm512_and_si512(scale, _mm512_set1_epi32(0x7fff)));
		__m512i shift = clamp_shift(_mm512_sub_epi32(bits, _mm512_srai_epi32(scale, 16)));
		struct wide r = round_products(lift_row(query, d, quotient.up), factor, shift);
		__m512i sum = _mm512_add_epi32(mean, wide_saturate(r, 1 << 30));

		sum = _mm512_max_epi32(_mm512_min_epi32(sum, most), least);
		_mm512_mask_cvtepi32_storeu_epi16(out + d, lanes, sum);
	}
}

static void start(const struct dvsm_fixed_attention *job, size_t index, struct query *query)
{
	const __m512i ones = _mm512_set1_epi8(1);
	__m512i sum = _mm512_setzero_si512();

	query->q = job->q + index * job->q_stride;
	query->slope = dvsm_fixed_slope_make(job->q_scale[index * job->scale_stride]);
	query->factor = (int32_t)(query->slope.factor * 0x10001u);
	query->top = 0;
	query->sum = 0;
	for (size_t d = 0; d < job->head_width; d += 16)
		sum = _mm512_dpbusd_epi32(sum, ones, _mm512_maskz_loadu_epi32(0xf, query->q + d));
	query->offset = -128 * _mm512_reduce_add_epi32(sum);
	memset(query->o, 0, job->head_width * sizeof(*query->o));
	memset(query->o_low, 0, job->head_width * sizeof(*query->o_low));
}
