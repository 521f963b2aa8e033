#include "attention.h"

#include <math.h>
#include <string.h>

#include "tiles.h"
#include "vector.h"

static int round_up32(int n)
{
	return (n + 31) & ~31;
}

static void clear_rows(uint16_t *x, int from, int to)
{
	memset(x + (size_t)from * HEAD, 0, (size_t)(to - from) * HEAD * 2);
}

static void copy_rows(const uint16_t *from, int stride, int rows, uint16_t *to)
{
	for (int r = 0; r < rows; r++) {
		memcpy(to + (size_t)r * HEAD, from + (size_t)r * stride, HEAD * 2);
	}
	clear_rows(to, rows, round_up32(rows));
}

/* 1 / root mean square of a row of a head. */
static float inverse_rms(const uint16_t *row, float eps)
{
	__m512 sum = _mm512_setzero_ps();
	for (int i = 0; i < HEAD; i += 16) {
		__m512 x = load_bf16(row + i);
		sum = _mm512_fmadd_ps(x, x, sum);
	}
	return 1.0f / sqrtf(_mm512_reduce_add_ps(sum) / HEAD + eps);
}

/* QK-norm, times `scale`. */
static void norm_head(const uint16_t *from, int stride, int rows, const float *weight, float scale,
		      float eps, uint16_t *to)
{
	for (int r = 0; r < rows; r++, from += stride) {
		__m512 s = _mm512_set1_ps(inverse_rms(from, eps) * scale);
		for (int i = 0; i < HEAD; i += 16) {
			store_bf16_16(to + (size_t)r * HEAD + i,
				      _mm512_mul_ps(_mm512_mul_ps(load_bf16(from + i), s),
						    _mm512_loadu_ps(weight + i)));
		}
	}
	clear_rows(to, rows, round_up32(rows));
}

static void add_bf16(uint16_t *to, __m512 x)
{
	store_bf16_16(to, _mm512_add_ps(load_bf16(to), x));
}

/* Back through QK-norm of one row, whose output times `scale` has the gradient dy; adds to dx. */
static void norm_head_back(const uint16_t *row, const float *dy, const float *weight, float scale,
			   float eps, float *dweight, uint16_t *dx)
{
	__m512 inverse = _mm512_set1_ps(inverse_rms(row, eps)), along = _mm512_setzero_ps();
	__m512 unit[HEAD / 16], g[HEAD / 16];
	for (int i = 0; i < HEAD / 16; i++) {
		unit[i] = _mm512_mul_ps(load_bf16(row + 16 * i), inverse);
		g[i] = _mm512_mul_ps(_mm512_loadu_ps(dy + 16 * i), _mm512_set1_ps(scale));
		_mm512_storeu_ps(dweight + 16 * i,
				 _mm512_fmadd_ps(g[i], unit[i], _mm512_loadu_ps(dweight + 16 * i)));
		g[i] = _mm512_mul_ps(g[i], _mm512_loadu_ps(weight + 16 * i));
		along = _mm512_fmadd_ps(g[i], unit[i], along);
	}
	__m512 mean = _mm512_set1_ps(_mm512_reduce_add_ps(along) / HEAD);
	for (int i = 0; i < HEAD / 16; i++) {
		add_bf16(dx + 16 * i,
			 _mm512_mul_ps(_mm512_fnmadd_ps(unit[i], mean, g[i]), inverse));
	}
}

static float score_scale(void)
{
	return 0.125f; /* 1 / sqrt(HEAD) */
}

