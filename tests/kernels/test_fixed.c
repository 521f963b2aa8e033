/*
 * Every fixed-point kernel of every tier against the scalar specification, bit for bit: random
 * shapes around the tile sizes, extreme values, memory that ends where the contract says
 * (support/guarded.h). The seed is printed; DIO_TEST_SEED repeats a run.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "amx_tiers.h"
#include "kernels/fixed_math.h"
#include "support/guarded.h"
#include "support/random.h"

#define COUNT(array) (sizeof(array) / sizeof((array)[0]))

static struct support_random rng;
static struct dvsm_fixed_kernels tiers[16];
static size_t tier_count;

static const size_t edges[] = {0,  1,  2,  3,  4,  5,  7,  8,  9,  12, 15, 16,
			       17, 31, 32, 33, 47, 48, 49, 63, 64, 65, 96, 97};

static size_t edge(size_t low)
{
	size_t value;

	do {
		value = edges[support_random_below(&rng, COUNT(edges))];
	} while (value < low);
	return value;
}

static int between(int low, int high)
{
	return low + (int)support_random_below(&rng, (size_t)(high - low + 1));
}

/* ---- memory of one check ---- */

static struct support_guarded blocks[24];
static size_t block_count;

/* `bytes` bytes of noise that end at a forbidden page. */
static void *take(size_t bytes)
{
	struct support_guarded *block = &blocks[block_count++];
	size_t words = (bytes + 3) / 4;

	assert_true(block_count <= COUNT(blocks));
	*block = support_guarded_make(words);
	assert_non_null(block->data);

	unsigned char *start = (unsigned char *)block->data + (words * 4 - bytes);

	for (size_t i = 0; i < bytes; i++)
		start[i] = (unsigned char)support_random_next(&rng);
	return start;
}

/* Two outputs of equal content: what lies between rows must stay, so all of it is compared. */
struct outputs {
	void *want, *got;
	size_t bytes;
};

static struct outputs take_outputs(size_t bytes)
{
	struct outputs made = {take(bytes), take(bytes), bytes};

	if (bytes)
		memcpy(made.got, made.want, bytes);
	return made;
}

static void compare(const struct outputs *outputs, const char *tier, const char *what)
{
	const unsigned char *want = outputs->want, *got = outputs->got;

	for (size_t i = 0; i < outputs->bytes; i++) {
		if (got[i] != want[i])
			fail_msg("%s, %s: byte %zu of %zu is %d, the specification says %d", tier,
				 what, i, outputs->bytes, got[i], want[i]);
	}
}

static void release(void)
{
	while (block_count > 0) {
		assert_true(support_guarded_intact(&blocks[--block_count]));
		support_guarded_free(&blocks[block_count]);
	}
}

/* ---- numbers ---- */

enum kind { EVEN, STEEP, EXTREME, ZERO };

static enum kind draw_kind(void)
{
	int at = between(0, 9);

	return at < 5 ? EVEN : at < 7 ? STEEP : at < 9 ? EXTREME : ZERO;
}

/* Up to `bits` bits and a sign: any size alike, mostly small ones, the largest alone, or none. */
static int32_t draw(int bits, enum kind kind)
{
	int64_t limit = ((int64_t)1 << bits) - 1;
	int64_t value = (int64_t)(support_random_next(&rng) % (uint64_t)(2 * limit + 1)) - limit;

	switch (kind) {
	case EVEN:
		return (int32_t)value;
	case STEEP:
		return (int32_t)(value / ((int64_t)1 << between(0, bits)));
	case EXTREME:
		return (int32_t)(value < 0 ? -limit : limit);
	case ZERO:
		break;
	}
	return 0;
}

static int8_t *take_s8(size_t count, enum kind kind)
{
	int8_t *made = take(count);

	for (size_t i = 0; i < count; i++)
		made[i] = (int8_t)draw(7, kind);
	return made;
}

