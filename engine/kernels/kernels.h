/*
 * The kernel tables: what the transformer spends its time in, one set of functions per precision
 * and instruction set. Private to the engine.
 *
 * A table's *numbers* are what its products and attention read: float32 in the f32 tables, bfloat16
 * in the bf16 ones. Sums, the residual stream and everything between products are float32 in both.
 * Wherever a function writes numbers it rounds once, to nearest, ties to even; bfloat16 below
 * 2^-126 may count as 0.
 *
 * A *left side* is numbers [rows][stride] that a product takes in as A: row by row or, in a table
 * that is `tiled`, in tiles (pack.h), of which whole strips lie in memory, those behind the last
 * row and behind `stride` with anything in them. dvsm_left_place() says where a number lies. A
 * pointer into a tiled left side points to its column 0 and to a row that is a multiple of 16, or
 * to such a row and a column that is a multiple of 32 where a function writes from there.
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
#include "kernels/lay.h"
#include "kernels/pack.h"

/** Most queries that one attention call takes, and most that any table takes. */
#define DVSM_ATTENTION_QUERIES      64u
#define DVSM_ATTENTION_MOST_QUERIES 256u

/** Largest bound of scores, in powers of 2, with which attention need not look for the maximum. */
#define DVSM_ATTENTION_BOUND 56.0f

/** Keys that the online softmax takes in at a time. */
#define DVSM_ATTENTION_KEYS 64u

/** What a matrix product does with each number before it is stored. */
enum dvsm_epilogue {
	DVSM_EPILOGUE_STORE, /* c = ab, floats                                     */
	DVSM_EPILOGUE_ADD,   /* c = c + ab, floats: the residual connection        */
	DVSM_EPILOGUE_GELU,  /* c = gelu(ab), left side; gelu(x) = x/2 erfc(-x/sqrt 2) */
};

/**
 * C[rows][cols] = epilogue(A[rows][depth] W[cols][depth]^T).
 *
 * a        left side with a_stride >= depth
 * panels   W in this precision's panels (pack.h), 64-byte aligned
 * c        floats [rows][c_stride], or a left side where the epilogue says numbers; not a
 *
 * Any size may be 0; with depth 0 the product is 0.
 */
typedef void dvsm_gemm_fn(const void *a, size_t a_stride, size_t rows, const void *panels,
			  size_t depth, size_t cols, void *c, size_t c_stride,
			  enum dvsm_epilogue epilogue);

/**
 * Rows of x to zero mean and unit variance, times weight: out = (x - mean) / sqrt(var + eps) w.
 *
 * x        [rows][dim] floats
 * out      floats [rows][dim], may be x; where numbers are written, a left side of stride dim
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

/**
 * Floats to columns out_col .. out_col + dim - 1 of a left side: out[rows][out_stride].
 *
 * x        [rows][dim], rows x_stride apart
 */
typedef void dvsm_left_fn(const float *x, size_t x_stride, size_t rows, size_t dim, void *out,
			  size_t out_stride, size_t out_col);

/** One head's attention for up to the table's attention_queries queries. */
struct dvsm_attention {
	const float *q; /* [queries][head_dim], rows q_stride apart */
	size_t q_stride;
	size_t queries; /* 0..attention_queries */
	const void *k;  /* numbers [keys][head_dim], contiguous; in blocks (lay.h) where */
	const void *v;  /* dvsm_kernels_want_blocks() says so, likewise */
	size_t keys;
	size_t head_dim; /* >= 1 */
	float scale;     /* scores are scale q.k */
	void *out;       /* left side [queries][out_stride], from column out_col on; not q */
	size_t out_stride;
	void *scratch; /* dvsm_attention_scratch(head_dim) bytes, 64-byte aligned */
	size_t out_col;
	float bound; /* none of scale log2(e) |q.k| is larger; 0 where that is not known */
};

/**
 * out = softmax(scale q k^T) v in one pass over the keys: a tile of scores at a time, its running
 * maximum and sum carried along, so that memory does not grow with the number of keys. Scores of
 * any finite size are safe. With 0 keys the output is 0.
 *
 * bf16: scale log2(e) q is rounded to bfloat16, and so is each weight 2^(score - running maximum)
 * before it meets its value; the sum that divides may be of weights before they are rounded. With a
 * bound of up to DVSM_ATTENTION_BOUND a weight may be 2^score.
 */
typedef void dvsm_attention_fn(const struct dvsm_attention *job);

