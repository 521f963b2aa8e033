/*
 * Template: a query on its way through the fixed-point attention of SSE4.1, AVX2 and AVX-VNNI.
 * Included behind row_prepare().
 */

/* The arrays lie in the scratch. */
struct query {
	struct dvsm_fixed_slope slope;
	int shift; /* of its words */
	int16_t top;
	int64_t sum;
	struct row_bytes q; /* [key_width] */
	int16_t *scores;    /* words, as many as are kept */
	int16_t *weights;   /* [DVSM_FIXED_KEYS] ordered words */
	int32_t *o;         /* [head_width] sums above their last 8 bits */
	int32_t *o_low;     /* [head_width] those bits; behind them what row_prepare() makes of q */
};

static void start(const struct dvsm_fixed_attention *job, size_t index, struct query *query)
{
	const int8_t *q = job->q + index * job->q_stride;

	query->shift = dvsm_fixed_score_shift(q, job->key_width);
	query->slope = dvsm_fixed_slope_make(job->q_scale[index * job->scale_stride], query->shift);
	query->top = INT16_MIN;
	query->sum = 0;
	query->q = row_prepare(q, job->key_width, (uint8_t *)(query->o_low + job->head_width));
	memset(query->o, 0, job->head_width * sizeof(*query->o));
	memset(query->o_low, 0, job->head_width * sizeof(*query->o_low));
}