/* Rows that differ in size as tokens do, here and there with the number that has no opposite. */
static int16_t *take_s16(size_t rows, size_t stride, size_t width)
{
	size_t count = rows ? (rows - 1) * stride + width : 0;
	int16_t *made = take(count * sizeof(*made));

	for (size_t i = 0; i < rows; i++) {
		enum kind kind = draw_kind();
		int bits = between(1, 15);

		for (size_t d = 0; d < width; d++)
			made[i * stride + d] = (int16_t)draw(bits, kind);
		if (width && between(0, 9) == 0)
			made[i * stride + support_random_below(&rng, width)] = INT16_MIN;
	}
	return made;
}

static struct dvsm_fixed_scale draw_scale(int low, int high)
{
	return (struct dvsm_fixed_scale){(int16_t)between(1 << 14, (1 << 15) - 1),
					 (int16_t)between(low, high)};
}

static int16_t *take_gain(size_t count)
{
	int16_t *made = take(count * sizeof(*made));
	enum kind kind = draw_kind();

	for (size_t i = 0; i < count; i++)
		made[i] = (int16_t)draw(15, kind);
	return made;
}

/* The gain of a norm that belongs to the matrix behind it. */
static void fill_ones(int16_t *gain, size_t count)
{
	for (size_t d = 0; d < count; d++)
		gain[d] = 1 << 14;
}

/* ---- the checks, one of a random shape each ---- */

/* A job by the specification and by the tier: the numbers that go to its field `to`, and the scales
 * that go to `scale_to`, are the same. */
#define EXPECT_SAME(tier, kernel, job, to, numbers, scale_to, scales, what)                        \
	do {                                                                                       \
		(job).to = (numbers).want;                                                         \
		(job).scale_to = (scales).want;                                                    \
		dvsm_fixed_kernels_scalar.kernel(&(job));                                          \
		(job).to = (numbers).got;                                                          \
		(job).scale_to = (scales).got;                                                     \
		(tier)->kernel(&(job));                                                            \
		compare(&(scales), (tier)->name, "scales of " what);                               \
		compare(&(numbers), (tier)->name, what);                                           \
	} while (0)

static void fill_weights(struct dvsm_fixed_gemm *job, size_t inner, int spread)
{
	enum kind kind = draw_kind();
	int8_t *w = take_s8(job->cols * inner, kind);
	int8_t *panels = take(dvsm_fixed_pad(job->cols, DVSM_FIXED_PANEL) * job->depth);
	int32_t *sums = take(job->cols * sizeof(*sums));
	int16_t *mantissas = take(job->cols * sizeof(*mantissas));
	int16_t *shifts = take(job->cols * sizeof(*shifts));
	int centre = between(15, 45);

	dvsm_fixed_pack_panels(w, job->cols, inner, panels);
	for (size_t j = 0; j < job->cols; j++) {
		sums[j] = 0;
		for (size_t d = 0; d < inner; d++)
			sums[j] += w[j * inner + d];
		mantissas[j] = (int16_t)(between(0, 20) ? between(1 << 14, INT16_MAX) : 0);
		shifts[j] = (int16_t)(centre + between(-spread, spread));
	}
	job->panels = panels;
	job->w_sum = sums;
	job->w_mantissa = mantissas;
	job->w_shift = shifts;
}

static void fill_tokens(struct dvsm_fixed_gemm *job, size_t inner, int spread)
{
	int8_t *a = take(job->rows ? (job->rows - 1) * job->a_stride + job->depth : 0);
	struct dvsm_fixed_scale *scales = take(job->rows * sizeof(*scales));

	for (size_t i = 0; i < job->rows; i++) {
		enum kind kind = draw_kind();

		for (size_t d = 0; d < job->depth; d++)
			a[i * job->a_stride + d] = (int8_t)(d < inner ? draw(7, kind) : 0);
		/* The low plane of a fine input reaches -128. */
		if (inner && between(0, 1))
			a[i * job->a_stride + support_random_below(&rng, inner)] = INT8_MIN;
		scales[i] = between(0, 20) ? draw_scale(-spread, spread)
					   : (struct dvsm_fixed_scale){0, 0};
	}
	job->a = a;
	job->a_scale = scales;
}

