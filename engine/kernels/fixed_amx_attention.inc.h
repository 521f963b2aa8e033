/*
 * Template: fixed-point attention of AMX, included by fixed_amx.c.
 *
 * Sixteen queries are the rows of a tile, a group. It passes over the keys twice, 64 at a time, a
 * block: for the scores, of which it keeps words and the largest, and for their weights and values.
 * The words of a block are made while the scores of the next are on their way; the processor looks
 * ahead a few rows only, so tiles and rows take turns. Weights and values do not: there is nothing
 * to be had from both units at once, which share a port and slow the clock.
 *
 * A tile that is stored keeps the processor's front busy for as long as a product takes, three
 * times as long where it is not in the first-level cache: scores are stored once, where they are
 * read soon. Keys and values, which a group meets once, pass by that cache.
 */
#include "kernels/fixed_avx512_lanes.h"
#include "kernels/fixed_avx512_softmax.h"

/* Up to here the sums of weighted values fit 32 bits. */
#define MOST_KEYS 65536u

/* Keys of a block; what a group has of it: scores and their words, a plane of weights. */
#define KEYS         DEPTH
#define BLOCK_SCORES ((size_t)KEYS * TILE)

/* Blocks whose weights are there before their values come: both planes stay in the first cache. */
#define SPAN ((size_t)8)

/* Blocks whose words are kept between the passes, and stay in the second-level cache. */
#define KEPT ((size_t)DVSM_FIXED_MANY_KEYS / KEYS)

/*
 * Where there are more, words are made twice, and all groups of a call pass over so many blocks
 * before any goes on, whose keys and values stay in that cache meanwhile.
 */
#define CHUNK ((size_t)32)

/* Groups of a call. */
#define GROUPS (DVSM_FIXED_MOST_QUERIES / TILE)

/* Sums of a pair: two groups of channels with both planes, which four tiles hold. */
#define PAIR_SUMS (4 * TILE * TILE)

/* A group of queries on its way; the arrays lie in the caller's scratch. */
struct group {
	const struct dvsm_fixed_attention *job;
	size_t first;                  /* query */
	size_t width;                  /* of the head */
	size_t slices;                 /* of a query, DEPTH each */
	size_t pairs;                  /* of groups of sixteen channels */
	size_t blocks;                 /* of all keys */
	size_t chunk;                  /* blocks that are passed over at a time */
	size_t key_lines, value_lines; /* of a block's: what the group calls of those to come */
	int8_t *q;                     /* [slices][TILE][DEPTH], 0 beyond the query */
	int32_t *scores;               /* [2 blocks][4][TILE queries][TILE keys] */
	int16_t *words;                /* [KEPT][TILE][KEYS] */
	uint8_t *planes;               /* [SPAN][high, low][TILE][KEYS] of weights */
	int32_t *sums;                 /* [pairs][2][high, low][TILE queries][TILE channels] */
	int32_t *tops;                 /* [TILE][16] largest words so far, by key modulo 32 */
	int32_t *total;                /* [TILE][16] sums of weights, likewise */
	struct slope slopes[TILE];
};

/* Blocks from `from` to before `to`. */
struct range {
	size_t from, to;
};

static inline struct range range_at(size_t from, size_t most, size_t end)
{
	return (struct range){from, end - from < most ? end : from + most};
}

static inline const int8_t *keys_at(const struct group *group, size_t block)
{
	return group->job->k + block * KEYS * group->job->key_width;
}

static inline int32_t *scores_at(const struct group *group, size_t block)
{
	return group->scores + block % 2 * BLOCK_SCORES;
}

static inline int16_t *words_at(const struct group *group, size_t block)
{
	return group->words + block % KEPT * BLOCK_SCORES;
}

static inline uint8_t *planes_at(const struct group *group, size_t block)
{
	return group->planes + block % SPAN * (2 * BLOCK_SCORES);
}

/* Keys of a block, KEYS but for the last. */
static inline size_t block_keys(const struct group *group, size_t block)
{
	const size_t left = group->job->keys - block * KEYS;

	return left < KEYS ? left : KEYS;
}

