/* Steps of a network made of oneDNN primitives, and of loops where oneDNN has none. */
#ifndef TESTS_BENCH_PEERS_ONEDNN_STEPS_H
#define TESTS_BENCH_PEERS_ONEDNN_STEPS_H

#include <dnnl.h>
#include <stdbool.h>
#include <stdint.h>

/** How products are done. */
enum mode {
	MODE_F32,
	MODE_BF16, /* everything that moves is bfloat16 */
	MODE_INT8, /* products with weights: one scale a tensor, one a row of weights; the rest f32
		    */
};

/** Numbers in memory: `rows` of `columns`, in the mode's type. */
struct array {
	void *numbers;
	size_t rows, columns;
};

/** A weight matrix packed as oneDNN likes it for products of one size. */
struct matrix {
	const float *numbers; /* [out][in], as the model has it */
	size_t out, in;
};

struct plan; /* steps in order */

enum after { AFTER_STORE, AFTER_ADD, AFTER_GELU };

struct plan *plan_create(enum mode mode);
void plan_run(struct plan *plan);

/** Memory for rows x columns in the mode's type; never freed: a plan lives as long as the program.
 */
struct array plan_array(const struct plan *plan, size_t rows, size_t columns);

/** c = a w^T, or added to c, or its GELU. */
void plan_product(struct plan *plan, struct array a, struct matrix w, struct array c,
		  enum after after);
void plan_norm(struct plan *plan, struct array x, const float *weight, float eps, struct array out);

/**
 * Heads of `from`, columns first .. first + heads width, to their own place [batch][heads][rows /
 * batch][width]; `weight` of QK-norm, or NULL for none.
 */
void plan_split(struct plan *plan, struct array from, size_t first, size_t heads, size_t batch,
		const float *weight, float eps, struct array out);

/** out[rows][heads width] = attention; q, k, v as plan_split() leaves them. */
void plan_attention(struct plan *plan, struct array q, struct array k, struct array v, size_t heads,
		    size_t batch, struct array out);

/** Floats to the mode's type and back, at once. */
void plan_fill(const struct plan *plan, const float *from, struct array to);
void plan_fetch(const struct plan *plan, struct array from, float *to);

#endif
