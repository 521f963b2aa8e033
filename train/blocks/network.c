#include "network.h"

#include <stdlib.h>

#include "memory.h"
#include "vector.h"

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
	s->gradients = take(&arena, gradient_floats(b), sizeof(float));
	s->a = take(&arena, rows * hidden, 2);
	s->b = take(&arena, rows * hidden, 2);
	s->rows = take(&arena, rows * dim, 2);
	s->hidden = take(&arena, (size_t)CHUNK * hidden * 2, 2);
	s->hidden_rows = take(&arena, rows * dim, 2);
	s->wide = take(&arena, rows * dim * 3, 2);
	s->chunk = take(&arena, (size_t)CHUNK * dim, sizeof(float));
	struct attention_scratch *t = &s->attention;
	size_t heads_rows = rows * HEAD;
	uint16_t **halves[] = {&t->q,         &t->k,         &t->v,           &t->g,
			       &t->q_columns, &t->k_columns, &t->g_columns,   &t->q_pairs,
			       &t->v_pairs,   &t->g_pairs,   &t->k_transposed};
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

void batch_free(struct dio_blocks *b)
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

int batch_shape(struct dio_blocks *b, int scenes, int context, int near, int targets, int far)
{
	if (b->scene && b->scenes == scenes && b->context == context && b->near == near &&
	    b->targets == targets && b->far == far) {
		return 0;
	}
	batch_free(b);
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
			batch_free(b);
			return -1;
		}
		place_scene(b, scene, scene->memory);
	}
	for (int i = 0; i < b->threads; i++) {
		struct scratch *s = &b->scratch[i];
		s->memory = allocate(place_scratch(b, s, NULL));
		if (!s->memory) {
			batch_free(b);
			return -1;
		}
		place_scratch(b, s, s->memory);
	}
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
