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

/* What weights_of() computes with: kept in registers, not made anew beside each product. */
struct curve {
	vf lift; /* takes scores to 255 - 2 bound .. 255 */
	__m512i first, second, third, half;
	__m512i ones; /* pairs of 1 */
};

struct bounded {
	size_t head_dim, query_rows;
	struct curve curve;
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
	size_t query, key;   /* first */
	size_t keys, blocks; /* in the chunk; no blocks: there is no unit */
	number *weights;
};

/* The rows of a block that are on their way from scores to weights. */
struct rows {
	const float *scores;
	number *weights;
	float *sums;
	size_t left;
	__mmask32 lanes; /* of keys that exist */
};

/*
 * What is under way between two steps. A tile is stored when the next sums want its place, because
 * a store that waits for a product holds up all products behind it.
 */
struct passage {
	struct rows rows, next; /* `next` as soon as its scores are stored */
	float *to;              /* where the sums in tiles 0 to 3 go: 32 rows of 32 */
	size_t stride;
	size_t turn; /* which room the next block's scores take */
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
DVSM_INLINE __m512i weights_of(const struct curve *curve, const float *scores, __mmask32 lanes)
{
	const __mmask32 odd = 0xaaaaaaaau;
	__m512i one = _mm512_castps_si512(vf_add(vf_load(scores), curve->lift));
	__m512i two = _mm512_castps_si512(vf_add(vf_load(scores + TILE), curve->lift));
	__m512i mixed = _mm512_shrdi_epi32(one, two, 16);
	__m512i f = _mm512_mask_blend_epi16(odd, one, mixed);
	__m512i whole = _mm512_mask_blend_epi16(odd, mixed, two);
	__m512i p = _mm512_mulhi_epu16(f, curve->third);

	p = _mm512_mulhi_epu16(f, _mm512_add_epi16(p, curve->second));
	p = _mm512_mulhi_epu16(f, _mm512_add_epi16(p, curve->first));
	p = _mm512_adds_epu16(p, curve->half);
	return _mm512_maskz_shldi_epi16(lanes, whole, p, 7);
}

/* Rows that go beside a product; `count` divides 32. */
DVSM_INLINE void weigh_rows(const struct curve *curve, struct rows *rows, const size_t count)
{
	if (rows->left == 0)
		return;
	for (size_t i = 0; i < count; i++) {
		__m512i weights = weights_of(curve, rows->scores + i * 2 * TILE, rows->lanes);
		float *sums = rows->sums + i * TILE;

		_mm512_storeu_si512(rows->weights + i * DEPTH, weights);
		vf_store(sums, vp_dot(vf_load(sums), (vp)weights, (vp)curve->ones));
	}
	rows->scores += count * 2 * TILE;
	rows->weights += count * DEPTH;
	rows->sums += count * TILE;
	rows->left -= count;
}

DVSM_INLINE void finish_rows(const struct curve *curve, struct rows *rows)
{
	while (rows->left > 0)
		weigh_rows(curve, rows, 2);
}

/* On to the next block, whose scores are stored; none where none waits. */
DVSM_INLINE void weigh_next(const struct curve *curve, struct passage *p)
{
	if (p->next.left == 0)
		return;
	finish_rows(curve, &p->rows);
	p->rows = p->next;
	p->next.left = 0;
}

static struct rows rows_of(const struct bounded *b, const struct unit *unit, size_t block,
			   const float *scores)
{
	struct rows rows = {
		.scores = scores,
		.weights = unit->weights + block * UNIT * DEPTH,
		.sums = b->sums + unit->query * TILE,
		.left = UNIT,
		.lanes = ~(uint32_t)0,
	};

	for (size_t key = unit->keys - block * DEPTH; key < DEPTH; key++)
		rows.lanes &= ~((uint32_t)1 << (key % TILE * 2 + key / TILE));
	return rows;
}

#define SUMS_AT(to, stride, tile) ((to) + (tile) % 2 * TILE + (tile) / 2 * TILE * (stride))

/* A tile's sums on their way, and what the tile begins with. */
#define LEAVE_SUMS(tile) AMX_STORE(tile, SUMS_AT(p->to, p->stride, tile), p->stride * sizeof(float))
#define BEGIN_SCORES(tile)                                                                         \
	do {                                                                                       \
		LEAVE_SUMS(tile);                                                                  \
		AMX_ZERO(tile);                                                                    \
	} while (0)
#define BEGIN_OUT(tile)                                                                            \
	do {                                                                                       \
		LEAVE_SUMS(tile);                                                                  \
		AMX_LOAD(tile, SUMS_AT(out, dim, tile), dim * sizeof(float));                      \
	} while (0)

static void store_sums(const struct passage *p)
{
	LEAVE_SUMS(0);
	LEAVE_SUMS(1);
	LEAVE_SUMS(2);
	LEAVE_SUMS(3);
}

/* Scores of a unit's queries with a block of its keys. */
DVSM_INLINE void score_unit(const struct bounded *b, const struct curve *curve, const size_t dim,
			    const struct unit *unit, size_t block, struct passage *p,
			    const size_t share)
{
	const number *q = b->q + left_at(unit->query, 0, dim);
	const number *k = block_of(b, b->k, b->last_k, unit->key + block * DEPTH);

	if (block >= unit->blocks)
		return;
	MULTIPLY_STEP(q, q + dim * TILE, k, k + dim * TILE, STREAM_W, BEGIN_SCORES,
		      weigh_rows(curve, &p->rows, share));
	weigh_next(curve, p);
	for (size_t d = DEPTH; d < dim; d += DEPTH)
		MULTIPLY_STEP(q + d * TILE, q + (dim + d) * TILE, k + d * TILE,
			      k + (dim + d) * TILE, STREAM_W, NOTHING,
			      weigh_rows(curve, &p->rows, share));
	p->to = b->scores[p->turn][0];
	p->stride = 2 * TILE;
	p->next = rows_of(b, unit, block, p->to);
	p->turn ^= 1;
}

/* Weighted values of a unit, 32 numbers of the head. */
DVSM_INLINE void mix_unit(const struct bounded *b, const struct curve *curve, const size_t dim,
			  const struct unit *unit, size_t d, struct passage *p, const size_t share)
{
	float *out = b->out + unit->query * dim + d;
	const number *weights = unit->weights;

	DVSM_UNROLL
	for (size_t block = 0; block < BLOCKS; block++, weights += UNIT * DEPTH) {
		const number *v =
			d * DEPTH + block_of(b, b->v, b->last_v, unit->key + block * DEPTH);

		if (block == BLOCKS - 1)
			weigh_next(curve, p);
		if (block == 0)
			MULTIPLY_STEP(weights, weights + TILE * DEPTH, v, v + TILE * DEPTH,
				      STREAM_W, BEGIN_OUT, weigh_rows(curve, &p->rows, share));
		else if (block < unit->blocks)
			MULTIPLY_STEP(weights, weights + TILE * DEPTH, v, v + TILE * DEPTH,
				      STREAM_W, NOTHING, weigh_rows(curve, &p->rows, share));
	}
	p->to = out;
	p->stride = dim;
}

/*
 * Scores and weights of one unit, but for the weights of its last block, which come with the next
 * one; weighted values of the unit before. Twice: scores of two blocks, then half of the values.
 */
DVSM_INLINE void advance(const struct bounded *b, const size_t dim, const struct unit *young,
			 const struct unit *old, struct passage *passage)
{
	const size_t share = dim < 64 ? 4 : dim < 128 ? 2 : 1;
	const size_t middle = dim / (2 * DEPTH) * DEPTH;
	const struct curve curve = b->curve;
	struct passage p = *passage;

	DVSM_UNROLL
	for (size_t block = 0; block < BLOCKS; block += 2) {
		const size_t first = block > 0 ? middle : 0, end = block > 0 ? dim : middle;

		score_unit(b, &curve, dim, young, block, &p, share);
		score_unit(b, &curve, dim, young, block + 1, &p, share);
		/* Where a second block of scores did not see to it. */
		if (block == 0 && young->blocks < 2)
			finish_rows(&curve, &p.rows);
		amx_publish();
		if (old->blocks == 0)
			continue;
		for (size_t d = first; d < end; d += DEPTH)
			mix_unit(b, &curve, dim, old, d, &p, share);
	}
	*passage = p;
}

static void advance_64(const struct bounded *b, const struct unit *young, const struct unit *old,
		       struct passage *p)
{
	advance(b, 64, young, old, p);
}

static void advance_any(const struct bounded *b, const struct unit *young, const struct unit *old,
			struct passage *p)
{
	advance(b, b->head_dim, young, old, p);
}

/* Most models' heads get code of their own. */
static void advance_unit(const struct bounded *b, const struct unit *young, const struct unit *old,
			 struct passage *p)
{
	if (b->head_dim == 64)
		advance_64(b, young, old, p);
	else
		advance_any(b, young, old, p);
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
static void attend_section(const struct bounded *b, size_t first, size_t end, struct unit *old,
			   struct passage *p)
{
	const size_t chunk = BLOCKS * DEPTH, keys = end - first;
	const number *k = b->k + end * b->head_dim, *v = b->v + end * b->head_dim;
	const size_t units = b->query_rows / UNIT * ((keys + chunk - 1) / chunk);
	const size_t share = units ? SECTION * b->head_dim / units : 0;

