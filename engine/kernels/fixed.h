/*
 * The kernels of the fixed-point path: their contracts, and the numbers they share. Private to the
 * engine. engine/FIXED_POINT.md derives what is stated here.
 *
 * Everything is exact: two sets of functions given the same input write the same bits. The scalar
 * set (fixed_ref.c) is the specification; test_fixed*.c of tests/kernels hold the others to it. All
 * functions are reentrant and touch nothing beyond the ranges stated. How a caller cuts rows,
 * columns or queries into calls changes no bit, nor does the order of keys.
 *
 * Rounding, wherever bits are dropped: R(a, s) = floor(a / 2^s + 1/2), and R(a, 0) = a. In 16-bit
 * lanes R(a b, 15) is pmulhrsw and sqrdmulh, R(a, s) of 64 bits is srshl.
 */
#ifndef DVSM_KERNELS_FIXED_H
#define DVSM_KERNELS_FIXED_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "dvsm/engine.h"

/** Columns of a panel of packed weights, and keys of a group of packed keys. */
#define DVSM_FIXED_PANEL 16u

/** Rows of int8 inputs are filled up with zeros to a multiple of this: an AMX tile's row. */
#define DVSM_FIXED_DEPTH 64u

/** Heads of int8 queries, keys and values are filled up with zeros to a multiple of this. */
#define DVSM_FIXED_HEAD 16u

/** Keys that attention takes in at a time. */
#define DVSM_FIXED_KEYS 128u

/**
 * Words of scores that there is room for between attention's two passes, of 64 queries with 2048
 * keys, or of 8 with 16,384; where there are more they are made twice.
 */
#define DVSM_FIXED_SCORES 133120u

/** Packed keys and values of a layer are filled up with zeros to a multiple of this. */
#define DVSM_FIXED_KEY_PAD 64u

/** Bytes behind a head's packed keys that attention may read, without minding what they are. */
#define DVSM_FIXED_BEHIND_KEYS 1024u

/** Most queries that one attention call takes, and that those tiers' do that make use of more. */
#define DVSM_FIXED_QUERIES      64u
#define DVSM_FIXED_MOST_QUERIES 256u

/** Keys of which there are too many to stay in a second-level cache while queries pass by. */
#define DVSM_FIXED_MANY_KEYS 8192u

/** A positive number, mantissa 2^exponent; mantissa is 2^14 .. 2^15 - 1, or 0 for zero. */
struct dvsm_fixed_scale {
	int16_t mantissa, exponent;
};

static inline size_t dvsm_fixed_pad(size_t count, size_t unit)
{
	return (count + unit - 1) / unit * unit;
}

/**
 * Weights [cols][depth] to the panels that dvsm_fixed_gemm states, for the padded depth:
 * padded cols x padded depth bytes.
 */
void dvsm_fixed_pack_panels(const int8_t *weights, size_t cols, size_t depth, int8_t *panels);

/** What a product does with each sum before it is stored. */
enum dvsm_fixed_epilogue {
	DVSM_FIXED_ADD,   /* int32 c += r, modulo 2^32: the residual stream            */
	DVSM_FIXED_STORE, /* int16 c = r, saturated                                    */
	DVSM_FIXED_GELU,  /* int16 c = gelu(r saturated), both in units of 2^-fraction */
};

/**
 * C[rows][cols] = epilogue(r), r[i][j] = R(2^15 t f, shift), t = sum over d of A[i][d] W[j][d],
 * f = R(a_m[i] w_m[j], 15), shift = w_shift[j] - a_exponent[i] clamped to 1..62.
 *
 * The int64 product cannot overflow: |t| < 2^30, f < 2^15. r is used modulo 2^32 by ADD and
 * saturated to -32768..32767 by the others.
 *
 * depth <= 65536; rows and cols may be 0
 */