static void check_gemm(const struct dvsm_fixed_kernels *tier)
{
	static const char *const names[] = {"gemm add", "gemm store", "gemm gelu"};
	/* Seldom rows of A that are longer than what a tier keeps close. */
	size_t inner = edge(0) + 64 * (size_t)(between(0, 5) ? between(0, 3) : between(4, 24));
	enum dvsm_fixed_epilogue epilogue = (enum dvsm_fixed_epilogue)between(0, 2);
	size_t size = epilogue == DVSM_FIXED_ADD ? sizeof(int32_t) : sizeof(int16_t);
	int spread = between(0, 12);
	struct dvsm_fixed_gemm job = {
		.rows = edge(0),
		.cols = edge(0),
		.depth = dvsm_fixed_pad(inner, DVSM_FIXED_DEPTH),
		.epilogue = epilogue,
		.fraction = between(-32, 12),
	};

	job.a_stride = job.depth + DVSM_FIXED_DEPTH * (size_t)between(0, 1);
	job.c_stride = job.cols + (size_t)between(0, 3);
	fill_weights(&job, inner, spread);
	fill_tokens(&job, inner, spread);

	struct outputs c =
		take_outputs(job.rows ? ((job.rows - 1) * job.c_stride + job.cols) * size : 0);

	job.c = c.want;
	dvsm_fixed_kernels_scalar.gemm(&job);
	job.c = c.got;
	tier->gemm(&job);
	compare(&c, tier->name, names[epilogue]);
}

static void check_norm(const struct dvsm_fixed_kernels *tier)
{
	size_t rows = edge(0), dim = edge(1) + (between(0, 3) ? 0 : 64 * (size_t)between(0, 12));
	size_t stride = dvsm_fixed_pad(dim, DVSM_FIXED_DEPTH) + (between(0, 3) ? 0 : 64);
	int32_t *x = take(rows * dim * sizeof(*x));
	int16_t *gain = take_gain(dim);
	/* Seldom numbers of the last bits: a tier may leave all its rows at once to another. */
	const int most = between(0, 3) ? 29 : 30;
	struct dvsm_fixed_norm job = {
		.x = x,
		.rows = rows,
		.dim = dim,
		.gain = {gain, draw_scale(-30, 10),
			 (int64_t)(support_random_next(&rng) >> between(4, 63))},
		.fine = between(0, 1),
		.out_stride = stride,
	};
	struct outputs high = take_outputs(rows * stride), low = take_outputs(rows * stride);
	struct outputs scale = take_outputs(rows * sizeof(struct dvsm_fixed_scale));

	if (between(0, 1))
		fill_ones(gain, dim);
	for (size_t i = 0; i < rows; i++) {
		enum kind kind = draw_kind();
		int bits = between(1, most), level = between(0, 1) ? draw(bits, EVEN) : 0;

		for (size_t d = 0; d < dim; d++)
			x[i * dim + d] =
				level ? draw(bits, kind) / 2 + level / 2 : draw(bits, kind);
	}
	job.high = high.want;
	job.low = low.want;
	job.a_scale = scale.want;
	dvsm_fixed_kernels_scalar.norm(&job);
	job.high = high.got;
	job.low = low.got;
	job.a_scale = scale.got;
	tier->norm(&job);
	compare(&scale, tier->name, "norm's scales");
	compare(&high, tier->name, job.fine ? "fine norm, high" : "norm");
	compare(&low, tier->name, "norm, low");
}

static void check_quantise(const struct dvsm_fixed_kernels *tier)
{
	size_t rows = edge(0), dim = edge(0) + 64 * (size_t)between(0, 3);
	size_t x_stride = dim + (size_t)between(0, 3);
	struct dvsm_fixed_quantise job = {
		.x = take_s16(rows, x_stride, dim),
		.x_stride = x_stride,
		.rows = rows,
		.dim = dim,
		.fraction = between(-20, 20),
		.a_stride = dvsm_fixed_pad(dim, DVSM_FIXED_DEPTH) + (between(0, 3) ? 0 : 64),
	};
	struct outputs a = take_outputs(rows * job.a_stride);
	struct outputs scale = take_outputs(rows * sizeof(struct dvsm_fixed_scale));

	EXPECT_SAME(tier, quantise, job, a, a, a_scale, scale, "quantise");
}

