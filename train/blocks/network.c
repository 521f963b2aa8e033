#include "network.h"

#include <stdlib.h>

#include "memory.h"
#include "vector.h"

static int round_up(int n, int unit)
{
	return (n + unit - 1) / unit * unit;
}

static void place_scene(const struct dio_blocks *b, struct arena *arena, struct scene *scene)
{
	size_t rows = (size_t)b->rows, dim = (size_t)b->dim;
	struct saved unused;
	scene->halves = take(arena, (size_t)b->layers * 2, sizeof(*scene->halves));
	scene->x = take(arena, rows * dim, sizeof(float));
	for (int i = 0; i < 2 * b->layers; i++) {
		struct saved *s = scene->halves ? &scene->halves[i] : &unused;
		s->attention_in = take(arena, rows * dim, 2);
		s->qkv = take(arena, rows * dim * 3, 2);
		s->attended = take(arena, rows * dim, 2);
		s->mlp_in = take(arena, rows * dim, 2);
		s->hidden = take(arena, rows * (size_t)b->hidden, 2);
		s->attention_rstd = take(arena, rows, sizeof(float));
		s->mlp_rstd = take(arena, rows, sizeof(float));
		s->log_sums = take(arena, rows * (size_t)b->heads, sizeof(float));
	}
}

static void place_attention(const struct dio_blocks *b, struct arena *arena,
			    struct attention_scratch *t)
{
	size_t rows = (size_t)b->rows, keys = (size_t)b->context_rows;
	/* Within a view targets are keys too. */
	size_t within = (size_t)round_up(b->near > b->far ? b->near : b->far, 32);
	uint16_t **halves[] = {&t->q,         &t->k,         &t->v,           &t->g,
			       &t->q_columns, &t->k_columns, &t->g_columns,   &t->q_pairs,
			       &t->v_pairs,   &t->g_pairs,   &t->k_transposed};
	for (size_t i = 0; i < sizeof(halves) / sizeof(*halves); i++) {
		*halves[i] = take(arena, rows * HEAD, 2);
	}
	t->scores = take(arena, 32 * (rows + 16), sizeof(float));
	t->shares = take(arena, 32 * (rows + 32), 2);
	t->slopes = take(arena, 32 * (rows + 32), 2);
	t->slope_pairs =
		take(arena, rows * keys > within * within ? rows * keys : within * within, 2);
	t->g_dot_o = take(arena, rows, sizeof(float));
	t->log_sums = take(arena, rows, sizeof(float));
}

static void place_scratch(const struct dio_blocks *b, struct arena *arena, struct scratch *s)
{
	size_t rows = (size_t)b->rows, dim = (size_t)b->dim, hidden = (size_t)b->hidden;
	s->gradients = take(arena, gradient_floats(b), sizeof(float));
	s->a = take(arena, rows * hidden, 2);
	s->b = take(arena, rows * hidden, 2);
	s->rows = take(arena, rows * dim, 2);
	s->hidden = take(arena, 32 * hidden, 2);
	s->hidden_rows = take(arena, rows * dim, 2);
	s->wide = take(arena, rows * dim * 3, 2);
	s->chunk = take(arena, (size_t)CHUNK * dim, sizeof(float));
	place_attention(b, arena, &s->attention);
}

static size_t place_batch(struct dio_blocks *b, char *base)
{
	struct arena arena = {base, 0};
	struct scene unused;
	b->scene = take(&arena, (size_t)b->scenes, sizeof(*b->scene));
	for (int i = 0; i < b->scenes; i++) {
		place_scene(b, &arena, b->scene ? &b->scene[i] : &unused);
	}
	for (int i = 0; i < b->threads; i++) {
		place_scratch(b, &arena, &b->scratch[i]);
	}
	return arena.used;
}

int batch_shape(struct dio_blocks *b, int scenes, int context, int near, int targets, int far)
{
	b->scenes = scenes;
	b->context = context;
	b->targets = targets;
	b->near = near;
	b->far = far;
	b->context_rows = round_up(context * near, 32);
	b->rows = b->context_rows + round_up(targets * far, 32);
	size_t bytes = place_batch(b, NULL);
	if (bytes > b->batch_bytes) {
		free(b->batch);
		b->batch = allocate(bytes);
		b->batch_bytes = b->batch ? bytes : 0;
	}
	if (!b->batch) {
		return -1;
	}
	place_batch(b, b->batch);
	return 0;
}

/* --- weights --- */

size_t weights_place(struct dio_blocks *b, char *base)
{
	struct arena arena = {base, 0};
	int dim = b->dim, hidden = b->hidden;
	for (int i = 0; i < 2 * b->layers * stages(b); i++) {
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
		pack_columns(strip, m->cols, 32, m->cols, m->forward + (size_t)r * m->cols,
			     m->cols);
		pack_pairs(strip, m->cols, 32, m->cols, m->backward + (size_t)r * 32, m->rows);
	}
}

void weights_pack(struct dio_blocks *b, const float *const *weights)
{
	for (int i = 0; i < 2 * b->layers * stages(b); i++, weights += HALF_TENSORS) {
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
