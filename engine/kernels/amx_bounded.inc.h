/*
 * Template: one-pass attention on AMX for scores of a known bound. Included by bf16_amx.c, behind
 * amx_online.inc.h.
 *
 * A weight is 2^score as it is, so that no maximum is looked for and nothing is rescaled. Queries
 * are rows: 32 of them and a chunk of keys make a unit of work. The tiles' unit makes scores of one
 * block of 32 keys, then weighted values of the unit before, while the vectors' units turn the rows
 * of the block before to weights, some behind each product. Keys and values pass by the first-level
 * cache, where scores, weights and sums of two units stay.
 */

#define UNIT   32u
#define BLOCKS (DVSM_ATTENTION_CHUNK / DEPTH)

/* Keys that all queries pass by before the next ones come: they stay in the second-level cache. */
#define SECTION 512u

struct bounded {
	size_t head_dim, query_rows;
	vf lift;                 /* takes scores to 255 - 2 bound .. 255 */
	number *q;               /* [query_rows][head_dim] in tiles, times scale log2(e) */
	float *out;              /* [query_rows][head_dim] */
	float *sums;             /* [query_rows][16]: of weights, by key modulo 16 */
	const number *k, *v;     /* in blocks */
	size_t whole;            /* keys of whole blocks; the others are in a block of their own: */
	number *last_k, *last_v; /* [32][head_dim], filled up with zeros */
	float (*scores)[UNIT][2 * TILE]; /* [2] of blocks */
	number *weights;                 /* [2] of units: [BLOCKS][UNIT][32] */
};

/* Where the parts of a unit are. */
struct unit {
	size_t query, key;   /* first, the latter among those laid */
	size_t keys, blocks; /* in the chunk; no blocks: there is no unit */
	number *weights;
};

/* The rows of a block that are on their way from scores to weights. */
struct weighing {
	const float *scores;
	number *weights;
	float *sums;
	size_t left;
	__mmask32 lanes; /* of keys that exist */
};

/* Rows of q to numbers in tiles, zeros behind the last. */
static void lay_queries(const struct bounded *b, const struct dvsm_attention *job)
{
	const vf scale = vf_set(job->scale * LOG2_E);

	for (size_t i = 0; i < b->query_rows; i++) {
		const float *from = job->q + i * job->q_stride;
		number *to = b->q + left_at(i, 0, b->head_dim);

		for (size_t d = 0; d < b->head_dim; d += DEPTH, to += TILE * DEPTH) {
			vf first = vf_set(0.0f), second = first;

			if (i < job->queries) {
				first = vf_mul(vf_load(from + d), scale);
				second = vf_mul(vf_load(from + d + TILE), scale);
			}
			vp_store(to, vp_join(first, second));
		}
	}
}

/* Where a block begins of keys, or of values. */
static inline const number *block_of(const struct bounded *b, const number *blocks,
				     const number *last, size_t key)
{
	return key < b->whole ? blocks + key * b->head_dim : last;
}

/*
 * Weights of 32 scores, pairs of keys that are 16 apart: -2^(score - bound), which is as good as
 * 2^score, because all are divided by their sum. A lifted score is a float of 128 and on: a fixed
 * exponent, 7 bits of a whole part and 16 of a fraction f. The whole part becomes the weight's
 * exponent as it is, behind a bit of that of the score, which becomes its sign; f its mantissa:
 *
 *   2^f - 1 = f (0.69512 + f (0.22764 + f 0.07707)), error 8.6e-5 of the weight
 *
 * rounded to nearest, where what would become 2 stays one step below.
 */
DVSM_INLINE __m512i weights_of(const float *scores, vf lift, __mmask32 lanes)
{
	const __mmask32 odd = 0xaaaaaaaau;
	__m512i one = _mm512_castps_si512(vf_add(vf_load(scores), lift));
	__m512i two = _mm512_castps_si512(vf_add(vf_load(scores + TILE), lift));
	__m512i mixed = _mm512_shrdi_epi32(one, two, 16);
	__m512i f = _mm512_mask_blend_epi16(odd, one, mixed);
	__m512i whole = _mm512_mask_blend_epi16(odd, mixed, two);
	__m512i p = _mm512_mulhi_epu16(f, _mm512_set1_epi16(5051));

	p = _mm512_mulhi_epu16(f, _mm512_add_epi16(p, _mm512_set1_epi16(14919)));
	p = _mm512_mulhi_epu16(f, _mm512_add_epi16(p, _mm512_set1_epi16((short)45555)));
	p = _mm512_adds_epu16(p, _mm512_set1_epi16(256));
	return _mm512_maskz_shldi_epi16(lanes, whole, p, 7);
}

