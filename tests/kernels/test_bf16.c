/*
 * The bfloat16 kernels, all but attention (test_bf16_attention.c): every tier against its scalar
 * specification, as test_kernels.c does it for float32. What differs is the tolerance: a result
 * that becomes bfloat16 may fall to the other side of a rounding, one part in 2^7.
 */
#include <float.h>

#include "bf16_checks.h"

#define GELU_ERROR 6e-5

/* ---- numbers and panels ---- */

static void rounding_is_to_nearest_and_ties_go_to_even(void **state)
{
	(void)state;
	for (int round = 0; round < 100000; round++) {
		float x = (float)ldexp(2.0 * support_random_unit(&rng) - 1,
				       (int)support_random_below(&rng, 200) - 100);
		float rounded = dvsm_bf16_widen(dvsm_bf16_round(x));
		int exponent;

		frexp(x, &exponent);
		/* nearbyint rounds ties to even in the default mode. */
		assert_true(rounded ==
			    (float)ldexp(nearbyint(ldexp(x, 8 - exponent)), exponent - 8));
	}
	assert_int_equal(dvsm_bf16_round(1.0f + 0x1p-8f), 0x3f80);
	assert_int_equal(dvsm_bf16_round(1.0f + 0x3p-8f), 0x3f82);
	assert_int_equal(dvsm_bf16_round(-1.0f - 0x1p-8f), 0xbf80);
}

static void panels_hold_pairs_of_depth_with_zeros_behind(void **state)
{
	(void)state;
	for (int round = 0; round < 200; round++) {
		size_t rows = edge(98), depth = edge(98), floats, count;
		struct support_guarded w = fill(rows * depth, 1.0f), panels;
		struct numbers pairs;

		assert_true(dvsm_pack_size(rows, depth, &floats));
		assert_true(dvsm_bf16_pack_size(rows, depth, &count));
		panels = fill(floats, 1.0f);
		pairs = make_numbers(count, 1.0f);
		dvsm_pack_panels(w.data, rows, depth, panels.data);
		dvsm_bf16_pack(panels.data, rows, depth, pairs.at);
		for (size_t row = 0; row < (rows + 15) / 16 * 16; row++) {
			for (size_t d = 0; d < dvsm_bf16_depth(depth); d++) {
				size_t at = dvsm_bf16_place(row, d, depth);
				bool inside = row < rows && d < depth;

				assert_true(at < count);
				assert_int_equal(pairs.at[at],
						 inside ? dvsm_bf16_round(w.data[row * depth + d])
							: 0);
			}
		}
		free_floats(&w);
		free_floats(&panels);
		free_numbers(&pairs);
	}
}

/* ---- matrix product ---- */

/* What a product and its epilogue may be off by, given sum |a w| and the number before. */
static double gemm_tolerance(const struct gemm_shape *shape, double magnitude, double before,
			     double want)
{
	double sum = (double)(shape->depth + 2) * (ROUNDING * magnitude + FLT_MIN);

	switch (shape->epilogue) {
	case DVSM_EPILOGUE_ADD:
		return sum + 2 * ROUNDING * (fabs(before) + fabs(want)) + FLT_MIN;
	case DVSM_EPILOGUE_GELU:
		/* The slope of GELU is at most 1.13; see gelu_short_vf() for its own error. */
		return 1.13 * sum + (BF16_STEP + 3e-4) * fabs(want) + GELU_ERROR + FLT_MIN;
	case DVSM_EPILOGUE_STORE:
		break;
	}
	return sum;
}

/* Weights as floats' panels, then as pairs. */
static struct numbers make_weights(struct support_guarded *w, size_t cols, size_t depth)
{
	size_t floats, count;
	struct numbers pairs;

	assert_true(dvsm_pack_size(cols, depth, &floats));
	assert_true(dvsm_bf16_pack_size(cols, depth, &count));
	for (size_t i = 0; i < cols * depth; i++)
		w->data[i] = dvsm_bf16_widen(dvsm_bf16_round(w->data[i]));

	struct support_guarded panels = fill(floats, 1.0f);

	dvsm_pack_panels(w->data, cols, depth, panels.data);
	pairs = make_numbers(count, 1.0f);
	dvsm_bf16_pack(panels.data, cols, depth, pairs.at);
	support_guarded_free(&panels);
	return pairs;
}