/* Exponentials of 32 rows of scores, to bfloat16; 1 / sum and the logarithm of the sum. */
static void exponentials(float *scores, int ld, int keys, uint16_t *shares, int ldp, float *inverse,
			 float *log_sums)
{
	int padded = round_up32(keys);
	for (int r = 0; r < 32; r++, scores += ld, shares += ldp) {
		for (int i = keys; i < padded; i++) {
			scores[i] = -1e30f;
		}
		__m512 top = _mm512_loadu_ps(scores), sum = _mm512_setzero_ps();
		for (int i = 16; i < padded; i += 16) {
			top = _mm512_max_ps(top, _mm512_loadu_ps(scores + i));
		}
		float most = _mm512_reduce_max_ps(top);
		top = _mm512_set1_ps(most);
		for (int i = 0; i < padded; i += 32) {
			__m512 a = exponential(_mm512_sub_ps(_mm512_loadu_ps(scores + i), top));
			__m512 b =
				exponential(_mm512_sub_ps(_mm512_loadu_ps(scores + i + 16), top));
			sum = _mm512_add_ps(sum, _mm512_add_ps(a, b));
			store_bf16(shares + i, a, b);
		}
		float total = _mm512_reduce_add_ps(sum);
		inverse[r] = 1.0f / total;
		log_sums[r] = most + logf(total);
	}
}

void attention_forward(const struct attention_shape *shape, const struct attention_rows *rows,
		       const uint16_t *qkv, uint16_t *attended, struct attention_scratch *t)
{
	int ld = 3 * shape->dim, keys = round_up32(rows->keys), queries = round_up32(rows->queries);
	int lds = keys + 16, ldp = keys + 32;
	const uint16_t *q = qkv + (size_t)rows->query * ld + shape->head * HEAD;
	const uint16_t *k = qkv + (size_t)rows->key * ld + shape->dim + shape->head * HEAD;
	norm_head(q, ld, rows->queries, shape->q_norm, score_scale(), shape->eps, t->q);
	norm_head(k, ld, rows->keys, shape->k_norm, 1.0f, shape->eps, t->k);
	copy_rows(k + shape->dim, ld, rows->keys, t->v);
	pack_columns(t->k, HEAD, keys, HEAD, t->k_columns, HEAD);
	pack_pairs(t->v, HEAD, keys, HEAD, t->v_pairs, keys);
	for (int r = 0; r < queries; r += 32) {
		_Alignas(64) float out[32 * HEAD];
		float inverse[32], log_sums[32];
		const uint16_t *a = t->q + (size_t)r * HEAD;
		for (int c = 0; c < keys; c += 32) {
			tiles_zero();
			tiles_multiply(a, a + 16 * HEAD, HEAD * 2, 64,
				       t->k_columns + (size_t)c * HEAD, HEAD / 32);
			tiles_store(t->scores + c, (long)lds * 4);
		}
		exponentials(t->scores, lds, rows->keys, t->shares, ldp, inverse, log_sums);
		for (int c = 0; c < HEAD; c += 32) {
			tiles_zero();
			tiles_multiply(t->shares, t->shares + (size_t)16 * ldp, (long)ldp * 2, 64,
				       t->v_pairs + (size_t)c * keys, keys / 32);
			tiles_store(out + c, HEAD * 4);
		}
		int count = rows->queries - r < 32 ? rows->queries - r : 32;
		for (int i = 0; i < count; i++) {
			size_t row = (size_t)rows->query + r + i;
			__m512 scale = _mm512_set1_ps(inverse[i]);
			shape->log_sums[row] = log_sums[i];
			for (int c = 0; c < HEAD; c += 16) {
				store_bf16_16(
					attended + row * shape->dim + shape->head * HEAD + c,
					_mm512_mul_ps(_mm512_load_ps(out + i * HEAD + c), scale));
			}
		}
	}
}

/* Rows of g . o, and the logarithms of the sums; padding gets shares of 0. */
static void query_sums(const struct attention_shape *shape, const struct attention_rows *rows,
		       const uint16_t *attended, struct attention_scratch *t)
{
	for (int r = 0; r < round_up32(rows->queries); r++) {
		if (r >= rows->queries) {
			t->g_dot_o[r] = 0.0f;
			t->log_sums[r] = 1e30f;
			continue;
		}
		size_t row = (size_t)rows->query + r;
		const uint16_t *o = attended + row * shape->dim + shape->head * HEAD;
		__m512 sum = _mm512_setzero_ps();
		for (int i = 0; i < HEAD; i += 16) {
			sum = _mm512_fmadd_ps(load_bf16(o + i),
					      load_bf16(t->g + (size_t)r * HEAD + i), sum);
		}
		t->g_dot_o[r] = _mm512_reduce_add_ps(sum);
		t->log_sums[r] = shape->log_sums[row];
	}
}

