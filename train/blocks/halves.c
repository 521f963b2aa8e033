#include "network.h"

#include <string.h>

#include "product.h"
#include "rows.h"
#include "tiles.h"
#include "vector.h"

/* --- gradients of weights --- */

/* A block of gradient[n][m] += sum over rows of g[row][n] x[row][m]; g transposed, x paired. */
static void gradient_block(const uint16_t *g, const uint16_t *x, int rows, int rows_total, int n,
			   int c, int m, float *gradient)
{
	const uint16_t *upper = g + (size_t)n * rows_total,
		       *lower = upper + (size_t)16 * rows_total;
	float *to = gradient + (size_t)n * m + c;
	tiles_load(to, (long)m * 4);
	tiles_multiply(upper, lower, 64, 1024, x + (size_t)c * rows_total, rows / 32);
	tiles_store(to, (long)m * 4);
}

/* The whole gradient; the larger factor passes the cache once. */
static void weight_gradient(const uint16_t *g, const uint16_t *x, int rows, int rows_total, int n,
			    int m, float *gradient)
{
	if (n >= m) {
		for (int r = 0; r < n; r += 32) {
			for (int c = 0; c < m; c += 32) {
				gradient_block(g, x, rows, rows_total, r, c, m, gradient);
			}
		}
		return;
	}
	for (int c = 0; c < m; c += 32) {
		for (int r = 0; r < n; r += 32) {
			gradient_block(g, x, rows, rows_total, r, c, m, gradient);
		}
	}
}

/*
 * --- the multi-layer perceptron of half a block, rows [first, end) ---
 *
 * The hidden layer is kept in blocks of 32 x 32, in the order in which they are made, so that
 * memory is written and read in one stream. What a block needs behind its product is done while the
 * tiles multiply the next.
 */

/* A block of the hidden layer: keep it, and its GELU as rows of `active`. */
static void keep_hidden(const float *tile, uint16_t *h, uint16_t *active, int stride)
{
	for (int i = 0; i < 32; i++) {
		__m512 low = _mm512_load_ps(tile + i * 32);
		__m512 high = _mm512_load_ps(tile + i * 32 + 16);
		store_bf16(h + i * 32, low, high);
		store_bf16(active + (size_t)i * stride, gelu(low), gelu(high));
	}
}

/* 32 rows through the first product. */
static void hidden_forward(const struct dio_blocks *b, const struct half *w, const uint16_t *rows,
			   uint16_t *h, uint16_t *active)
{
	_Alignas(64) float tiles[2][32 * 32];
	for (int c = 0; c <= b->hidden; c += 32) {
		if (c < b->hidden) {
			tiles_zero();
			tiles_multiply(rows, rows + (size_t)16 * b->dim, (long)b->dim * 2, 64,
				       w->up.forward + (size_t)c * b->dim, b->dim / 32);
		}
		if (c > 0) {
			keep_hidden(tiles[c / 32 % 2 ^ 1], h + (size_t)(c - 32) * 32,
				    active + c - 32, b->hidden);
		}
		if (c < b->hidden) {
			tiles_store(tiles[c / 32 % 2], 32 * 4);
		}
	}
}

static void mlp_forward(const struct dio_blocks *b, const struct half *w, struct scratch *t,
			struct scene *scene, struct saved *s, int first, int end)
{
	int dim = b->dim, hidden = b->hidden;
	for (int r = first; r < end; r += 32) {
		float *x = scene->x + (size_t)r * dim;
		uint16_t *unit = s->mlp_in + (size_t)r * dim;
		norm_rows(x, 32, dim, b->eps, unit, s->mlp_rstd + r);
		weigh_rows(unit, 32, dim, w->mlp_norm, t->rows);
		hidden_forward(b, w, t->rows, s->hidden + (size_t)r * hidden, t->hidden);
		product(t->hidden, hidden, w->down.forward, hidden, 32, dim, hidden, x, dim, true);
	}
}

/*
 * A block of the gradient of GELU's output: GELU's output paired, and the gradient of its input, as
 * rows of `slope` and transposed.
 */
