/*
 * Template: one-pass attention on AMX for scores of a known bound. Included by bf16_amx.c, behind
 * amx_online.inc.h.
 *
 * A weight is 2^score as it is, so that no maximum is looked for and nothing is rescaled. Queries
 * are rows: 32 of them and a chunk of keys make a unit of work, whose scores, weights and weighted
 * values are computed one unit apart each. The tiles' unit multiplies for the units before and
 * behind while the vectors' units take the exponential of this one. All keys that are laid pass by
 * the first-level cache, where a unit's scores, weights and sums stay.
 */

#define UNIT  32u
#define CHUNK DVSM_ATTENTION_CHUNK
#define LAID  DVSM_ATTENTION_LAID

struct bounded {
	size_t head_dim, query_rows;
	number *q;   /* [query_rows][head_dim] in tiles, times scale log2(e) */
	float *out;  /* [query_rows][head_dim] */
	float *sums; /* [query_rows][16]: of weights, by key modulo 16 */
	number *k;   /* [LAID] keys as the weights of a product: [LAID / 16][head_dim / 2][16][2] */
	number *v;   /* values, likewise: [LAID / 32][head_dim / 16][16][16][2] */
	float (*scores)[UNIT][CHUNK]; /* [2] */
	number *weights;              /* [2][UNIT][CHUNK] in tiles */
};

/* Where the parts of a unit are, which may not exist. */
struct unit {
	size_t query, key; /* first, the latter among those laid */
	size_t keys;       /* in the chunk */
	size_t turn;       /* of the two rooms for scores and weights */
	bool exists;
};

/* 2^score for |score| <= DVSM_ATTENTION_BOUND; relative error 7.5e-5, see exp2_short_vf(). */
static inline vf weight_of(vf score)
{
	vf f = _mm512_reduce_ps(score, _MM_FROUND_TO_NEG_INF | _MM_FROUND_NO_EXC);
	vf p = vf_set(0.07802452f);

	p = vf_fma(p, f, vf_set(0.22606717f));
	p = vf_fma(p, f, vf_set(0.6958335f));
	p = vf_fma(p, f, vf_set(0.9999252f));
	return _mm512_scalef_ps(p, score);
}

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

/* Keys to tiles of pairs of depth, zeros up to a whole chunk. */
static void lay_keys(const struct bounded *b, const number *k, size_t keys)
{
	const size_t whole = (keys + CHUNK - 1) / CHUNK * CHUNK;

	for (size_t key = 0; key < whole; key += TILE) {
		for (size_t d = 0; d < b->head_dim; d += DEPTH) {
			__m512i rows[TILE];

			for (size_t i = 0; i < TILE; i++) {
				rows[i] = _mm512_setzero_si512();
				if (key + i < keys)
					rows[i] =
						_mm512_loadu_si512(k + (key + i) * b->head_dim + d);
			}
			turn_block(rows, (unsigned char *)(b->k + key * b->head_dim + d * TILE),
				   64);
		}
	}
}

/* Values to tiles of pairs of keys, zeros up to a whole chunk. */
static void lay_values(const struct bounded *b, const number *v, size_t keys)
{
	const size_t whole = (keys + CHUNK - 1) / CHUNK * CHUNK;

	for (size_t key = 0; key < whole; key += DEPTH) {
		for (size_t d = 0; d < b->head_dim; d += TILE) {
			number *to = b->v + key * b->head_dim + d * DEPTH;

			for (size_t i = 0; i < DEPTH; i += 2, to += 2 * TILE) {
				__m512i even = value_lanes(v, keys, b->head_dim, key + i, d);
				__m512i odd = value_lanes(v, keys, b->head_dim, key + i + 1, d);

				_mm512_storeu_si512(
					to, _mm512_or_si512(even, _mm512_slli_epi32(odd, 16)));
			}
		}
	}
}

/*
 * A half of a row of scores to weights. The chunk has `keys` keys, which are all of it where
 * `whole`.
 */
DVSM_INLINE void weigh_part(const struct bounded *b, const struct unit *unit, size_t row,
			    size_t first, size_t count, bool whole)
{
	const float *scores = b->scores[unit->turn][row];
	number *to = b->weights + unit->turn * UNIT * CHUNK + left_at(row, first, CHUNK);
	float *sums = b->sums + (unit->query + row) * TILE;
	vf total = vf_load(sums);

	DVSM_UNROLL
	for (size_t key = first; key < first + count; key += DEPTH, to += TILE * DEPTH) {
		vf one = weight_of(vf_load(scores + key));
		vf two = weight_of(vf_load(scores + key + TILE));

		if (!whole) {
			size_t left = unit->keys > key ? unit->keys - key : 0;
			uint64_t lanes = left < DEPTH ? ((uint64_t)1 << left) - 1 : ~(uint64_t)0;

			one = _mm512_maskz_mov_ps((__mmask16)lanes, one);
			two = _mm512_maskz_mov_ps((__mmask16)(lanes >> TILE), two);
		}
		total = vf_add(total, vf_add(one, two));
		vp_store(to, vp_join(one, two));
	}
	vf_store(sums, total);
}

/* What is left to weigh of a unit. */
struct weighing {
	const struct unit *unit;
	size_t row;
};

/* The next rows, those that go beside one step of products. */
DVSM_INLINE void weigh_some(const struct bounded *b, struct weighing *w, size_t rows)
{
	for (size_t i = 0; i < rows && w->row < UNIT; i++, w->row++) {
		if (w->unit->keys == CHUNK)
			weigh_part(b, w->unit, w->row, 0, CHUNK, true);
		else
			weigh_part(b, w->unit, w->row, 0, CHUNK, false);
	}
}