/* The backward pass of one head at work. */
struct back {
	const struct attention_shape *shape;
	const struct attention_rows *rows;
	struct attention_scratch *t;
	const uint16_t *qkv;
	uint16_t *dqkv;
	float *dq_norm, *dk_norm;
	int keys, queries, ld, ldp; /* rounded up; strides of qkv and of shares and slopes */
	size_t q_at, k_at;          /* where this head's queries and keys begin in qkv */
};

/* 32 keys x 32 queries: shares of the softmax and slopes of the scores, keys in rows. */
static void shares_and_slopes(const struct back *w, int key, int query)
{
	_Alignas(64) float scores[32 * 32], dshares[32 * 32];
	struct attention_scratch *t = w->t;
	const uint16_t *k = t->k + (size_t)key * HEAD, *v = t->v + (size_t)key * HEAD;
	tiles_zero();
	tiles_multiply(k, k + 16 * HEAD, HEAD * 2, 64, t->q_columns + (size_t)query * HEAD,
		       HEAD / 32);
	tiles_store(scores, 32 * 4);
	tiles_zero();
	tiles_multiply(v, v + 16 * HEAD, HEAD * 2, 64, t->g_columns + (size_t)query * HEAD,
		       HEAD / 32);
	tiles_store(dshares, 32 * 4);
	for (int i = 0; i < 32; i++) {
		uint16_t *share = t->shares + (size_t)i * w->ldp + query;
		uint16_t *slope = t->slopes + (size_t)i * w->ldp + query;
		for (int j = 0; j < 32; j += 16) {
			__m512 p = exponential(
				_mm512_sub_ps(_mm512_load_ps(scores + i * 32 + j),
					      _mm512_loadu_ps(t->log_sums + query + j)));
			p = key + i < w->rows->keys ? p : _mm512_setzero_ps();
			__m512 d = _mm512_sub_ps(_mm512_load_ps(dshares + i * 32 + j),
						 _mm512_loadu_ps(t->g_dot_o + query + j));
			store_bf16_16(share + j, p);
			store_bf16_16(slope + j, _mm512_mul_ps(p, d));
		}
	}
	pack_pairs(t->slopes + query, w->ldp, 32, 32,
		   t->slope_pairs + (size_t)query * w->keys + (size_t)key * 32, w->keys);
}

/* out[32][HEAD] = 32 rows of `left` (all queries long) times queries' rows, paired. */
static void over_queries(const struct back *w, const uint16_t *left, const uint16_t *pairs,
			 float *out)
{
	for (int c = 0; c < HEAD; c += 32) {
		tiles_zero();
		tiles_multiply(left, left + (size_t)16 * w->ldp, (long)w->ldp * 2, 64,
			       pairs + (size_t)c * w->queries, w->queries / 32);
		tiles_store(out + c, HEAD * 4);
	}
}

/* The gradients of 32 keys and values. */
static void key_block(const struct back *w, int key)
{
	_Alignas(64) float dv[32 * HEAD], dk[32 * HEAD];
	int count = w->rows->keys - key < 32 ? w->rows->keys - key : 32;
	for (int c = 0; c < w->queries; c += 32) {
		shares_and_slopes(w, key, c);
	}
	over_queries(w, w->t->shares, w->t->g_pairs, dv);
	over_queries(w, w->t->slopes, w->t->q_pairs, dk);
	for (int i = 0; i < count; i++) {
		size_t at = w->k_at + (size_t)(key + i) * w->ld;
		for (int c = 0; c < HEAD; c += 16) {
			add_bf16(w->dqkv + at + w->shape->dim + c,
				 _mm512_load_ps(dv + i * HEAD + c));
		}
		norm_head_back(w->qkv + at, dk + i * HEAD, w->shape->k_norm, 1.0f, w->shape->eps,
			       w->dk_norm, w->dqkv + at);
	}
}