static void check_split(const struct dvsm_fixed_kernels *tier)
{
	size_t rows = edge(0), dim = edge(0) + 64 * (size_t)between(0, 3);
	size_t x_stride = dim + (size_t)between(0, 3);
	struct dvsm_fixed_split job = {
		.x = take_s16(rows, x_stride, dim),
		.x_stride = x_stride,
		.rows = rows,
		.dim = dim,
		.fraction = between(-20, 20),
		.plane = dvsm_fixed_pad(dim, DVSM_FIXED_DEPTH) + (between(0, 3) ? 0 : 64),
	};
	struct outputs planes = take_outputs(2 * rows * job.plane);
	struct outputs scale = take_outputs(rows * sizeof(struct dvsm_fixed_scale));

	EXPECT_SAME(tier, split, job, planes, planes, a_scale, scale, "split");
}

static void check_queries(const struct dvsm_fixed_kernels *tier)
{
	size_t rows = edge(0), heads = (size_t)between(1, 4), dim = edge(1);
	size_t stride = heads * dim + (size_t)between(0, 3);
	struct dvsm_fixed_gain gains[4];
	struct dvsm_fixed_queries job = {
		.u = take_s16(rows, stride, heads * dim),
		.u_stride = stride,
		.rows = rows,
		.heads = heads,
		.dim = dim,
		.head_width = dvsm_fixed_pad(dim, DVSM_FIXED_HEAD),
		.gains = gains,
	};
	struct outputs q = take_outputs(rows * heads * job.head_width);
	struct outputs scale = take_outputs(rows * heads * sizeof(struct dvsm_fixed_scale));

	for (size_t h = 0; h < heads; h++)
		gains[h] = (struct dvsm_fixed_gain){
			take_gain(dim), draw_scale(-30, 10),
			(int64_t)(support_random_next(&rng) >> between(4, 63))};
	EXPECT_SAME(tier, queries, job, q, q, q_scale, scale, "queries");
}

/* Rows of one number each, of every size: all shifts and inverses there are. */
static void check_every_size(const struct dvsm_fixed_kernels *tier)
{
	enum { ROWS = 32769 };
	int16_t *x = take(ROWS * sizeof(*x)), gain = (int16_t)between(1, INT16_MAX);
	const struct dvsm_fixed_gain gains = {&gain, draw_scale(-30, 10), between(0, 9)};
	struct dvsm_fixed_quantise quantise = {
		.x = x, .x_stride = 1, .rows = ROWS, .dim = 1, .a_stride = DVSM_FIXED_DEPTH};
	struct dvsm_fixed_queries queries = {.u = x,
					     .u_stride = 1,
					     .rows = ROWS,
					     .heads = 1,
					     .dim = 1,
					     .head_width = DVSM_FIXED_HEAD,
					     .gains = &gains};
	struct outputs a = take_outputs(ROWS * DVSM_FIXED_DEPTH);
	struct outputs q = take_outputs(ROWS * DVSM_FIXED_HEAD);
	struct outputs a_scale = take_outputs(ROWS * sizeof(struct dvsm_fixed_scale));
	struct outputs q_scale = take_outputs(ROWS * sizeof(struct dvsm_fixed_scale));

	for (int i = 0; i < ROWS; i++)
		x[i] = (int16_t)(i == ROWS - 1 || between(0, 1) ? -i : i);
	EXPECT_SAME(tier, quantise, quantise, a, a, a_scale, a_scale, "quantise by size");
	EXPECT_SAME(tier, queries, queries, q, q, q_scale, q_scale, "queries by size");
}

/* Scales of rows of ones by epsilon alone: roots of numbers of any bits, and of powers of two. */
static void check_every_root(const struct dvsm_fixed_kernels *tier)
{
	const int16_t u = 1, gain = 1;
	const int bits = between(1, 60);
	const uint64_t power = (uint64_t)1 << (bits - 1);
	struct dvsm_fixed_gain gains = {&gain, draw_scale(-30, 10), 0};
	struct dvsm_fixed_queries job = {.u = &u,
					 .u_stride = 1,
					 .rows = 1,
					 .heads = 1,
					 .dim = 1,
					 .head_width = DVSM_FIXED_HEAD,
					 .gains = &gains};
	struct outputs q = take_outputs(DVSM_FIXED_HEAD);
	struct outputs scale = take_outputs(sizeof(struct dvsm_fixed_scale));

	gains.epsilon = (int64_t)(power - 1);
	if (between(0, 4))
		gains.epsilon = (int64_t)(power + support_random_next(&rng) % power - 1);
	EXPECT_SAME(tier, queries, job, q, q, q_scale, scale, "queries by root");
}

