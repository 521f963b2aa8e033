/*
 * Template: one-pass attention that multiplies floats. Included once by each tier without products
 * of bfloat16, after its number_<precision>.inc.h and after
 *
 *   ATTENTION_VECTORS   vectors of queries worked on together
 *   ATTENTION_ROWS      keys (then: numbers of a value) that a full tile takes
 *
 * Queries lie along the lanes: q is transposed once, scores and outputs stay transposed, and the
 * keys and values are read as they lie in the cache, one number at a time for all queries. Maximum,
 * rescaling and sum are then plain lane-wise operations.
 */

#include "kernels/attention_rows.inc.h"

/* Scores of `rows` keys (a constant where it is called). */
DVSM_INLINE void score_rows(const int rows, const float *k, size_t head_dim, const float *q,
			    float *scores)
{
	vf sums[ATTENTION_ROWS][ATTENTION_VECTORS];

	clear_rows(rows, sums);
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
	store_scores(rows, sums, scores);
}

/* out = out shrink + weights v, for `rows` numbers of the head (a constant where it is called). */
DVSM_INLINE void value_rows(const int rows, const float *v, size_t head_dim, size_t keys,
			    const struct attention_state *state, float *out)
{
	vf sums[ATTENTION_ROWS][ATTENTION_VECTORS];

	clear_rows(rows, sums);
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
	add_values(rows, sums, state, out);
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
			vf weight = num_round(num_exp2(vf_sub(vf_load(score), top)));

			vf_store(score, weight);
			sum = vf_add(sum, weight);
		}

		vf shrink = exp2_vf(vf_sub(before, top)); /* exactly 1 where nothing changed */

		vf_store(state->shrink + j, shrink);
		vf_store(state->total + j, vf_fma(vf_load(state->total + j), shrink, sum));
		vf_store(state->top + j, top);
	}
}

static void prepare(const struct attention_state *state, size_t head_dim)
{
	(void)state;
	(void)head_dim;
}

/* One tile of up to DVSM_ATTENTION_KEYS keys. */
static void attend(const struct attention_state *state, const number *keys_at,
		   const number *values_at, size_t keys, size_t head_dim)
{
	const float *k = num_floats(keys_at, keys * head_dim, state->room);
	const float *v = num_floats(values_at, keys * head_dim,
				    state->room + DVSM_ATTENTION_KEYS * head_dim);

#define SCORES(rows, at)                                                                           \
	score_rows(rows, k + (at)*head_dim, head_dim, state->q, state->scores + (at)*QUERY_LANES)
#define VALUES(rows, at)                                                                           \
	value_rows(rows, v + (at), head_dim, keys, state, state->out + (at)*QUERY_LANES)

	FOR_ROWS(keys, SCORES);
	weigh(state, keys);
	FOR_ROWS(head_dim, VALUES);

#undef SCORES
#undef VALUES
}

#include "kernels/attention_frame.inc.h"
