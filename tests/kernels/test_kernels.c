/*
 * Every kernel of every tier against the scalar specification: random shapes around the tile sizes,
 * extreme values, memory that ends where the contract says (support/guarded.h). The seed is
 * printed; DIO_TEST_SEED repeats a run.
 *
 * Tolerances come from the standard bound of a sum of n products in float32, n 2^-24 sum |a b|
 * (Higham, Accuracy and Stability of Numerical Algorithms, section 3.1), carried through whatever
 * follows the sum.
 */
#include <float.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "float_checks.h"

static const struct dvsm_kernels *tiers[5];
static size_t tier_count;

/* Around the tiles of every tier: 2, 4, 6 and 8 rows, 16 and 48 columns, 16 and 64 lanes, 64 keys.
 */
static const size_t edges[] = {0,  1,  2,  3,  4,  5,  6,  7,  8,  9,  12, 13, 15,
			       16, 17, 31, 32, 33, 47, 48, 49, 63, 64, 65, 96, 97};

static size_t edge(size_t below)
{
	return draw_size(edges, COUNT(edges), below);
}

/* ---- panels ---- */

static void a_matrix_packed_in_runs_is_row_major_in_panels_and_zero_behind(void **state)
{
	(void)state;
	for (int round = 0; round < 300; round++) {
		size_t rows = edge(98), depth = edge(98), count = rows * depth, floats, step;
		struct support_guarded w = fill(count, 1.0f), panels;

		assert_true(dvsm_pack_size(rows, depth, &floats));
		panels = fill(floats, 1.0f);
		dvsm_pack_pad(rows, depth, panels.data);
		for (size_t first = 0; first < count; first += step) {
			step = 1 + support_random_below(&rng, count - first);
			dvsm_pack_run(w.data + first, first, step, depth, panels.data);
		}
		for (size_t at = 0; at < floats; at++) {
			size_t panel = at / (DVSM_PANEL * depth), d = at / DVSM_PANEL % depth;
			size_t row = panel * DVSM_PANEL + at % DVSM_PANEL;

			assert_true(panels.data[at] ==
				    (row < rows ? w.data[row * depth + d] : 0.0f));
		}
		assert_true(support_guarded_intact(&w) && support_guarded_intact(&panels));
		support_guarded_free(&w);
		support_guarded_free(&panels);
	}
}

/* ---- matrix product ---- */

/* What a product and its epilogue may be off by, given sum |a w| and the number before. */
static double gemm_tolerance(const struct gemm_shape *shape, double magnitude, double before,
			     double want)
{
	double sum = (double)(shape->depth + 2) * ROUNDING * magnitude;

	switch (shape->epilogue) {
	case DVSM_EPILOGUE_ADD:
		return sum + 2 * ROUNDING * (fabs(before) + fabs(want)) + FLT_MIN;
	case DVSM_EPILOGUE_GELU:
		/* The slope of GELU is at most 1.13; its own error is 2^-20 of the result. */
		return 1.13 * sum + 0x1p-20 * fabs(want) + FLT_MIN;
	case DVSM_EPILOGUE_STORE:
		break;
	}
	return sum + FLT_MIN;
}