static void check_keys(const struct dvsm_fixed_kernels *tier)
{
	size_t rows = edge(0), dim = edge(1);
	size_t u_stride = dim + (size_t)between(0, 9), n_stride = dim + (size_t)between(0, 9);
	struct dvsm_fixed_keys job = {
		.u = take_s16(rows, u_stride, dim),
		.u_stride = u_stride,
		.rows = rows,
		.dim = dim,
		.epsilon = (int64_t)(support_random_next(&rng) >> between(20, 63)),
		.root = dvsm_fixed_rsqrt(dvsm_fixed_bits(dim)),
		.fraction = between(8, 14),
		.n_stride = n_stride,
	};
	struct outputs n = take_outputs(rows ? ((rows - 1) * n_stride + dim) * sizeof(int16_t) : 0);

	job.n = n.want;
	dvsm_fixed_kernels_scalar.keys(&job);
	job.n = n.got;
	tier->keys(&job);
	compare(&n, tier->name, "keys");
}

static void check_range(const struct dvsm_fixed_kernels *tier)
{
	size_t rows = edge(0), channels = edge(0), stride = channels + (size_t)between(0, 9);
	int16_t *x = take_s16(rows, stride, channels);
	struct outputs ranges = take_outputs(channels * sizeof(struct dvsm_fixed_range));

	for (size_t d = 0; d < channels; d++) {
		struct dvsm_fixed_range start = {between(-9, 9), INT16_MAX, INT16_MIN};

		memcpy((struct dvsm_fixed_range *)ranges.want + d, &start, sizeof(start));
		memcpy((struct dvsm_fixed_range *)ranges.got + d, &start, sizeof(start));
	}
	dvsm_fixed_kernels_scalar.range(x, stride, rows, channels, ranges.want);
	tier->range(x, stride, rows, channels, ranges.got);
	for (size_t d = 0; d < channels; d++) {
		const struct dvsm_fixed_range *want = ranges.want, *got = ranges.got;

		assert_int_equal(got[d].sum, want[d].sum);
		assert_int_equal(got[d].low, want[d].low);
		assert_int_equal(got[d].high, want[d].high);
	}
}

static void check_pack(const struct dvsm_fixed_kernels *tier)
{
	size_t rows = edge(0), dim = edge(1), stride = dim + (size_t)between(0, 9);
	struct dvsm_fixed_channel *channels = take(dim * sizeof(*channels));
	struct dvsm_fixed_pack job = {
		.x = take_s16(rows, stride, dim),
		.x_stride = stride,
		.rows = rows,
		.dim = dim,
		.head_width = dvsm_fixed_pad(dim, DVSM_FIXED_HEAD),
		.channels = channels,
		.first = edge(0),
	};
	size_t padded = dvsm_fixed_pad(job.first + rows, DVSM_FIXED_KEY_PAD);
	struct outputs keys = take_outputs(padded * job.head_width);
	struct outputs values = take_outputs(padded * job.head_width);

	for (size_t d = 0; d < dim; d++) {
		struct dvsm_fixed_fit fit =
			dvsm_fixed_fit_make((uint32_t)abs(draw(15, draw_kind())));

		channels[d] = (struct dvsm_fixed_channel){(int16_t)draw(15, STEEP),
							  (int16_t)fit.shift, fit.inverse};
	}
	job.packed = keys.want;
	dvsm_fixed_kernels_scalar.pack_keys(&job);
	job.packed = keys.got;
	tier->pack_keys(&job);
	compare(&keys, tier->name, "pack_keys");
	job.packed = values.want;
	dvsm_fixed_kernels_scalar.pack_values(&job);
	job.packed = values.got;
	tier->pack_values(&job);
	compare(&values, tier->name, "pack_values");
}

