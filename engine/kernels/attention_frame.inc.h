/*
 * Template: attention of a group of queries, from the caller's rows to the caller's rows. Included
 * behind a template that defines attend(), for one tile of keys, and prepare(), for queries that it
 * wants in another form.
 */

/* A score that every real one beats, yet whose differences are finite. */
#define LOWEST_SCORE (-1e30f)

/* The group's sums to rows of the caller's numbers, by way of the queries' room. */
static void write_rows(const struct attention_state *state, const struct dvsm_attention *job,
		       size_t first, size_t count)
{
	float *rows = state->q;

	transpose(state->out, QUERY_LANES, job->head_dim, count, rows, job->head_dim);
	left(rows, job->head_dim, count, job->head_dim,
	     (number *)job->out + left_at(first, 0, job->out_stride), job->out_stride,
	     job->out_col);
}

/* Queries first .. first + count - 1, count <= QUERY_LANES; idle lanes attend with q = 0. */
static void attend_group(const struct dvsm_attention *job, size_t first, size_t count)
{
	const size_t dim = job->head_dim;
	float *q = job->scratch, *out = q + dim * QUERY_LANES;
	float *scores = out + dim * QUERY_LANES;
	float *top = scores + DVSM_ATTENTION_KEYS * QUERY_LANES;
	float *total = top + QUERY_LANES, *shrink = total + QUERY_LANES;
	const struct attention_state state = {
		q, out, scores, top, total, shrink, shrink + QUERY_LANES};
	const number *k = job->k, *v = job->v;
	const vf scale = vf_set(job->scale * LOG2_E);

	memset(q, 0, 2 * dim * QUERY_LANES * sizeof(float));
	transpose(job->q + first * job->q_stride, job->q_stride, count, dim, q, QUERY_LANES);
	for (size_t i = 0; i < dim * QUERY_LANES; i += VF_LANES)
		vf_store(q + i, num_round(vf_mul(vf_load(q + i), scale)));
	prepare(&state, dim);
	for (size_t j = 0; j < QUERY_LANES; j++) {
		state.top[j] = LOWEST_SCORE;
		state.total[j] = 0.0f;
	}
	for (size_t key = 0; key < job->keys; key += DVSM_ATTENTION_KEYS) {
		size_t left = job->keys - key;

		attend(&state, k + key * dim, v + key * dim,
		       left < DVSM_ATTENTION_KEYS ? left : DVSM_ATTENTION_KEYS, dim);
	}
	for (size_t j = 0; j < QUERY_LANES; j += VF_LANES) {
		vf inverse = vf_div(vf_set(1.0f), vf_load(state.total + j));

		for (size_t d = 0; job->keys > 0 && d < dim; d++) {
			float *o = out + d * QUERY_LANES + j;

			vf_store(o, vf_mul(vf_load(o), inverse));
		}
	}
	write_rows(&state, job, first, count);
}

static void attention(const struct dvsm_attention *job)
{
	for (size_t first = 0; first < job->queries; first += QUERY_LANES) {
		size_t left = job->queries - first;

		attend_group(job, first, left < QUERY_LANES ? left : QUERY_LANES);
	}
}
