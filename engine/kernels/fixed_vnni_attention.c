/*
 * Fixed-point attention for AVX-512 VNNI: eight queries pass over the keys together.
 *
 * vpdpbusd multiplies unsigned by signed bytes. Scores take the keys as the unsigned ones, 128 too
 * large, and 128 times the sum of the query is taken off; the two planes of the weights are
 * unsigned as they are. Both products have the lanes that the packed layouts give: sixteen keys,
 * then sixteen channels.
 */
#include "kernels/fixed_tiers.h"
#include "kernels/tier.h"

#define QUERIES 8

/* Scores of two groups of keys, and sums of two queries: registers enough to hide the latency. */
#define SCORE_GROUPS 2
#define MIX_QUERIES  2
#define MIX_GROUPS   4

#include "kernels/fixed_avx512_softmax.h"

/* A query on its way; the arrays lie in the scratch. */
struct query {
	const int8_t *q;
	struct slope slope;
	int16_t top;
	int32_t offset; /* -128 times the sum of q */
	int64_t sum;
	int16_t *scores;  /* words, as many as are kept */
	uint8_t *weights; /* [2][DVSM_FIXED_KEYS] planes: high, low */
	int32_t *o;       /* [head_width] sums with the high plane */
	int32_t *o_low;   /* [head_width] sums with the low one */
};

static void start(const struct dvsm_fixed_attention *job, size_t index, struct query *query)
{
	const __m512i ones = _mm512_set1_epi8(1);
	__m512i sum = _mm512_setzero_si512();

	query->q = job->q + index * job->q_stride;
	query->slope =
		slope_make(job->q_scale[index * job->scale_stride], query->q, job->key_width);
	query->top = INT16_MIN;
	query->sum = 0;
	for (size_t d = 0; d < job->key_width; d += 16)
		sum = _mm512_dpbusd_epi32(sum, ones, _mm512_maskz_loadu_epi32(0xf, query->q + d));
	query->offset = -128 * _mm512_reduce_add_epi32(sum);
	memset(query->o, 0, job->head_width * sizeof(*query->o));
	memset(query->o_low, 0, job->head_width * sizeof(*query->o_low));
}

static inline __m512i broadcast(const void *four)
{
	int bits;

	memcpy(&bits, four, sizeof(bits));
	return _mm512_set1_epi32(bits);
}

/* sums += unsigned times signed bytes. The intrinsic makes gcc 12 move and spill sums in loops. */
static inline __m512i dot(__m512i sums, __m512i unsigned_bytes, __m512i signed_bytes)
{
	__asm__("vpdpbusd %2, %1, %0" : "+v"(sums) : "v"(unsigned_bytes), "v"(signed_bytes));
	return sums;
}

/* ---- scores ---- */

DVSM_INLINE void score_groups(const int groups, const struct query *queries, const int8_t *k,
			      size_t key_width, size_t at)
{
	const __m512i flip = _mm512_set1_epi8(INT8_MIN);
	__m512i sums[QUERIES][SCORE_GROUPS];

	DVSM_UNROLL
	for (int i = 0; i < QUERIES; i++) {
		DVSM_UNROLL
		for (int j = 0; j < groups; j++)
			sums[i][j] = _mm512_set1_epi32(queries[i].offset);
	}
	for (size_t d = 0; d < key_width; d += 4) {
		__m512i b[SCORE_GROUPS];

		DVSM_UNROLL
		for (int j = 0; j < groups; j++)
			b[j] = _mm512_xor_si512(
				_mm512_load_si512(k + (size_t)j * DVSM_FIXED_PANEL * key_width +
						  d * DVSM_FIXED_PANEL),
				flip);
		DVSM_UNROLL
		for (int i = 0; i < QUERIES; i++) {
			__m512i x = broadcast(queries[i].q + d);

			DVSM_UNROLL
			for (int j = 0; j < groups; j++)
				sums[i][j] = dot(sums[i][j], b[j], x);
		}
	}
	DVSM_UNROLL
	for (int i = 0; i < QUERIES; i++)
		_mm512_store_si512(queries[i].scores + at,
				   score_words(sums[i][0], sums[i][groups - 1],
					       _mm512_set1_epi32(queries[i].slope.shift)));
}