static void check_gemm(const struct dvsm_kernels *kernels, const struct gemm_shape *shape)
{
	const bool narrow = shape->epilogue == DVSM_EPILOGUE_GELU;
	size_t c_count = shape->rows ? (shape->rows - 1) * shape->c_stride + shape->cols : 0;
	struct numbers a =
		make_left(kernels, shape->rows, shape->a_stride, shape->depth, shape->scale);
	struct support_guarded w = fill(shape->cols * shape->depth, shape->scale);
	struct numbers pairs = make_weights(&w, shape->cols, shape->depth);
	struct support_guarded c = fill(narrow ? 0 : c_count, 1.0f);
	struct support_guarded before = fill(c_count, 1.0f);
	struct numbers c_numbers =
		make_left(kernels, narrow ? shape->rows : 0, shape->c_stride, shape->cols, 1.0f);

	for (size_t i = 0; i < c_count; i++) {
		if (narrow)
			before.data[i] =
				dvsm_bf16_widen(c_numbers.at[left_at(kernels, i, shape->c_stride)]);
		else
			before.data[i] = c.data[i];
	}
	kernels->gemm(a.at, shape->a_stride, shape->rows, pairs.at, shape->depth, shape->cols,
		      narrow ? (void *)c_numbers.at : (void *)c.data, shape->c_stride,
		      shape->epilogue);
	for (size_t at = 0; at < c_count; at++) {
		size_t i = at / shape->c_stride, j = at % shape->c_stride;
		double sum = 0, magnitude = 0, want;
		double got = narrow ? dvsm_bf16_widen(
					      c_numbers.at[left_at(kernels, at, shape->c_stride)])
				    : c.data[at];

		if (j >= shape->cols) {
			assert_true(got == before.data[at]);
			continue;
		}
		for (size_t d = 0; d < shape->depth; d++) {
			size_t place = dvsm_left_place(kernels, i, d, shape->a_stride);
			double term =
				(double)dvsm_bf16_widen(a.at[place]) * w.data[j * shape->depth + d];

			sum += term;
			magnitude += fabs(term);
		}
		want = sum;
		if (shape->epilogue == DVSM_EPILOGUE_ADD)
			want = before.data[at] + sum;
		else if (narrow)
			want = gelu_of(sum);
		expect_near(kernels->name, "gemm", at, got, want,
			    gemm_tolerance(shape, magnitude, before.data[at], want));
	}
	free_numbers(&a);
	free_numbers(&pairs);
	free_numbers(&c_numbers);
	free_floats(&w);
	free_floats(&c);
	free_floats(&before);
}

static void products_agree_for_every_shape_and_epilogue(void **state)
{
	static const float scales[] = {1e-16f, 1e-3f, 1.0f, 3.0f, 1e9f};

	(void)state;
	for (size_t t = 0; t < tier_count; t++) {
		for (int round = 0; round < 300; round++) {
			struct gemm_shape shape = {
				.rows = edge(66), .cols = edge(98), .depth = edge(130)};

			shape.a_stride = shape.depth + edge(8);
			shape.c_stride = shape.cols + edge(8) + (shape.cols == 0);
			shape.epilogue = (enum dvsm_epilogue)support_random_below(&rng, 3);
			shape.scale = scales[support_random_below(&rng, COUNT(scales))];
			check_gemm(tiers[t], &shape);
		}
	}
}

static void products_agree_for_depths_that_no_cache_holds(void **state)
{
	static const size_t depths[] = {383, 384, 385, 768, 1152, 1185, 1536},
			    sizes[] = {31, 64, 97};

	(void)state;
	for (size_t t = 0; t < tier_count; t++) {
		for (int round = 0; round < 12; round++) {
			struct gemm_shape shape = {
				.rows = sizes[support_random_below(&rng, COUNT(sizes))],
				.cols = sizes[support_random_below(&rng, COUNT(sizes))],
				.depth = depths[support_random_below(&rng, COUNT(depths))],
				.epilogue = (enum dvsm_epilogue)(round % 3),
				.scale = 1.0f,
			};

			shape.a_stride = shape.depth;
			shape.c_stride = shape.cols;
			check_gemm(tiers[t], &shape);
		}
	}
}

