/* Several viewpoints at once: the bits of one at a time, whatever the batch and the threads. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "support/allocations.h"
#include "support/random_model.h"

enum { VIEWS = 3, SIDE = 48, NUMBERS = SIDE * SIDE * 3, TARGETS = 20, RING = 12 };

struct fixture {
	struct dvsm_model *model;
	struct dvsm_view views[VIEWS];
	float pictures[VIEWS][NUMBERS];
	struct dvsm_camera targets[TARGETS];
	size_t bytes[TARGETS]; /* of a target's picture of floats */
	struct dvsm_picture_out out[TARGETS];
	struct dvsm_error error;
};

/* Viewpoints of so many pixels, and every third of others where they are to differ. */
static void look_at(struct fixture *f, uint32_t width, uint32_t height, bool differ)
{
	for (uint32_t i = 0; i < TARGETS; i++) {
		uint32_t more = differ && i % 3 == 1 ? 24 : 0;

		f->targets[i] = support_ring_camera(width + more, height, i, 6 * TARGETS);
		f->bytes[i] = (size_t)(width + more) * height * 3 * sizeof(float);
		free(f->out[i].rgb);
		f->out[i] = (struct dvsm_picture_out){.rgb = malloc(f->bytes[i])};
		assert_non_null(f->out[i].rgb);
	}
}

static int set_up(void **state)
{
	static const struct dvsm_model_config config = {
		.dim = 36,
		.heads = 4,
		.layers = 2,
		.patch_px = 8,
		.mlp_ratio = 4,
		.norm_eps = 1e-6,
	};
	struct fixture *f = calloc(1, sizeof(*f));
	struct support_random random = support_random_seeded("test_batch");

	assert_non_null(f);
	f->model = support_random_model(&config, &random);
	assert_non_null(f->model);
	for (uint32_t v = 0; v < VIEWS; v++) {
		const struct dvsm_camera camera = support_ring_camera(SIDE, SIDE, 2 * v, RING);

		f->views[v] = support_random_view(&random, &camera, f->pictures[v]);
	}
	*state = f;
	return 0;
}

static int tear_down(void **state)
{
	struct fixture *f = *state;

	for (uint32_t i = 0; i < TARGETS; i++)
		free(f->out[i].rgb);
	dvsm_model_close(f->model);
	free(f);
	return 0;
}

static struct dvsm_engine *make_engine(struct fixture *f, enum dvsm_precision precision,
				       uint32_t threads)
{
	const struct dvsm_engine_options options = {.threads = threads, .precision = precision};
	struct dvsm_engine *engine = NULL;

	assert_int_equal(dvsm_engine_create(f->model, &options, &engine, &f->error), DVSM_OK);
	return engine;
}

static struct dvsm_scene *make_scene(struct fixture *f, struct dvsm_engine *engine)
{
	struct dvsm_scene *scene = NULL;

	assert_int_equal(
		dvsm_reconstruct(engine, f->views, VIEWS, 0, NULL, NULL, &scene, NULL, &f->error),
		DVSM_OK);
	return scene;
}

/* All targets, `batch` at a time. */
static void render_all(struct fixture *f, struct dvsm_engine *engine,
		       const struct dvsm_scene *scene, uint32_t batch)
{
	for (uint32_t at = 0; at < TARGETS; at += batch) {
		uint32_t count = TARGETS - at < batch ? TARGETS - at : batch;

		if (dvsm_render_batch(engine, scene, f->targets + at, count, 0, f->out + at, NULL,
				      &f->error) != DVSM_OK)
			fail_msg("%s", f->error.text);
	}
}

struct hashes {
	char hex[TARGETS][65];
};

static struct hashes hash_all(const struct fixture *f)
{
	struct hashes hashes;

	for (uint32_t i = 0; i < TARGETS; i++)
		dvsm_hash_bytes(f->out[i].rgb, f->bytes[i], hashes.hex[i]);
	return hashes;
}

/* Threads and views of a batch, large pictures with the first of them only: emulation is slow. */
static const struct {
	uint32_t threads, batch;
} ways[] = {{2, TARGETS}, {3, 5}, {1, TARGETS}, {2, 1}, {2, 3}, {4, 2}, {5, 3}};

#define ALL_WAYS  (sizeof(ways) / sizeof(ways[0]))
#define SOME_WAYS 2u

static void expect_one_by_one(struct fixture *f, enum dvsm_precision precision, size_t count)
{
	struct dvsm_engine *one = make_engine(f, precision, 1);
	struct dvsm_scene *scene = make_scene(f, one);
	struct hashes want;

	for (uint32_t i = 0; i < TARGETS; i++)
		assert_int_equal(
			dvsm_render(one, scene, &f->targets[i], 0, f->out[i].rgb, NULL, &f->error),
			DVSM_OK);
	want = hash_all(f);
	for (size_t way = 0; way < count; way++) {
		struct dvsm_engine *engine = make_engine(f, precision, ways[way].threads);
		struct hashes got;

		for (uint32_t i = 0; i < TARGETS; i++)
			memset(f->out[i].rgb, 0, f->bytes[i]);
		render_all(f, engine, scene, ways[way].batch);
		got = hash_all(f);
		for (uint32_t i = 0; i < TARGETS; i++)
			assert_string_equal(got.hex[i], want.hex[i]);
		dvsm_engine_destroy(engine);
	}
	dvsm_scene_destroy(scene);
	dvsm_engine_destroy(one);
}