struct dvsm_fixed_gemm {
	const int8_t *a; /* [rows][depth], rows a_stride bytes apart; 64-byte aligned */
	size_t a_stride; /* multiple of DVSM_FIXED_DEPTH */
	const struct dvsm_fixed_scale *a_scale; /* [rows] */
	size_t rows, depth;                     /* depth a multiple of DVSM_FIXED_DEPTH */
	/* W, -127..127, as [ceil(cols / 16)][depth / 4][16][4], 64-byte aligned, missing columns 0:
	 * a panel's next 64 bytes are four more numbers of each of its 16 columns. */
	const int8_t *panels;
	const int32_t *w_sum;      /* [cols] sum over d of W[j][d], for tiers that offset A */
	const int16_t *w_mantissa; /* [cols] 0..32767 */
	const int16_t *w_shift;    /* [cols] -16384..16383 */
	size_t cols;
	void *c;         /* int32_t or int16_t [rows][cols] */
	size_t c_stride; /* in numbers */
	enum dvsm_fixed_epilogue epilogue;
	int fraction; /* of GELU's input and output, -32..12 */
};
typedef void dvsm_fixed_gemm_fn(const struct dvsm_fixed_gemm *job);

/** The weight of a norm as a product takes it. */
struct dvsm_fixed_gain {
	const int16_t *gain;           /* [dim], -32767..32767 */
	struct dvsm_fixed_scale scale; /* what the output's scale is multiplied by */
	int64_t epsilon;               /* dim eps in squared units of the input, 0 .. 2^60 */
};

/**
 * LayerNorm of the residual stream to int8: a[i] with a_scale[i] stands for (x - mean) / sqrt(var +
 * eps) gain. Per row, with n = dim:
 *
 *   t  = max(0, bits(max |x|) - (30 - ceil(log2 n))),  x' = R(x, t)
 *   c' = x' - floor((2 sum x' + n) / (2 n)),  u = max(0, bits(max |c'|) - 14),  c = R(c', u)
 *   y  = c gain,  and then dvsm_fixed_narrow() of y; the sum of squares is that of c, epsilon is
 *   R(epsilon, 2 (t + u))
 *
 * bits(0) = 0, bits(1) = 1, bits(2) = 2, bits(4) = 3.
 *
 * With fine set, the row is written as two planes of int8, high and low: 256 high + low = R(y, bits
 * (max |y|) - 14), and a_scale belongs to 256 high + low.
 *
 * x          [rows][dim], |x| < 2^31; dim 1..65536
 * high, low  [rows][out_stride]; columns dim .. out_stride - 1 are set to 0; low only when fine
 */
struct dvsm_fixed_norm {
	const int32_t *x;
	size_t rows, dim;
	struct dvsm_fixed_gain gain;
	bool fine;
	int8_t *high, *low;
	size_t out_stride; /* multiple of DVSM_FIXED_DEPTH */
	struct dvsm_fixed_scale *a_scale;
};
typedef void dvsm_fixed_norm_fn(const struct dvsm_fixed_norm *job);

/**
 * Rows of int16 to int8, each by its largest number: m = max |x|, at most 32767, z = 15 - bits(m),
 * inverse = floor(127 2^15 / (m 2^z)), a = R((x 2^z) inverse, 15), a_scale = 2^(15 - z) / inverse
 * 2^-fraction by dvsm_fixed_inverse_scale(). A row of zeros gets zeros and scale 0.
 *
 * x   [rows][dim], rows x_stride numbers apart
 * a   [rows][a_stride]; columns dim .. a_stride - 1 are set to 0
 */
struct dvsm_fixed_quantise {
	const int16_t *x;
	size_t x_stride, rows, dim;
	int fraction; /* x stands for x 2^-fraction */
	int8_t *a;
	size_t a_stride; /* multiple of DVSM_FIXED_DEPTH */
	struct dvsm_fixed_scale *a_scale;
};
typedef void dvsm_fixed_quantise_fn(const struct dvsm_fixed_quantise *job);

/**
 * Rows of int16 to two planes of int8 side by side, of 12 bits together: with up = 15 - bits(m), m
 * = max |x|, at most 32767,
 *
 *   x 2^up = 2^8 (high + low / 16),  high = min(R(x 2^up, 8), 127),  low = R(x 2^up - 256 high, 4)
 *
 * a_scale is that of high, 2^(8 - up - fraction), of a row of zeros too.
 *
 * x       [rows][dim], rows x_stride numbers apart
 * planes  [rows][2][plane], high before low; columns dim .. plane - 1 are set to 0
 */
