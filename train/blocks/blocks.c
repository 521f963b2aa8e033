#include "blocks.h"

#include <immintrin.h>
#include <math.h>
#include <pthread.h>
#include <stdatomic.h>
#include <stdbool.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include "amx.h"
#include "attention.h"
#include "memory.h"
#include "product.h"
#include "vector.h"

enum {
	MAX_THREADS = 64,
	CHUNK = 128, /* rows whose hidden layer stays in the second-level cache */
};

/* Tensors of half a block, in the order of the caller's pointers. */
enum { NORM, QKV, Q_NORM, K_NORM, OUT, MLP_NORM, UP, DOWN, HALF_TENSORS };

/* One matrix [rows, cols], packed for x W^T and for g W. */
struct matrix {
	uint16_t *forward, *backward;
	int rows, cols;
};

struct half {
	struct matrix qkv, out, up, down;
	const float *norm, *q_norm, *k_norm, *mlp_norm;
};

/* What the backward pass needs of half a block and one scene. */
struct saved {
	uint16_t *attention_in, *qkv, *attended, *mlp_in, *hidden;
	float *attention_rstd, *mlp_rstd, *log_sums;
};

struct scene {
	float *x; /* [rows][dim]: the residual stream, then its gradient */
	struct saved *halves;
	char *memory;
};

/* A thread's scratch. */
struct scratch {
	float *gradients;
	uint16_t *a, *b, *rows, *hidden, *wide;
	float *chunk;
	struct attention_scratch attention;
	char *memory;
};

struct dio_blocks {
	int dim, heads, layers, hidden, threads;
	float eps;
	struct half *halves; /* 2 a layer */
	char *packed;
	size_t offsets[HALF_TENSORS]; /* of a half's tensors in `gradients`, in floats */
	size_t half_floats;
	/* The batch at hand. */
	int scenes, context, near, targets, far; /* near, far: tokens of a context and a target view */
	int context_rows, rows; /* padded: context rows come first, targets after them */
	struct scene *scene;
	size_t scene_bytes;
	struct scratch scratch[MAX_THREADS];
	size_t scratch_bytes;
	/* The call at hand. */
	const float *near_in, *far_in;
	float *near_out, *far_out;
	atomic_int next;
};

static int round_up(int n, int unit)
{
	return (n + unit - 1) / unit * unit;
}

static size_t place_scene(const struct dio_blocks *b, struct scene *scene, char *base)
{
	struct arena arena = {base, 0};
	size_t rows = (size_t)b->rows, dim = (size_t)b->dim;
	scene->x = take(&arena, rows * dim, sizeof(float));
	struct saved unused;
	for (int i = 0; i < 2 * b->layers; i++) {
		struct saved *s = base ? &scene->halves[i] : &unused;
		s->attention_in = take(&arena, rows * dim, 2);
		s->qkv = take(&arena, rows * dim * 3, 2);
		s->attended = take(&arena, rows * dim, 2);
		s->mlp_in = take(&arena, rows * dim, 2);
		s->hidden = take(&arena, rows * (size_t)b->hidden, 2);
		s->attention_rstd = take(&arena, rows, sizeof(float));
		s->mlp_rstd = take(&arena, rows, sizeof(float));
		s->log_sums = take(&arena, rows * (size_t)b->heads, sizeof(float));
	}
	return arena.used;
}

