/*
 * Template: one-pass attention. Included once by each f32_<tier>.c, after f32_math.inc.h and after
 *
 *   ATTENTION_VECTORS   vectors of queries worked on together
 *   ATTENTION_ROWS      keys (then: numbers of a value) that a full tile takes
 *
 * Queries lie along the lanes: q is transposed once, scores and outputs stay transposed, and the
 * keys and values are read as they lie in the cache, one number at a time for all queries. Maximum,
 * rescaling and sum are then plain lane-wise operations.
 */

#define QUERY_LANES (ATTENTION_VECTORS * VF_LANES)

/* What one group of QUERY_LANES queries keeps; all rows are QUERY_LANES wide. */
struct attention_state {
	const float *q; /* [head_dim] transposed, times scale and log2 e */
	float *scores;  /* [DVSM_ATTENTION_KEYS], then the weights */
	float *out;     /* [head_dim] transposed, sum of weights times values */
	float *top;     /* largest score so far, base 2 */
	float *total;   /* sum of weights so far */
	float *shrink;  /* what the last tile's new maximum did to the older sums */
};

/* out[j][i] = in[i][j] for any rows x cols block. */
static void transpose(const float *in, size_t in_stride, size_t rows, size_t cols, float *out,
		      size_t out_stride)
{
	size_t i = 0;

	for (; i + 4 <= rows; i += 4) {
		const float *from = in + i * in_stride;
		size_t j = 0;

		for (; j + 4 <= cols; j += 4)
			vf_transpose4(from + j, in_stride, out + j * out_stride + i, out_stride);
		for (; j < cols; j++) {
			for (size_t r = 0; r < 4; r++)
				out[j * out_stride + i + r] = from[r * in_stride + j];
		}
	}
	for (; i < rows; i++) {
		for (size_t j = 0; j < cols; j++)
			out[j * out_stride + i] = in[i * in_stride + j];
	}
}

/* Scores of `rows` keys (a constant where it is called). */
DVSM_INLINE void score_rows(const int rows, const float *k, size_t head_dim, const float *q,
			    float *scores)
{
	vf sums[ATTENTION_ROWS][ATTENTION_VECTORS];

	DVSM_UNROLL
	for (int i = 0; i < rows; i++) {
		DVSM_UNROLL
		for (int j = 0; j < ATTENTION_VECTORS; j++)
			sums[i][j] = vf_set(0.0f);
	}
	for (size_t d = 0; d < head_dim; d++) {
		vf b[ATTENTION_VECTORS];

		DVSM_UNROLL
		for (int j = 0; j < ATTENTION_VECTORS; j++)
			b[j] = vf_load(q + d * QUERY_LANES + (size_t)j * VF_LANES);
		DVSM_UNROLL
		for (int i = 0; i < rows; i++) {
			vf x = vf_set(k[(size_t)i * head_dim + d]);

			DVSM_UNROLL
			for (int j = 0; j < ATTENTION_VECTORS; j++)
				sums[i][j] = vf_fma(x, b[j], sums[i][j]);
		}
	}
	DVSM_UNROLL
	for (int i = 0; i < rows; i++) {
		DVSM_UNROLL
		for (int j = 0; j < ATTENTION_VECTORS; j++)
			vf_store(scores + i * QUERY_LANES + j * VF_LANES, sums[i][j]);
	}
}

/* out = out shrink + weights v, for `rows` numbers of the head (a constant where it is called). */
DVSM_INLINE void value_rows(const int rows, const float *v, size_t head_dim, size_t keys,
			    const struct attention_state *state, float *out)
{
	vf sums[ATTENTION_ROWS][ATTENTION_VECTORS];

	DVSM_UNROLL
	for (int i = 0; i < rows; i++) {
		DVSM_UNROLL
		for (int j = 0; j < ATTENTION_VECTORS; j++)
			sums[i][j] = vf_set(0.0f);
	}
	for (size_t key = 0; key < keys; key++) {
		vf b[ATTENTION_VECTORS];

		DVSM_UNROLL
		for (int j = 0; j < ATTENTION_VECTORS; j++)
			b[j] = vf_load(state->scores + key * QUERY_LANES + (size_t)j * VF_LANES);
		DVSM_UNROLL
		for (int i = 0; i < rows; i++) {
			vf x = vf_set(v[key * head_dim + (size_t)i]);

			DVSM_UNROLL
			for (int j = 0; j < ATTENTION_VECTORS; j++)
				sums[i][j] = vf_fma(x, b[j], sums[i][j]);
		}
	}
	DVSM_UNROLL
	for (int i = 0; i < rows; i++) {
		DVSM_UNROLL
		for (int j = 0; j < ATTENTION_VECTORS; j++) {
			float *o = out + i * QUERY_LANES + j * VF_LANES;
			vf shrink = vf_load(state->shrink + j * VF_LANES);

			vf_store(o, vf_fma(vf_load(o), shrink, sums[i][j]));
		}
	}
}

