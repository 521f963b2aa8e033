/* Template: attention of a group of queries, see fixed_avx512_softmax.inc.h. */

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

#include "kernels/fixed_group.inc.h"
