/*
 * The kernel table: what the transformer spends its time in, one set of functions per instruction
 * set. Private to the engine.
 *
 * The contracts stand here, once. The scalar set (f32_ref.c) is the specification: it accumulates
 * in double and rounds once. The others keep float accumulators; tests/kernels states how far they
 * may be from it. Every function is reentrant, reads and writes nothing beyond the ranges stated,
 * needs no alignment unless said, and computes each output number in an order that depends on
 * `depth`, `keys` or `dim` alone - never on how the caller cut the rows into tiles - so that
 * results do not depend on the number of threads.
 */
#ifndef DVSM_KERNELS_KERNELS_H
#define DVSM_KERNELS_KERNELS_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "dvsm/engine.h"
#include "kernels/pack.h"

/** Most queries that one attention call takes. */
#define DVSM_ATTENTION_QUERIES 64u

/** Keys that the online softmax takes in at a time. */
#define DVSM_ATTENTION_KEYS 64u

/** What a matrix product does with each number before it is stored. */
enum dvsm_epilogue {
	DVSM_EPILOGUE_STORE, /* c = ab                                    */
	DVSM_EPILOGUE_ADD,   /* c = c + ab, the residual connection       */
	DVSM_EPILOGUE_GELU,  /* c = gelu(ab), gelu(x) = x/2 erfc(-x/sqrt 2) */
};

/**
 * C[rows][cols] = epilogue(A[rows][depth] W[cols][depth]^T).
 *
 * panels   W as dvsm_pack_panels() writes it, 64-byte aligned
 * a, c     rows lie a_stride, c_stride floats apart; they do not overlap
 *
 * Any size may be 0; with depth 0 the product is 0.
 */
typedef void dvsm_gemm_fn(const float *a, size_t a_stride, size_t rows, const float *panels,
			  size_t depth, size_t cols, float *c, size_t c_stride,
			  enum dvsm_epilogue epilogue);

/**
 * Rows of x to zero mean and unit variance, times weight: out = (x - mean) / sqrt(var + eps) w.
 *
 * x, out   [rows][dim]; out may be x
 */
typedef void dvsm_layer_norm_fn(const float *x, size_t rows, size_t dim, const float *weight,
				float eps, float *out);

/**
 * Rows of x to unit root mean square, times weight: out = x / sqrt(mean(x^2) + eps) w (QK-norm).
 *
 * x, out   rows of dim numbers, x_stride and out_stride floats apart; out may be x
 */
typedef void dvsm_rms_norm_fn(const float *x, size_t x_stride, size_t rows, size_t dim,
			      const float *weight, float eps, float *out, size_t out_stride);

/** One head's attention for up to DVSM_ATTENTION_QUERIES queries. */
struct dvsm_attention {
	const float *q; /* [queries][head_dim], rows q_stride apart */
	size_t q_stride;
	size_t queries; /* 0..DVSM_ATTENTION_QUERIES */
	const float *k; /* [keys][head_dim], contiguous */
	const float *v; /* [keys][head_dim], contiguous */
	size_t keys;
	size_t head_dim; /* >= 1 */
	float scale;     /* scores are scale q.k */
	float *out;      /* [queries][head_dim], rows out_stride apart; may be q's memory */
	size_t out_stride;
	void *scratch; /* dvsm_attention_scratch(head_dim) bytes, 64-byte aligned */
};

/**
 * out = softmax(scale q k^T) v in one pass over the keys: a tile of scores at a time, its running
 * maximum and sum carried along, so that memory does not grow with the number of keys. Scores of
 * any finite size are safe. With 0 keys the output is 0.
 */
typedef void dvsm_attention_fn(const struct dvsm_attention *job);

/** Network output to colour: y = 1 / (1 + exp(-y)) with sigmoid, 0.5 + 0.5 y without. */
typedef void dvsm_to_colour_fn(float *y, size_t count, bool sigmoid);

struct dvsm_kernels {
	enum dvsm_cpu cpu; /* the tier these functions are made for */
	const char *name;
	dvsm_gemm_fn *gemm;
	dvsm_layer_norm_fn *layer_norm;
	dvsm_rms_norm_fn *rms_norm;
	dvsm_attention_fn *attention;
	dvsm_to_colour_fn *to_colour;
};

/** The best set among the tiers in `mask` that this machine has; never NULL. */
const struct dvsm_kernels *dvsm_kernels_choose(uint32_t mask);

/** Bytes of scratch for one attention call: q and out transposed, a tile of scores, three rows. */
static inline size_t dvsm_attention_scratch(size_t head_dim)
{
	return (2 * head_dim + DVSM_ATTENTION_KEYS + 3) * DVSM_ATTENTION_QUERIES * sizeof(float);
}

/* The sets, each in the file of its name; those of other architectures are not built. */
extern const struct dvsm_kernels dvsm_kernels_scalar;
extern const struct dvsm_kernels dvsm_kernels_sse2;
extern const struct dvsm_kernels dvsm_kernels_avx2;
extern const struct dvsm_kernels dvsm_kernels_avx512;
extern const struct dvsm_kernels dvsm_kernels_neon;

#endif
