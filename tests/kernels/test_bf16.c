/*
 * The bfloat16 kernels of every tier against their scalar specification, as test_kernels.c does it
 * for float32. What differs is the tolerance: a result that becomes bfloat16 may fall to the other
 * side of a rounding, one part in 2^7.
 */
#include <float.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "bf16_tiers.h"
#include "float_checks.h"

#define BF16_STEP  0x1p-7
#define EXP2_ERROR 1e-4
#define GELU_ERROR 6e-5

static const struct dvsm_kernels *tiers[BF16_TIERS];
static size_t tier_count;

static const size_t edges[] = {0,  1,  2,  3,  4,  5,  6,  7,  8,  9,  15, 16,  17,
			       31, 32, 33, 47, 48, 49, 63, 64, 65, 96, 97, 128, 129};

static size_t edge(size_t below)
{
	return draw_size(edges, COUNT(edges), below);
}

/* Numbers that end where the guard begins. */
struct numbers {
	struct support_guarded memory;
	dvsm_bf16 *at;
	size_t count;
};

static struct numbers make_numbers(size_t count, float scale)
{
	struct support_guarded floats = fill(count, scale);
	struct numbers made = {fill((count + 1) / 2, 1.0f), NULL, count};

	made.at = (dvsm_bf16 *)made.memory.data + count % 2;
	for (size_t i = 0; i < count; i++)
		made.at[i] = dvsm_bf16_round(floats.data[i]);
	support_guarded_free(&floats);
	return made;
}

static void free_numbers(struct numbers *numbers)
{
	assert_true(support_guarded_intact(&numbers->memory));
	support_guarded_free(&numbers->memory);
}

static void free_floats(struct support_guarded *floats)
{
	assert_true(support_guarded_intact(floats));
	support_guarded_free(floats);
}

/* Where number `at` of rows of `stride` lies in a left side of a table. */
static size_t left_at(const struct dvsm_kernels *kernels, size_t at, size_t stride)
{
	return dvsm_left_place(kernels, at / stride, at % stride, stride);
}

static struct numbers make_left(const struct dvsm_kernels *kernels, size_t rows, size_t stride,
				size_t last, float scale)
{
	/* Rows end with their last number in memory, unless tiles go on to a whole strip. */
	size_t count = rows ? (rows - 1) * stride + last : 0;

	return make_numbers(kernels->tiled ? dvsm_left_size(kernels, rows, stride) : count, scale);
}

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

/* ---- attention ---- */

struct attention_shape {
	size_t queries, keys, dim, q_stride, out_stride;
	float scale; /* of q and k: logits grow with its square */
	bool bounded;
};

/*
 * A weight rounds to one of two neighbours here and there, on top of what the exponential is off:
 * twice that, for the values it meets and for the sum it is divided by. A query's number may round
 * the other way too, when it is within 2^-24 of a tie: one of 2^15, so no more than two a score.
 */
static double attention_tolerance(const struct attention_shape *shape)
{
	double dim = (double)shape->dim, square = (double)shape->scale * shape->scale;
	double score = 2 * (dim + 4) * ROUNDING * sqrt(dim) * square;
	double flips = 2 * BF16_STEP * square / sqrt(dim);

	return 2 * (BF16_STEP + EXP2_ERROR + score + flips) + BF16_STEP;
}

