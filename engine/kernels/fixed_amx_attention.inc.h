/*
 * Template: fixed-point attention of AMX, included by fixed_amx.c.
 *
 * Sixteen queries are the rows of a tile, a tile of keys for them an item. All items are passed
 * twice: for the largest scores, then for the sums. While the softmax of one item is computed, the
 * tiles multiply the values of the one before. Scores are kept between the passes where they fit
 * the scratch; else, while the values of one item are added up, the tiles make the scores of the
 * next.
 */
#define GROUPS (DVSM_FIXED_KEYS / TILE)  /* of keys, an item */
#define BLOCKS (DVSM_FIXED_KEYS / DEPTH) /* of weights, an item */

#define SCORE_STEP  (TILE * TILE)
#define WEIGHT_STEP (TILE * DEPTH)

#include "kernels/fixed_avx512_softmax.inc.h"

/* Up to here the sums of weighted values fit 32 bits. */
#define MOST_KEYS 65536u

/* Numbers of an item's scores, and items whose scores the scratch holds. */
#define ITEM_SCORES (GROUPS * SCORE_STEP)
#define ITEMS_KEPT  (DVSM_FIXED_SCORES / ITEM_SCORES)

/* What the softmax of an item leaves to its values; two items take turns. */
struct weights {
	uint8_t *high, *low; /* [BLOCKS][TILE queries][DEPTH keys], planes of the weights */
};

/* A call: its queries, and what lies between the stages of an item. */
struct state {
	const struct dvsm_fixed_attention *job;
	struct query queries[DVSM_FIXED_QUERIES];
	size_t groups;   /* of queries, sixteen each */
	size_t slices;   /* of the head, DEPTH each */
	size_t items;    /* tiles of keys for each group */
	int8_t *q;       /* [groups][slices][TILE][DEPTH], 0 beyond the head */
	int32_t *scores; /* [ITEMS_KEPT][GROUPS][TILE queries][TILE keys] */
	struct weights weights[2];
	int32_t *sums; /* [channels / TILE][2 planes][TILE queries][TILE channels] */
};

/* One item: the queries of a group, `count` keys from `key` on, and where their scores go. */
struct item {
	size_t group, key, count;
	int32_t *scores;
};

/* Groups of queries pass by before the next keys come. */
static inline struct item item_at(const struct state *state, size_t index)
{
	const size_t key = index / state->groups * DVSM_FIXED_KEYS;

	return (struct item){
		.group = index % state->groups,
		.key = key,
		.count = dvsm_fixed_tile_keys(state->job, key),
		.scores = state->scores + index % ITEMS_KEPT * ITEM_SCORES,
	};
}

/* Keys with those that fill them up. */
static inline size_t padded_count(const struct item *item)
{
	return dvsm_fixed_pad(item->count, DVSM_FIXED_KEY_PAD);
}

/* ---- scores ---- */

/*
 * A head of more than a slice is cut into whole ones; the last of them reaches back to numbers that
 * the one before has, where its queries are 0. A shorter head makes the tiles smaller.
 */
static inline size_t slice_start(size_t head_width, size_t slice)
{
	if (head_width < DEPTH)
		return 0;
	return (slice + 1) * DEPTH <= head_width ? slice * DEPTH : head_width - DEPTH;
}

static struct amx_config attention_tiles(size_t head_width)
{
	struct amx_config config = amx_whole_tiles();

	if (head_width < DEPTH) {
		config.row_bytes[7] = (uint16_t)head_width;
		config.rows[6] = (uint8_t)(head_width / 4);
	}
	return config;
}

