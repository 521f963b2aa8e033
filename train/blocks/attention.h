/* Softmax attention of one head, forward and backward, on tiles (tiles.h). */
#pragma once

#include <stdint.h>

enum { HEAD = 64 };

/* Which rows of [rows][3 dim] ask, and which are asked. */
struct attention_rows {
	int query, queries, key, keys;
};

struct attention_shape {
	int dim, head;
	float eps;
	const float *q_norm, *k_norm; /* [HEAD] */
	float *log_sums;              /* [rows]: logarithm of the sum of a query's exponentials */
};

/*
 * Room for one head: [rows][HEAD] each, in the packings of vector.h. Rows are rounded up to 32,
 * those beyond are zero.
 */
struct attention_scratch {
	uint16_t *q, *k, *v, *g; /* g: gradient of what was attended */
	uint16_t *q_columns, *k_columns, *g_columns;
	uint16_t *q_pairs, *v_pairs, *g_pairs;
	uint16_t *k_transposed;
	float *scores;             /* [32][rows + 16] */
	uint16_t *shares, *slopes; /* [32][rows + 32] */
	uint16_t *slope_pairs;     /* [keys][queries] */
	float *g_dot_o, *log_sums;
};

/* qkv [rows][3 dim] -> attended [rows][dim], this head's columns. */
void attention_forward(const struct attention_shape *shape, const struct attention_rows *rows,
		       const uint16_t *qkv, uint16_t *attended, struct attention_scratch *scratch);

/*
 * Given the gradient of `attended`, add that of the queries asking and of the keys and values asked
 * (before QK-norm) to dqkv, and that of QK-norm's weights to dq_norm and dk_norm.
 */
void attention_backward(const struct attention_shape *shape, const struct attention_rows *rows,
			const uint16_t *qkv, const uint16_t *attended, const uint16_t *gradient,
			uint16_t *dqkv, float *dq_norm, float *dk_norm,
			struct attention_scratch *scratch);