/* The next rows, those that go beside a product: `rows` divides 32. */
DVSM_INLINE void weigh_rows(const struct bounded *b, struct weighing *w, const size_t rows)
{
	if (w->left == 0)
		return;
	DVSM_UNROLL
	for (size_t i = 0; i < rows; i++) {
		__m512i weights = weights_of(w->scores + i * 2 * TILE, b->lift, w->lanes);
		float *sums = w->sums + i * TILE;

		_mm512_storeu_si512(w->weights + i * DEPTH, weights);
		vf_store(sums, vp_dot(vf_load(sums), (vp)weights, vp_ones()));
	}
	w->scores += rows * 2 * TILE;
	w->weights += rows * DEPTH;
	w->sums += rows * TILE;
	w->left -= rows;
}

/* From one block, of which the rest is weighed, to the next, whose scores are there. */
DVSM_INLINE void weigh_next(const struct bounded *b, struct weighing *w, const struct unit *unit,
			    size_t block)
{
	while (w->left > 0)
		weigh_rows(b, w, 2);
	if (block >= unit->blocks)
		return;

	const size_t keys = unit->keys - block * DEPTH;

	w->scores = b->scores[block % 2][0];
	w->weights = unit->weights + block * UNIT * DEPTH;
	w->sums = b->sums + unit->query * TILE;
	w->left = UNIT;
	w->lanes = ~(uint32_t)0;
	for (size_t key = keys; key < DEPTH; key++)
		w->lanes &= ~((uint32_t)1 << (key % TILE * 2 + key / TILE));
}

/* Scores of a unit's queries with a block of its keys. */
DVSM_INLINE void score_unit(const struct bounded *b, const size_t dim, const struct unit *unit,
			    size_t block, struct weighing *w, const size_t share)
{
	const number *q = b->q + left_at(unit->query, 0, dim);
	const number *k = block_of(b, b->k, b->last_k, unit->key + block * DEPTH);
	float *scores = b->scores[block % 2][0];

	if (block >= unit->blocks)
		return;
	clear_sums();
	DVSM_UNROLL
	for (size_t d = 0; d < dim; d += DEPTH)
		MULTIPLY_STEP(q + d * TILE, q + (dim + d) * TILE, k + d * TILE,
			      k + (dim + d) * TILE, STREAM_W, NOTHING, weigh_rows(b, w, share));
	AMX_STORE(0, scores, 2 * TILE * sizeof(float));
	AMX_STORE(1, scores + TILE, 2 * TILE * sizeof(float));
	AMX_STORE(2, scores + 2 * TILE * TILE, 2 * TILE * sizeof(float));
	AMX_STORE(3, scores + 2 * TILE * TILE + TILE, 2 * TILE * sizeof(float));
}

/* Weighted values of an old unit, 32 numbers of the head; half way on to a block of the young. */
DVSM_INLINE void mix_unit(const struct bounded *b, const size_t dim, const struct unit *old,
			  size_t d, const struct unit *young, size_t next, struct weighing *w,
			  const size_t share)
{
	float *out = b->out + old->query * dim + d;

	AMX_LOAD(0, out, dim * sizeof(float));
	AMX_LOAD(1, out + TILE, dim * sizeof(float));
	AMX_LOAD(2, out + TILE * dim, dim * sizeof(float));
	AMX_LOAD(3, out + TILE * dim + TILE, dim * sizeof(float));
	DVSM_UNROLL
	for (size_t block = 0; block < BLOCKS; block++) {
		const number *p = old->weights + block * UNIT * DEPTH;
		const number *v =
			d * DEPTH + block_of(b, b->v, b->last_v, old->key + block * DEPTH);

		if (block == BLOCKS / 2 && next < BLOCKS)
			weigh_next(b, w, young, next);
		if (block < old->blocks)
			MULTIPLY_STEP(p, p + TILE * DEPTH, v, v + TILE * DEPTH, STREAM_W, NOTHING,
				      weigh_rows(b, w, share));
	}
	AMX_STORE(0, out, dim * sizeof(float));
	AMX_STORE(1, out + TILE, dim * sizeof(float));
	AMX_STORE(2, out + TILE * dim, dim * sizeof(float));
	AMX_STORE(3, out + TILE * dim + TILE, dim * sizeof(float));
}

/*
 * Scores and weights of one unit, but for the weights of its last block, which come with the next
 * one; weighted values of the unit before. Twice: scores of two blocks, then half of the values.
 */