	for (size_t query = 0; query < b->query_rows; query += UNIT) {
		for (size_t key = first; key < end; key += chunk) {
			const size_t left = end - key < chunk ? end - key : chunk;
			const bool turn = old->weights == b->weights;
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
			advance_unit(b, &young, old, p);
			*old = young;
		}
	}
}

/* All queries with all keys. */
static void attend_all(const struct bounded *b, size_t keys)
{
	const struct unit none = {.blocks = 0};
	struct unit old = none;
	struct passage p = {.to = b->scores[0][0], .stride = 2 * TILE};

	for (size_t key = 0; key < keys; key += SECTION)
		attend_section(b, key, keys - key < SECTION ? keys : key + SECTION, &old, &p);
	store_sums(&p);
	weigh_next(&b->curve, &p);
	finish_rows(&b->curve, &p.rows);
	advance_unit(b, &none, &old, &p);
	store_sums(&p);
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
		.curve =
			{
				.lift = vf_set(255.0f - job->bound),
				.first = _mm512_set1_epi16((short)45555),
				.second = _mm512_set1_epi16(14919),
				.third = _mm512_set1_epi16(5051),
				.half = _mm512_set1_epi16(256),
				.ones = (__m512i)vp_ones(),
			},
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
	attend_all(&b, job->keys);
	for (size_t i = 0; i < job->queries; i++) {
		float total = vf_sum(vf_load(b.sums + i * TILE));
		vf inverse = vf_set(job->keys > 0 ? 1.0f / total : 0.0f);

		for (size_t d = 0; d < dim; d += VF_LANES)
			vf_store(b.out + i * dim + d,
				 vf_mul(vf_load(b.out + i * dim + d), inverse));
	}
	left(b.out, dim, job->queries, dim, job->out, job->out_stride, job->out_col);
}