/* Queries to whole tiles; where there are fewer, the last one fills up. */
static void gather_queries(const struct state *state)
{
	const size_t width = state->job->head_width;
	int8_t *to = state->q;

	for (size_t group = 0; group < state->groups; group++) {
		for (size_t slice = 0; slice < state->slices; slice++, to += TILE * DEPTH) {
			const size_t start = slice_start(width, slice), done = slice * DEPTH;
			const size_t bytes = width - done < DEPTH ? width - done : DEPTH;

			memset(to, 0, (size_t)TILE * DEPTH);
			for (size_t i = 0; i < TILE; i++)
				memcpy(to + i * DEPTH + (done - start),
				       state->queries[group * TILE + i].q + done, bytes);
		}
	}
}

/* Four groups of keys at a time. */
static void score(const struct state *state, const struct item *item)
{
	const size_t width = state->job->head_width, group_bytes = TILE * width;
	const int8_t *q = state->q + item->group * state->slices * TILE * DEPTH;
	const int8_t *k = state->job->k + item->key * width;
	int32_t *scores = item->scores;

	for (size_t key = 0; key < padded_count(item); key += 4 * TILE) {
		AMX_ZERO(0);
		AMX_ZERO(1);
		AMX_ZERO(2);
		AMX_ZERO(3);
		for (size_t slice = 0; slice < state->slices; slice++) {
			const int8_t *from = k + key * width + slice_start(width, slice) * TILE;

			AMX_LOAD(7, q + slice * TILE * DEPTH, DEPTH);
			AMX_LOAD(6, from, 64);
			AMX_DOT_SIGNED(0, 7, 6);
			AMX_LOAD(6, from + group_bytes, 64);
			AMX_DOT_SIGNED(1, 7, 6);
			AMX_LOAD(6, from + 2 * group_bytes, 64);
			AMX_DOT_SIGNED(2, 7, 6);
			AMX_LOAD(6, from + 3 * group_bytes, 64);
			AMX_DOT_SIGNED(3, 7, 6);
		}
		AMX_STORE(0, scores, 64);
		AMX_STORE(1, scores + SCORE_STEP, 64);
		AMX_STORE(2, scores + 2 * SCORE_STEP, 64);
		AMX_STORE(3, scores + 3 * SCORE_STEP, 64);
		scores += 4 * SCORE_STEP;
	}
}

/* ---- values ---- */

/* The next of an item's products: both planes of 64 weights times two groups of channels. */
struct mixing {
	size_t channel, key;
};

/* Tiles 0 to 5: 6 and 7 have the head's shape. */
static inline void mix_next(const struct state *state, const struct item *item,
			    const struct weights *weights, struct mixing *at)
{
	const size_t width = state->job->head_width;
	const int8_t *v = state->job->v + (item->key + at->key) * width + 4 * at->channel;
	const bool two = at->channel + TILE < width;
	int32_t *sums = state->sums + 2 * TILE * at->channel;

	if (at->key == 0) {
		AMX_ZERO(0);
		AMX_ZERO(1);
		AMX_ZERO(2);
		AMX_ZERO(3);
	}
	AMX_LOAD(4, weights->high + at->key * TILE, DEPTH);
	AMX_LOAD(5, v, 4 * width);
	AMX_DOT_UNSIGNED(0, 4, 5);
	if (two) {
		AMX_LOAD(5, v + 64, 4 * width);
		AMX_DOT_UNSIGNED(2, 4, 5);
	}
	AMX_LOAD(4, weights->low + at->key * TILE, DEPTH);
	if (two) {
		AMX_DOT_UNSIGNED(3, 4, 5);
		AMX_LOAD(5, v, 4 * width);
	}
	AMX_DOT_UNSIGNED(1, 4, 5);
	at->key += DEPTH;
	if (at->key < item->count)
		return;
	AMX_STORE(0, sums, 64);
	AMX_STORE(1, sums + TILE * TILE, 64);
	if (two) {
		AMX_STORE(2, sums + 2 * TILE * TILE, 64);
		AMX_STORE(3, sums + 3 * TILE * TILE, 64);
	}
	at->key = 0;
	at->channel += 2 * TILE;
}