static void check_attention(const struct dvsm_kernels *kernels, const struct attention_shape *shape)
{
	size_t q_count = shape->queries ? (shape->queries - 1) * shape->q_stride + shape->dim : 0;
	size_t out_count =
		shape->queries ? (shape->queries - 1) * shape->out_stride + shape->dim : 0;
	struct support_guarded q = fill(q_count, shape->scale);
	struct numbers k = make_numbers(shape->keys * shape->dim, shape->scale);
	struct numbers v = make_numbers(shape->keys * shape->dim, 1.0f);
	struct numbers got =
		make_left(kernels, shape->queries, shape->out_stride, shape->dim, 1.0f);
	struct numbers want = make_numbers(out_count, 1.0f);
	struct support_guarded scratch =
		fill(dvsm_attention_scratch(shape->dim) / sizeof(float), 1.0f);
	struct dvsm_attention job = {
		.q = q.data,
		.q_stride = shape->q_stride,
		.queries = shape->queries,
		.k = k.at,
		.v = v.at,
		.keys = shape->keys,
		.head_dim = shape->dim,
		.scale = 1.0f / sqrtf((float)shape->dim),
		.out = want.at,
		.out_stride = shape->out_stride,
		.scratch = scratch.data,
		.bound = shape->bounded
				 ? sqrtf((float)shape->dim) * 1.45f * shape->scale * shape->scale
				 : 0,
	};

	for (size_t i = 0; i < out_count; i++)
		want.at[i] = got.at[left_at(kernels, i, shape->out_stride)];
	dvsm_kernels_bf16_scalar.attention(&job);
	job.out = got.at;
	kernels->attention(&job);
	for (size_t i = 0; i < out_count; i++) {
		bool between = i % shape->out_stride >= shape->dim;

		expect_near(kernels->name, "attention", i,
			    dvsm_bf16_widen(got.at[left_at(kernels, i, shape->out_stride)]),
			    dvsm_bf16_widen(want.at[i]), between ? 0 : attention_tolerance(shape));
	}
	free_floats(&q);
	free_floats(&scratch);
	free_numbers(&k);
	free_numbers(&v);
	free_numbers(&got);
	free_numbers(&want);
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

static void attention_agrees_where_scores_are_bounded(void **state)
{
	static const size_t dims[] = {32, 64, 96, 128},
			    many[] = {0, 1, 31, 127, 128, 129, 512, 513};
	static const float scales[] = {0.1f, 1.0f, 2.0f};

	(void)state;
	for (size_t t = 0; t < tier_count; t++) {
		for (int round = 0; round < 60; round++) {
			struct attention_shape shape = {
				.queries = edge(65),
				.keys = edge(98) + many[support_random_below(&rng, COUNT(many))],
				.dim = dims[support_random_below(&rng, COUNT(dims))],
				.scale = scales[support_random_below(&rng, COUNT(scales))],
				.bounded = true,
			};

			if (round % 4 == 0)
				shape.queries = tiers[t]->attention_queries - edge(65);
			shape.q_stride = shape.dim + edge(9);
			shape.out_stride = shape.dim + edge(9);
			check_attention(tiers[t], &shape);
		}
	}
}

/* Heads side by side fill one left side. */
static void attention_writes_its_columns_alone(void **state)
{
	enum { QUERIES = 19, KEYS = 33, DIM = 48, STRIDE = 3 * DIM + 5 };
	struct support_guarded q = fill(QUERIES * DIM, 1.0f);
	struct numbers k = make_numbers(KEYS * DIM, 1.0f), v = make_numbers(KEYS * DIM, 1.0f);
	struct support_guarded scratch = fill(dvsm_attention_scratch(DIM) / sizeof(float), 1.0f);

	(void)state;
	for (size_t t = 0; t < tier_count; t++) {
		struct numbers out = make_left(tiers[t], QUERIES, STRIDE, STRIDE, 1.0f);
		struct numbers want = make_left(tiers[t], QUERIES, DIM, DIM, 1.0f);
		struct dvsm_attention job = {q.data,       DIM, QUERIES, k.at,    v.at,
					     KEYS,         DIM, 0.1f,    want.at, DIM,
					     scratch.data, 0,   0};

		memset(out.at, 0, out.count * sizeof(*out.at));
		tiers[t]->attention(&job);
		job.out = out.at;
		job.out_stride = STRIDE;
		job.out_col = DIM;
		tiers[t]->attention(&job);
		for (size_t i = 0; i < QUERIES; i++) {
			for (size_t d = 0; d < STRIDE; d++) {
				dvsm_bf16 got = out.at[dvsm_left_place(tiers[t], i, d, STRIDE)];

				if (d < DIM || d >= 2 * DIM)
					assert_int_equal(got, 0);
				else
					assert_int_equal(got, want.at[dvsm_left_place(
								      tiers[t], i, d - DIM, DIM)]);
			}
		}
		free_numbers(&out);
		free_numbers(&want);
	}
	free_floats(&q);
	free_floats(&scratch);
	free_numbers(&k);
	free_numbers(&v);
}

static void attention_to_equal_keys_is_the_mean_of_the_values(void **state)
{
	enum { KEYS = 4097, DIM = 32 };
	struct support_guarded q = fill(DIM, 1.0f);
	struct numbers k = make_numbers(KEYS * DIM, 1.0f), v = make_numbers(KEYS * DIM, 1.0f);
	struct numbers out = make_numbers(16 * DIM, 1.0f);
	struct support_guarded scratch = fill(dvsm_attention_scratch(DIM) / sizeof(float), 1.0f);

	(void)state;
	for (size_t i = DIM; i < KEYS * DIM; i++)
		k.at[i] = k.at[i - DIM];
	for (size_t t = 0; t < tier_count; t++) {
		struct dvsm_attention job = {q.data, DIM,    1,   k.at,         v.at, KEYS, DIM,
					     1,      out.at, DIM, scratch.data, 0,    0};

		tiers[t]->attention(&job);
		for (size_t d = 0; d < DIM; d++) {
			double mean = 0;

			for (size_t i = 0; i < KEYS; i++)
				mean += dvsm_bf16_widen(v.at[i * DIM + d]);
			mean /= KEYS;
			/* Weights are all the same: sums in float, one rounding at the end. */
			expect_near(tiers[t]->name, "mean of values", d,
				    dvsm_bf16_widen(out.at[dvsm_left_place(tiers[t], 0, d, DIM)]),
				    mean, 0.5 * BF16_STEP * fabs(mean) + 140 * ROUNDING);
		}
	}
	free_floats(&q);
	free_floats(&scratch);
	free_numbers(&k);
	free_numbers(&v);
	free_numbers(&out);
}

static void attention_survives_logits_of_a_thousand(void **state)
{
	enum { KEYS = 200, DIM = 64 };
	struct support_guarded q = fill(DIM, 11.0f);
	struct numbers k = make_numbers(KEYS * DIM, 11.0f), v = make_numbers(KEYS * DIM, 1.0f);
	struct numbers out = make_numbers(16 * DIM, 1.0f);
	struct support_guarded scratch = fill(dvsm_attention_scratch(DIM) / sizeof(float), 1.0f);

	(void)state;
	/* One key is the query itself: its logit of some 330 leaves nothing to the others. */
	for (size_t d = 0; d < DIM; d++)
		k.at[77 * DIM + d] = dvsm_bf16_round(q.data[d]);
	for (size_t t = 0; t < tier_count; t++) {
		struct dvsm_attention job = {q.data, DIM,    1,   k.at,         v.at, KEYS, DIM,
					     0.125,  out.at, DIM, scratch.data, 0,    0};

		tiers[t]->attention(&job);
		for (size_t d = 0; d < DIM; d++)
			expect_near(tiers[t]->name, "value", d,
				    dvsm_bf16_widen(out.at[dvsm_left_place(tiers[t], 0, d, DIM)]),
				    dvsm_bf16_widen(v.at[77 * DIM + d]), 1e-6);
	}
	free_floats(&q);
	free_floats(&scratch);
	free_numbers(&k);
	free_numbers(&v);
	free_numbers(&out);
}

static int find_tiers(void **state)
{
	(void)state;
	rng = support_random_seeded("test_bf16");
	tier_count = bf16_tiers(tiers);
	for (size_t t = 0; t < tier_count; t++)
		printf("tier %s\n", tiers[t]->name);
	return 0;
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
		cmocka_unit_test(attention_agrees_for_every_shape),
		cmocka_unit_test(attention_agrees_where_scores_are_bounded),
		cmocka_unit_test(attention_writes_its_columns_alone),
		cmocka_unit_test(attention_survives_logits_of_a_thousand),
		cmocka_unit_test(attention_to_equal_keys_is_the_mean_of_the_values),
	};

	return cmocka_run_group_tests(tests, find_tiers, NULL);
}