struct dvsm_fixed_split {
	const int16_t *x;
	size_t x_stride, rows, dim;
	int fraction; /* x stands for x 2^-fraction */
	int8_t *planes;
	size_t plane; /* multiple of DVSM_FIXED_DEPTH */
	struct dvsm_fixed_scale *a_scale;
};
typedef void dvsm_fixed_split_fn(const struct dvsm_fixed_split *job);

/**
 * QK-norm of queries to int8: per row and head y = u gain (int32), then dvsm_fixed_narrow() of y;
 * the sum of squares is that of u. q_scale is what one unit of a score, q k summed, is worth
 * as a power of two: softmax's base-2 logarithm.
 *
 * u        [rows] of heads * dim numbers, rows u_stride apart
 * gains    [heads]: the query's and the key's weight, the key's channel scale and log2(e) /
 *          sqrt(dim) are in it
 * q        [rows][heads][head_width], numbers beyond dim set to 0
 * q_scale  [rows][heads]
 */
struct dvsm_fixed_queries {
	const int16_t *u;
	size_t u_stride, rows, heads, dim;
	size_t head_width; /* dvsm_fixed_pad(dim, DVSM_FIXED_HEAD) */
	const struct dvsm_fixed_gain *gains;
	int8_t *q;
	struct dvsm_fixed_scale *q_scale;
};
typedef void dvsm_fixed_queries_fn(const struct dvsm_fixed_queries *job);

/**
 * RMS norm of one head's keys in 16 bits: n = R(u m, s) saturated, where m 2^-s = 2^fraction
 * sqrt(dim) / sqrt(sum u^2 + epsilon): m and -s are mantissa and exponent + fraction of
 * dvsm_fixed_multiply(root, dvsm_fixed_rsqrt(...)), s clamped to 0..62.
 *
 * u      [rows][dim], rows u_stride numbers apart; n likewise, and may be u
 * root   sqrt(dim)
 */
struct dvsm_fixed_keys {
	const int16_t *u;
	size_t u_stride, rows, dim;
	int64_t epsilon;
	struct dvsm_fixed_scale root;
	int fraction; /* 14 - ceil(log2(sqrt(dim))): n is below 2^14 */
	int16_t *n;
	size_t n_stride;
};
typedef void dvsm_fixed_keys_fn(const struct dvsm_fixed_keys *job);

/** Sum and range of one channel of keys or values; initially {0, 32767, -32768}. */
struct dvsm_fixed_range {
	int64_t sum;
	int16_t low, high;
};

/**
 * Widen the range of each channel by some rows.
 *
 * x       [rows][channels], rows x_stride numbers apart
 * ranges  [channels], updated
 */
typedef void dvsm_fixed_range_fn(const int16_t *x, size_t x_stride, size_t rows, size_t channels,
				 struct dvsm_fixed_range *ranges);

/** How one channel of keys or values becomes int8: R(((x - mean) saturated 2^shift) inverse, 15).
 */
struct dvsm_fixed_channel {
	int16_t mean, shift, inverse; /* shift 0..15; inverse 0, or 63..254 */
};

/**
 * Pack keys or values of one head into their place among all of the layer.
 *
 * x         [rows][dim], rows x_stride numbers apart
 * channels  [dim]
 * packed    keys:   [padded keys / 16][head_width / 4][16][4]: four numbers of each of 16 keys
 *           values: [padded keys / 4][head_width][4]: one channel of four keys
 *           Bytes of other keys, and of channels beyond dim, stay as they are.
 * first     key that row 0 is; any number
 */
struct dvsm_fixed_pack {
	const int16_t *x;
	size_t x_stride, rows, dim, head_width;
	const struct dvsm_fixed_channel *channels;
	int8_t *packed;
	size_t first;
};
typedef void dvsm_fixed_pack_fn(const struct dvsm_fixed_pack *job);

/**
 * One head's attention for up to the table's attention_queries queries. Per query, with the words
 * s[key] = (sum over d of q k) >> dvsm_fixed_score_shift(q), top = max s over all keys, and
 * factor and fraction of dvsm_fixed_slope_make():
 *
 *   p[key] = dvsm_fixed_exp2((top - s) factor >> 16, fraction), 0..23150
 *   O[d]   = sum of p v, sum = sum of p: exact, whatever the order
 *   out[d] = mean[d] + R(O'[d] inverse v_m[d], shift) saturated, where O', which has 24 bits below
 *   the sum's highest, inverse and shift are those of dvsm_fixed_divide()
 *
 * With 0 keys the output is the mean.
 */