static void check_gemm(const struct dvsm_kernels *kernels, const struct gemm_shape *shape)
{
	size_t panel_floats;
	size_t a_count = shape->rows ? (shape->rows - 1) * shape->a_stride + shape->depth : 0;
	size_t c_count = shape->rows ? (shape->rows - 1) * shape->c_stride + shape->cols : 0;
	struct support_guarded a = fill(a_count, shape->scale);
	struct support_guarded w = fill(shape->cols * shape->depth, shape->scale);
	struct support_guarded c = fill(c_count, 1.0f);
	struct support_guarded panels;

	assert_true(dvsm_pack_size(shape->cols, shape->depth, &panel_floats));
	panels = fill(panel_floats, 1.0f);
	dvsm_pack_panels(w.data, shape->cols, shape->depth, panels.data);

	float *before = malloc((c_count + 1) * sizeof(float));

	assert_non_null(before);
	memcpy(before, c.data, c_count * sizeof(float));
	kernels->gemm(a.data, shape->a_stride, shape->rows, panels.data, shape->depth, shape->cols,
		      c.data, shape->c_stride, shape->epilogue);
	for (size_t at = 0; at < c_count; at++) {
		size_t i = at / shape->c_stride, j = at % shape->c_stride;
		double sum = 0, magnitude = 0, want;

		if (j >= shape->cols) {
			assert_true(c.data[at] == before[at]);
			continue;
		}
		for (size_t d = 0; d < shape->depth; d++) {
			double term = (double)a.data[i * shape->a_stride + d] *
				      w.data[j * shape->depth + d];

			sum += term;
			magnitude += fabs(term);
		}
		want = sum;
		if (shape->epilogue == DVSM_EPILOGUE_ADD)
			want = before[at] + sum;
		else if (shape->epilogue == DVSM_EPILOGUE_GELU)
			want = gelu_of(sum);
		expect_near(kernels->name, "gemm", at, c.data[at], want,
			    gemm_tolerance(shape, magnitude, before[at], want));
	}
	assert_true(support_guarded_intact(&c) && support_guarded_intact(&a));
	free(before);
	support_guarded_free(&a);
	support_guarded_free(&w);
	support_guarded_free(&c);
	support_guarded_free(&panels);
}

static void products_agree_for_every_shape_and_epilogue(void **state)
{
	static const float scales[] = {1e-18f, 1e-3f, 1.0f, 4.0f, 1e9f};

	(void)state;
	for (size_t t = 0; t < tier_count; t++) {
		for (int round = 0; round < 300; round++) {
			struct gemm_shape shape = {
				.rows = edge(34), .cols = edge(98), .depth = edge(98)};

			shape.a_stride = shape.depth + edge(8);
			shape.c_stride = shape.cols + edge(8) + (shape.cols == 0);
			shape.epilogue = (enum dvsm_epilogue)support_random_below(&rng, 3);
			shape.scale = scales[support_random_below(&rng, COUNT(scales))];
			check_gemm(tiers[t], &shape);
		}
	}
}

static void one_row_alone_gives_the_same_bits_as_in_a_tile(void **state)
{
	enum { ROWS = 21, COLS = 64, DEPTH = 96 };
	static float together[ROWS * COLS], alone[COLS];

	(void)state;
	for (size_t t = 0; t < tier_count; t++) {
		struct support_guarded a = fill(ROWS * DEPTH, 1.0f);
		struct support_guarded w = fill(COLS * DEPTH, 1.0f);
		struct support_guarded panels = fill(COLS * DEPTH, 1.0f);

		dvsm_pack_panels(w.data, COLS, DEPTH, panels.data);
		tiers[t]->gemm(a.data, DEPTH, ROWS, panels.data, DEPTH, COLS, together, COLS,
			       DVSM_EPILOGUE_GELU);
		for (size_t i = 0; i < ROWS; i++) {
			tiers[t]->gemm(a.data + i * DEPTH, DEPTH, 1, panels.data, DEPTH, COLS,
				       alone, COLS, DVSM_EPILOGUE_GELU);
			assert_memory_equal(alone, together + i * COLS, sizeof(alone));
		}
		support_guarded_free(&a);
		support_guarded_free(&w);
		support_guarded_free(&panels);
	}
}