static size_t place_scratch(const struct dio_blocks *b, struct scratch *s, char *base)
{
	struct arena arena = {base, 0};
	size_t rows = (size_t)b->rows, dim = (size_t)b->dim, hidden = (size_t)b->hidden;
	s->gradients = take(&arena, b->half_floats * 2 * (size_t)b->layers, sizeof(float));
	s->a = take(&arena, rows * hidden, 2);
	s->b = take(&arena, rows * hidden, 2);
	s->rows = take(&arena, rows * dim, 2);
	s->hidden = take(&arena, (size_t)CHUNK * hidden * 2, 2);
	s->wide = take(&arena, rows * dim * 3, 2);
	s->chunk = take(&arena, (size_t)CHUNK * dim, sizeof(float));
	struct attention_scratch *t = &s->attention;
	size_t heads_rows = rows * HEAD;
	uint16_t **halves[] = {&t->q, &t->k, &t->v, &t->g, &t->q_columns, &t->k_columns,
		&t->g_columns, &t->q_pairs, &t->v_pairs, &t->g_pairs, &t->k_transposed};
	for (size_t i = 0; i < sizeof(halves) / sizeof(*halves); i++) {
		*halves[i] = take(&arena, heads_rows, 2);
	}
	t->scores = take(&arena, 32 * (rows + 16), sizeof(float));
	t->shares = take(&arena, 32 * (rows + 32), 2);
	t->slopes = take(&arena, 32 * (rows + 32), 2);
	t->slope_pairs = take(&arena, rows * (size_t)b->context_rows + rows * 32, 2);
	t->g_dot_o = take(&arena, rows, sizeof(float));
	t->log_sums = take(&arena, rows, sizeof(float));
	t->dq = take(&arena, heads_rows, sizeof(float));
	return arena.used;
}

static void free_batch(struct dio_blocks *b)
{
	for (int i = 0; i < b->scenes && b->scene; i++) {
		free(b->scene[i].memory);
		free(b->scene[i].halves);
	}
	free(b->scene);
	b->scene = NULL;
	b->scenes = 0;
	for (int i = 0; i < MAX_THREADS; i++) {
		free(b->scratch[i].memory);
		b->scratch[i].memory = NULL;
	}
}

static int shape_batch(struct dio_blocks *b, int scenes, int context, int near, int targets, int far)
{
	if (b->scene && b->scenes == scenes && b->context == context && b->near == near &&
		b->targets == targets && b->far == far) {
		return 0;
	}
	free_batch(b);
	b->context = context;
	b->targets = targets;
	b->near = near;
	b->far = far;
	b->context_rows = round_up(context * near, 32);
	b->rows = b->context_rows + round_up(targets * far, 32);
	b->scene = calloc((size_t)scenes, sizeof(*b->scene));
	if (!b->scene) {
		return -1;
	}
	b->scenes = scenes;
	for (int i = 0; i < scenes; i++) {
		struct scene *scene = &b->scene[i];
		scene->halves = calloc((size_t)b->layers * 2, sizeof(*scene->halves));
		scene->memory = allocate(place_scene(b, scene, NULL));
		if (!scene->halves || !scene->memory) {
			free_batch(b);
			return -1;
		}
		place_scene(b, scene, scene->memory);
	}
	for (int i = 0; i < b->threads; i++) {
		struct scratch *s = &b->scratch[i];
		s->memory = allocate(place_scratch(b, s, NULL));
		if (!s->memory) {
			free_batch(b);
			return -1;
		}
		place_scratch(b, s, s->memory);
	}
	return 0;
}

/* --- gradients of weights --- */