static inline const int8_t *values_at(const struct group *group, size_t block)
{
	return group->job->v + block * KEYS * group->width;
}

/*
 * Query i's share, `each` lines of a tile's, of what comes a chunk later, or in the next head,
 * which lies behind this one as a rule: to the second-level cache. What is not there does no harm.
 */
static inline void call_ahead(const struct group *group, const int8_t *from, size_t width,
			      size_t each, size_t i)
{
	const size_t first = (group->first + i) * each / TILE;
	const size_t end = (group->first + i + 1) * each / TILE;

	from += group->chunk * KEYS * width;
	for (size_t line = first; line < end; line++)
		_mm_prefetch(from + line * 64, _MM_HINT_T1);
}

/* ---- scores ---- */

/*
 * A query of more than a slice is cut into whole ones; the last of them reaches back to numbers
 * that the one before has, where its queries are 0. A tile of shorter keys reaches ahead to other
 * keys, where its queries are 0 too.
 */
static inline size_t slice_start(size_t width, size_t slice)
{
	if (width < DEPTH)
		return 0;
	return (slice + 1) * DEPTH <= width ? slice * DEPTH : width - DEPTH;
}

/* Query i of a group; the last one fills up. */
static inline size_t query_at(const struct group *group, size_t i)
{
	const size_t last = group->job->queries - 1;

	return group->first + i < last ? group->first + i : last;
}

/* Queries to whole tiles. */
static void gather_queries(const struct group *group)
{
	const struct dvsm_fixed_attention *job = group->job;
	int8_t *to = group->q;

	for (size_t slice = 0; slice < group->slices; slice++, to += TILE * DEPTH) {
		const size_t start = slice_start(job->key_width, slice), done = slice * DEPTH;
		const size_t left = job->key_width - done, bytes = left < DEPTH ? left : DEPTH;

		if (bytes < DEPTH)
			memset(to, 0, (size_t)TILE * DEPTH);
		for (size_t i = 0; i < TILE; i++) {
			const int8_t *q = job->q + query_at(group, i) * job->q_stride;

			memcpy(to + i * DEPTH + (done - start), q + done, bytes);
		}
	}
}

/* Scores of sixteen keys to a tile; queries of a single slice wait in tile 5. */
#define SCORE_TILE(tile, group, k)                                                                 \
	do {                                                                                       \
		AMX_ZERO(tile);                                                                    \
		if ((group)->slices == 1) {                                                        \
			AMX_STREAM(6, k, 64);                                                      \
			AMX_DOT_SIGNED(tile, 5, 6);                                                \
		}                                                                                  \
		for (size_t slice = 0; (group)->slices > 1 && slice < (group)->slices; slice++) {  \
			AMX_LOAD(5, (group)->q + slice * TILE * DEPTH, DEPTH);                     \
			AMX_STREAM(6, (k) + slice_start((group)->job->key_width, slice) * TILE,    \
				   64);                                                            \
			AMX_DOT_SIGNED(tile, 5, 6);                                                \
		}                                                                                  \
	} while (0)

/* Words of four rows of a block's scores, and the largest of all so far. */
DVSM_INLINE void keep_words(const struct group *group, size_t block, const size_t first,
			    const __mmask32 lanes[2], __m512i tops[TILE])
{
	const int32_t *scores = scores_at(group, block);
	int16_t *words = words_at(group, block);

	DVSM_UNROLL
	for (size_t i = first; i < first + 4; i++) {
		const __m512i shift = _mm512_set1_epi32(group->slopes[i].shift);

		DVSM_UNROLL
		for (size_t half = 0; half < 2; half++) {
			const int32_t *from = scores + (2 * half * TILE + i) * TILE;
			const __m512i made =
				score_words(_mm512_load_si512(from),
					    _mm512_load_si512(from + TILE * TILE), shift);

			tops[i] = _mm512_mask_max_epi16(tops[i], lanes[half], tops[i], made);
			_mm512_store_si512(words + i * KEYS + half * 32, made);
		}
	}
}