static void gelu_is_exact_to_float_over_its_whole_range(void **state)
{
	enum { STEPS = 60000 };
	struct support_guarded one = fill(16, 0.0f), x = fill(1, 0.0f), y = fill(1, 0.0f);

	(void)state;
	one.data[0] = 1.0f;
	for (size_t t = 0; t < tier_count; t++) {
		double worst = 0, worst_tail = 0;

		for (int i = 0; i <= STEPS; i++) {
			x.data[0] = 15.0f * ((float)i * 2 / STEPS - 1);
			tiers[t]->gemm(x.data, 1, 1, one.data, 1, 1, y.data, 1, DVSM_EPILOGUE_GELU);

			double want = gelu_of(x.data[0]);
			double error = want == 0 ? fabs(y.data[0]) : fabs(y.data[0] / want - 1);

			if (x.data[0] > -4)
				worst = fmax(worst, error);
			else if (x.data[0] > -12)
				worst_tail = fmax(worst_tail, error);
			else
				assert_true(fabs(y.data[0] - want) < 1e-30);
		}
		printf("gelu %-7s relative error %.1e above -4, %.1e down to -12\n", tiers[t]->name,
		       worst, worst_tail);
		assert_true(worst <= 1.2e-6);
		assert_true(worst_tail <= 1e-5);
	}
	support_guarded_free(&one);
	support_guarded_free(&x);
	support_guarded_free(&y);
}

/* ---- norms ---- */

/*
 * The mean is off by the roundings of its sum, `shift`: against a spread that is small beside the
 * numbers themselves that is what counts, in each number and, squared, in the variance.
 */
static double layer_norm_tolerance(const float *row, size_t dim, float weight, double want)
{
	double mean = 0, largest = 0, squares = 0;

	for (size_t d = 0; d < dim; d++) {
		mean += row[d] / (double)dim;
		largest = fmax(largest, fabs((double)row[d]));
	}
	for (size_t d = 0; d < dim; d++)
		squares += (row[d] - mean) * (row[d] - mean);

	double inverse = 1 / sqrt(squares / (double)dim + 1e-6);
	double shift = (double)(dim + 4) * ROUNDING * largest * inverse;

	return fabs((double)weight) * shift +
	       fabs(want) * (0.5 * shift * shift + (double)(dim + 8) * ROUNDING) + FLT_MIN;
}

static void layer_norm_agrees_for_every_width(void **state)
{
	static const float offsets[] = {0.0f, 1.0f, -100.0f};

	(void)state;
	for (size_t t = 0; t < tier_count; t++) {
		for (int round = 0; round < 200; round++) {
			size_t rows = edge(9), dim = 1 + edge(98), count = rows * dim;
			float offset = offsets[support_random_below(&rng, COUNT(offsets))];
			struct support_guarded x = fill(count, 1.0f), w = fill(dim, 2.0f);
			struct support_guarded got = fill(count, 1.0f), want = fill(count, 1.0f);

			for (size_t i = 0; i < count; i++)
				x.data[i] += offset;
			dvsm_kernels_scalar.layer_norm(x.data, rows, dim, w.data, 1e-6f, want.data);
			tiers[t]->layer_norm(x.data, rows, dim, w.data, 1e-6f, got.data);
			for (size_t i = 0; i < count; i++)
				expect_near(tiers[t]->name, "layer_norm", i, got.data[i],
					    want.data[i],
					    layer_norm_tolerance(x.data + i / dim * dim, dim,
								 w.data[i % dim], want.data[i]));
			/* In place gives the same bits. */
			tiers[t]->layer_norm(x.data, rows, dim, w.data, 1e-6f, x.data);
			assert_memory_equal(x.data, got.data, count * sizeof(float));
			assert_true(support_guarded_intact(&got) && support_guarded_intact(&x));
			support_guarded_free(&x);
			support_guarded_free(&w);
			support_guarded_free(&got);
			support_guarded_free(&want);
		}
	}
}