static void slope_hidden(const float *tile, const uint16_t *h, uint16_t *slope, int stride,
			 uint16_t *paired, uint16_t *transposed, int rows)
{
	_Alignas(64) uint16_t active[32 * 32];
	for (int i = 0; i < 32; i++) {
		__m512 a0, a1, d0, d1;
		gelu_both(load_bf16(h + i * 32), &a0, &d0);
		gelu_both(load_bf16(h + i * 32 + 16), &a1, &d1);
		store_bf16(active + i * 32, a0, a1);
		store_bf16(slope + (size_t)i * stride,
			   _mm512_mul_ps(d0, _mm512_load_ps(tile + i * 32)),
			   _mm512_mul_ps(d1, _mm512_load_ps(tile + i * 32 + 16)));
	}
	pack_pairs(active, 32, 32, 32, paired, rows);
	pack_transposed(slope, stride, 32, 32, transposed, rows);
}

/* 32 of `total` rows, from `r` on, back through the second product and GELU. */
static void hidden_backward(const struct dio_blocks *b, const struct half *w, struct scratch *t,
			    const uint16_t *h, int r, int total)
{
	_Alignas(64) float tiles[2][32 * 32];
	const uint16_t *rows = t->rows + (size_t)r * b->dim;
	for (int c = 0; c <= b->hidden; c += 32) {
		if (c < b->hidden) {
			tiles_zero();
			tiles_multiply(rows, rows + (size_t)16 * b->dim, (long)b->dim * 2, 64,
				       w->down.backward + (size_t)c * b->dim, b->dim / 32);
		}
		if (c > 0) {
			size_t panel = (size_t)(c - 32) * total;
			slope_hidden(tiles[c / 32 % 2 ^ 1], h + (size_t)(c - 32) * 32,
				     t->hidden + c - 32, b->hidden, t->b + panel + (size_t)r * 32,
				     t->a + panel + (size_t)r * 16, total);
		}
		if (c < b->hidden) {
			tiles_store(tiles[c / 32 % 2], 32 * 4);
		}
	}
}

static void mlp_backward(const struct dio_blocks *b, const struct half *w, struct scratch *t,
			 struct scene *scene, const struct saved *s, float *const *gradients,
			 int first, int end)
{
	int dim = b->dim, hidden = b->hidden, total = end - first;
	float *dx = scene->x + (size_t)first * dim;
	const uint16_t *unit = s->mlp_in + (size_t)first * dim;
	to_bf16(dx, (size_t)total * dim, t->rows);
	for (int r = 0; r < total; r += 32) {
		hidden_backward(b, w, t, s->hidden + (size_t)(first + r) * hidden, r, total);
		product(t->hidden, hidden, w->up.backward, hidden, 32, dim, hidden, t->chunk, dim,
			false);
		norm_rows_back(t->chunk, unit + (size_t)r * dim, s->mlp_rstd + first + r, 32, dim,
			       w->mlp_norm, gradients[MLP_NORM], dx + (size_t)r * dim);
	}
	/* up: [hidden, dim] from the slopes and the normalised rows; down: [dim, hidden]. */
	weigh_rows(unit, total, dim, w->mlp_norm, t->wide);
	pack_pairs(t->wide, dim, total, dim, t->wide + (size_t)total * dim, total);
	weight_gradient(t->a, t->wide + (size_t)total * dim, total, total, hidden, dim,
			gradients[UP]);
	pack_transposed(t->rows, dim, total, dim, t->a, total);
	weight_gradient(t->a, t->b, total, total, dim, hidden, gradients[DOWN]);
}

/* --- attention of half a block --- */

struct attention_call {
	const struct dio_blocks *b;
	const struct half *w[2]; /* of context and of target rows */
	float *const *gradients[2];
	struct scratch *t;
	struct saved *s;
	const uint16_t *gradient; /* of what was attended; NULL in the forward pass */
};

/* `queries` rows from `query` on ask `keys` rows from `key` on; all heads. */
static void attend(const struct attention_call *c, int query, int queries, int key, int keys)
{
	int asking = query >= c->b->context_rows, asked = key >= c->b->context_rows;
	struct attention_rows rows = {query, queries, key, keys};
	for (int head = 0; head < c->b->heads; head++) {
		struct attention_shape shape = {.dim = c->b->dim,
						.head = head,
						.eps = c->b->eps,
						.q_norm = c->w[asking]->q_norm,
						.k_norm = c->w[asked]->k_norm,
						.log_sums =
							c->s->log_sums + (size_t)head * c->b->rows};
		if (c->gradient) {
			attention_backward(&shape, &rows, c->s->qkv, c->s->attended, c->gradient,
					   c->t->wide, c->gradients[asking][Q_NORM],
					   c->gradients[asked][K_NORM], &c->t->attention);
		} else {
			attention_forward(&shape, &rows, c->s->qkv, c->s->attended,
					  &c->t->attention);
		}
	}
}