/* Scores to weights 2^(score - top), with the running maximum and sum brought up to date. */
static void weigh(const struct attention_state *state, size_t keys)
{
	for (size_t j = 0; j < QUERY_LANES; j += VF_LANES) {
		float *scores = state->scores + j;
		vf before = vf_load(state->top + j), top = before, sum = vf_set(0.0f);

		for (size_t key = 0; key < keys; key++)
			top = vf_max(top, vf_load(scores + key * QUERY_LANES));
		for (size_t key = 0; key < keys; key++) {
			float *score = scores + key * QUERY_LANES;
			vf weight = exp2_vf(vf_sub(vf_load(score), top));

			vf_store(score, weight);
			sum = vf_add(sum, weight);
		}

		vf shrink = exp2_vf(vf_sub(before, top));

		vf_store(state->shrink + j, shrink);
		vf_store(state->total + j, vf_fma(vf_load(state->total + j), shrink, sum));
		vf_store(state->top + j, top);
	}
}

/* One tile of up to DVSM_ATTENTION_KEYS keys. */
static void attend(const struct attention_state *state, const float *k, const float *v, size_t keys,
		   size_t head_dim)
{
	size_t i = 0;

#define SCORES(count)                                                                              \
	do {                                                                                       \
		score_rows(count, k + i * head_dim, head_dim, state->q,                            \
			   state->scores + i * QUERY_LANES);                                       \
		i += (count);                                                                      \
	} while (0)

	while (i + ATTENTION_ROWS <= keys)
		SCORES(ATTENTION_ROWS);
	if (i + 4 <= keys)
		SCORES(4);
	while (i < keys)
		SCORES(1);
#undef SCORES

	weigh(state, keys);

#define VALUES(count)                                                                              \
	do {                                                                                       \
		value_rows(count, v + i, head_dim, keys, state, state->out + i * QUERY_LANES);     \
		i += (count);                                                                      \
	} while (0)

	i = 0;
	while (i + ATTENTION_ROWS <= head_dim)
		VALUES(ATTENTION_ROWS);
	if (i + 4 <= head_dim)
		VALUES(4);
	while (i < head_dim)
		VALUES(1);
#undef VALUES
}

/* A score that every real one beats, yet whose differences are finite. */
#define LOWEST_SCORE (-1e30f)

/* Queries first .. first + count - 1, count <= QUERY_LANES; idle lanes attend with q = 0. */
static void attend_group(const struct dvsm_attention *job, size_t first, size_t count)
{
	const size_t dim = job->head_dim;
	float *q = job->scratch, *out = q + dim * QUERY_LANES;
	float *scores = out + dim * QUERY_LANES;
	float *rows = scores + DVSM_ATTENTION_KEYS * QUERY_LANES;
	const struct attention_state state = {
		q, scores, out, rows, rows + QUERY_LANES, rows + 2 * QUERY_LANES};
	const vf scale = vf_set(job->scale * LOG2_E);

	memset(q, 0, 2 * dim * QUERY_LANES * sizeof(float));
	transpose(job->q + first * job->q_stride, job->q_stride, count, dim, q, QUERY_LANES);
	for (size_t i = 0; i < dim * QUERY_LANES; i += VF_LANES)
		vf_store(q + i, vf_mul(vf_load(q + i), scale));
	for (size_t j = 0; j < QUERY_LANES; j++) {
		state.top[j] = LOWEST_SCORE;
		state.total[j] = 0.0f;
	}
	for (size_t key = 0; key < job->keys; key += DVSM_ATTENTION_KEYS) {
		size_t left = job->keys - key;

		attend(&state, job->k + key * dim, job->v + key * dim,
		       left < DVSM_ATTENTION_KEYS ? left : DVSM_ATTENTION_KEYS, dim);
	}
	for (size_t j = 0; j < QUERY_LANES; j += VF_LANES) {
		vf inverse = vf_div(vf_set(1.0f), vf_load(state.total + j));

		for (size_t d = 0; job->keys > 0 && d < dim; d++) {
			float *o = out + d * QUERY_LANES + j;

			vf_store(o, vf_mul(vf_load(o), inverse));
		}
	}
	transpose(out, QUERY_LANES, dim, count, job->out + first * job->out_stride,
		  job->out_stride);
}

static void attention(const struct dvsm_attention *job)
{
	for (size_t first = 0; first < job->queries; first += QUERY_LANES) {
		size_t left = job->queries - first;

		attend_group(job, first, left < QUERY_LANES ? left : QUERY_LANES);
	}
}