static void rms_norm_agrees_for_every_width_and_stride(void **state)
{
	static const float scales[] = {0.0f, 1e-15f, 1.0f, 1e15f};

	(void)state;
	for (size_t t = 0; t < tier_count; t++) {
		for (int round = 0; round < 200; round++) {
			size_t rows = 1 + edge(9), dim = 1 + edge(98), stride = dim + edge(9);
			size_t count = (rows - 1) * stride + dim;
			float scale = scales[support_random_below(&rng, COUNT(scales))];
			struct support_guarded x = fill(count, scale), w = fill(dim, 2.0f);
			struct support_guarded got = fill(rows * dim, 1.0f);
			struct support_guarded want = fill(rows * dim, 1.0f);

			dvsm_kernels_scalar.key_norm(x.data, stride, rows, dim, w.data, 1e-6f,
						     want.data, dim);
			tiers[t]->key_norm(x.data, stride, rows, dim, w.data, 1e-6f, got.data, dim);
			/* A sum of positive squares: relative error below dim 2^-24. */
			for (size_t i = 0; i < rows * dim; i++)
				expect_near(tiers[t]->name, "rms_norm", i, got.data[i],
					    want.data[i],
					    (double)(dim + 8) * ROUNDING * fabs(want.data[i]) +
						    FLT_MIN);
			assert_true(support_guarded_intact(&got) && support_guarded_intact(&x));
			support_guarded_free(&x);
			support_guarded_free(&w);
			support_guarded_free(&got);
			support_guarded_free(&want);
		}
	}
}

/* ---- attention ---- */

struct attention_shape {
	size_t queries, keys, dim, q_stride, out_stride;
	float scale; /* of q and k: logits grow with its square */
};

/*
 * Scores are off by dim 2^-24 sum |q k| scale; twice that is the relative error of a weight, and
 * with it of the result against the largest value. The sums over a tile and over tiles add theirs.
 */
static double attention_tolerance(const struct attention_shape *shape)
{
	double dim = (double)shape->dim, score = sqrt(dim) * shape->scale * shape->scale;

	return 2 * (dim + 4) * ROUNDING * score +
	       (2.0 * DVSM_ATTENTION_KEYS + (double)shape->keys / DVSM_ATTENTION_KEYS + 8) *
		       ROUNDING;
}

static void check_attention(const struct dvsm_kernels *kernels, const struct attention_shape *shape)
{
	size_t q_count = shape->queries ? (shape->queries - 1) * shape->q_stride + shape->dim : 0;
	size_t out_count =
		shape->queries ? (shape->queries - 1) * shape->out_stride + shape->dim : 0;
	struct support_guarded q = fill(q_count, shape->scale);
	struct support_guarded k = fill(shape->keys * shape->dim, shape->scale);
	struct support_guarded v = fill(shape->keys * shape->dim, 1.0f);
	struct support_guarded got = fill(out_count, 1.0f), want = fill(out_count, 1.0f);
	struct support_guarded scratch =
		fill(dvsm_attention_scratch(shape->dim) / sizeof(float), 1.0f);
	struct dvsm_attention job = {
		.q = q.data,
		.q_stride = shape->q_stride,
		.queries = shape->queries,
		.k = k.data,
		.v = v.data,
		.keys = shape->keys,
		.head_dim = shape->dim,
		.scale = 1.0f / sqrtf((float)shape->dim),
		.out = want.data,
		.out_stride = shape->out_stride,
		.scratch = scratch.data,
	};

	memcpy(want.data, got.data, out_count * sizeof(float));
	dvsm_kernels_scalar.attention(&job);
	job.out = got.data;
	kernels->attention(&job);
	for (size_t i = 0; i < out_count; i++) {
		bool between = i % shape->out_stride >= shape->dim;

		expect_near(kernels->name, "attention", i, got.data[i], want.data[i],
			    between ? 0 : attention_tolerance(shape));
	}
	assert_true(support_guarded_intact(&got) && support_guarded_intact(&scratch));
	support_guarded_free(&q);
	support_guarded_free(&k);
	support_guarded_free(&v);
	support_guarded_free(&got);
	support_guarded_free(&want);
	support_guarded_free(&scratch);
}