/* Packed keys or values: zeros behind the last key, and behind the last channel. */
static int8_t *take_packed(const struct dvsm_fixed_attention *job, bool keys)
{
	size_t padded = dvsm_fixed_pad(job->keys, DVSM_FIXED_KEY_PAD), unit = keys ? 16 : 4;
	int8_t *made = take(padded * job->head_width);
	enum kind kind = draw_kind();

	memset(made, 0, padded * job->head_width);
	for (size_t key = 0; key < job->keys; key++) {
		int8_t *to = made + key / unit * unit * job->head_width;
		/* Keys that are alike, as neighbours are, and now and then one that stands out. */
		int bits = between(0, 30) ? between(3, 6) : 7;

		for (size_t d = 0; d < job->dim; d++)
			to[keys ? d / 4 * 64 + key % 16 * 4 + d % 4 : d * 4 + key % 4] =
				(int8_t)draw(kind == EXTREME ? 7 : bits, kind);
	}
	return made;
}

static void check_attention(const struct dvsm_fixed_kernels *tier)
{
	size_t dim = edge(1), width = dvsm_fixed_pad(dim, DVSM_FIXED_HEAD);
	struct dvsm_fixed_scale *scales, *v_scales = take(dim * sizeof(*v_scales));
	int16_t *means = take(dim * sizeof(*means));
	struct dvsm_fixed_attention job = {
		.q_stride = width * (size_t)between(1, 3),
		.scale_stride = (size_t)between(1, 3),
		.queries = edge(0) % (DVSM_FIXED_QUERIES + 1),
		.keys = edge(0) + (between(0, 1) ? 0 : 256 * (size_t)between(0, 5)) +
			(between(0, 60) ? 0 : 8192),
		.dim = dim,
		.head_width = width,
		.v_scale = v_scales,
		.v_mean = means,
		.out_stride = dim + (size_t)between(0, 9),
	};
	int8_t *q = take(job.queries ? (job.queries - 1) * job.q_stride + width : 0);
	int low = between(-46, -10), high = low + between(0, 8);

	scales = take(job.queries ? ((job.queries - 1) * job.scale_stride + 1) * sizeof(*scales)
				  : 0);
	for (size_t i = 0; i < job.queries; i++) {
		enum kind kind = draw_kind();

		for (size_t d = 0; d < width; d++)
			q[i * job.q_stride + d] = (int8_t)(d < dim ? draw(7, kind) : 0);
		scales[i * job.scale_stride] =
			kind == ZERO ? (struct dvsm_fixed_scale){0, 0} : draw_scale(low, high);
	}
	for (size_t d = 0; d < dim; d++) {
		v_scales[d] =
			between(0, 20) ? draw_scale(-16, -4) : (struct dvsm_fixed_scale){0, 0};
		means[d] = (int16_t)draw(15, STEEP);
	}
	job.q = q;
	job.q_scale = scales;
	job.k = take_packed(&job, true);
	job.v = take_packed(&job, false);
	job.scratch = take(dvsm_fixed_pad(dvsm_fixed_attention_scratch(width), 64));

	struct outputs out = take_outputs(
		job.queries ? ((job.queries - 1) * job.out_stride + dim) * sizeof(int16_t) : 0);

	job.out = out.want;
	dvsm_fixed_kernels_scalar.attention(&job);
	job.out = out.got;
	tier->attention(&job);
	compare(&out, tier->name, "attention");
}

static void walk(void (*check)(const struct dvsm_fixed_kernels *tier), int rounds)
{
	for (size_t t = 0; t < tier_count; t++) {
		for (int round = 0; round < rounds; round++) {
			check(&tiers[t]);
			release();
		}
	}
}