/* All of a tile; the last group may reach into the padding, or be there twice. */
static void score(const struct query *queries, const int8_t *k, size_t key_width, size_t count,
		  size_t at)
{
	size_t key = 0;

	for (; key + (SCORE_GROUPS - 1) * DVSM_FIXED_PANEL < count;
	     key += SCORE_GROUPS * DVSM_FIXED_PANEL)
		score_groups(SCORE_GROUPS, queries, k + key * key_width, key_width, at + key);
	if (key < count)
		score_groups(1, queries, k + key * key_width, key_width, at + key);
}

/* ---- values ---- */

/* o += weights times values of `groups` x 16 channels, for two queries. */
DVSM_INLINE void mix_groups(const int groups, const struct query *queries, const int8_t *v,
			    size_t head_width, size_t count, size_t channel)
{
	__m512i high[MIX_QUERIES][MIX_GROUPS], low[MIX_QUERIES][MIX_GROUPS];

	DVSM_UNROLL
	for (int i = 0; i < MIX_QUERIES; i++) {
		DVSM_UNROLL
		for (int j = 0; j < groups; j++) {
			const size_t at = channel + (size_t)j * 16;

			high[i][j] = _mm512_load_si512(queries[i].o + at);
			low[i][j] = _mm512_load_si512(queries[i].o_low + at);
		}
	}
	for (size_t key = 0; key < count; key += 4) {
		const int8_t *from = v + key * head_width + 4 * channel;
		__m512i b[MIX_GROUPS];

		DVSM_UNROLL
		for (int j = 0; j < groups; j++)
			b[j] = _mm512_load_si512(from + (size_t)j * 64);
		DVSM_UNROLL
		for (int i = 0; i < MIX_QUERIES; i++) {
			__m512i x = broadcast(queries[i].weights + key);
			__m512i y = broadcast(queries[i].weights + DVSM_FIXED_KEYS + key);

			DVSM_UNROLL
			for (int j = 0; j < groups; j++) {
				high[i][j] = dot(high[i][j], x, b[j]);
				low[i][j] = dot(low[i][j], y, b[j]);
			}
		}
	}
	DVSM_UNROLL
	for (int i = 0; i < MIX_QUERIES; i++) {
		DVSM_UNROLL
		for (int j = 0; j < groups; j++) {
			const size_t at = channel + (size_t)j * 16;

			_mm512_store_si512(queries[i].o + at, high[i][j]);
			_mm512_store_si512(queries[i].o_low + at, low[i][j]);
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

/* ---- softmax ---- */

static int16_t largest_score(const struct query *query, size_t count, size_t at)
{
	__m512i largest = _mm512_set1_epi16(INT16_MIN);

	for (size_t key = 0; key < count; key += 32)
		largest = _mm512_mask_max_epi16(largest, word_lanes(key, count), largest,
						_mm512_load_si512(query->scores + at + key));
	return (int16_t)_mm512_reduce_max_epi32(larger_words(largest));
}

static void weigh(struct query *query, size_t count, size_t at)
{
	const struct softmax_lanes lanes = softmax_lanes_make();
	__m512i sums = _mm512_setzero_si512();

	query->slope.top = twice(query->top);
	sums = weigh_keys(&lanes, &query->slope, query->scores + at, query->weights,
			  query->weights + DVSM_FIXED_KEYS, count, sums);
	query->sum += _mm512_reduce_add_epi32(sums);
}

static void write_out(const struct dvsm_fixed_attention *job, const struct query *query,
		      int16_t *out)
{
	const struct dvsm_fixed_quotient quotient = dvsm_fixed_divide((uint64_t)query->sum);

	for (size_t d = 0; d < job->dim; d += 16) {
		const struct channels channels = load_channels(job, d);

		write_channels(&channels, quotient, _mm512_load_si512(query->o + d),
			       _mm512_load_si512(query->o_low + d), out + d);
	}
}

#include "kernels/fixed_group.inc.h"

void dvsm_fixed_attention_vnni(const struct dvsm_fixed_attention *job)
{
	attention(job);
}
