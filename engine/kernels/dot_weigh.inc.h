/*
 * Template: what attention over pairs of bfloat16 does beside its products. Included by
 * dot_attention.inc.h and amx_online.inc.h, after attention_state.inc.h.
 *
 * The queries become pairs of depth, the weights pairs of keys: [pairs][QUERY_LANES][2]. The
 * weights take the place of the scores.
 */

/* Pairs of queries, in the state's room: [ceil(depth / 2)], zeros behind the depth. */
static number *query_pairs(const struct attention_state *state)
{
	return (number *)state->room;
}

static void zip_queries(const struct attention_state *state, size_t head_dim, size_t depth)
{
	number *pairs = query_pairs(state);
	const vf zero = vf_set(0.0f);

	for (size_t d = 0; d < depth; d += 2) {
		const float *q = state->q + d * QUERY_LANES;

		for (size_t j = 0; j < QUERY_LANES; j += VF_LANES) {
			vf first = d < head_dim ? vf_load(q + j) : zero;
			vf second = d + 1 < head_dim ? vf_load(q + QUERY_LANES + j) : zero;

			vp_store(pairs + d * QUERY_LANES + 2 * j, vp_zip(first, second));
		}
	}
}

/* Scores to pairs of weights 2^(score - top), with the running maximum and sum brought up to date.
 */
static void weigh(const struct attention_state *state, size_t keys)
{
	for (size_t j = 0; j < QUERY_LANES; j += VF_LANES) {
		float *scores = state->scores + j;
		vf before = vf_load(state->top + j), top = before, sum = vf_set(0.0f);

		for (size_t key = 0; key < keys; key++)
			top = vf_max(top, vf_load(scores + key * QUERY_LANES));
		for (size_t key = 0; key < keys; key += 2) {
			vf first = vf_load(scores + key * QUERY_LANES), second = vf_set(0.0f);
			vp weights;

			first = num_exp2(vf_sub(first, top));
			if (key + 1 < keys) {
				second = vf_load(scores + (key + 1) * QUERY_LANES);
				second = num_exp2(vf_sub(second, top));
			}
			weights = vp_zip(first, second);
			sum = vp_dot(sum, vp_ones(), weights);
			vp_store((number *)state->scores + key * QUERY_LANES + 2 * j, weights);
		}

		vf shrink = exp2_vf(vf_sub(before, top)); /* exactly 1 where nothing changed */

		vf_store(state->shrink + j, shrink);
		vf_store(state->total + j, vf_fma(vf_load(state->total + j), shrink, sum));
		vf_store(state->top + j, top);
	}
}