/* Makes the words of a block, and the scores of the next one where `ahead`. */
DVSM_INLINE void word_step(const struct group *group, size_t block, bool ahead, __m512i tops[TILE])
{
	const size_t key_bytes = TILE * group->job->key_width, count = block_keys(group, block);
	const __mmask32 lanes[2] = {word_lanes(0, count), word_lanes(32, count)};
	const int8_t *k = keys_at(group, block + 1);
	int32_t *next = scores_at(group, block + 1);

	for (size_t i = 0; i < TILE && group->chunk < group->blocks; i++)
		call_ahead(group, keys_at(group, block), group->job->key_width, group->key_lines,
			   i);
	if (ahead)
		SCORE_TILE(0, group, k);
	keep_words(group, block, 0, lanes, tops);
	if (ahead) {
		SCORE_TILE(1, group, k + key_bytes);
		AMX_STORE(0, next, 64);
	}
	keep_words(group, block, 4, lanes, tops);
	if (ahead) {
		SCORE_TILE(2, group, k + 2 * key_bytes);
		AMX_STORE(1, next + TILE * TILE, 64);
	}
	keep_words(group, block, 8, lanes, tops);
	if (ahead) {
		SCORE_TILE(3, group, k + 3 * key_bytes);
		AMX_STORE(2, next + 2 * TILE * TILE, 64);
	}
	keep_words(group, block, 12, lanes, tops);
	if (ahead)
		AMX_STORE(3, next + 3 * TILE * TILE, 64);
}

/* Sums of tiles 0 to 3, tile behind tile. */
static inline void store_tiles(int32_t *to)
{
	AMX_STORE(0, to, 64);
	AMX_STORE(1, to + TILE * TILE, 64);
	AMX_STORE(2, to + 2 * TILE * TILE, 64);
	AMX_STORE(3, to + 3 * TILE * TILE, 64);
}

static void make_words(const struct group *group, struct range range)
{
	const size_t key_bytes = TILE * group->job->key_width;
	const int8_t *k = keys_at(group, range.from);
	__m512i tops[TILE];

	DVSM_UNROLL
	for (size_t i = 0; i < TILE; i++)
		tops[i] = _mm512_load_si512(group->tops + i * 16);
	AMX_LOAD(5, group->q, DEPTH);
	SCORE_TILE(0, group, k);
	SCORE_TILE(1, group, k + key_bytes);
	SCORE_TILE(2, group, k + 2 * key_bytes);
	SCORE_TILE(3, group, k + 3 * key_bytes);
	store_tiles(scores_at(group, range.from));
	for (size_t block = range.from; block < range.to; block++)
		word_step(group, block, block + 1 < range.to, tops);
	DVSM_UNROLL
	for (size_t i = 0; i < TILE; i++)
		_mm512_store_si512(group->tops + i * 16, tops[i]);
}

/* ---- weights and values ---- */

static inline void open_sums(const int32_t *sums, bool begin)
{
	if (begin) {
		AMX_ZERO(0);
		AMX_ZERO(1);
		AMX_ZERO(2);
		AMX_ZERO(3);
		return;
	}
	AMX_LOAD(0, sums, 64);
	AMX_LOAD(1, sums + TILE * TILE, 64);
	AMX_LOAD(2, sums + 2 * TILE * TILE, 64);
	AMX_LOAD(3, sums + 3 * TILE * TILE, 64);
}

/* A block's weights times its values of two groups of channels, of which one may be all. */
static inline void mix_block(const struct group *group, size_t block, size_t pair)
{
	const uint8_t *planes = planes_at(group, block);
	const size_t stride = 4 * group->width;
	const int8_t *v = values_at(group, block) + pair * 8 * TILE;

	AMX_LOAD(4, planes, KEYS);
	AMX_STREAM(6, v, stride);
	AMX_DOT_UNSIGNED(0, 4, 6);
	AMX_LOAD(5, planes + BLOCK_SCORES, KEYS);
	AMX_DOT_UNSIGNED(1, 5, 6);
	if ((pair + 1) * 2 * TILE <= group->width) {
		AMX_STREAM(7, v + 64, stride);
		AMX_DOT_UNSIGNED(2, 4, 7);
		AMX_DOT_UNSIGNED(3, 5, 7);
	}
}