/* The gradients of 32 queries: dq^T [HEAD][queries] = k^T slopes^T, then row by row. */
static void query_block(const struct back *w, int query)
{
	_Alignas(64) float columns[HEAD * 32], dq[32 * HEAD];
	int count = w->rows->queries - query < 32 ? w->rows->queries - query : 32;
	for (int r = 0; r < HEAD; r += 32) {
		const uint16_t *a = w->t->k_transposed + (size_t)r * w->keys;
		tiles_zero();
		tiles_multiply(a, a + (size_t)16 * w->keys, 64, 1024,
			       w->t->slope_pairs + (size_t)query * w->keys, w->keys / 32);
		tiles_store(columns + r * 32, 32 * 4);
	}
	for (int r = 0; r < HEAD; r += 16) {
		for (int j = 0; j < 32; j += 16) {
			__m512i words[16];
			for (int i = 0; i < 16; i++) {
				words[i] = _mm512_load_si512(columns + (r + i) * 32 + j);
			}
			transpose16(words);
			for (int i = 0; i < 16; i++) {
				_mm512_store_si512(dq + (j + i) * HEAD + r, words[i]);
			}
		}
	}
	for (int i = 0; i < count; i++) {
		size_t at = w->q_at + (size_t)(query + i) * w->ld;
		norm_head_back(w->qkv + at, dq + i * HEAD, w->shape->q_norm, score_scale(),
			       w->shape->eps, w->dq_norm, w->dqkv + at);
	}
}

void attention_backward(const struct attention_shape *shape, const struct attention_rows *rows,
			const uint16_t *qkv, const uint16_t *attended, const uint16_t *gradient,
			uint16_t *dqkv, float *dq_norm, float *dk_norm, struct attention_scratch *t)
{
	int dim = shape->dim, ld = 3 * dim;
	int keys = round_up32(rows->keys), queries = round_up32(rows->queries);
	struct back work = {
		.shape = shape,
		.rows = rows,
		.t = t,
		.qkv = qkv,
		.dqkv = dqkv,
		.dq_norm = dq_norm,
		.dk_norm = dk_norm,
		.keys = keys,
		.queries = queries,
		.ld = ld,
		.ldp = queries + 32,
		.q_at = (size_t)rows->query * ld + (size_t)shape->head * HEAD,
		.k_at = (size_t)rows->key * ld + (size_t)dim + (size_t)shape->head * HEAD,
	};
	const uint16_t *q = qkv + work.q_at, *k = qkv + work.k_at;
	norm_head(q, ld, rows->queries, shape->q_norm, score_scale(), shape->eps, t->q);
	norm_head(k, ld, rows->keys, shape->k_norm, 1.0f, shape->eps, t->k);
	copy_rows(k + dim, ld, rows->keys, t->v);
	copy_rows(gradient + (size_t)rows->query * dim + shape->head * HEAD, dim, rows->queries,
		  t->g);
	query_sums(shape, rows, attended, t);
	pack_columns(t->q, HEAD, queries, HEAD, t->q_columns, HEAD);
	pack_columns(t->g, HEAD, queries, HEAD, t->g_columns, HEAD);
	pack_pairs(t->q, HEAD, queries, HEAD, t->q_pairs, queries);
	pack_pairs(t->g, HEAD, queries, HEAD, t->g_pairs, queries);
	pack_transposed(t->k, HEAD, keys, HEAD, t->k_transposed, keys);
	for (int i = 0; i < keys; i += 32) {
		key_block(&work, i);
	}
	for (int i = 0; i < queries; i += 32) {
		query_block(&work, i);
	}
}
