/* Attention in bfloat16: every tier against its scalar specification, and what it must not lose. */
#include <string.h>

#include "bf16_checks.h"

#define EXP2_ERROR 1e-4

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

/* Rows of numbers as a table's attention wants them. */
static struct numbers laid_for(const struct dvsm_kernels *kernels, enum dvsm_block_order order,
			       const struct numbers *rows, size_t dim)
{
	struct numbers made = make_numbers(rows->count, 1.0f);

	if (dvsm_kernels_want_blocks(kernels, dim))
		dvsm_lay_head(order, rows->at, rows->count / dim, dim, made.at);
	else if (rows->count > 0)
		memcpy(made.at, rows->at, rows->count * sizeof(*made.at));
	return made;
}

/* One call with keys and values that lie row by row. */
static void attend(const struct dvsm_kernels *kernels, struct dvsm_attention job,
		   const struct numbers *k, const struct numbers *v)
{
	struct numbers keys = laid_for(kernels, DVSM_BLOCK_OF_KEYS, k, job.head_dim);
	struct numbers values = laid_for(kernels, DVSM_BLOCK_OF_VALUES, v, job.head_dim);

	job.k = keys.at;
	job.v = values.at;
	kernels->attention(&job);
	free_numbers(&keys);
	free_numbers(&values);
}

static void blocks_are_laid_as_their_order_says(void **state)
{
	static const size_t dims[] = {32, 64, 96, 128};

	(void)state;
	for (size_t t = 0; t < tier_count; t++) {
		for (int round = 0; tiers[t]->lay && round < 40; round++) {
			const size_t keys = 32 * (1 + support_random_below(&rng, 4));
			const size_t dim = dims[support_random_below(&rng, COUNT(dims))];
			struct numbers k = make_numbers(keys * dim, 1.0f);
			struct numbers v = make_numbers(keys * dim, 1.0f);
			struct numbers want_k = laid_for(tiers[t], DVSM_BLOCK_OF_KEYS, &k, dim);
			struct numbers want_v = laid_for(tiers[t], DVSM_BLOCK_OF_VALUES, &v, dim);
			struct numbers got_k = make_numbers(keys * dim, 1.0f);
			struct numbers got_v = make_numbers(keys * dim, 1.0f);

			tiers[t]->lay(k.at, v.at, keys, dim, got_k.at, got_v.at);
			assert_memory_equal(got_k.at, want_k.at, k.count * sizeof(*k.at));
			assert_memory_equal(got_v.at, want_v.at, v.count * sizeof(*v.at));
			dvsm_unlay_head(DVSM_BLOCK_OF_KEYS, want_k.at, keys, dim, got_k.at);
			dvsm_unlay_head(DVSM_BLOCK_OF_VALUES, want_v.at, keys, dim, got_v.at);
			assert_memory_equal(got_k.at, k.at, k.count * sizeof(*k.at));
			assert_memory_equal(got_v.at, v.at, v.count * sizeof(*v.at));
			free_numbers(&k);
			free_numbers(&v);
			free_numbers(&want_k);
			free_numbers(&want_v);
			free_numbers(&got_k);
			free_numbers(&got_v);
		}
	}
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
	attend(kernels, job, &k, &v);
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
		attend(tiers[t], job, &k, &v);
		job.out = out.at;
		job.out_stride = STRIDE;
		job.out_col = DIM;
		attend(tiers[t], job, &k, &v);
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

		attend(tiers[t], job, &k, &v);
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

static void attention_keeps_its_precision_where_all_scores_are_at_their_bound(void **state)
{
	enum { KEYS = 161, DIM = 64 };
	struct support_guarded q = fill(DIM, 1.0f);
	struct numbers k = make_numbers(KEYS * DIM, 1.0f), v = make_numbers(KEYS * DIM, 1.0f);
	struct numbers out = make_numbers(16 * DIM, 1.0f);
	struct support_guarded scratch = fill(dvsm_attention_scratch(DIM) / sizeof(float), 1.0f);

	(void)state;
	for (size_t i = 0; i < KEYS * DIM; i++)
		k.at[i] = dvsm_bf16_round(1.0f);
	for (size_t t = 0; t < 2 * tier_count; t++) {
		const struct dvsm_kernels *tier = tiers[t / 2];
		const float bound = DVSM_ATTENTION_BOUND, score = 0.98f * bound / (float)M_LOG2E;
		struct dvsm_attention job = {q.data, DIM,    1,   k.at,         v.at, KEYS, DIM,
					     1,      out.at, DIM, scratch.data, 0,    bound};

		for (size_t d = 0; d < DIM; d++)
			q.data[d] = (t % 2 ? score : -score) / DIM;
		attend(tier, job, &k, &v);
		for (size_t d = 0; d < DIM; d++) {
			double mean = 0;

			for (size_t i = 0; i < KEYS; i++)
				mean += dvsm_bf16_widen(v.at[i * DIM + d]) / KEYS;
			expect_near(tier->name, "mean of values", d,
				    dvsm_bf16_widen(out.at[dvsm_left_place(tier, 0, d, DIM)]), mean,
				    0.5 * BF16_STEP * fabs(mean) + 140 * ROUNDING);
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

		attend(tiers[t], job, &k, &v);
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

static int set_up(void **state)
{
	(void)state;
	return find_tiers("test_bf16_attention");
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(blocks_are_laid_as_their_order_says),
		cmocka_unit_test(attention_agrees_for_every_shape),
		cmocka_unit_test(attention_agrees_where_scores_are_bounded),
		cmocka_unit_test(attention_writes_its_columns_alone),
		cmocka_unit_test(attention_keeps_its_precision_where_all_scores_are_at_their_bound),
		cmocka_unit_test(attention_survives_logits_of_a_thousand),
		cmocka_unit_test(attention_to_equal_keys_is_the_mean_of_the_values),
	};

	return cmocka_run_group_tests(tests, set_up, NULL);
}
