/*
 * Template: fixed-point attention of AMX, included by fixed_amx.c.
 *
 * Sixteen queries are the rows of a tile, a group. Its keys come in spans, of which scores and
 * weights stay in the first-level cache: a tile that is stored beyond it takes three times as long.
 * So where keys are more than a span, their scores are made twice, for the largest and for the
 * sums. Keys and values, which a group meets once, pass by that cache. Stages follow each other: a
 * tile that is stored keeps the processor's front busy for as long as a product takes, and there is
 * little to be had from the vectors' and the tiles' units at the same time.
 */
#define SCORE_STEP  TILE
#define WEIGHT_STEP DEPTH

#include "kernels/fixed_avx512_lanes.h"
#include "kernels/fixed_avx512_softmax.inc.h"

/* Up to here the sums of weighted values fit 32 bits. */
#define MOST_KEYS 65536u

/* Keys of a span, and the numbers from a query's scores and weights to those of the next. */
#define SPAN          ((size_t)256)
#define SCORES_STRIDE (SPAN + TILE)
#define PLANE_STRIDE  (SPAN + DEPTH)

/* Sums of a pair: two groups of channels with both planes, which four tiles hold. */
#define PAIR_SUMS (4 * TILE * TILE)

/* A group of queries on its way; the arrays lie in the caller's scratch. */
struct group {
	const struct dvsm_fixed_attention *job;
	size_t width;        /* of the head */
	size_t slices;       /* of the head, DEPTH each */
	size_t pairs;        /* of sixteen channels */
	int8_t *q;           /* [slices][TILE][DEPTH], 0 beyond the head */
	int32_t *scores;     /* [TILE][SCORES_STRIDE] of a span */
	uint8_t *high, *low; /* [TILE][PLANE_STRIDE] planes of its weights */
	int32_t *sums;       /* [pairs][2][2 planes][TILE queries][TILE channels] */
	int32_t *tops;       /* [TILE][16] largest scores so far, by key modulo 16 */
	int32_t *total;      /* [TILE][16] sums of weights, likewise */
	struct slope slopes[TILE];
	int32_t top[TILE]; /* largest scores over all keys */
};

/* Keys from `key` on. */
struct span {
	size_t key, count;
	size_t padded; /* with those that fill the last block up */
};

static inline struct span span_at(const struct group *group, size_t key)
{
	const size_t left = group->job->keys - key, count = left < SPAN ? left : SPAN;

	return (struct span){key, count, dvsm_fixed_pad(count, DVSM_FIXED_KEY_PAD)};
}

/* ---- scores ---- */

/*
 * A head of more than a slice is cut into whole ones; the last of them reaches back to numbers that
 * the one before has, where its queries are 0. A shorter head makes the tiles smaller.
 */
static inline size_t slice_start(size_t width, size_t slice)
{
	if (width < DEPTH)
		return 0;
	return (slice + 1) * DEPTH <= width ? slice * DEPTH : width - DEPTH;
}

/* Scores take queries from tile 7 and keys from tile 6: these a short head makes smaller. */
static void open_tiles(const struct group *group, bool scores)
{
	struct amx_config config = amx_whole_tiles();

	if (scores && group->width < DEPTH) {
		config.row_bytes[7] = (uint16_t)group->width;
		config.rows[6] = (uint8_t)(group->width / 4);
	}
	amx_open(&config);
}

/* Query i of those from `first` on; the last one fills up. */
static inline size_t query_at(const struct group *group, size_t first, size_t i)
{
	return first + i < group->job->queries ? first + i : group->job->queries - 1;
}

/* Queries to whole tiles. */
static void gather_queries(const struct group *group, size_t first)
{
	const struct dvsm_fixed_attention *job = group->job;
	int8_t *to = group->q;

	for (size_t slice = 0; slice < group->slices; slice++, to += TILE * DEPTH) {
		const size_t start = slice_start(group->width, slice), done = slice * DEPTH;
		const size_t left = group->width - done, bytes = left < DEPTH ? left : DEPTH;

		memset(to, 0, (size_t)TILE * DEPTH);
		for (size_t i = 0; i < TILE; i++) {
			const int8_t *q = job->q + query_at(group, first, i) * job->q_stride;

			memcpy(to + i * DEPTH + (done - start), q + done, bytes);
		}
	}
}

