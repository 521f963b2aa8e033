/*
 * Fixed-point attention for AVX-512 VNNI: eight queries pass over the keys together.
 *
 * vpdpbusd multiplies unsigned by signed bytes. Scores take the keys as the unsigned ones, 128 too
 * large, and 128 times the sum of the query is taken off; the two planes of the weights are
 * unsigned as they are. Both products have the lanes that the packed layouts give: sixteen keys,
 * then sixteen channels.
 */
#include "kernels/fixed_avx512.h"
#include "kernels/fixed_tiers.h"
#include "kernels/tier.h"

#define QUERIES 8

/* Scores of two groups of keys, and sums of two queries: registers enough to hide the latency. */
#define SCORE_GROUPS 2
#define MIX_QUERIES  2
#define MIX_GROUPS   4

/* Up to here the sums of weighted values fit 32 bits, and the sum of weights needs no shift. */
#define MOST_KEYS 65536u

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

static inline __m512i broadcast(const void *four)
{
	int bits;

	memcpy(&bits, four, sizeof(bits));
	return _mm512_set1_epi32(bits);
}

/* ---- scores ---- */

DVSM_INLINE void score_groups(const int groups, const struct query *queries, const int8_t *k,
			      size_t head_width, size_t at)
{
	const __m512i flip = _mm512_set1_epi8(INT8_MIN);
	__m512i sums[QUERIES][SCORE_GROUPS];

	DVSM_UNROLL
	for (int i = 0; i < QUERIES; i++) {
		DVSM_UNROLL
		for (int j = 0; j < groups; j++)
			sums[i][j] = _mm512_set1_epi32(queries[i].offset);
	}
	for (size_t d = 0; d < head_width; d += 4) {
		__m512i b[SCORE_GROUPS];

		DVSM_UNROLL
		for (int j = 0; j < groups; j++)
			b[j] = _mm512_xor_si512(
				_mm512_load_si512(k + (size_t)j * DVSM_FIXED_PANEL * head_width +
						  d * DVSM_FIXED_PANEL),
				flip);
		DVSM_UNROLL
		for (int i = 0; i < QUERIES; i++) {
			__m512i x = broadcast(queries[i].q + d);

			DVSM_UNROLL
			for (int j = 0; j < groups; j++)
				sums[i][j] = _mm512_dpbusd_epi32(sums[i][j], b[j], x);
		}
	}
	DVSM_UNROLL
	for (int i = 0; i < QUERIES; i++) {
		DVSM_UNROLL
		for (int j = 0; j < groups; j++)
			_mm512_store_si512(queries[i].scores + at + j * (int)DVSM_FIXED_PANEL,
					   sums[i][j]);
	}
}

/* All of a tile; the last group may reach into the padding. */
static void score(const struct query *queries, const int8_t *k, size_t head_width, size_t count)
{
	size_t at = 0;

	for (; at + (SCORE_GROUPS - 1) * DVSM_FIXED_PANEL < count;
	     at += SCORE_GROUPS * DVSM_FIXED_PANEL)
		score_groups(SCORE_GROUPS, queries, k + at * head_width, head_width, at);
	if (at < count)
		score_groups(1, queries, k + at * head_width, head_width, at);
}

/* ---- weights ---- */

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

/* The running maximum, then the weights of a tile. */
static void softmax(struct query *query, size_t head_width, bool first, size_t count)
{
	int32_t largest = largest_score(query, count);

	if (first)
		query->top = largest;
	else if (largest > query->top)
		shrink(query, head_width, dvsm_fixed_raise(query->scale, largest, &query->top));
	weigh(query, count);
}

/* ---- values ---- */

/* o += weights times values of `groups` x 16 channels, for two queries. */
DVSM_INLINE void mix_groups(const int groups, const struct query *queries, const int8_t *v,
			    size_t head_width, size_t count, size_t channel)
{
	__m512i high[MIX_QUERIES][MIX_GROUPS], low[MIX_QUERIES][MIX_GROUPS];
	const __m512i half = _mm512_set1_epi32(128);

	DVSM_UNROLL
	for (int i = 0; i < MIX_QUERIES; i++) {
		DVSM_UNROLL
		for (int j = 0; j < groups; j++)
			high[i][j] = low[i][j] = _mm512_setzero_si512();
	}
	for (size_t key = 0; key < count; key += 4) {
		const int8_t *from = v + key * head_width + 4 * channel;
		__m512i b[MIX_GROUPS];

		DVSM_UNROLL
		for (int j = 0; j < groups; j++)
			b[j] = _mm512_load_si512(from + (size_t)j * 64);
		DVSM_UNROLL
		for (int i = 0; i < MIX_QUERIES; i++) {
			__m512i x = broadcast(queries[i].high + key);
			__m512i y = broadcast(queries[i].low + key);

			DVSM_UNROLL
			for (int j = 0; j < groups; j++) {
				high[i][j] = _mm512_dpbusd_epi32(high[i][j], x, b[j]);
				low[i][j] = _mm512_dpbusd_epi32(low[i][j], y, b[j]);
			}
		}
	}
	DVSM_UNROLL
	for (int i = 0; i < MIX_QUERIES; i++) {
		DVSM_UNROLL
		for (int j = 0; j < groups; j++) {
			int32_t *o = queries[i].o + channel + (size_t)j * 16;
			__m512i rest = _mm512_srai_epi32(_mm512_add_epi32(low[i][j], half), 8);
			__m512i sum = _mm512_add_epi32(high[i][j], rest);

			_mm512_store_si512(o, _mm512_add_epi32(_mm512_load_si512(o), sum));
		}
	}
}