static void one_row_alone_gives_the_same_bits_as_in_a_tile(void **state)
{
	enum { ROWS = 37, COLS = 64, DEPTH = 97, STRIPS = 3 };
	static dvsm_bf16 together[STRIPS * 16 * COLS], alone[16 * COLS];

	(void)state;
	for (size_t t = 0; t < tier_count; t++) {
		struct numbers a = make_left(tiers[t], ROWS, DEPTH, DEPTH, 1.0f);
		struct numbers one = make_left(tiers[t], 1, DEPTH, DEPTH, 1.0f);
		struct support_guarded w = fill(COLS * DEPTH, 1.0f);
		struct numbers pairs = make_weights(&w, COLS, DEPTH);

		tiers[t]->gemm(a.at, DEPTH, ROWS, pairs.at, DEPTH, COLS, together, COLS,
			       DVSM_EPILOGUE_GELU);
		for (size_t i = 0; i < ROWS; i++) {
			for (size_t d = 0; d < DEPTH; d++)
				one.at[dvsm_left_place(tiers[t], 0, d, DEPTH)] =
					a.at[dvsm_left_place(tiers[t], i, d, DEPTH)];
			tiers[t]->gemm(one.at, DEPTH, 1, pairs.at, DEPTH, COLS, alone, COLS,
				       DVSM_EPILOGUE_GELU);
			for (size_t j = 0; j < COLS; j++)
				assert_int_equal(alone[dvsm_left_place(tiers[t], 0, j, COLS)],
						 together[dvsm_left_place(tiers[t], i, j, COLS)]);
		}
		free_numbers(&one);
		free_numbers(&a);
		free_numbers(&pairs);
		free_floats(&w);
	}
}

/* ---- norms and conversion ---- */

/* One step of bfloat16, and what cancels in x - mean before it. */
static void expect_numbers_near(const char *tier, const char *what, const struct numbers *got,
				const struct numbers *want, double cancelled)
{
	for (size_t i = 0; i < want->count; i++) {
		double x = dvsm_bf16_widen(got->at[i]), y = dvsm_bf16_widen(want->at[i]);

		expect_near(tier, what, i, x, y, BF16_STEP * fabs(y) + cancelled);
	}
}

static void norms_to_numbers_agree_for_every_width_and_stride(void **state)
{
	static const float scales[] = {0.0f, 1e-15f, 1.0f, 1e15f};
	const struct dvsm_kernels *scalar = &dvsm_kernels_bf16_scalar;

	(void)state;
	for (size_t t = 0; t < tier_count; t++) {
		for (int round = 0; round < 200; round++) {
			size_t rows = 1 + edge(9), dim = 1 + edge(98), stride = dim + edge(9);
			float scale = scales[support_random_below(&rng, COUNT(scales))];
			struct support_guarded x = fill((rows - 1) * stride + dim, scale);
			struct support_guarded w = fill(dim, 2.0f);
			struct numbers got = make_numbers(rows * dim, 1.0f);
			struct numbers want = make_numbers(rows * dim, 1.0f);

			scalar->key_norm(x.data, stride, rows, dim, w.data, 1e-6f, want.at, dim);
			tiers[t]->key_norm(x.data, stride, rows, dim, w.data, 1e-6f, got.at, dim);
			expect_numbers_near(tiers[t]->name, "key_norm", &got, &want, FLT_MIN);
			struct numbers left = make_left(tiers[t], 1, dim, dim, 1.0f);

			scalar->layer_norm(x.data, 1, dim, w.data, 1e-6f, want.at);
			tiers[t]->layer_norm(x.data, 1, dim, w.data, 1e-6f, left.at);
			for (size_t d = 0; d < dim; d++)
				got.at[d] = left.at[dvsm_left_place(tiers[t], 0, d, dim)];
			free_numbers(&left);
			expect_numbers_near(tiers[t]->name, "layer_norm", &got, &want,
					    8 * (double)(dim + 8) * ROUNDING * scale /
						    (scale + 1e-3) * 10);
			scalar->convert(x.data, stride, rows, dim, want.at, dim);
			tiers[t]->convert(x.data, stride, rows, dim, got.at, dim);
			/* The same bits, but that numbers below FLT_MIN may be 0. */
			expect_numbers_near(tiers[t]->name, "convert", &got, &want, FLT_MIN);
			free_floats(&x);
			free_floats(&w);
			free_numbers(&got);
			free_numbers(&want);
		}
	}
}

static int set_up(void **state)
{
	(void)state;
	return find_tiers("test_bf16");
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(rounding_is_to_nearest_and_ties_go_to_even),
		cmocka_unit_test(panels_hold_pairs_of_depth_with_zeros_behind),
		cmocka_unit_test(products_agree_for_every_shape_and_epilogue),
		cmocka_unit_test(products_agree_for_depths_that_no_cache_holds),
		cmocka_unit_test(one_row_alone_gives_the_same_bits_as_in_a_tile),
		cmocka_unit_test(norms_to_numbers_agree_for_every_width_and_stride),
	};

	return cmocka_run_group_tests(tests, set_up, NULL);
}