/* Four groups of keys at a time. */
static void score(const struct group *group, const struct span *span)
{
	const size_t key_bytes = TILE * group->width;
	const size_t stride = SCORES_STRIDE * sizeof(int32_t);
	const int8_t *k = group->job->k + span->key * group->width;
	int32_t *scores = group->scores;

	AMX_LOAD(7, group->q, DEPTH);
	for (size_t key = 0; key < span->padded; key += 4 * TILE) {
		AMX_ZERO(0);
		AMX_ZERO(1);
		AMX_ZERO(2);
		AMX_ZERO(3);
		for (size_t slice = 0; slice < group->slices; slice++) {
			const int8_t *from = k + slice_start(group->width, slice) * TILE;

			if (group->slices > 1)
				AMX_LOAD(7, group->q + slice * TILE * DEPTH, DEPTH);
			AMX_STREAM(6, from, 64);
			AMX_DOT_SIGNED(0, 7, 6);
			AMX_STREAM(6, from + key_bytes, 64);
			AMX_DOT_SIGNED(1, 7, 6);
			AMX_STREAM(6, from + 2 * key_bytes, 64);
			AMX_DOT_SIGNED(2, 7, 6);
			AMX_STREAM(6, from + 3 * key_bytes, 64);
			AMX_DOT_SIGNED(3, 7, 6);
		}
		AMX_STORE(0, scores, stride);
		AMX_STORE(1, scores + TILE, stride);
		AMX_STORE(2, scores + 2 * TILE, stride);
		AMX_STORE(3, scores + 3 * TILE, stride);
		scores += 4 * TILE;
		k += 4 * key_bytes;
	}
}

/* Sixteen rows of as many numbers, each to one. */
DVSM_INLINE __m512i fold_numbers(const int32_t *numbers, combine_fn *combine)
{
	__m512i rows[TILE];

	DVSM_UNROLL
	for (size_t i = 0; i < TILE; i++)
		rows[i] = _mm512_load_si512(numbers + i * 16);
	return fold_rows(rows, combine);
}

/* The largest scores of a span among those of all. */
static void raise_tops(const struct group *group, const struct span *span)
{
	for (size_t i = 0; i < TILE; i++) {
		int32_t *top = group->tops + i * 16;
		__m512i largest = largest_lanes(group->scores + i * SCORES_STRIDE, span->count);

		if (span->key > 0)
			largest = _mm512_max_epi32(largest, _mm512_load_si512(top));
		_mm512_store_si512(top, largest);
	}
}

static void find_tops(struct group *group)
{
	for (size_t key = 0; key < group->job->keys; key += SPAN) {
		const struct span span = span_at(group, key);

		score(group, &span);
		raise_tops(group, &span);
	}
	_mm512_storeu_si512(group->top, fold_numbers(group->tops, max_s32));
}

/* ---- weights and values ---- */

/* Bytes of a head's keys, up to which those of two heads and their values share a cache. */
#define MOST_CALLED ((size_t)256 << 10)

/*
 * Behind the keys and values of a head lie those of the next, as a rule, which comes next: each
 * query calls its share of a span to the second-level cache. What is not there does no harm.
 */
static inline void call_ahead(const struct group *group, const struct span *span, size_t query)
{
	const size_t head = dvsm_fixed_pad(group->job->keys, DVSM_FIXED_KEY_PAD) * group->width;
	const size_t share = span->padded * group->width / DVSM_FIXED_QUERIES;
	const size_t at = head + span->key * group->width + query * share;

	for (size_t i = 0; head <= MOST_CALLED && i < share; i += 64) {
		_mm_prefetch(group->job->k + at + i, _MM_HINT_T1);
		_mm_prefetch(group->job->v + at + i, _MM_HINT_T1);
	}
}

/* A span's scores to planes of weights, and the sums of these. */
static void weigh(const struct group *group, const struct span *span, size_t first)
{
	for (size_t i = 0; i < TILE; i++) {
		int32_t *total = group->total + i * 16;
		__m512i sums;

		AMX_KEEP_AWAKE(0, 4, 5);
		call_ahead(group, span, first + i);
		sums = weigh_scores(
			&group->slopes[i], group->top[i], group->scores + i * SCORES_STRIDE,
			group->high + i * PLANE_STRIDE, group->low + i * PLANE_STRIDE, span->count);
		if (span->key > 0)
			sums = _mm512_add_epi32(sums, _mm512_load_si512(total));
		_mm512_store_si512(total, sums);
	}
}