static void attention_agrees_for_every_shape(void **state)
{
	static const float scales[] = {0.0f, 0.1f, 1.0f, 4.0f};

	(void)state;
	for (size_t t = 0; t < tier_count; t++) {
		for (int round = 0; round < 200; round++) {
			struct attention_shape shape = {
				.queries = edge(65),
				.keys = edge(98) + (round % 4 == 0 ? 128 : 0),
				.dim = 1 + edge(66),
				.scale = scales[support_random_below(&rng, COUNT(scales))],
			};

			shape.q_stride = shape.dim + edge(9);
			shape.out_stride = shape.dim + edge(9);
			check_attention(tiers[t], &shape);
		}
	}
}

static void attention_survives_logits_of_a_thousand(void **state)
{
	(void)state;
	for (size_t t = 0; t < tier_count; t++) {
		struct attention_shape shape = {64, 200, 64, 64, 64, 11.0f};

		/* 11^2 64 / sqrt 64: logits up to +-968, some hundred in practice. */
		check_attention(tiers[t], &shape);
	}
}

static void attention_to_equal_keys_is_the_mean_of_the_values(void **state)
{
	enum { KEYS = 4097, DIM = 32 };
	struct support_guarded q = fill(DIM, 1.0f), k = fill(KEYS * DIM, 1.0f);
	struct support_guarded v = fill(KEYS * DIM, 1.0f), out = fill(DIM, 1.0f);
	struct support_guarded scratch = fill(dvsm_attention_scratch(DIM) / sizeof(float), 1.0f);

	(void)state;
	for (size_t i = DIM; i < KEYS * DIM; i++)
		k.data[i] = k.data[i - DIM];
	for (size_t t = 0; t < tier_count; t++) {
		struct dvsm_attention job = {q.data, DIM,      1,   k.data,       v.data, KEYS, DIM,
					     1,      out.data, DIM, scratch.data, 0,      0};

		tiers[t]->attention(&job);
		for (size_t d = 0; d < DIM; d++) {
			double mean = 0;

			for (size_t i = 0; i < KEYS; i++)
				mean += v.data[i * DIM + d];
			/* Weights are all 1: tile sums, then 65 of them, of numbers below 1. */
			expect_near(tiers[t]->name, "mean of values", d, out.data[d], mean / KEYS,
				    (64 + 65) * ROUNDING);
		}
	}
	support_guarded_free(&q);
	support_guarded_free(&k);
	support_guarded_free(&v);
	support_guarded_free(&out);
	support_guarded_free(&scratch);
}

/* ---- colour ---- */

static void colours_agree_with_both_outputs(void **state)
{
	(void)state;
	for (size_t t = 0; t < tier_count; t++) {
		for (int round = 0; round < 100; round++) {
			size_t count = edge(98);
			bool sigmoid = round % 2;
			struct support_guarded got = fill(count, round % 3 ? 5.0f : 200.0f);
			struct support_guarded want = fill(count, 1.0f);

			memcpy(want.data, got.data, count * sizeof(float));
			dvsm_kernels_scalar.to_colour(want.data, count, sigmoid);
			tiers[t]->to_colour(got.data, count, sigmoid);
			/* exp(-y) carries the rounding of y log2 e: 200 2^-24, bounded by y e^-y.
			 */
			for (size_t i = 0; i < count; i++)
				expect_near(tiers[t]->name, "to_colour", i, got.data[i],
					    want.data[i], 8 * ROUNDING * fabs(want.data[i]) + 3e-7);
			assert_true(support_guarded_intact(&got));
			support_guarded_free(&got);
			support_guarded_free(&want);
		}
	}
}

/* ---- dispatch ---- */