/* Scores of one unit, weights of the next older, weighted values of the oldest. */
static void advance(const struct bounded *b, const struct unit *young, const struct unit *middle,
		    const struct unit *old)
{
	const size_t dim = b->head_dim, steps = dim / DEPTH;
	const size_t share = UNIT / (2 * (CHUNK / DEPTH) * steps);
	struct weighing w = {middle, middle->exists ? 0 : UNIT};

	amx_publish();
	for (size_t key = 0; young->exists && key < CHUNK; key += 2 * TILE) {
		const number *q = b->q + left_at(young->query, 0, dim);
		const number *k = b->k + (young->key + key) * dim;
		float *scores = b->scores[young->turn][0] + key;

		clear_sums();
		for (size_t d = 0; d < dim; d += DEPTH) {
			multiply_step(q + d * TILE, q + (dim + d) * TILE, k + d * TILE,
				      k + (dim + d) * TILE, STREAM_W);
			weigh_some(b, &w, share);
		}
		AMX_STORE(0, scores, CHUNK * sizeof(float));
		AMX_STORE(1, scores + TILE, CHUNK * sizeof(float));
		AMX_STORE(2, scores + TILE * CHUNK, CHUNK * sizeof(float));
		AMX_STORE(3, scores + TILE * CHUNK + TILE, CHUNK * sizeof(float));
	}
	for (size_t d = 0; old->exists && d < dim; d += 2 * TILE) {
		const number *p = b->weights + old->turn * UNIT * CHUNK;
		const number *v = b->v + old->key * dim + d * DEPTH;
		float *out = b->out + old->query * dim + d;

		AMX_LOAD(0, out, dim * sizeof(float));
		AMX_LOAD(1, out + TILE, dim * sizeof(float));
		AMX_LOAD(2, out + TILE * dim, dim * sizeof(float));
		AMX_LOAD(3, out + TILE * dim + TILE, dim * sizeof(float));
		for (size_t key = 0; key < CHUNK; key += DEPTH) {
			multiply_step(p + key * TILE, p + (CHUNK + key) * TILE, v + key * dim,
				      v + key * dim + TILE * DEPTH, STREAM_W);
			weigh_some(b, &w, share);
		}
		AMX_STORE(0, out, dim * sizeof(float));
		AMX_STORE(1, out + TILE, dim * sizeof(float));
		AMX_STORE(2, out + TILE * dim, dim * sizeof(float));
		AMX_STORE(3, out + TILE * dim + TILE, dim * sizeof(float));
	}
	weigh_some(b, &w, UNIT);
}

/* Keys and values that are laid next, of this head or of the one behind it, to the second-level
 * cache; what is not there does no harm. */
static inline void call_numbers(const number *k, const number *v, size_t count)
{
	for (size_t i = 0; i < count; i += 64 / sizeof(*k)) {
		_mm_prefetch((const char *)(k + i), _MM_HINT_T1);
		_mm_prefetch((const char *)(v + i), _MM_HINT_T1);
	}
}

/* All queries with the keys and values that are laid; `k` and `v` come next. */
static void attend_laid(const struct bounded *b, size_t keys, const number *k, const number *v)
{
	const size_t units = b->query_rows / UNIT * ((keys + CHUNK - 1) / CHUNK);
	const size_t share = units ? LAID * b->head_dim / units : 0;
	struct unit middle = {.exists = false}, old = middle;
	size_t turn = 0;

	for (size_t query = 0; query < b->query_rows; query += UNIT) {
		for (size_t key = 0; key < keys; key += CHUNK, turn ^= 1) {
			const size_t left = keys - key;
			struct unit young = {query, key, left < CHUNK ? left : CHUNK, turn, true};

			call_numbers(k, v, share);
			k += share;
			v += share;
			advance(b, &young, &middle, &old);
			old = middle;
			middle = young;
		}
	}
	for (int i = 0; i < 2; i++) {
		struct unit none = {.exists = false};

		advance(b, &none, &middle, &old);
		old = middle;
		middle = none;
	}
}

static void attention_bounded(const struct dvsm_attention *job)
{
	const size_t dim = job->head_dim, rows = (job->queries + UNIT - 1) / UNIT * UNIT;
	const number *k = job->k, *v = job->v;
	struct bounded b = {.head_dim = dim, .query_rows = rows, .k = job->scratch};

	b.v = b.k + LAID * dim;
	b.q = b.v + LAID * dim;
	b.out = (float *)(b.q + rows * dim);
	b.sums = b.out + rows * dim;
	b.scores = (float(*)[UNIT][CHUNK])(b.sums + rows * TILE);
	b.weights = (number *)b.scores[2];
	lay_queries(&b, job);
	memset(b.out, 0, rows * (dim + TILE) * sizeof(float));
	for (size_t key = 0; key < job->keys; key += LAID) {
		const size_t keys = job->keys - key < LAID ? job->keys - key : LAID;

		lay_keys(&b, k + key * dim, keys);
		lay_values(&b, v + key * dim, keys);
		attend_laid(&b, keys, k + (key + keys) * dim, v + (key + keys) * dim);
	}
	for (size_t i = 0; i < job->queries; i++) {
		float total = vf_sum(vf_load(b.sums + i * TILE));
		vf inverse = vf_set(job->keys > 0 ? 1.0f / total : 0.0f);

		for (size_t d = 0; d < dim; d += VF_LANES)
			vf_store(b.out + i * dim + d,
				 vf_mul(vf_load(b.out + i * dim + d), inverse));
	}
	left(b.out, dim, job->queries, dim, job->out, job->out_stride, job->out_col);
}