DVSM_INLINE void advance(const struct bounded *b, const size_t dim, const struct unit *young,
			 const struct unit *old, struct weighing *at)
{
	const size_t share = dim < 64 ? 4 : dim < 128 ? 2 : 1;
	const size_t middle = dim / (2 * DEPTH) * DEPTH;
	struct weighing w = *at;

	DVSM_UNROLL
	for (size_t block = 0; block < BLOCKS; block += 2) {
		const size_t first = block > 0 ? middle : 0, end = block > 0 ? dim : middle;

		score_unit(b, dim, young, block, &w, share);
		weigh_next(b, &w, young, block);
		score_unit(b, dim, young, block + 1, &w, share);
		amx_publish();
		if (old->blocks == 0 || first == end)
			weigh_next(b, &w, young, block + 1);
		if (old->blocks == 0)
			continue;
		DVSM_UNROLL
		for (size_t d = first; d < end; d += DEPTH)
			mix_unit(b, dim, old, d, young, d == first ? block + 1 : BLOCKS, &w, share);
	}
	*at = w;
}

/* Most models' heads get loops of their own. */
static void advance_64(const struct bounded *b, const struct unit *young, const struct unit *old,
		       struct weighing *w)
{
	advance(b, 64, young, old, w);
}

static void advance_any(const struct bounded *b, const struct unit *young, const struct unit *old,
			struct weighing *w)
{
	advance(b, b->head_dim, young, old, w);
}

/* Keys and values that come next, of this head or of the one behind it, to the second-level cache;
 * what is not there does no harm. */
static inline void call_numbers(const number *k, const number *v, size_t count)
{
	for (size_t i = 0; i < count; i += 64 / sizeof(*k)) {
		_mm_prefetch((const char *)(k + i), _MM_HINT_T1);
		_mm_prefetch((const char *)(v + i), _MM_HINT_T1);
	}
}

/* All queries with keys first .. end - 1, while those behind `end` are called. */
static void attend_section(const struct bounded *b, size_t first, size_t end)
{
	const size_t chunk = BLOCKS * DEPTH, keys = end - first;
	const number *k = b->k + end * b->head_dim, *v = b->v + end * b->head_dim;
	const size_t units = b->query_rows / UNIT * ((keys + chunk - 1) / chunk);
	const size_t share = units ? SECTION * b->head_dim / units : 0;
	const struct unit none = {.blocks = 0};
	struct unit old = none;
	struct weighing w = {.left = 0};
	size_t turn = 0;

	for (size_t query = 0; query < b->query_rows; query += UNIT) {
		for (size_t key = first; key < end; key += chunk, turn ^= 1) {
			const size_t left = end - key < chunk ? end - key : chunk;
			const struct unit young = {
				.query = query,
				.key = key,
				.keys = left,
				.blocks = (left + DEPTH - 1) / DEPTH,
				.weights = b->weights + turn * BLOCKS * UNIT * DEPTH,
			};

			call_numbers(k, v, share);
			k += share;
			v += share;
			if (b->head_dim == 64)
				advance_64(b, &young, &old, &w);
			else
				advance_any(b, &young, &old, &w);
			old = young;
		}
	}
	advance_any(b, &none, &old, &w);
}

/* The keys and values behind the whole blocks to theirs. */
static void lay_last(const struct bounded *b, size_t keys)
{
	const number *k = b->k + b->whole * b->head_dim, *v = b->v + b->whole * b->head_dim;

	lay_keys(k, keys, DEPTH, b->head_dim, b->last_k);
	lay_values(v, keys, DEPTH, b->head_dim, b->last_v);
}

static void attention_bounded(const struct dvsm_attention *job)
{
	const size_t dim = job->head_dim, rows = (job->queries + UNIT - 1) / UNIT * UNIT;
	struct bounded b = {
		.head_dim = dim,
		.query_rows = rows,
		.lift = vf_set(255.0f - job->bound),
		.k = job->k,
		.v = job->v,
		.whole = job->keys / DEPTH * DEPTH,
		.last_k = job->scratch,
	};

	b.last_v = b.last_k + DEPTH * dim;
	b.q = b.last_v + DEPTH * dim;
	b.out = (float *)(b.q + rows * dim);
	b.sums = b.out + rows * dim;
	b.scores = (float(*)[UNIT][2 * TILE])(b.sums + rows * TILE);
	b.weights = (number *)b.scores[2];
	lay_queries(&b, job);
	memset(b.out, 0, rows * (dim + TILE) * sizeof(float));
	if (b.whole < job->keys)
		lay_last(&b, job->keys - b.whole);
	for (size_t key = 0; key < job->keys; key += SECTION)
		attend_section(&b, key, job->keys - key < SECTION ? job->keys : key + SECTION);
	for (size_t i = 0; i < job->queries; i++) {
		float total = vf_sum(vf_load(b.sums + i * TILE));
		vf inverse = vf_set(job->keys > 0 ? 1.0f / total : 0.0f);

		for (size_t d = 0; d < dim; d += VF_LANES)
			vf_store(b.out + i * dim + d,
				 vf_mul(vf_load(b.out + i * dim + d), inverse));
	}
	left(b.out, dim, job->queries, dim, job->out, job->out_stride, job->out_col);
}
