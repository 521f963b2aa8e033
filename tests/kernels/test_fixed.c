/*
 * The fixed-point kernels, all but those of attention (test_fixed_attention.c): every tier against
 * the scalar specification, bit for bit, in random shapes around the tile sizes and with extreme
 * values.
 */
#include "fixed_checks.h"

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

static int8_t *take_s8(size_t count, enum kind kind)
{
	int8_t *made = take(count);

	for (size_t i = 0; i < count; i++)
		made[i] = (int8_t)draw(7, kind);
	return made;
}

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
	/* Seldom rows of A that are longer than what a tier keeps close, or takes in one piece. */
	const int more = between(0, 11);
	size_t inner = edge(0) + 64 * (size_t)(more > 1   ? between(0, 3)
					       : more > 0 ? between(4, 24)
							  : between(60, 140));
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

EXACT(gemm, 400)
EXACT(norm, 300)
EXACT(quantise, 300)
EXACT(split, 300)
EXACT(queries, 300)
EXACT(every_size, 2)
EXACT(every_root, 4000)
EXACT(keys, 300)
EXACT(range, 200)

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

static int set_up(void **state)
{
	(void)state;
	return find_tiers("test_fixed");
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(the_mask_chooses_what_each_tier_has_and_scalar_fills_the_rest),
		cmocka_unit_test(gemm_is_exact_in_every_tier),
		cmocka_unit_test(norm_is_exact_in_every_tier),
		cmocka_unit_test(quantise_is_exact_in_every_tier),
		cmocka_unit_test(split_is_exact_in_every_tier),
		cmocka_unit_test(queries_is_exact_in_every_tier),
		cmocka_unit_test(every_size_is_exact_in_every_tier),
		cmocka_unit_test(every_root_is_exact_in_every_tier),
		cmocka_unit_test(keys_is_exact_in_every_tier),
		cmocka_unit_test(range_is_exact_in_every_tier),
	};

	return cmocka_run_group_tests(tests, set_up, NULL);
}