static void the_mask_chooses_the_tier_and_scalar_is_always_there(void **state)
{
	uint32_t present = dvsm_cpu_detect();

	(void)state;
	assert_true(present & DVSM_CPU_SCALAR);
	assert_ptr_equal(dvsm_kernels_choose(DVSM_PRECISION_F32, 0), &dvsm_kernels_scalar);
	assert_ptr_equal(dvsm_kernels_choose(DVSM_PRECISION_F32, DVSM_CPU_SCALAR),
			 &dvsm_kernels_scalar);
	assert_string_equal(dvsm_cpu_name(DVSM_CPU_SCALAR), "scalar");
	for (uint32_t cpu = DVSM_CPU_SCALAR; cpu <= DVSM_CPU_NEON; cpu <<= 1) {
		const struct dvsm_kernels *kernels = dvsm_kernels_choose(DVSM_PRECISION_F32, cpu);

		assert_int_equal(kernels->cpu, present & cpu ? cpu : (uint32_t)DVSM_CPU_SCALAR);
	}
	const struct dvsm_kernels *best = dvsm_kernels_choose(DVSM_PRECISION_F32, DVSM_CPU_ALL);

	assert_string_equal(best->name, dvsm_cpu_name(best->cpu));
	assert_true(present & best->cpu);
}

static void every_tier_comes_with_those_it_builds_on(void **state)
{
	static const struct {
		uint32_t tier, below;
	} builds[] = {
		{DVSM_CPU_SSE4, DVSM_CPU_SSE2},
		{DVSM_CPU_AVX2, DVSM_CPU_SSE4},
		{DVSM_CPU_AVX_VNNI, DVSM_CPU_AVX2},
		{DVSM_CPU_AVX512, DVSM_CPU_AVX2},
		{DVSM_CPU_VNNI, DVSM_CPU_AVX512},
		{DVSM_CPU_AVX512_BF16, DVSM_CPU_AVX512},
		{DVSM_CPU_AMX_INT8, DVSM_CPU_VNNI},
		{DVSM_CPU_AMX_BF16, DVSM_CPU_AVX512_BF16},
		{DVSM_CPU_NEON_DOTPROD, DVSM_CPU_NEON},
		{DVSM_CPU_NEON_I8MM, DVSM_CPU_NEON_DOTPROD},
		{DVSM_CPU_NEON_BF16, DVSM_CPU_NEON_DOTPROD},
	};
	uint32_t present = dvsm_cpu_detect();

	(void)state;
	for (size_t i = 0; i < sizeof(builds) / sizeof(builds[0]); i++) {
		assert_string_not_equal(dvsm_cpu_name(builds[i].tier), "scalar");
		if (present & builds[i].tier)
			assert_true(present & builds[i].below);
	}
}

static int find_tiers(void **state)
{
	(void)state;
	rng = support_random_seeded("test_kernels");
	for (uint32_t cpu = DVSM_CPU_SCALAR; cpu <= DVSM_CPU_NEON; cpu <<= 1) {
		if (dvsm_cpu_detect() & cpu)
			tiers[tier_count++] = dvsm_kernels_choose(DVSM_PRECISION_F32, cpu);
	}
	return 0;
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(the_mask_chooses_the_tier_and_scalar_is_always_there),
		cmocka_unit_test(every_tier_comes_with_those_it_builds_on),
		cmocka_unit_test(a_matrix_packed_in_runs_is_row_major_in_panels_and_zero_behind),
		cmocka_unit_test(products_agree_for_every_shape_and_epilogue),
		cmocka_unit_test(one_row_alone_gives_the_same_bits_as_in_a_tile),
		cmocka_unit_test(gelu_is_exact_to_float_over_its_whole_range),
		cmocka_unit_test(layer_norm_agrees_for_every_width),
		cmocka_unit_test(rms_norm_agrees_for_every_width_and_stride),
		cmocka_unit_test(attention_agrees_for_every_shape),
		cmocka_unit_test(attention_survives_logits_of_a_thousand),
		cmocka_unit_test(attention_to_equal_keys_is_the_mean_of_the_values),
		cmocka_unit_test(colours_agree_with_both_outputs),
	};

	return cmocka_run_group_tests(tests, find_tiers, NULL);
}
