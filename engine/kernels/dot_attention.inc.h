/*
 * Template: one-pass attention over pairs of bfloat16. Included once by each tier that multiplies
 * them, after number_bf16.inc.h and after ATTENTION_VECTORS and ATTENTION_ROWS as in
 * attention.inc.h, whose shape it has: queries along the lanes, keys and values read one pair at a
 * time for all queries. The values of two keys are laid side by side first.
 */

#include "kernels/attention_rows.inc.h"
#include "kernels/dot_weigh.inc.h"

static void prepare(const struct attention_state *state, size_t head_dim)
{
	zip_queries(state, head_dim, head_dim);
}

/*
 * sums[i] += the pair at x of each row, or its first number alone, times the lanes' pairs at b.
 * Each is broadcast as it is needed, for want of registers.
 */
DVSM_INLINE void attention_step(const int rows, const bool half, const number *x, size_t x_stride,
				const number *lanes, vf sums[ATTENTION_ROWS][ATTENTION_VECTORS])
{
	vp b[ATTENTION_VECTORS];

	DVSM_UNROLL
	for (int j = 0; j < ATTENTION_VECTORS; j++)
		b[j] = vp_load(lanes + 2 * j * VF_LANES);
	DVSM_UNROLL
	for (int i = 0; i < rows; i++) {
		const number *at = x + (size_t)i * x_stride;
		vp pair = half ? vp_set_half(at) : vp_set(at);

		DVSM_UNROLL
		for (int j = 0; j < ATTENTION_VECTORS; j++)
			sums[i][j] = vp_dot(sums[i][j], pair, b[j]);
	}
}

/* Scores of `rows` keys (a constant where it is called). */
DVSM_INLINE void score_rows(const int rows, const number *k, size_t head_dim, const number *q,
			    float *scores)
{
	vf sums[ATTENTION_ROWS][ATTENTION_VECTORS];
	size_t d = 0;

	clear_rows(rows, sums);
	for (; d + 2 <= head_dim; d += 2)
		attention_step(rows, false, k + d, head_dim, q + d * QUERY_LANES, sums);
	if (d < head_dim)
		attention_step(rows, true, k + d, head_dim, q + d * QUERY_LANES, sums);
	store_scores(rows, sums, scores);
}

/*
 * out = out shrink + weights v, for `rows` numbers of the head (a constant where it is called).
 *
 * v   pairs of keys: [ceil(keys / 2)][head_dim][2]
 */
DVSM_INLINE void value_rows(const int rows, const number *v, size_t head_dim, size_t keys,
			    const struct attention_state *state, float *out)
{
	const number *weights = (const number *)state->scores;
	vf sums[ATTENTION_ROWS][ATTENTION_VECTORS];

	clear_rows(rows, sums);
	for (size_t key = 0; key < keys; key += 2)
		attention_step(rows, false, v + key * head_dim, 2, weights + key * QUERY_LANES,
			       sums);
	add_values(rows, sums, state, out);
}

/* The values of two keys side by side; a missing last one is 0. */
static void zip_values(const number *v, size_t keys, size_t head_dim, number *pairs)
{
	for (size_t key = 0; key < keys; key += 2, v += 2 * head_dim, pairs += 2 * head_dim) {
		if (key + 1 < keys) {
			for (size_t d = 0; d < head_dim; d++) {
				pairs[2 * d] = v[d];
				pairs[2 * d + 1] = v[head_dim + d];
			}
		} else {
			for (size_t d = 0; d < head_dim; d++) {
				pairs[2 * d] = v[d];
				pairs[2 * d + 1] = 0;
			}
		}
	}
}

/* One tile of up to DVSM_ATTENTION_KEYS keys. */
static void attend(const struct attention_state *state, const number *k, const number *values,
		   size_t keys, size_t head_dim)
{
	number *v = (number *)(state->room + DVSM_ATTENTION_KEYS * head_dim);

#define SCORES(rows, at)                                                                           \
	score_rows(rows, k + (at)*head_dim, head_dim, query_pairs(state),                          \
		   state->scores + (at)*QUERY_LANES)
#define VALUES(rows, at)                                                                           \
	value_rows(rows, v + 2 * (at), head_dim, keys, state, state->out + (at)*QUERY_LANES)

	FOR_ROWS(keys, SCORES);
	weigh(state, keys);
	zip_values(values, keys, head_dim, v);
	FOR_ROWS(head_dim, VALUES);

#undef SCORES
#undef VALUES
}

#include "kernels/attention_frame.inc.h"