/**
 * Keys and values of whole blocks, row by row, to blocks (lay.h).
 *
 * k, v       numbers [keys][head_dim] each, keys a multiple of 32, head_dim too
 * to_k, to_v of as many numbers; not k, v
 */
typedef void dvsm_lay_fn(const void *k, const void *v, size_t keys, size_t head_dim, void *to_k,
			 void *to_v);

/** Network output to colour: y = 1 / (1 + exp(-y)) with sigmoid, 0.5 + 0.5 y without. */
typedef void dvsm_to_colour_fn(float *y, size_t count, bool sigmoid);

struct dvsm_kernels {
	enum dvsm_cpu cpu; /* the tier these functions are made for */
	const char *name;
	size_t number_bytes; /* 4 or 2 */
	bool tiled;          /* left sides lie in tiles */
	size_t attention_queries;
	size_t product_rows, product_cols; /* what a task takes at most: multiples of 32 */
	dvsm_gemm_fn *gemm;
	dvsm_layer_norm_fn *layer_norm; /* to a left side */
	dvsm_layer_norm_fn *embed_norm; /* to floats */
	dvsm_rms_norm_fn *key_norm;     /* to numbers */
	dvsm_rms_norm_fn *query_norm;   /* to floats */
	dvsm_convert_fn *convert;
	dvsm_left_fn *left;
	dvsm_attention_fn *attention;
	dvsm_lay_fn *lay; /* NULL where attention wants no blocks */
	dvsm_to_colour_fn *to_colour;
};

/* What each tier's templates define, in the order of their contracts above. */
#define DVSM_KERNEL_FUNCTIONS                                                                      \
	.number_bytes = sizeof(number), .attention_queries = DVSM_ATTENTION_QUERIES,               \
	.product_rows = 64, .product_cols = 96, .gemm = gemm, .layer_norm = layer_norm,            \
	.embed_norm = embed_norm, .key_norm = key_norm, .query_norm = query_norm,                  \
	.convert = convert, .left = left, .attention = attention, .to_colour = to_colour

/**
 * The best set of a float precision among the tiers in `mask` that this machine has; never NULL.
 */
const struct dvsm_kernels *dvsm_kernels_choose(enum dvsm_precision precision, uint32_t mask);

/** Place of number [row][d] of a table's left side, and the numbers that one takes up. */
static inline size_t dvsm_left_place(const struct dvsm_kernels *kernels, size_t row, size_t d,
				     size_t stride)
{
	return kernels->tiled ? dvsm_tile_place(row, d, stride) : row * stride + d;
}

static inline size_t dvsm_left_size(const struct dvsm_kernels *kernels, size_t rows, size_t stride)
{
	size_t strips = (rows + DVSM_TILE_ROWS - 1) / DVSM_TILE_ROWS;

	return kernels->tiled ? strips * DVSM_TILE_ROWS * dvsm_bf16_depth(stride) : rows * stride;
}

/** Whether attention wants keys and values in blocks. */
static inline bool dvsm_kernels_want_blocks(const struct dvsm_kernels *kernels, size_t head_dim)
{
	return kernels->lay && head_dim % DVSM_BLOCK_KEYS == 0;
}

/** Keys that AMX mixes between two stores of the sums. */
#define DVSM_ATTENTION_CHUNK 128u

/**
 * Bytes of scratch for one attention call: q and out transposed, a tile of scores, three rows, and
 * a tile of keys and one of values, of which AMX wants whole tiles. Or, for AMX with a bound: a
 * block of keys and one of values, q and out of all queries, their sums, and two times scores and
 * weights.
 */
static inline size_t dvsm_attention_scratch(size_t head_dim)
{
	size_t queries = (2 * head_dim + DVSM_ATTENTION_KEYS + 3) * DVSM_ATTENTION_QUERIES;
	size_t keys = 2 * DVSM_ATTENTION_KEYS * dvsm_bf16_depth(head_dim);
	size_t depth = dvsm_bf16_depth(head_dim);
	size_t bounded = (DVSM_BLOCK_KEYS + DVSM_ATTENTION_MOST_QUERIES / 2) * depth +
			 DVSM_ATTENTION_MOST_QUERIES * (depth + 16) + 64 * 32 +
			 DVSM_ATTENTION_CHUNK * 32;
	size_t floats = queries + keys;

	return (floats > bounded ? floats : bounded) * sizeof(float);
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