static void mix(const struct query *queries, const int8_t *v, size_t head_width, size_t count)
{
	for (size_t i = 0; i < QUERIES; i += MIX_QUERIES) {
		size_t channel = 0;

		for (; channel + MIX_GROUPS * 16 <= head_width; channel += MIX_GROUPS * 16)
			mix_groups(MIX_GROUPS, queries + i, v, head_width, count, channel);
		for (; channel < head_width; channel += 16)
			mix_groups(1, queries + i, v, head_width, count, channel);
	}
}

/* ---- a group of queries ---- */

/* o / sum, in the output's units. */
static void write_out(const struct dvsm_fixed_attention *job, const struct query *query,
		      int16_t *out)
{
	const struct dvsm_fixed_quotient quotient = dvsm_fixed_divide((uint64_t)query->sum);
	const __m512i inverse = _mm512_set1_epi32(quotient.inverse);
	const __m512i most = _mm512_set1_epi32(INT16_MAX), least = _mm512_set1_epi32(INT16_MIN);

	for (size_t d = 0; d < job->dim; d += 16) {
		__mmask16 lanes = first_lanes(job->dim - d);
		__m512i scale = _mm512_maskz_loadu_epi32(lanes, job->v_scale + d);
		__m512i mean =
			_mm512_cvtepi16_epi32(_mm256_maskz_loadu_epi16(lanes, job->v_mean + d));
		__m512i factor = _mm512_mullo_epi32(
			inverse, _mm512_and_si512(scale, _mm512_set1_epi32(0x7fff)));
		__m512i shift = clamp_shift(_mm512_sub_epi32(_mm512_set1_epi32(quotient.behind),
							     _mm512_srai_epi32(scale, 16)));
		struct wide r = round_products(_mm512_load_si512(query->o + d), factor, shift);
		__m512i sum = _mm512_add_epi32(mean, wide_saturate(r, 1 << 30));

		sum = _mm512_max_epi32(_mm512_min_epi32(sum, most), least);
		_mm512_mask_cvtepi32_storeu_epi16(out + d, lanes, sum);
	}
}

static void start(const struct dvsm_fixed_attention *job, size_t index, struct query *query)
{
	int32_t sum = 0;

	query->q = job->q + index * job->q_stride;
	query->scale = job->q_scale[index * job->scale_stride];
	query->slope = dvsm_fixed_slope_make(query->scale);
	query->top = 0;
	query->sum = 0;
	for (size_t d = 0; d < job->head_width; d++)
		sum += query->q[d];
	query->offset = -128 * sum;
	memset(query->o, 0, job->head_width * sizeof(*query->o));
}

/* Places for the queries of a group in the caller's scratch. */
static void place(const struct dvsm_fixed_attention *job, struct query queries[QUERIES])
{
	unsigned char *at = job->scratch;

	for (int i = 0; i < QUERIES; i++) {
		queries[i].scores = (int32_t *)at;
		at += DVSM_FIXED_KEYS * sizeof(int32_t);
		queries[i].high = at;
		at += DVSM_FIXED_KEYS;
		queries[i].low = at;
		at += DVSM_FIXED_KEYS;
		queries[i].o = (int32_t *)at;
		at += job->head_width * sizeof(int32_t);
	}
}

/* Queries `first` and on; a group that is not full repeats the last one. */
static void attend(const struct dvsm_fixed_attention *job, struct query queries[QUERIES],
		   size_t first, size_t count)
{
	const size_t width = job->head_width;

	for (size_t i = 0; i < QUERIES; i++)
		start(job, first + (i < count ? i : count - 1), &queries[i]);
	for (size_t key = 0; key < job->keys; key += DVSM_FIXED_KEYS) {
		size_t left = job->keys - key;
		size_t keys = left < DVSM_FIXED_KEYS ? left : DVSM_FIXED_KEYS;

		score(queries, job->k + key * width, width, keys);
		for (size_t i = 0; i < QUERIES; i++)
			softmax(&queries[i], width, key == 0, keys);
		mix(queries, job->v + key * width, width, keys);
	}
	for (size_t i = 0; i < count; i++)
		write_out(job, &queries[i], job->out + (first + i) * job->out_stride);
}

void dvsm_fixed_attention_vnni(const struct dvsm_fixed_attention *job)
{
	struct query queries[QUERIES];

	if (job->keys > MOST_KEYS) {
		dvsm_fixed_kernels_scalar.attention(job);
		return;
	}
	place(job, queries);
	for (size_t first = 0; first < job->queries; first += QUERIES) {
		size_t left = job->queries - first;

		attend(job, queries, first, left < QUERIES ? left : QUERIES);
	}
}