struct dvsm_fixed_attention {
	const int8_t *q; /* [queries][key_width], rows q_stride bytes apart */
	size_t q_stride;
	const struct dvsm_fixed_scale *q_scale; /* scale_stride apart */
	size_t scale_stride;
	size_t queries;  /* 0..the table's attention_queries */
	const int8_t *k; /* packed keys of key_width numbers, 64-byte aligned; padded ones are
			  * readable, and so are DVSM_FIXED_BEHIND_KEYS */
	const int8_t *v; /* packed values, likewise; padded keys are 0 */
	size_t keys;     /* below 2^31 */
	size_t dim, head_width;
	size_t key_width; /* head_width, or where queries have two planes a plane's twice */
	const struct dvsm_fixed_scale *v_scale; /* [dim] of a value, in units of the output */
	const int16_t *v_mean;                  /* [dim] in units of the output */
	int16_t *out;                           /* [queries][dim], rows out_stride numbers apart */
	size_t out_stride;
	void *scratch; /* dvsm_fixed_attention_scratch(head_width) bytes, 64-byte aligned */
};
typedef void dvsm_fixed_attention_fn(const struct dvsm_fixed_attention *job);

/** Keys of the tile that begins at key `first`. */
static inline size_t dvsm_fixed_tile_keys(const struct dvsm_fixed_attention *job, size_t first)
{
	return job->keys - first < DVSM_FIXED_KEYS ? job->keys - first : DVSM_FIXED_KEYS;
}

/**
 * Numbers between the scores of one query and of the next: a vector more than there are, as rows a
 * power of two apart share few lines of a cache.
 */
static inline size_t dvsm_fixed_scores_stride(size_t keys)
{
	return dvsm_fixed_pad(keys, DVSM_FIXED_KEYS) + 2 * DVSM_FIXED_PANEL;
}

/** Whether the scores of `queries` for all keys fit the scratch. */
static inline bool dvsm_fixed_scores_fit(size_t queries, size_t keys)
{
	return dvsm_fixed_scores_stride(keys) <= DVSM_FIXED_SCORES / queries;
}

/** Words, both planes of p for a tile, accumulators of two widths, a few numbers a query. */
static inline size_t dvsm_fixed_attention_scratch(size_t head_width)
{
	return DVSM_FIXED_SCORES * sizeof(int16_t) + DVSM_FIXED_QUERIES * DVSM_FIXED_KEYS * 2 +
	       DVSM_FIXED_MOST_QUERIES * (head_width * 9 + 512);
}

/** One set of kernels. A tier leaves NULL what the tiers below it do as well. */
struct dvsm_fixed_kernels {
	enum dvsm_cpu cpu;
	const char *name;
	dvsm_fixed_gemm_fn *gemm;
	dvsm_fixed_norm_fn *norm;
	dvsm_fixed_quantise_fn *quantise;
	dvsm_fixed_split_fn *split;
	dvsm_fixed_queries_fn *queries;
	dvsm_fixed_keys_fn *keys;
	dvsm_fixed_range_fn *range;
	dvsm_fixed_pack_fn *pack_keys;
	dvsm_fixed_pack_fn *pack_values;
	dvsm_fixed_attention_fn *attention;
	size_t attention_queries; /* most it takes: DVSM_FIXED_QUERIES, or _MOST_QUERIES */
};

/**
 * For each kernel the best that the tiers in `mask` and this machine have; cpu and name are the
 * best tier's that gave one.
 */
struct dvsm_fixed_kernels dvsm_fixed_kernels_choose(uint32_t mask);

extern const struct dvsm_fixed_kernels dvsm_fixed_kernels_scalar;
extern const struct dvsm_fixed_kernels dvsm_fixed_kernels_neon;
extern const struct dvsm_fixed_kernels dvsm_fixed_kernels_dotprod;
extern const struct dvsm_fixed_kernels dvsm_fixed_kernels_i8mm;

#endif
