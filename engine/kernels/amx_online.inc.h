/*
 * Template: one-pass attention on AMX for scores of any size, with a running maximum. Included by
 * bf16_amx.c.
 *
 * The queries lie along the lanes, as in dot_attention.inc.h: the keys are A as they lie, the
 * values A once they are turned.
 */

#include "kernels/attention_state.inc.h"
#include "kernels/dot_weigh.inc.h"

/* Up to 32 x 32 sums on their way out. */
struct sums {
	_Alignas(64) float part[2][2][TILE][TILE];
};

/* A tile of keys that is not whole: zeros where it has no rows or no depth. */
struct fringe {
	_Alignas(64) number rows[TILE][DEPTH];
};

/* Sixteen rows of a at depth d, in place or copied, of which `rows` and up to `depth` exist. */
static const number *whole_tile(const number *a, size_t a_stride, size_t rows, size_t d,
				size_t depth, struct fringe *fringe, size_t *stride)
{
	const size_t count = depth - d < DEPTH ? depth - d : DEPTH;

	*stride = a_stride * sizeof(number);
	if (rows >= TILE && count == DEPTH)
		return a + d;
	*stride = DEPTH * sizeof(number);
	memset(fringe, 0, sizeof(*fringe));
	for (size_t i = 0; i < rows && i < TILE; i++)
		memcpy(fringe->rows[i], a + i * a_stride + d, count * sizeof(number));
	amx_publish();
	return &fringe->rows[0][0];
}

/* Behind the pairs of queries: the values of a tile, turned to [head_dim][DVSM_ATTENTION_KEYS]. */
static number *turned_values(const struct attention_state *state, size_t head_dim)
{
	return query_pairs(state) + dvsm_bf16_depth(head_dim) * QUERY_LANES;
}

static void prepare(const struct attention_state *state, size_t head_dim)
{
	zip_queries(state, head_dim, dvsm_bf16_depth(head_dim));
	amx_publish();
}

/* Scores of 32 keys with 32 queries; keys that are not there get scores of 0. */
static void score_block(const struct attention_state *state, const number *k, size_t keys,
			size_t head_dim, size_t key, size_t query)
{
	const bool two = key + TILE < keys;
	const size_t lanes = QUERY_LANES * sizeof(float);
	float *scores = state->scores + key * QUERY_LANES + query;
	struct fringe fringe;

	AMX_ZERO(0);
	AMX_ZERO(1);
	AMX_ZERO(2);
	AMX_ZERO(3);
	for (size_t d = 0; d < head_dim; d += DEPTH) {
		const number *q = query_pairs(state) + d * QUERY_LANES + 2 * query, *from;
		size_t stride;

		AMX_LOAD(6, q, lanes);
		AMX_LOAD(7, q + 2 * TILE, lanes);
		from = whole_tile(k + key * head_dim, head_dim, keys - key, d, head_dim, &fringe,
				  &stride);
		AMX_LOAD(4, from, stride);
		AMX_DOT_BF16(0, 4, 6);
		AMX_DOT_BF16(1, 4, 7);
		if (two) {
			from = whole_tile(k + (key + TILE) * head_dim, head_dim, keys - key - TILE,
					  d, head_dim, &fringe, &stride);
			AMX_LOAD(5, from, stride);
			AMX_DOT_BF16(2, 5, 6);
			AMX_DOT_BF16(3, 5, 7);
		}
	}
	AMX_STORE(0, scores, lanes);
	AMX_STORE(1, scores + TILE, lanes);
	AMX_STORE(2, scores + TILE * QUERY_LANES, lanes);
	AMX_STORE(3, scores + TILE * QUERY_LANES + TILE, lanes);
}

/* out = out shrink + sums, for up to sixteen numbers of the head from `d` on. */
static void add_part(const struct attention_state *state, size_t head_dim, size_t d, size_t query,
		     float part[TILE][TILE])
{
	vf shrink = vf_load(state->shrink + query);

	for (size_t i = 0; i < TILE && d + i < head_dim; i++) {
		float *o = state->out + (d + i) * QUERY_LANES + query;

		vf_store(o, vf_fma(vf_load(o), shrink, vf_load(part[i])));
	}
}