static void mix_span(const struct group *group, struct range range)
{
	amx_publish();
	for (size_t pair = 0; pair < group->pairs; pair++) {
		int32_t *sums = group->sums + pair * PAIR_SUMS;

		open_sums(sums, range.from == 0);
		for (size_t block = range.from; block < range.to; block++)
			mix_block(group, block, pair);
		store_tiles(sums);
	}
}

/* A block's words to planes of weights, and the sums of these. */
DVSM_INLINE void weigh_block(const struct group *group, const struct softmax_lanes *lanes,
			     size_t block, size_t count)
{
	const int8_t *k = keys_at(group, block), *v = values_at(group, block);
	const int16_t *words = words_at(group, block);
	uint8_t *high = planes_at(group, block);
	int32_t *total = group->total;

	for (size_t i = 0; i < TILE; i++) {
		call_ahead(group, k, group->job->key_width, group->key_lines, i);
		call_ahead(group, v, group->width, group->value_lines, i);
		_mm512_store_si512(total, weigh_keys(lanes, &group->slopes[i], words, high,
						     high + BLOCK_SCORES, count,
						     _mm512_load_si512(total)));
		words += KEYS;
		high += KEYS;
		total += 16;
	}
}

static void weigh_span(const struct group *group, struct range range)
{
	const struct softmax_lanes lanes = softmax_lanes_make();

	for (size_t block = range.from; block < range.to; block++) {
		const size_t count = block_keys(group, block);

		AMX_KEEP_AWAKE(0, 4, 5);
		if (count == KEYS)
			weigh_block(group, &lanes, block, KEYS);
		else
			weigh_block(group, &lanes, block, count);
	}
}

static void weigh_and_mix(const struct group *group, struct range range)
{
	for (size_t block = range.from; block < range.to; block += SPAN) {
		const struct range span = range_at(block, SPAN, range.to);

		weigh_span(group, span);
		mix_span(group, span);
	}
}

/* ---- the call ---- */

/* Sixteen rows of as many numbers, each to one. */
DVSM_INLINE __m512i fold_numbers(const int32_t *numbers, combine_fn *combine)
{
	__m512i rows[TILE];

	DVSM_UNROLL
	for (size_t i = 0; i < TILE; i++)
		rows[i] = _mm512_load_si512(numbers + i * 16);
	return fold_rows(rows, combine);
}

static void write_out(const struct group *group)
{
	const struct dvsm_fixed_attention *job = group->job;
	const size_t left = job->queries - group->first, count = left < TILE ? left : TILE;
	int32_t total[TILE];
	struct dvsm_fixed_quotient quotients[TILE];

	_mm512_storeu_si512(total, fold_numbers(group->total, add_s32));
	for (size_t i = 0; i < count; i++)
		quotients[i] = dvsm_fixed_divide((uint32_t)total[i]);
	for (size_t d = 0; d < job->dim; d += TILE) {
		const struct channels channels = load_channels(job, d);
		const int32_t *sums = group->sums + d / TILE * (PAIR_SUMS / 2);
		int16_t *out = job->out + group->first * job->out_stride + d;

		for (size_t i = 0; i < count; i++, sums += TILE, out += job->out_stride)
			write_channels(&channels, quotients[i], _mm512_load_si512(sums),
				       _mm512_load_si512(sums + TILE * TILE), out);
	}
}

static void *take(unsigned char **at, size_t bytes)
{
	void *taken = *at;

	*at += bytes;
	return taken;
}

/* A group, the `index`th of those on their way, and its places in the caller's scratch, of which
 * what it has of blocks is everyone's. */