static void attend_within(const struct attention_call *c, bool targets)
{
	const struct dio_blocks *b = c->b;
	for (int v = 0; v < b->context; v++) {
		attend(c, v * b->near, b->near, v * b->near, b->near);
	}
	for (int v = 0; targets && v < b->targets; v++) {
		int at = b->context_rows + v * b->far;
		attend(c, at, b->far, at, b->far);
	}
}

/* Everybody asks all context views; after the last block only targets matter. */
static void attend_across(const struct attention_call *c, bool last)
{
	const struct dio_blocks *b = c->b;
	int keys = b->context * b->near;
	if (b->shared && !b->lone && !last) {
		attend(c, 0, b->rows, 0, keys);
		return;
	}
	if (!last && b->lone) {
		attend_within(c, false);
	} else if (!last) {
		attend(c, 0, keys, 0, keys);
	}
	attend(c, b->context_rows, b->rows - b->context_rows, 0, keys);
}

static void attend_forward(const struct dio_blocks *b, const struct half *const w[2],
			   struct scratch *t, struct scene *scene, struct saved *s, bool cross,
			   bool last)
{
	int dim = b->dim, own = b->context_rows, rest = b->rows - own,
	    first = cross && last ? own : 0;
	uint16_t *far = t->rows + (size_t)own * dim;
	norm_rows(scene->x, b->rows, dim, b->eps, s->attention_in, s->attention_rstd);
	weigh_rows(s->attention_in, own, dim, w[0]->norm, t->rows);
	weigh_rows(s->attention_in + (size_t)own * dim, rest, dim, w[1]->norm, far);
	product_bf16(t->rows, dim, w[0]->qkv.forward, dim, own, 3 * dim, dim, s->qkv, 3 * dim);
	product_bf16(far, dim, w[1]->qkv.forward, dim, rest, cross ? dim : 3 * dim, dim,
		     s->qkv + (size_t)own * 3 * dim, 3 * dim);
	memset(s->attended, 0, (size_t)b->rows * dim * 2);
	struct attention_call call = {.b = b, .w = {w[0], w[1]}, .t = t, .s = s};
	if (cross) {
		attend_across(&call, last);
	} else {
		attend_within(&call, true);
	}
	product(s->attended + (size_t)first * dim, dim, w[0]->out.forward, dim, own - first, dim,
		dim, scene->x + (size_t)first * dim, dim, true);
	product(s->attended + (size_t)own * dim, dim, w[1]->out.forward, dim, rest, dim, dim,
		scene->x + (size_t)own * dim, dim, true);
}

/* Back through the output projection of rows [first, end): its weights, and what was attended. */
static void project_backward(const struct dio_blocks *b, const struct half *w, struct scratch *t,
			     struct scene *scene, struct saved *s, float *const *gradients,
			     int first, int end)
{
	int dim = b->dim, total = end - first;
	uint16_t *slopes = t->rows + (size_t)first * dim;
	to_bf16(scene->x + (size_t)first * dim, (size_t)total * dim, slopes);
	pack_transposed(slopes, dim, total, dim, t->a, total);
	pack_pairs(s->attended + (size_t)first * dim, dim, total, dim, t->b, total);
	weight_gradient(t->a, t->b, total, total, dim, dim, gradients[OUT]);
	product_bf16(slopes, dim, w->out.backward, dim, total, dim, dim,
		     t->hidden_rows + (size_t)first * dim, dim);
}

/* Back through queries, keys and values of rows [first, end); from `only_queries` on, queries
 * alone. */