/* A span's weights times its values of a pair of groups of channels, of which one may be all. */
DVSM_INLINE void mix_pair(const struct group *group, const struct span *span, size_t pair,
			  const bool two)
{
	const size_t stride = 4 * group->width;
	const int8_t *v = group->job->v + span->key * group->width + pair * 8 * TILE;
	int32_t *sums = group->sums + pair * PAIR_SUMS;

	if (span->key == 0) {
		AMX_ZERO(0);
		AMX_ZERO(1);
		AMX_ZERO(2);
		AMX_ZERO(3);
	} else {
		AMX_LOAD(0, sums, 64);
		AMX_LOAD(1, sums + TILE * TILE, 64);
		AMX_LOAD(2, sums + 2 * TILE * TILE, 64);
		AMX_LOAD(3, sums + 3 * TILE * TILE, 64);
	}
	for (size_t key = 0; key < span->count; key += DEPTH, v += DEPTH * group->width) {
		AMX_LOAD(4, group->high + key, PLANE_STRIDE);
		AMX_STREAM(6, v, stride);
		AMX_DOT_UNSIGNED(0, 4, 6);
		AMX_LOAD(5, group->low + key, PLANE_STRIDE);
		AMX_DOT_UNSIGNED(1, 5, 6);
		if (two) {
			AMX_STREAM(7, v + 64, stride);
			AMX_DOT_UNSIGNED(2, 4, 7);
			AMX_DOT_UNSIGNED(3, 5, 7);
		}
	}
	AMX_STORE(0, sums, 64);
	AMX_STORE(1, sums + TILE * TILE, 64);
	AMX_STORE(2, sums + 2 * TILE * TILE, 64);
	AMX_STORE(3, sums + 3 * TILE * TILE, 64);
}

static void mix(const struct group *group, const struct span *span)
{
	size_t pair = 0;

	for (; (pair + 1) * 2 * TILE <= group->width; pair++)
		mix_pair(group, span, pair, true);
	if (pair < group->pairs)
		mix_pair(group, span, pair, false);
}

/* ---- the call ---- */

static void write_out(const struct group *group, size_t first)
{
	const struct dvsm_fixed_attention *job = group->job;
	const size_t left = job->queries - first, count = left < TILE ? left : TILE;
	int32_t total[TILE];
	struct dvsm_fixed_quotient quotients[TILE];

	_mm512_storeu_si512(total, fold_numbers(group->total, add_s32));
	for (size_t i = 0; i < count; i++)
		quotients[i] = dvsm_fixed_divide((uint32_t)total[i]);
	for (size_t d = 0; d < job->dim; d += TILE) {
		const struct channels channels = load_channels(job, d);
		const int32_t *sums = group->sums + d / TILE * (PAIR_SUMS / 2);
		int16_t *out = job->out + first * job->out_stride + d;

		for (size_t i = 0; i < count; i++, sums += TILE, out += job->out_stride)
			write_channels(&channels, quotients[i], _mm512_load_si512(sums),
				       _mm512_load_si512(sums + TILE * TILE), out);
	}
}

/* Queries `first` and on, sixteen at most. */
static void attend(struct group *group, size_t first)
{
	const struct dvsm_fixed_attention *job = group->job;
	const bool reshaped = group->width < DEPTH;

	for (size_t i = 0; i < TILE; i++) {
		const size_t at = query_at(group, first, i) * job->scale_stride;

		group->slopes[i] = slope_make(job->q_scale[at]);
	}
	gather_queries(group, first);
	open_tiles(group, true);
	find_tops(group);
	for (size_t key = 0; key < job->keys; key += SPAN) {
		const struct span span = span_at(group, key);

		if (key > 0 && reshaped)
			open_tiles(group, true);
		if (job->keys > SPAN)
			score(group, &span);
		weigh(group, &span, first);
		if (reshaped)
			open_tiles(group, false);
		amx_publish();
		mix(group, &span);
	}
	write_out(group, first);
}

static void *take(unsigned char **at, size_t bytes)
{
	void *taken = *at;

	*at += bytes;
	return taken;
}

/* Places in the caller's scratch. */
static void place(struct group *group)
{
	unsigned char *at = group->job->scratch;

	group->scores = take(&at, TILE * SCORES_STRIDE * sizeof(int32_t));
	group->high = take(&at, TILE * PLANE_STRIDE);
	group->low = take(&at, TILE * PLANE_STRIDE);
	group->q = take(&at, group->slices * TILE * DEPTH);
	group->tops = take(&at, TILE * 16 * sizeof(int32_t));
	group->total = take(&at, TILE * 16 * sizeof(int32_t));
	group->sums = take(&at, group->pairs * PAIR_SUMS * sizeof(int32_t));
}

static void attention(const struct dvsm_fixed_attention *job)
{
	struct group group = {
		.job = job,
		.width = job->head_width,
		.slices = dvsm_fixed_pad(job->head_width, DEPTH) / DEPTH,
		.pairs = dvsm_fixed_pad(job->head_width, 2 * TILE) / (2 * TILE),
	};

	if (job->keys == 0 || job->keys > MOST_KEYS) {
		dvsm_fixed_kernels_scalar.attention(job);
		return;
	}
	if (job->queries == 0)
		return;
	place(&group);
	for (size_t first = 0; first < job->queries; first += TILE)
		attend(&group, first);
	amx_close();
}