static void start(const struct dvsm_fixed_attention *job, size_t first, size_t index,
		  struct group *group)
{
	const size_t blocks = dvsm_fixed_pad(job->keys, KEYS) / KEYS;
	const size_t slices = dvsm_fixed_pad(job->key_width, DEPTH) / DEPTH;
	const size_t pairs = dvsm_fixed_pad(job->head_width, 2 * TILE) / (2 * TILE);
	const size_t tops = TILE * 16 * sizeof(int32_t);
	unsigned char *at = job->scratch;

	*group = (struct group){
		.job = job,
		.first = first,
		.width = job->head_width,
		.slices = slices,
		.pairs = pairs,
		.blocks = blocks,
		.chunk = blocks > KEPT ? CHUNK : blocks,
		.key_lines = job->key_width * TILE / dvsm_fixed_pad(job->queries, TILE),
		.value_lines = job->head_width * TILE / dvsm_fixed_pad(job->queries, TILE),
		.words = take(&at, KEPT * BLOCK_SCORES * sizeof(int16_t)),
		.scores = take(&at, 2 * BLOCK_SCORES * sizeof(int32_t)),
		.planes = take(&at, SPAN * 2 * BLOCK_SCORES),
	};
	at += index * (slices * TILE * DEPTH + 2 * tops + pairs * PAIR_SUMS * sizeof(int32_t));
	group->q = take(&at, slices * TILE * DEPTH);
	group->tops = take(&at, tops);
	group->total = take(&at, tops);
	group->sums = take(&at, pairs * PAIR_SUMS * sizeof(int32_t));
	for (size_t i = 0; i < TILE; i++) {
		const size_t query = query_at(group, i);

		group->slopes[i] = slope_make(job->q_scale[query * job->scale_stride],
					      job->q + query * job->q_stride, job->key_width);
		_mm512_store_si512(group->tops + i * 16, _mm512_set1_epi16(INT16_MIN));
		_mm512_store_si512(group->total + i * 16, _mm512_setzero_si512());
	}
	gather_queries(group);
	amx_publish();
}

/* Each row of words to its largest. */
static void settle_tops(struct group *group)
{
	__m512i rows[TILE];
	int32_t tops[TILE];

	DVSM_UNROLL
	for (size_t i = 0; i < TILE; i++)
		rows[i] = larger_words(_mm512_load_si512(group->tops + i * 16));
	_mm512_storeu_si512(tops, fold_rows(rows, max_s32));
	for (size_t i = 0; i < TILE; i++)
		group->slopes[i].top = twice(tops[i]);
}

static void attend(struct group *groups, size_t count)
{
	const size_t blocks = groups->blocks, step = groups->chunk;

	for (size_t block = 0; block < blocks; block += step)
		for (size_t i = 0; i < count; i++)
			make_words(&groups[i], range_at(block, step, blocks));
	for (size_t i = 0; i < count; i++)
		settle_tops(&groups[i]);
	for (size_t block = 0; block < blocks; block += step) {
		const struct range range = range_at(block, step, blocks);

		for (size_t i = 0; i < count; i++) {
			if (blocks > step)
				make_words(&groups[i], range);
			weigh_and_mix(&groups[i], range);
		}
	}
	for (size_t i = 0; i < count; i++)
		write_out(&groups[i]);
}

static void attention(const struct dvsm_fixed_attention *job)
{
	const struct amx_config config = amx_whole_tiles();
	const size_t together = job->keys > KEPT * KEYS ? GROUPS : 1;
	struct group groups[GROUPS];
	size_t first = 0;

	if (job->keys == 0 || job->keys > MOST_KEYS) {
		dvsm_fixed_kernels_scalar.attention(job);
		return;
	}
	amx_open(&config);
	while (first < job->queries) {
		size_t count = 0;

		for (; count < together && first < job->queries; count++, first += TILE)
			start(job, first, count, &groups[count]);
		attend(groups, count);
	}
	amx_close();
}
