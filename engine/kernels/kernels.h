/*
 * The kernel tables: what the transformer spends its time in, one set of functions per precision
 * and instruction set. Private to the engine.
 *
 * A table's *numbers* are what its products and attention read: float32 in the f32 tables, bfloat16
 * in the bf16 ones. Sums, the residual stream and everything between products are float32 in both.
 * Wherever a function writes numbers it rounds once, to nearest, ties to even; bfloat16 below
 * 2^-126 may count as 0.
 *
 * The contracts stand here, once. The scalar sets (ref.inc.h) are the specification: they
 * accumulate in double and round once. The others keep float accumulators; tests/kernels states how
 * far they may be from it. Every function is reentrant, reads and writes nothing beyond the ranges
 * stated, needs no alignment unless said, and computes each output number in an order that depends
 * on `depth`, `keys` or `dim` alone - never on how the caller cut the rows into tiles - so that
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
	DVSM_EPILOGUE_STORE, /* c = ab, floats                                     */
	DVSM_EPILOGUE_ADD,   /* c = c + ab, floats: the residual connection        */
	DVSM_EPILOGUE_GELU,  /* c = gelu(ab), numbers; gelu(x) = x/2 erfc(-x/sqrt 2) */
};

/**
 * C[rows][cols] = epilogue(A[rows][depth] W[cols][depth]^T).
 *
 * a        numbers, rows a_stride numbers apart
 * panels   W in this precision's panels (pack.h), 64-byte aligned
 * c        floats, or numbers where the epilogue says so; rows c_stride of them apart; not a
 *
 * Any size may be 0; with depth 0 the product is 0.
 */
typedef void dvsm_gemm_fn(const void *a, size_t a_stride, size_t rows, const void *panels,
			  size_t depth, size_t cols, void *c, size_t c_stride,
			  enum dvsm_epilogue epilogue);

/**
 * Rows of x to zero mean and unit variance, times weight: out = (x - mean) / sqrt(var + eps) w.
 *
 * x, out   [rows][dim], x floats; a float out may be x
 */
typedef void dvsm_layer_norm_fn(const float *x, size_t rows, size_t dim, const float *weight,
				float eps, void *out);

/**
 * Rows of x to unit root mean square, times weight: out = x / sqrt(mean(x^2) + eps) w (QK-norm).
 *
 * x, out   rows of dim numbers, x_stride and out_stride apart, x floats; a float out may be x
 */
typedef void dvsm_rms_norm_fn(const float *x, size_t x_stride, size_t rows, size_t dim,
			      const float *weight, float eps, void *out, size_t out_stride);

/** Floats to numbers: out[rows][dim] = x, rows x_stride and out_stride apart. */
typedef void dvsm_convert_fn(const float *x, size_t x_stride, size_t rows, size_t dim, void *out,
			     size_t out_stride);

/** One head's attention for up to DVSM_ATTENTION_QUERIES queries. */
struct dvsm_attention {
	const float *q; /* [queries][head_dim], rows q_stride apart */
	size_t q_stride;
	size_t queries; /* 0..DVSM_ATTENTION_QUERIES */
	const void *k;  /* numbers [keys][head_dim], contiguous */
	const void *v;  /* numbers [keys][head_dim], contiguous */
	size_t keys;
	size_t head_dim; /* >= 1 */
	float scale;     /* scores are scale q.k */
	void *out;       /* numbers [queries][head_dim], rows out_stride apart; not q's memory */
	size_t out_stride;
	void *scratch; /* dvsm_attention_scratch(head_dim) bytes, 64-byte aligned */
};

/**
 * out = softmax(scale q k^T) v in one pass over the keys: a tile of scores at a time, its running
 * maximum and sum carried along, so that memory does not grow with the number of keys. Scores of
 * any finite size are safe. With 0 keys the output is 0.
 *
 * bf16: scale log2(e) q is rounded to bfloat16, and so is each weight 2^(score - running maximum)
 * before it meets its value and the sum that divides.
 */
typedef void dvsm_attention_fn(const struct dvsm_attention *job);

/** Network output to colour: y = 1 / (1 + exp(-y)) with sigmoid, 0.5 + 0.5 y without. */
typedef void dvsm_to_colour_fn(float *y, size_t count, bool sigmoid);

struct dvsm_kernels {
	enum dvsm_cpu cpu; /* the tier these functions are made for */
	const char *name;
	size_t number_bytes; /* 4 or 2 */
	dvsm_gemm_fn *gemm;
	dvsm_layer_norm_fn *layer_norm; /* to numbers */
	dvsm_layer_norm_fn *embed_norm; /* to floats */
	dvsm_rms_norm_fn *key_norm;     /* to numbers */
	dvsm_rms_norm_fn *query_norm;   /* to floats */
	dvsm_convert_fn *convert;
	dvsm_attention_fn *attention;
	dvsm_to_colour_fn *to_colour;
};

/* What each tier's templates define, in the order of their contracts above. */
#define DVSM_KERNEL_FUNCTIONS                                                                      \
	.number_bytes = sizeof(number), .gemm = gemm, .layer_norm = layer_norm,                    \
	.embed_norm = embed_norm, .key_norm = key_norm, .query_norm = query_norm,                  \
	.convert = convert, .attention = attention, .to_colour = to_colour

/**
 * The best set of a float precision among the tiers in `mask` that this machine has; never NULL.
 */
const struct dvsm_kernels *dvsm_kernels_choose(enum dvsm_precision precision, uint32_t mask);

/**
 * Bytes of scratch for one attention call: q and out transposed, a tile of scores, three rows, and
 * a tile of keys and one of values, of which AMX wants whole tiles.
 */
static inline size_t dvsm_attention_scratch(size_t head_dim)
{
	size_t queries = (2 * head_dim + DVSM_ATTENTION_KEYS + 3) * DVSM_ATTENTION_QUERIES;
	size_t keys = 2 * DVSM_ATTENTION_KEYS * dvsm_bf16_depth(head_dim);

	return (queries + keys) * sizeof(float);
}

/* The sets, each in the file of its name; those of other architectures are not built. */
extern const struct dvsm_kernels dvsm_kernels_scalar;
extern const struct dvsm_kernels dvsm_kernels_sse2;
extern const struct dvsm_kernels dvsm_kernels_avx2;
extern const struct dvsm_kernels dvsm_kernels_avx512;
extern const struct dvsm_kernels dvsm_kernels_neon;
extern const struct dvsm_kernels dvsm_kernels_bf16_scalar;
extern const struct dvsm_kernels dvsm_kernels_bf16_sse2;
extern const struct dvsm_kernels dvsm_kernels_bf16_avx2;
extern const struct dvsm_kernels dvsm_kernels_bf16_avx512;
extern const struct dvsm_kernels dvsm_kernels_bf16_avx512bf16;
extern const struct dvsm_kernels dvsm_kernels_bf16_amx;
extern const struct dvsm_kernels dvsm_kernels_bf16_neon;
extern const struct dvsm_kernels dvsm_kernels_bf16_neonbf16;

#endif