/* Both planes to the sums over all keys. */
static void add_values(const struct state *state, const struct item *item)
{
	const struct query *queries = state->queries + item->group * TILE;
	const int32_t *sums = state->sums;

	for (size_t channel = 0; channel < state->job->head_width; channel += TILE) {
		for (size_t i = 0; i < TILE; i++, sums += TILE) {
			int32_t *o = queries[i].o + channel, *o_low = queries[i].o_low + channel;
			__m512i high = _mm512_load_si512(sums);
			__m512i low = _mm512_load_si512(sums + TILE * TILE);

			_mm512_store_si512(o, _mm512_add_epi32(_mm512_load_si512(o), high));
			_mm512_store_si512(o_low, _mm512_add_epi32(_mm512_load_si512(o_low), low));
		}
		sums += TILE * TILE;
	}
}

/* ---- softmax ---- */

/* Sixteen rows, each to one number. */
#define REDUCE_ROWS(name, op)                                                                      \
	static inline __m512i name(const __m512i rows[TILE])                                       \
	{                                                                                          \
		__m512i pairs[8], fours[4], left, right;                                           \
                                                                                                   \
		DVSM_UNROLL                                                                        \
		for (int i = 0; i < 8; i++)                                                        \
			pairs[i] = op(_mm512_unpacklo_epi32(rows[2 * i], rows[2 * i + 1]),         \
				      _mm512_unpackhi_epi32(rows[2 * i], rows[2 * i + 1]));        \
		DVSM_UNROLL                                                                        \
		for (int i = 0; i < 4; i++)                                                        \
			fours[i] = op(_mm512_unpacklo_epi64(pairs[2 * i], pairs[2 * i + 1]),       \
				      _mm512_unpackhi_epi64(pairs[2 * i], pairs[2 * i + 1]));      \
		left = op(_mm512_shuffle_i32x4(fours[0], fours[1], 0x88),                          \
			  _mm512_shuffle_i32x4(fours[0], fours[1], 0xdd));                         \
		right = op(_mm512_shuffle_i32x4(fours[2], fours[3], 0x88),                         \
			   _mm512_shuffle_i32x4(fours[2], fours[3], 0xdd));                        \
		return op(_mm512_shuffle_i32x4(left, right, 0x88),                                 \
			  _mm512_shuffle_i32x4(left, right, 0xdd));                                \
	}

REDUCE_ROWS(largest_in_rows, _mm512_max_epi32)
REDUCE_ROWS(sum_of_rows, _mm512_add_epi32)

/* The largest scores of an item among those of its queries. */
static void raise_tops(struct state *state, const struct item *item)
{
	struct query *queries = state->queries + item->group * TILE;
	int32_t largest[TILE];
	__m512i rows[TILE];

	for (size_t i = 0; i < TILE; i++)
		rows[i] = largest_lanes(item->scores + i * TILE, item->count);
	_mm512_storeu_si512(largest, largest_in_rows(rows));
	for (size_t i = 0; i < TILE; i++)
		if (item->key == 0 || largest[i] > queries[i].top)
			queries[i].top = largest[i];
}

/* The first pass; an item's scores are made while those of the one before are looked through. */
static void find_tops(struct state *state)
{
	struct item item = item_at(state, 0), next = item;

	score(state, &item);
	for (size_t index = 0; index < state->items; index++) {
		if (index + 1 < state->items) {
			next = item_at(state, index + 1);
			score(state, &next);
		}
		raise_tops(state, &item);
		item = next;
	}
}

/* Rows of the softmax between two products. */
#define MIX_ROWS 4