#define EXACT(kernel, rounds)                                                                      \
	static void kernel##_is_exact_in_every_tier(void **state)                                  \
	{                                                                                          \
		(void)state;                                                                       \
		walk(check_##kernel, rounds);                                                      \
	}

EXACT(gemm, 400)
EXACT(norm, 300)
EXACT(quantise, 300)
EXACT(split, 300)
EXACT(queries, 300)
EXACT(every_size, 2)
EXACT(every_root, 4000)
EXACT(keys, 300)
EXACT(range, 200)
EXACT(pack, 200)
EXACT(attention, 300)

/* From the top down beyond where scores leave 16 bits; a unit of a score is 2^-11 powers at most.
 */
static void weights_follow_powers_of_two_however_far_a_score_is(void **state)
{
	(void)state;
	for (int round = 0; round < 20000; round++) {
		const struct dvsm_fixed_scale scale = draw_scale(-40, -26);
		const struct dvsm_fixed_slope slope = dvsm_fixed_slope_make(scale);
		const double unit = ldexp(scale.mantissa, scale.exponent);
		const uint32_t way = (uint32_t)fmin(between(0, 4000) * 0.01 / unit, 0x1p30);
		const uint32_t near = way >> slope.down < 65535 ? way >> slope.down : 65535;
		const double p = dvsm_fixed_exp2(near * slope.factor >> 16, slope.up);
		/* Two roundings to 2^-11 powers; the polynomial's; half a unit of p. */
		const double want = 23150 * exp2(-(way * unit)), most = 0.6 + want * 8.8e-4;

		if (fabs(p - want) > most)
			fail_msg("%u units of %d 2^%d: weight %g, not %g", way, scale.mantissa,
				 scale.exponent, p, want);
	}
}

static void the_mask_chooses_what_each_tier_has_and_scalar_fills_the_rest(void **state)
{
	struct dvsm_fixed_kernels none = dvsm_fixed_kernels_choose(0);

	(void)state;
	assert_int_equal(none.cpu, DVSM_CPU_SCALAR);
	assert_ptr_equal(none.gemm, dvsm_fixed_kernels_scalar.gemm);
	for (size_t t = 0; t < tier_count; t++) {
		assert_true(tiers[t].gemm && tiers[t].norm && tiers[t].quantise && tiers[t].split);
		assert_true(tiers[t].queries && tiers[t].keys && tiers[t].range);
		assert_true(tiers[t].pack_keys && tiers[t].pack_values && tiers[t].attention);
	}
}

/* Each tier alone over the scalar set, so that what it lacks is not tested by another. */
static int find_tiers(void **state)
{
	(void)state;
	rng = support_random_seeded("test_fixed");
	for (uint32_t cpu = DVSM_CPU_SCALAR; cpu <= DVSM_CPU_NEON_BF16; cpu <<= 1) {
		struct dvsm_fixed_kernels tier = dvsm_fixed_kernels_choose(cpu);

		if (tier.cpu == cpu)
			tiers[tier_count++] = tier;
	}
#if defined(__x86_64__)
	if (dvsm_cpu_detect() & DVSM_CPU_VNNI) {
		struct dvsm_fixed_kernels model = dvsm_fixed_kernels_scalar;

		model.cpu = amx_model_fixed_kernels.cpu;
		model.name = "amx, modelled";
		model.gemm = amx_model_fixed_kernels.gemm;
		model.attention = amx_model_fixed_kernels.attention;
		tiers[tier_count++] = model;
	}
#endif
	for (size_t t = 0; t < tier_count; t++)
		printf("tier %s\n", tiers[t].name);
	return 0;
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(the_mask_chooses_what_each_tier_has_and_scalar_fills_the_rest),
		cmocka_unit_test(weights_follow_powers_of_two_however_far_a_score_is),
		cmocka_unit_test(gemm_is_exact_in_every_tier),
		cmocka_unit_test(norm_is_exact_in_every_tier),
		cmocka_unit_test(quantise_is_exact_in_every_tier),
		cmocka_unit_test(split_is_exact_in_every_tier),
		cmocka_unit_test(queries_is_exact_in_every_tier),
		cmocka_unit_test(every_size_is_exact_in_every_tier),
		cmocka_unit_test(every_root_is_exact_in_every_tier),
		cmocka_unit_test(keys_is_exact_in_every_tier),
		cmocka_unit_test(range_is_exact_in_every_tier),
		cmocka_unit_test(pack_is_exact_in_every_tier),
		cmocka_unit_test(attention_is_exact_in_every_tier),
	};

	return cmocka_run_group_tests(tests, find_tiers, NULL);
}
