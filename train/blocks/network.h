/* A network's blocks in memory: packed weights, what the backward pass needs, threads' scratch. */
#pragma once

#include <stdatomic.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "attention.h"

enum {
	MAX_THREADS = 64,
	CHUNK = 128, /* rows whose gradient stays in the second-level cache */
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
};

/* A thread's scratch. */
struct scratch {
	float *gradients;
	uint16_t *a, *b, *rows, *hidden, *hidden_rows, *wide;
	float *chunk;
	struct attention_scratch attention;
};

struct dio_blocks {
	int dim, heads, layers, hidden, threads;
	float eps;
	bool shared; /* one set of weights for context and target rows */
	bool lone;   /* context views see only themselves */
	/* Two a layer; behind them those of the target rows where they are not shared. */
	struct half *halves;
	char *packed;
	size_t offsets[HALF_TENSORS]; /* of a half's tensors in `gradients`, in floats */
	size_t half_floats;
	/* The batch at hand. */
	int scenes, context, targets;
	int near, far;          /* tokens of a context and of a target view */
	int context_rows, rows; /* padded: context rows come first, targets after them */
	struct scene *scene;
	struct scratch scratch[MAX_THREADS];
	char *batch; /* holds all of it, for the largest batch so far */
	size_t batch_bytes;
	/* The call at hand. */
	const float *near_in, *far_in;
	float *near_out, *far_out;
	atomic_int next;
};

static inline int stages(const struct dio_blocks *b)
{
	return b->shared ? 1 : 2;
}

/*
 * Half a block, i of 2 layers, on one scene: forward in place in scene->x; backward with the
 * gradient of its output there, which becomes that of its input. Within views where i is even,
 * across where it is odd; after the last one only target rows are right.
 */
void half_forward(const struct dio_blocks *b, int i, struct scratch *t, struct scene *scene);
void half_backward(const struct dio_blocks *b, int i, struct scratch *t, struct scene *scene);

/* Make room for a batch; 0, or -1 without memory: then there is no b->scene. */
int batch_shape(struct dio_blocks *b, int scenes, int context, int near, int targets, int far);

/* All packed weights: measures where base is NULL, else places. */
size_t weights_place(struct dio_blocks *b, char *base);
void weights_pack(struct dio_blocks *b, const float *const *weights);

/* Floats of the gradients of all weights. */
static inline size_t gradient_floats(const struct dio_blocks *b)
{
	return b->half_floats * 2 * (size_t)b->layers * (size_t)stages(b);
}