static void qkv_backward(const struct dio_blocks *b, const struct half *w, struct scratch *t,
			 struct scene *scene, struct saved *s, float *const *gradients, int first,
			 int end, int only_queries)
{
	int dim = b->dim, total = end - first, full = only_queries - first;
	const uint16_t *unit = s->attention_in + (size_t)first * dim;
	const uint16_t *slopes = t->wide + (size_t)first * 3 * dim;
	weigh_rows(unit, total, dim, w->norm, t->rows);
	pack_pairs(t->rows, dim, total, dim, t->b, total);
	pack_transposed(slopes, 3 * dim, total, 3 * dim, t->a, total);
	weight_gradient(t->a, t->b, total, total, dim, dim, gradients[QKV]);
	weight_gradient(t->a + (size_t)dim * total, t->b, full, total, 2 * dim, dim,
			gradients[QKV] + (size_t)dim * dim);
	for (int r = first, rows; r < end; r += rows) {
		int stop = r < only_queries ? only_queries : end;
		rows = stop - r < CHUNK ? stop - r : CHUNK;
		product(t->wide + (size_t)r * 3 * dim, 3 * dim, w->qkv.backward, 3 * dim, rows, dim,
			r < only_queries ? 3 * dim : dim, t->chunk, dim, false);
		norm_rows_back(t->chunk, s->attention_in + (size_t)r * dim, s->attention_rstd + r,
			       rows, dim, w->norm, gradients[NORM], scene->x + (size_t)r * dim);
	}
}

static void attend_backward(const struct dio_blocks *b, const struct half *const w[2],
			    struct scratch *t, struct scene *scene, struct saved *s,
			    float *const *const gradients[2], bool cross, bool last)
{
	int own = b->context_rows, first = cross && last ? own : 0, keyed = cross ? own : b->rows;
	if (b->shared) {
		project_backward(b, w[0], t, scene, s, gradients[0], first, b->rows);
	} else {
		if (first < own) {
			project_backward(b, w[0], t, scene, s, gradients[0], first, own);
		}
		project_backward(b, w[1], t, scene, s, gradients[1], own, b->rows);
	}
	memset(t->wide, 0, (size_t)b->rows * b->dim * 3 * 2);
	struct attention_call call = {.b = b,
				      .w = {w[0], w[1]},
				      .t = t,
				      .s = s,
				      .gradients = {gradients[0], gradients[1]},
				      .gradient = t->hidden_rows};
	if (cross) {
		attend_across(&call, last);
	} else {
		attend_within(&call, true);
	}
	if (b->shared) {
		qkv_backward(b, w[0], t, scene, s, gradients[0], 0, b->rows, keyed);
		return;
	}
	qkv_backward(b, w[0], t, scene, s, gradients[0], 0, own, own);
	qkv_backward(b, w[1], t, scene, s, gradients[1], own, b->rows, keyed);
}

/* --- both --- */

/* Half a block as context (0) or target (1) rows see it. */
static const struct half *half_of(const struct dio_blocks *b, int stage, int index)
{
	return &b->halves[b->shared ? index : stage * 2 * b->layers + index];
}

static void gradients_of(const struct dio_blocks *b, struct scratch *t, int stage, int index,
			 float *gradients[HALF_TENSORS])
{
	size_t at = (size_t)(half_of(b, stage, index) - b->halves) * b->half_floats;
	for (int k = 0; k < HALF_TENSORS; k++) {
		gradients[k] = t->gradients + at + b->offsets[k];
	}
}

void half_forward(const struct dio_blocks *b, int i, struct scratch *t, struct scene *scene)
{
	bool cross = i % 2, last = i == 2 * b->layers - 1;
	int first = last ? b->context_rows : 0;
	struct saved *s = &scene->halves[i];
	const struct half *w[] = {half_of(b, 0, i), half_of(b, 1, i)};
	attend_forward(b, w, t, scene, s, cross, last);
	mlp_forward(b, w[0], t, scene, s, first, b->context_rows);
	mlp_forward(b, w[1], t, scene, s, b->context_rows, b->rows);
}

void half_backward(const struct dio_blocks *b, int i, struct scratch *t, struct scene *scene)
{
	bool cross = i % 2, last = i == 2 * b->layers - 1;
	int first = last ? b->context_rows : 0;
	struct saved *s = &scene->halves[i];
	const struct half *w[] = {half_of(b, 0, i), half_of(b, 1, i)};
	float *near[HALF_TENSORS], *far_side[HALF_TENSORS];
	gradients_of(b, t, 0, i, near);
	gradients_of(b, t, 1, i, far_side);
	float *const *gradients[] = {near, far_side};
	if (b->shared) {
		mlp_backward(b, w[0], t, scene, s, near, first, b->rows);
	} else {
		mlp_backward(b, w[0], t, scene, s, near, first, b->context_rows);
		mlp_backward(b, w[1], t, scene, s, far_side, b->context_rows, b->rows);
	}
	attend_backward(b, w, t, scene, s, gradients, cross, last);
}