/* The weights of a tile times 32 numbers of the head, for 32 queries. */
static void value_block(const struct attention_state *state, size_t head_dim, size_t keys, size_t d,
			size_t query)
{
	const size_t lanes = QUERY_LANES * sizeof(float), row = DVSM_ATTENTION_KEYS;
	const number *v = turned_values(state, head_dim) + d * row;
	struct sums sums;

	AMX_ZERO(0);
	AMX_ZERO(1);
	AMX_ZERO(2);
	AMX_ZERO(3);
	for (size_t key = 0; key < keys; key += DEPTH) {
		const number *weights =
			(const number *)state->scores + key * QUERY_LANES + 2 * query;

		AMX_LOAD(6, weights, lanes);
		AMX_LOAD(7, weights + 2 * TILE, lanes);
		AMX_LOAD(4, v + key, row * sizeof(number));
		AMX_LOAD(5, v + TILE * row + key, row * sizeof(number));
		AMX_DOT_BF16(0, 4, 6);
		AMX_DOT_BF16(1, 4, 7);
		AMX_DOT_BF16(2, 5, 6);
		AMX_DOT_BF16(3, 5, 7);
	}
	AMX_STORE(0, sums.part[0][0], 64);
	AMX_STORE(1, sums.part[0][1], 64);
	AMX_STORE(2, sums.part[1][0], 64);
	AMX_STORE(3, sums.part[1][1], 64);
	for (size_t j = 0; j < 2; j++) {
		add_part(state, head_dim, d, query + j * TILE, sums.part[0][j]);
		add_part(state, head_dim, d + TILE, query + j * TILE, sums.part[1][j]);
	}
}

/* Values to their turned place, pairs of keys as 32-bit elements, zeros behind keys and head. */
static void turn_values(const struct attention_state *state, const number *v, size_t keys,
			size_t head_dim)
{
	const size_t row = DVSM_ATTENTION_KEYS;

	for (size_t key = 0; key < keys; key += 2 * TILE) {
		for (size_t d = 0; d < dvsm_bf16_depth(head_dim); d += TILE) {
			__m512i pairs[TILE];

			for (size_t i = 0; i < TILE; i++) {
				__m512i even = value_lanes(v, keys, head_dim, key + 2 * i, d);
				__m512i odd = value_lanes(v, keys, head_dim, key + 2 * i + 1, d);

				pairs[i] = _mm512_or_si512(even, _mm512_slli_epi32(odd, 16));
			}
			turn_block(
				pairs,
				(unsigned char *)(turned_values(state, head_dim) + d * row + key),
				row * sizeof(number));
		}
	}
}

/* Weights of keys that are not there, up to whole tiles, are 0. */
static void clear_weights(const struct attention_state *state, size_t keys)
{
	const size_t from = (keys + 1) / 2 * 2, to = (keys + DEPTH - 1) / DEPTH * DEPTH;

	memset((number *)state->scores + from * QUERY_LANES, 0,
	       (to - from) * QUERY_LANES * sizeof(number));
}

/* Behind the turned values: keys and values row by row, where they come in blocks. */
static const number *in_rows(const struct attention_state *state, const number **v, const number *k,
			     size_t keys, size_t head_dim)
{
	const size_t whole = keys / DEPTH * DEPTH, left = (keys - whole) * head_dim;
	number *rows = turned_values(state, head_dim) + head_dim * DVSM_ATTENTION_KEYS;
	number *values = rows + head_dim * DVSM_ATTENTION_KEYS;

	unlay_keys(k, whole, head_dim, rows);
	unlay_values(*v, whole, head_dim, values);
	memcpy(rows + whole * head_dim, k + whole * head_dim, left * sizeof(number));
	memcpy(values + whole * head_dim, *v + whole * head_dim, left * sizeof(number));
	amx_publish();
	*v = values;
	return rows;
}

/* One tile of up to DVSM_ATTENTION_KEYS keys. */
static void attend(const struct attention_state *state, const number *k, const number *v,
		   size_t keys, size_t head_dim)
{
	if (head_dim % DEPTH == 0)
		k = in_rows(state, &v, k, keys, head_dim);
	for (size_t key = 0; key < keys; key += 2 * TILE) {
		for (size_t query = 0; query < QUERY_LANES; query += 2 * TILE)
			score_block(state, k, keys, head_dim, key, query);
	}
	weigh(state, keys);
	clear_weights(state, keys);
	turn_values(state, v, keys, head_dim);
	amx_publish();
	for (size_t d = 0; d < head_dim; d += 2 * TILE) {
		for (size_t query = 0; query < QUERY_LANES; query += 2 * TILE)
			value_block(state, head_dim, keys, d, query);
	}
}

#include "kernels/attention_frame.inc.h"