/* A block of gradient[n][m] += sum over rows of g[row][n] x[row][m]; g transposed, x paired. */
static void gradient_block(const uint16_t *g, const uint16_t *x, int rows, int rows_total, int n,
	int c, int m, float *gradient)
{
	const uint16_t *upper = g + (size_t)n * rows_total, *lower = upper + (size_t)16 * rows_total;
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

/* --- row-wise parts --- */

/* Normalise rows of x: unit (bf16, before the weight) and 1/sigma. */
static void norm_rows(const float *x, int rows, int dim, float eps, uint16_t *unit, float *rstd)
{
	for (int r = 0; r < rows; r++, x += dim, unit += dim) {
		__m512 sum = _mm512_setzero_ps(), squares = sum;
		for (int i = 0; i < dim; i += 16) {
			sum = _mm512_add_ps(sum, _mm512_loadu_ps(x + i));
		}
		__m512 mean = _mm512_set1_ps(_mm512_reduce_add_ps(sum) / (float)dim);
		for (int i = 0; i < dim; i += 16) {
			__m512 d = _mm512_sub_ps(_mm512_loadu_ps(x + i), mean);
			squares = _mm512_fmadd_ps(d, d, squares);
		}
		rstd[r] = 1.0f / sqrtf(_mm512_reduce_add_ps(squares) / (float)dim + eps);
		__m512 scale = _mm512_set1_ps(rstd[r]);
		for (int i = 0; i < dim; i += 32) {
			store_bf16(unit + i, _mm512_mul_ps(_mm512_sub_ps(_mm512_loadu_ps(x + i), mean), scale),
				_mm512_mul_ps(_mm512_sub_ps(_mm512_loadu_ps(x + i + 16), mean), scale));
		}
	}
}

/* rows of unit x weight */
static void weigh_rows(const uint16_t *unit, int rows, int dim, const float *weight, uint16_t *out)
{
	for (int r = 0; r < rows; r++) {
		for (int i = 0; i < dim; i += 32, unit += 32, out += 32) {
			store_bf16(out, _mm512_mul_ps(load_bf16(unit), _mm512_loadu_ps(weight + i)),
				_mm512_mul_ps(load_bf16(unit + 16), _mm512_loadu_ps(weight + i + 16)));
		}
	}
}

/* Through the norm: dx += its gradient, weight_gradient += ... for the gradient dy of its output. */
static void norm_rows_back(const float *dy, const uint16_t *unit, const float *rstd, int rows,
	int dim, const float *weight, float *weight_gradient, float *dx)
{
	for (int r = 0; r < rows; r++, dy += dim, unit += dim, dx += dim) {
		__m512 sum = _mm512_setzero_ps(), along = sum;
		for (int i = 0; i < dim; i += 16) {
			__m512 u = load_bf16(unit + i), g = _mm512_loadu_ps(dy + i);
			_mm512_storeu_ps(weight_gradient + i,
				_mm512_fmadd_ps(g, u, _mm512_loadu_ps(weight_gradient + i)));
			g = _mm512_mul_ps(g, _mm512_loadu_ps(weight + i));
			sum = _mm512_add_ps(sum, g);
			along = _mm512_fmadd_ps(g, u, along);
		}
		__m512 mean = _mm512_set1_ps(_mm512_reduce_add_ps(sum) / (float)dim);
		__m512 mean_along = _mm512_set1_ps(_mm512_reduce_add_ps(along) / (float)dim);
		__m512 scale = _mm512_set1_ps(rstd[r]);
		for (int i = 0; i < dim; i += 16) {
			__m512 g = _mm512_mul_ps(_mm512_loadu_ps(dy + i), _mm512_loadu_ps(weight + i));
			g = _mm512_sub_ps(g, _mm512_fmadd_ps(load_bf16(unit + i), mean_along, mean));
			_mm512_storeu_ps(dx + i, _mm512_fmadd_ps(g, scale, _mm512_loadu_ps(dx + i)));
		}
	}
}

/* --- the multi-layer perceptron of half a block, rows [first, rows) --- */

static void mlp_forward(const struct dio_blocks *b, const struct half *w, struct scratch *t,
	struct scene *scene, struct saved *s, int first)
{
	int dim = b->dim, hidden = b->hidden;
	for (int r = first; r < b->rows; r += CHUNK) {
		int rows = b->rows - r < CHUNK ? b->rows - r : CHUNK;
		float *x = scene->x + (size_t)r * dim;
		uint16_t *unit = s->mlp_in + (size_t)r * dim, *h = s->hidden + (size_t)r * hidden;
		norm_rows(x, rows, dim, b->eps, unit, s->mlp_rstd + r);
		weigh_rows(unit, rows, dim, w->mlp_norm, t->rows);
		product_bf16(t->rows, dim, w->up.forward, dim, rows, hidden, dim, h, hidden);
		for (int i = 0; i < rows * hidden; i += 32) {
			store_bf16(t->hidden + i, gelu(load_bf16(h + i)), gelu(load_bf16(h + i + 16)));
		}
		product(t->hidden, hidden, w->down.forward, hidden, rows, dim, hidden, x, dim, true);
	}
}

static void mlp_backward(const struct dio_blocks *b, const struct half *w, struct scratch *t,
	struct scene *scene, const struct saved *s, float *const *gradients, int first)
{
	int dim = b->dim, hidden = b->hidden, total = b->rows - first;
	float *dx = scene->x + (size_t)first * dim;
	const uint16_t *unit = s->mlp_in + (size_t)first * dim;
	to_bf16(dx, (size_t)total * dim, t->rows);
	for (int r = 0; r < total; r += CHUNK) {
		int rows = total - r < CHUNK ? total - r : CHUNK;
		const uint16_t *h = s->hidden + (size_t)(first + r) * hidden;
		uint16_t *active = t->hidden, *slope = t->hidden + (size_t)CHUNK * hidden;
		product_bf16(t->rows + (size_t)r * dim, dim, w->down.backward, dim, rows, hidden, dim, slope,
			hidden);
		for (int i = 0; i < rows * hidden; i += 32) {
			__m512 a0, a1, d0, d1;
			gelu_both(load_bf16(h + i), &a0, &d0);
			gelu_both(load_bf16(h + i + 16), &a1, &d1);
			store_bf16(active + i, a0, a1);
			store_bf16(slope + i, _mm512_mul_ps(d0, load_bf16(slope + i)),
				_mm512_mul_ps(d1, load_bf16(slope + i + 16)));
		}
		pack_pairs(active, hidden, rows, hidden, t->b + (size_t)r * 32, total);
		pack_transposed(slope, hidden, rows, hidden, t->a + (size_t)r * 16, total);
		product(slope, hidden, w->up.backward, hidden, rows, dim, hidden, t->chunk, dim, false);
		norm_rows_back(t->chunk, unit + (size_t)r * dim, s->mlp_rstd + first + r, rows, dim,
			w->mlp_norm, gradients[MLP_NORM], dx + (size_t)r * dim);
	}
	/* up: [hidden, dim] from the slopes and the normalised rows; down: [dim, hidden]. */
	weigh_rows(unit, total, dim, w->mlp_norm, t->wide);
	pack_pairs(t->wide, dim, total, dim, t->wide + (size_t)total * dim, total);
	weight_gradient(t->a, t->wide + (size_t)total * dim, total, total, hidden, dim, gradients[UP]);
	pack_transposed(t->rows, dim, total, dim, t->a, total);
	weight_gradient(t->a, t->b, total, total, dim, hidden, gradients[DOWN]);
}

/* --- attention of half a block --- */

/* The attentions of half a block: within each view, or to all context views. */
static void each_attention(const struct dio_blocks *b, bool cross, bool last,
	void (*call)(void *, const struct attention_rows *), void *context)
{
	if (cross) {
		int first = last ? b->context_rows : 0;
		struct attention_rows all = {first, b->rows - first, 0, b->context * b->near};
		call(context, &all);
		return;
	}
	for (int v = 0; v < b->context + b->targets; v++) {
		bool given = v < b->context;
		int at = given ? v * b->near : b->context_rows + (v - b->context) * b->far;
		int tokens = given ? b->near : b->far;
		struct attention_rows one = {at, tokens, at, tokens};
		call(context, &one);
	}
}

struct attention_call {
	const struct dio_blocks *b;
	const struct half *w;
	struct scratch *t;
	struct saved *s;
	uint16_t *gradient; /* of what was attended, then of queries, keys and values */
	float *const *gradients;
};

static struct attention_shape shape_of(const struct attention_call *c, int head)
{
	return (struct attention_shape){.dim = c->b->dim, .head = head, .eps = c->b->eps,
		.q_norm = c->w->q_norm, .k_norm = c->w->k_norm,
		.log_sums = c->s->log_sums + (size_t)head * c->b->rows};
}

static void forward_call(void *context, const struct attention_rows *rows)
{
	const struct attention_call *c = context;
	for (int head = 0; head < c->b->heads; head++) {
		struct attention_shape shape = shape_of(c, head);
		attention_forward(&shape, rows, c->s->qkv, c->s->attended, &c->t->attention);
	}
}

static void backward_call(void *context, const struct attention_rows *rows)
{
	const struct attention_call *c = context;
	for (int head = 0; head < c->b->heads; head++) {
		struct attention_shape shape = shape_of(c, head);
		attention_backward(&shape, rows, c->s->qkv, c->s->attended, c->gradient, c->t->wide,
			c->gradients[Q_NORM], c->gradients[K_NORM], &c->t->attention);
	}
}

static void attend_forward(const struct dio_blocks *b, const struct half *w, struct scratch *t,
	struct scene *scene, struct saved *s, bool cross, bool last)
{
	int dim = b->dim, own = cross ? b->context_rows : b->rows, first = cross && last ? own : 0;
	norm_rows(scene->x, b->rows, dim, b->eps, s->attention_in, s->attention_rstd);
	weigh_rows(s->attention_in, b->rows, dim, w->norm, t->rows);
	product_bf16(t->rows, dim, w->qkv.forward, dim, own, 3 * dim, dim, s->qkv, 3 * dim);
	product_bf16(t->rows + (size_t)own * dim, dim, w->qkv.forward, dim, b->rows - own, dim, dim,
		s->qkv + (size_t)own * 3 * dim, 3 * dim);
	memset(s->attended, 0, (size_t)b->rows * dim * 2);
	struct attention_call call = {b, w, t, s, NULL, NULL};
	each_attention(b, cross, last, forward_call, &call);
	product(s->attended + (size_t)first * dim, dim, w->out.forward, dim, b->rows - first, dim, dim,
		scene->x + (size_t)first * dim, dim, true);
}

static void attend_backward(const struct dio_blocks *b, const struct half *w, struct scratch *t,
	struct scene *scene, struct saved *s, float *const *gradients, bool cross, bool last)
{
	int dim = b->dim, own = cross ? b->context_rows : b->rows, first = cross && last ? own : 0;
	int total = b->rows - first;
	to_bf16(scene->x + (size_t)first * dim, (size_t)total * dim, t->rows);
	pack_transposed(t->rows, dim, total, dim, t->a, total);
	pack_pairs(s->attended + (size_t)first * dim, dim, total, dim, t->b, total);
	weight_gradient(t->a, t->b, total, total, dim, dim, gradients[OUT]);
	uint16_t *attended = t->b; /* its gradient; [rows][dim] */
	product_bf16(t->rows, dim, w->out.backward, dim, total, dim, dim,
		attended + (size_t)first * dim, dim);
	memset(t->wide, 0, (size_t)b->rows * dim * 3 * 2);
	struct attention_call call = {b, w, t, s, attended, gradients};
	each_attention(b, cross, last, backward_call, &call);
	/* Rows from `own` on have queries alone. */
	weigh_rows(s->attention_in, b->rows, dim, w->norm, t->rows);
	pack_pairs(t->rows, dim, b->rows, dim, t->b, b->rows);
	pack_transposed(t->wide, 3 * dim, b->rows, 3 * dim, t->a, b->rows);
	weight_gradient(t->a, t->b, b->rows, b->rows, dim, dim, gradients[QKV]);
	weight_gradient(t->a + (size_t)dim * b->rows, t->b, own, b->rows, 2 * dim, dim,
		gradients[QKV] + (size_t)dim * dim);
	for (int r = 0; r < b->rows; r += CHUNK) {
		int end = r < own ? own : b->rows, rows = end - r < CHUNK ? end - r : CHUNK;
		product(t->wide + (size_t)r * 3 * dim, 3 * dim, w->qkv.backward, 3 * dim, rows, dim,
			r < own ? 3 * dim : dim, t->chunk, dim, false);
		norm_rows_back(t->chunk, s->attention_in + (size_t)r * dim, s->attention_rstd + r, rows, dim,
			w->norm, gradients[NORM], scene->x + (size_t)r * dim);
		r += rows - CHUNK;
	}
}

/* --- threads: each takes the next scene --- */

struct worker {
	struct dio_blocks *b;
	struct scratch *scratch;
	void (*scene)(struct dio_blocks *, struct scratch *, int index);
	pthread_t thread;
	bool started;
};

static void *work(void *argument)
{
	struct worker *worker = argument;
	tiles_configure();
	for (;;) {
		int index = atomic_fetch_add(&worker->b->next, 1);
		if (index >= worker->b->scenes) {
			break;
		}
		worker->scene(worker->b, worker->scratch, index);
	}
	tiles_release();
	return NULL;
}

static int run_threads(struct dio_blocks *b, void (*scene)(struct dio_blocks *, struct scratch *, int))
{
	struct worker workers[MAX_THREADS] = {0};
	int count = b->threads < b->scenes ? b->threads : b->scenes, started = 0;
	atomic_store(&b->next, 0);
	for (int i = 0; i < count; i++) {
		workers[i] = (struct worker){b, &b->scratch[i], scene, 0, false};
		workers[i].started = pthread_create(&workers[i].thread, NULL, work, &workers[i]) == 0;
		started += workers[i].started;
	}
	for (int i = 0; i < count; i++) {
		if (workers[i].started) {
			pthread_join(workers[i].thread, NULL);
		}
	}
	return started > 0 ? 0 : -1;
}

static void scene_forward(struct dio_blocks *b, struct scratch *t, int index)
{
	struct scene *scene = &b->scene[index];
	size_t dim = (size_t)b->dim, context = (size_t)b->context * b->near * dim;
	size_t targets = (size_t)b->targets * b->far * dim;
	float *far = scene->x + (size_t)b->context_rows * dim;
	memset(scene->x, 0, (size_t)b->rows * dim * sizeof(float));
	memcpy(scene->x, b->near_in + (size_t)index * context, context * sizeof(float));
	memcpy(far, b->far_in + (size_t)index * targets, targets * sizeof(float));
	for (int i = 0; i < 2 * b->layers; i++) {
		bool cross = i % 2, last = i == 2 * b->layers - 1;
		attend_forward(b, &b->halves[i], t, scene, &scene->halves[i], cross, last);
		mlp_forward(b, &b->halves[i], t, scene, &scene->halves[i], last ? b->context_rows : 0);
	}
	memcpy(b->far_out + (size_t)index * targets, far, targets * sizeof(float));
}

static void scene_backward(struct dio_blocks *b, struct scratch *t, int index)
{
	struct scene *scene = &b->scene[index];
	size_t dim = (size_t)b->dim, context = (size_t)b->context * b->near * dim;
	size_t targets = (size_t)b->targets * b->far * dim;
	float *far = scene->x + (size_t)b->context_rows * dim;
	memset(scene->x, 0, (size_t)b->rows * dim * sizeof(float));
	memcpy(far, b->far_in + (size_t)index * targets, targets * sizeof(float));
	for (int i = 2 * b->layers - 1; i >= 0; i--) {
		bool cross = i % 2, last = i == 2 * b->layers - 1;
		float *gradients[HALF_TENSORS];
		for (int k = 0; k < HALF_TENSORS; k++) {
			gradients[k] = t->gradients + b->half_floats * (size_t)i + b->offsets[k];
		}
		struct saved *s = &scene->halves[i];
		mlp_backward(b, &b->halves[i], t, scene, s, gradients, last ? b->context_rows : 0);
		attend_backward(b, &b->halves[i], t, scene, s, gradients, cross, last);
	}
	memcpy(b->near_out + (size_t)index * context, scene->x, context * sizeof(float));
	memcpy(b->far_out + (size_t)index * targets, far, targets * sizeof(float));
}

/* --- weights --- */

static size_t place_weights(struct dio_blocks *b, char *base)
{
	struct arena arena = {base, 0};
	int dim = b->dim, hidden = b->hidden;
	for (int i = 0; i < 2 * b->layers; i++) {
		struct half *half = &b->halves[i];
		struct matrix *matrices[] = {&half->qkv, &half->out, &half->up, &half->down};
		int shapes[][2] = {{3 * dim, dim}, {dim, dim}, {hidden, dim}, {dim, hidden}};
		for (int k = 0; k < 4; k++) {
			size_t count = (size_t)shapes[k][0] * shapes[k][1];
			matrices[k]->rows = shapes[k][0];
			matrices[k]->cols = shapes[k][1];
			matrices[k]->forward = take(&arena, count, 2);
			matrices[k]->backward = take(&arena, count, 2);
		}
	}
	return arena.used;
}

/* Pack 32 rows at a time, through a strip of bfloat16. */
static void pack_matrix(const float *weight, struct matrix *m, uint16_t *strip)
{
	for (int r = 0; r < m->rows; r += 32) {
		to_bf16(weight + (size_t)r * m->cols, (size_t)32 * m->cols, strip);
		pack_columns(strip, m->cols, 32, m->cols, m->forward + (size_t)r * m->cols, m->cols);
		pack_pairs(strip, m->cols, 32, m->cols, m->backward + (size_t)r * 32, m->rows);
	}
}

static void pack_weights(struct dio_blocks *b, const float *const *weights)
{
	for (int i = 0; i < 2 * b->layers; i++, weights += HALF_TENSORS) {
		struct half *half = &b->halves[i];
		half->norm = weights[NORM];
		half->q_norm = weights[Q_NORM];
		half->k_norm = weights[K_NORM];
		half->mlp_norm = weights[MLP_NORM];
		uint16_t *strip = b->scratch[0].a;
		pack_matrix(weights[QKV], &half->qkv, strip);
		pack_matrix(weights[OUT], &half->out, strip);
		pack_matrix(weights[UP], &half->up, strip);
		pack_matrix(weights[DOWN], &half->down, strip);
	}
}

/* --- the interface --- */

int dio_blocks_supported(void)
{
	return tiles_supported();
}

struct dio_blocks *dio_blocks_create(int dim, int heads, int layers, float eps, int threads)
{
	if (dim <= 0 || layers <= 0 || heads <= 0 || dim != heads * HEAD || !tiles_supported()) {
		return NULL;
	}
	struct dio_blocks *b = calloc(1, sizeof(*b));
	if (!b) {
		return NULL;
	}
	b->dim = dim;
	b->heads = heads;
	b->layers = layers;
	b->hidden = 4 * dim;
	b->eps = eps;
	b->threads = threads < 1 ? 1 : threads > MAX_THREADS ? MAX_THREADS : threads;
	size_t square = (size_t)dim * dim, width = (size_t)dim;
	size_t sizes[HALF_TENSORS] = {width, 3 * square, HEAD, HEAD, square, width, 4 * square, 4 * square};
	for (int k = 0; k < HALF_TENSORS; k++) {
		b->offsets[k] = b->half_floats;
		b->half_floats += (sizes[k] + 15) & ~(size_t)15;
	}
	b->halves = calloc((size_t)layers * 2, sizeof(*b->halves));
	b->packed = b->halves ? allocate(place_weights(b, NULL)) : NULL;
	if (!b->packed) {
		dio_blocks_destroy(b);
		return NULL;
	}
	place_weights(b, b->packed);
	return b;
}

void dio_blocks_destroy(struct dio_blocks *b)
{
	if (b) {
		free_batch(b);
		free(b->packed);
		free(b->halves);
		free(b);
	}
}

int dio_blocks_forward(struct dio_blocks *b, const float *const *weights, int scenes, int context,
	int near, int targets, int far, const float *given, const float *asked, float *y)
{
	if (scenes < 1 || context < 1 || near < 1 || targets < 1 || far < 1 ||
		shape_batch(b, scenes, context, near, targets, far) != 0) {
		return -1;
	}
	pack_weights(b, weights);
	b->near_in = given;
	b->far_in = asked;
	b->far_out = y;
	return run_threads(b, scene_forward);
}

int dio_blocks_backward(struct dio_blocks *b, const float *dy, float *dgiven, float *dasked,
	float *const *gradients)
{
	if (!b->scene) {
		return -1;
	}
	int used = b->threads < b->scenes ? b->threads : b->scenes;
	size_t floats = b->half_floats * 2 * (size_t)b->layers;
	for (int i = 0; i < used; i++) {
		memset(b->scratch[i].gradients, 0, floats * sizeof(float));
	}
	b->far_in = dy;
	b->near_out = dgiven;
	b->far_out = dasked;
	if (run_threads(b, scene_backward) != 0) {
		return -1;
	}
	size_t square = (size_t)b->dim * b->dim, width = (size_t)b->dim;
	size_t sizes[HALF_TENSORS] = {width, 3 * square, HEAD, HEAD, square, width, 4 * square, 4 * square};
	for (int i = 0; i < 2 * b->layers; i++) {
		for (int k = 0; k < HALF_TENSORS; k++) {
			float *to = gradients[i * HALF_TENSORS + k];
			size_t at = b->half_floats * (size_t)i + b->offsets[k];
			memcpy(to, b->scratch[0].gradients + at, sizes[k] * sizeof(float));
			for (int t = 1; t < used; t++) {
				const float *from = b->scratch[t].gradients + at;
				for (size_t n = 0; n < sizes[k]; n += 16) {
					_mm512_storeu_ps(to + n,
						_mm512_add_ps(_mm512_loadu_ps(to + n), _mm512_loadu_ps(from + n)));
				}
			}
		}
	}
	return 0;
}