/* The softmax of an item, and the values of the one before where there is one. */
static void softmax(struct state *state, const struct item *item, struct weights *own,
		    const struct item *before, const struct weights *other)
{
	const size_t width = state->job->head_width, channels = before ? width : 0;
	const size_t share = width * BLOCKS * MIX_ROWS / (2 * TILE * TILE) + 1;
	struct query *queries = state->queries + item->group * TILE;
	struct mixing mixing = {0};
	int32_t sums[TILE];
	__m512i rows[TILE];

	for (size_t i = 0; i < TILE; i++) {
		if (i % MIX_ROWS == 0 && mixing.channel >= channels)
			AMX_KEEP_AWAKE(0, 4, 5);
		for (size_t n = 0; i % MIX_ROWS == 0 && n < share && mixing.channel < channels; n++)
			mix_next(state, before, other, &mixing);
		rows[i] = weigh_scores(&queries[i], item->scores + i * TILE, own->high + i * DEPTH,
				       own->low + i * DEPTH, item->count);
	}
	while (mixing.channel < channels)
		mix_next(state, before, other, &mixing);
	_mm512_storeu_si512(sums, sum_of_rows(rows));
	for (size_t i = 0; i < TILE; i++)
		queries[i].sum += sums[i];
}

/* ---- the call ---- */

static void *take(unsigned char **at, size_t bytes)
{
	void *taken = *at;

	*at += bytes;
	return taken;
}

/* Places in the caller's scratch. */
static void place(struct state *state)
{
	const size_t width = state->job->head_width;
	unsigned char *at = state->job->scratch;

	for (int i = 0; i < 2; i++) {
		state->weights[i].high = take(&at, (size_t)BLOCKS * WEIGHT_STEP);
		state->weights[i].low = take(&at, (size_t)BLOCKS * WEIGHT_STEP);
	}
	state->scores = take(&at, DVSM_FIXED_SCORES * sizeof(int32_t));
	state->slices = dvsm_fixed_pad(width, DEPTH) / DEPTH;
	state->q = take(&at, DVSM_FIXED_QUERIES * state->slices * DEPTH);
	state->sums = take(&at, 2 * TILE * width * sizeof(int32_t));
	for (size_t i = 0; i < DVSM_FIXED_QUERIES; i++) {
		state->queries[i].o = take(&at, width * sizeof(int32_t));
		state->queries[i].o_low = take(&at, width * sizeof(int32_t));
	}
}

static void attend(struct state *state)
{
	const struct amx_config config = attention_tiles(state->job->head_width);
	const bool kept = state->items <= ITEMS_KEPT;
	struct item item = item_at(state, 0), before = item, next = item;
	struct mixing mixing = {0};

	amx_publish();
	amx_open(&config);
	find_tops(state);
	if (!kept)
		score(state, &item);
	for (size_t index = 0; index < state->items; index++) {
		struct weights *own = &state->weights[index % 2];
		const struct weights *other = &state->weights[(index + 1) % 2];

		amx_publish();
		softmax(state, &item, own, index > 0 ? &before : NULL, other);
		if (index + 1 < state->items) {
			next = item_at(state, index + 1);
			if (!kept)
				score(state, &next);
		}
		if (index > 0)
			add_values(state, &before);
		before = item;
		item = next;
	}
	amx_publish();
	while (mixing.channel < state->job->head_width)
		mix_next(state, &before, &state->weights[(state->items - 1) % 2], &mixing);
	add_values(state, &before);
	amx_close();
}

static void attention(const struct dvsm_fixed_attention *job)
{
	struct state state = {.job = job, .groups = (job->queries + TILE - 1) / TILE};
	const size_t tiles = (job->keys + DVSM_FIXED_KEYS - 1) / DVSM_FIXED_KEYS;

	if (job->keys > MOST_KEYS) {
		dvsm_fixed_kernels_scalar.attention(job);
		return;
	}
	if (job->queries == 0)
		return;
	state.items = tiles * state.groups;
	place(&state);
	for (size_t i = 0; i < state.groups * TILE; i++)
		start(job, i < job->queries ? i : job->queries - 1, &state.queries[i]);
	gather_queries(&state);
	if (job->keys > 0)
		attend(&state);
	for (size_t i = 0; i < job->queries; i++)
		write_out(job, &state.queries[i], job->out + i * job->out_stride);
}