static void expect_one_by_one_everywhere(struct fixture *f, size_t count)
{
	for (int p = DVSM_PRECISION_F32; p <= DVSM_PRECISION_FIXED; p++)
		expect_one_by_one(f, (enum dvsm_precision)p, count);
}

/* 8 x 4 tokens: rows of views that lie side by side are cut as if they were one view's. */
static void batches_of_views_without_gap_change_no_bit(void **state)
{
	look_at(*state, 64, 32, false);
	expect_one_by_one_everywhere(*state, ALL_WAYS);
}

/* 6 x 5 tokens, which fill no tile. */
static void batches_of_odd_views_change_no_bit(void **state)
{
	look_at(*state, 48, 36, false);
	expect_one_by_one_everywhere(*state, ALL_WAYS);
}

static void batches_of_views_of_two_sizes_change_no_bit(void **state)
{
	look_at(*state, 40, 40, true);
	expect_one_by_one_everywhere(*state, ALL_WAYS);
}

/* 16 x 12 tokens: more than are worked at in one go. */
static void batches_of_large_views_change_no_bit(void **state)
{
	look_at(*state, 128, 96, false);
	expect_one_by_one_everywhere(*state, SOME_WAYS);
}

static void a_batch_allocates_nothing_after_reserve(void **state)
{
	struct fixture *f = *state;

	look_at(f, 64, 32, true);
	for (int p = DVSM_PRECISION_F32; p <= DVSM_PRECISION_FIXED; p++) {
		struct dvsm_engine *engine = make_engine(f, (enum dvsm_precision)p, 3);
		struct dvsm_scene *scene = make_scene(f, engine);
		size_t before = allocations_made();

		assert_int_equal(
			dvsm_render_batch_reserve(engine, scene, f->targets, TARGETS, 0, &f->error),
			DVSM_OK);
		assert_true(allocations_made() > before);
		before = allocations_made();
		render_all(f, engine, scene, TARGETS);
		render_all(f, engine, scene, 3);
		assert_int_equal(allocations_made(), before);
		dvsm_scene_destroy(scene);
		dvsm_engine_destroy(engine);
	}
}

static void one_bad_viewpoint_leaves_all_pictures_untouched(void **state)
{
	struct fixture *f = *state;
	struct dvsm_engine *engine;
	struct dvsm_scene *scene;
	struct dvsm_picture_out none[2];

	look_at(f, 40, 40, false);
	engine = make_engine(f, DVSM_PRECISION_F32, 2);
	scene = make_scene(f, engine);
	f->out[0].rgb[0] = 7;
	f->targets[2].fx = NAN;
	assert_int_equal(
		dvsm_render_batch(engine, scene, f->targets, 4, 0, f->out, NULL, &f->error),
		DVSM_BAD_ARG);
	assert_non_null(strstr(f->error.text, "target camera 2"));
	none[0] = f->out[0];
	none[1] = (struct dvsm_picture_out){0};
	assert_int_equal(dvsm_render_batch(engine, scene, f->targets, 2, 0, none, NULL, &f->error),
			 DVSM_BAD_ARG);
	assert_int_equal(
		dvsm_render_batch(engine, scene, f->targets, 0, 0, f->out, NULL, &f->error),
		DVSM_BAD_ARG);
	assert_true(f->out[0].rgb[0] == 7);
	dvsm_scene_destroy(scene);
	dvsm_engine_destroy(engine);
}

/* 256 tokens a thread, and no more than fixed works at in one go. */
static void the_size_of_a_batch_follows_from_tokens_and_threads(void **state)
{
	struct fixture *f = *state;
	struct dvsm_engine *one = make_engine(f, DVSM_PRECISION_BF16, 1);
	struct dvsm_engine *two = make_engine(f, DVSM_PRECISION_BF16, 2);
	struct dvsm_engine *fixed = make_engine(f, DVSM_PRECISION_FIXED, 8);
	struct dvsm_camera camera = support_ring_camera(64, 64, 0, RING);

	assert_int_equal(dvsm_render_batch_size(one, &camera, 8), 4);
	assert_int_equal(dvsm_render_batch_size(two, &camera, 8), 8);
	assert_int_equal(dvsm_render_batch_size(fixed, &camera, 8), 8);
	assert_int_equal(dvsm_render_batch_size(one, &camera, 4), 1);
	assert_int_equal(dvsm_render_batch_size(two, &camera, 4), 2);
	assert_int_equal(dvsm_render_batch_size(two, &camera, 64), 16);
	camera.width = 0;
	assert_int_equal(dvsm_render_batch_size(two, &camera, 8), 1);
	dvsm_engine_destroy(one);
	dvsm_engine_destroy(two);
	dvsm_engine_destroy(fixed);
}

int main(void)
{
#define TEST(name) cmocka_unit_test_setup_teardown(name, set_up, tear_down)
	const struct CMUnitTest tests[] = {
		TEST(batches_of_views_without_gap_change_no_bit),
		TEST(batches_of_odd_views_change_no_bit),
		TEST(batches_of_views_of_two_sizes_change_no_bit),
		TEST(batches_of_large_views_change_no_bit),
		TEST(a_batch_allocates_nothing_after_reserve),
		TEST(one_bad_viewpoint_leaves_all_pictures_untouched),
		TEST(the_size_of_a_batch_follows_from_tokens_and_threads),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
