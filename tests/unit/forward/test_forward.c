/* Reconstruct and render through the public header: memory, refusals, cancelling, invariances. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "model/model.h"
#include "support/allocations.h"
#include "support/random_model.h"

#define VIEWS 3u

/* Views stand on part of a ring: all around, their mean direction would vanish and the first view
 * decide. */
#define RING 12u

/* A small model, three pictures of different sizes, and a target. */
struct fixture {
	struct support_random random;
	struct dvsm_model *model;
	struct dvsm_view views[VIEWS];
	float *pictures[VIEWS];
	struct dvsm_camera target;
	struct dvsm_error error;
};

static const uint32_t widths[VIEWS] = {40, 24, 64}, heights[VIEWS] = {32, 40, 24};

static int set_up(void **state)
{
	/* A dim that is no multiple of a panel, heads of an odd size. */
	static const struct dvsm_model_config config = {
		.dim = 36,
		.heads = 4,
		.layers = 3,
		.patch_px = 8,
		.mlp_ratio = 4,
		.norm_eps = 1e-6,
	};
	struct fixture *f = calloc(1, sizeof(*f));

	assert_non_null(f);
	f->random = support_random_seeded("test_forward");
	f->model = support_random_model(&config, &f->random);
	assert_non_null(f->model);
	for (uint32_t v = 0; v < VIEWS; v++) {
		const struct dvsm_camera camera =
			support_ring_camera(widths[v], heights[v], 2 * v, RING);

		f->pictures[v] = malloc((size_t)widths[v] * heights[v] * 3 * sizeof(float));
		assert_non_null(f->pictures[v]);
		f->views[v] = support_random_view(&f->random, &camera, f->pictures[v]);
	}
	f->target = support_ring_camera(48, 36, 1, RING);
	*state = f;
	return 0;
}

static int tear_down(void **state)
{
	struct fixture *f = *state;

	for (uint32_t v = 0; v < VIEWS; v++)
		free(f->pictures[v]);
	dvsm_model_close(f->model);
	free(f);
	return 0;
}

static struct dvsm_engine *make_engine(struct fixture *f, uint32_t threads)
{
	const struct dvsm_engine_options options = {.threads = threads};
	struct dvsm_engine *engine = NULL;

	assert_int_equal(dvsm_engine_create(f->model, &options, &engine, &f->error), DVSM_OK);
	return engine;
}

static struct dvsm_scene *make_scene(struct fixture *f, struct dvsm_engine *engine)
{
	struct dvsm_scene *scene = NULL;

	if (dvsm_reconstruct(engine, f->views, VIEWS, 0, NULL, NULL, &scene, NULL, &f->error) !=
	    DVSM_OK)
		fail_msg("%s", f->error.text);
	return scene;
}

static float *make_picture(struct fixture *f, struct dvsm_engine *engine,
			   const struct dvsm_scene *scene)
{
	float *picture = malloc((size_t)f->target.width * f->target.height * 3 * sizeof(float));

	assert_non_null(picture);
	if (dvsm_render(engine, scene, &f->target, 0, picture, NULL, &f->error) != DVSM_OK)
		fail_msg("%s", f->error.text);
	return picture;
}

/* ---- memory ---- */

static void render_allocates_nothing_after_reserve(void **state)
{
	struct fixture *f = *state;
	struct dvsm_engine *engine = make_engine(f, 3);
	struct dvsm_scene *scene = make_scene(f, engine);
	struct dvsm_camera large = f->target;
	float *picture;
	size_t before;

	/* Larger than all context views together, so that reconstruction's workspace is too small.
	 */
	large.width = 160;
	large.height = 120;
	picture = malloc((size_t)large.width * large.height * 3 * sizeof(float));
	assert_non_null(picture);

	before = allocations_made();
	assert_int_equal(dvsm_render_reserve(engine, scene, &large, 0, &f->error), DVSM_OK);
	assert_true(allocations_made() > before);

	before = allocations_made();
	for (int i = 0; i < 8; i++) {
		const struct dvsm_camera *camera = i % 2 ? &large : &f->target;
		struct dvsm_stats stats;

		assert_int_equal(dvsm_render(engine, scene, camera, i % 3 ? 0 : 12, picture, &stats,
					     &f->error),
				 DVSM_OK);
	}
	assert_int_equal(allocations_made(), before);
	free(picture);
	dvsm_scene_destroy(scene);
	dvsm_engine_destroy(engine);
}

static void render_without_reserve_grows_the_workspace_and_gives_the_same_bits(void **state)
{
	struct fixture *f = *state;
	struct dvsm_engine *reserved = make_engine(f, 2), *fresh = make_engine(f, 2);
	struct dvsm_scene *scene = make_scene(f, reserved);
	float *a, *b;

	assert_int_equal(dvsm_render_reserve(reserved, scene, &f->target, 0, &f->error), DVSM_OK);
	a = make_picture(f, reserved, scene);
	b = make_picture(f, fresh, scene);
	assert_memory_equal(a, b, (size_t)f->target.width * f->target.height * 3 * sizeof(float));
	free(a);
	free(b);
	dvsm_scene_destroy(scene);
	dvsm_engine_destroy(fresh);
	dvsm_engine_destroy(reserved);
}

static void what_is_planned_is_what_is_used(void **state)
{
	struct fixture *f = *state;
	struct dvsm_engine *engine = make_engine(f, 2);
	struct dvsm_camera cameras[VIEWS];
	struct dvsm_memory planned;
	struct dvsm_stats recon, render;
	struct dvsm_scene *scene;
	float *picture = malloc((size_t)f->target.width * f->target.height * 3 * sizeof(float));

	assert_non_null(picture);
	for (uint32_t v = 0; v < VIEWS; v++)
		cameras[v] = f->views[v].camera;
	assert_int_equal(dvsm_plan(engine, cameras, VIEWS, 4, &f->target, 3, &planned, &f->error),
			 DVSM_OK);
	assert_int_equal(
		dvsm_reconstruct(engine, f->views, VIEWS, 4, NULL, NULL, &scene, &recon, &f->error),
		DVSM_OK);
	assert_int_equal(dvsm_render(engine, scene, &f->target, 3, picture, &render, &f->error),
			 DVSM_OK);
	assert_int_equal(render.memory.weights_bytes, planned.weights_bytes);
	/* The model's panels are all there is: an engine adds nothing to them. */
	assert_int_equal(planned.weights_bytes, dvsm_model_get_weight_bytes(f->model));
	assert_int_equal(recon.memory.cache_bytes, planned.cache_bytes);
	assert_int_equal(render.memory.cache_bytes, planned.cache_bytes);
	assert_int_equal(render.memory.workspace_bytes, planned.workspace_bytes);
	/* L x 2 x tokens x D floats. */
	assert_int_equal(planned.cache_bytes,
			 3 * 2 * dvsm_scene_get_token_count(scene) * 36 * sizeof(float));
	assert_int_equal(recon.keys, dvsm_scene_get_token_count(scene));
	assert_int_equal(render.tokens, 16 * 12);
	free(picture);
	dvsm_scene_destroy(scene);
	dvsm_engine_destroy(engine);
}

static void a_plan_that_overflows_is_refused(void **state)
{
	struct fixture *f = *state;
	struct dvsm_engine *engine = make_engine(f, 1);
	const uint32_t count = 65536;
	struct dvsm_camera *cameras = calloc(count, sizeof(*cameras));
	struct dvsm_memory memory = {1, 2, 3};

	assert_non_null(cameras);
	for (uint32_t i = 0; i < count; i++)
		cameras[i] = support_ring_camera(16384, 16384, i, count);
	/* 2^44 tokens of 36 numbers, 3 layers, keys and values: 2^55 bytes fit; then a wider model.
	 */
	f->model->config.dim = 1u << 20;
	f->model->config.heads = 1;
	assert_int_equal(dvsm_plan(engine, cameras, count, 1, NULL, 0, &memory, &f->error),
			 DVSM_NO_MEM);
	assert_true(strlen(f->error.text) > 0);
	assert_int_equal(memory.cache_bytes, 2);
	f->model->config.dim = 36;
	f->model->config.heads = 4;
	free(cameras);
	dvsm_engine_destroy(engine);
}

/* ---- cancelling ---- */

struct watcher {
	uint32_t calls, stop_at;
	double last;
};

static bool watch(void *context, double done)
{
	struct watcher *watcher = context;

	assert_true(done >= watcher->last && done <= 1);
	watcher->last = done;
	return ++watcher->calls != watcher->stop_at;
}

static void a_cancelled_reconstruction_leaves_nothing_behind(void **state)
{
	struct fixture *f = *state;
	struct dvsm_engine *engine = make_engine(f, 2);

	/* Let the workspace grow before anything is counted. */
	dvsm_scene_destroy(make_scene(f, engine));
	for (uint32_t stop_at = 1; stop_at <= 3; stop_at++) {
		struct watcher watcher = {.stop_at = stop_at};
		struct dvsm_scene *scene = NULL;
		long alive = allocations_alive();

		assert_int_equal(dvsm_reconstruct(engine, f->views, VIEWS, 0, watch, &watcher,
						  &scene, NULL, &f->error),
				 DVSM_CANCELLED);
		assert_null(scene);
		assert_int_equal(watcher.calls, stop_at);
		assert_int_equal(allocations_alive(), alive);
	}
	dvsm_engine_destroy(engine);
}

static void progress_ends_at_one(void **state)
{
	struct fixture *f = *state;
	struct dvsm_engine *engine = make_engine(f, 2);
	struct watcher watcher = {0};
	struct dvsm_scene *scene;

	assert_int_equal(dvsm_reconstruct(engine, f->views, VIEWS, 0, watch, &watcher, &scene, NULL,
					  &f->error),
			 DVSM_OK);
	assert_true(watcher.last == 1);
	dvsm_scene_destroy(scene);
	dvsm_engine_destroy(engine);
}

/* ---- refusals ---- */

static void expect_refusal(struct fixture *f, struct dvsm_engine *engine, uint32_t count,
			   uint32_t patch_px, enum dvsm_status want, const char *word)
{
	struct dvsm_scene *scene = NULL;
	long alive = allocations_alive();

	assert_int_equal(dvsm_reconstruct(engine, f->views, count, patch_px, NULL, NULL, &scene,
					  NULL, &f->error),
			 want);
	if (!strstr(f->error.text, word))
		fail_msg("'%s' does not say '%s'", f->error.text, word);
	assert_null(scene);
	assert_int_equal(allocations_alive(), alive);
}

static void bad_views_are_refused_by_name(void **state)
{
	struct fixture *f = *state;
	struct dvsm_engine *engine = make_engine(f, 1);
	struct dvsm_camera good = f->views[1].camera;

	expect_refusal(f, engine, 0, 0, DVSM_BAD_ARG, "view");
	expect_refusal(f, engine, VIEWS, 257, DVSM_BAD_ARG, "257");
	f->views[1].camera.fx = 0;
	expect_refusal(f, engine, VIEWS, 0, DVSM_BAD_ARG, "view 1");
	f->views[1].camera = good;
	f->views[1].camera.world_from_camera[0] += 0.01;
	expect_refusal(f, engine, VIEWS, 0, DVSM_BAD_ARG, "view 1");
	f->views[1].camera = good;
	f->views[1].camera.width = 0;
	expect_refusal(f, engine, VIEWS, 0, DVSM_BAD_ARG, "view 1");
	f->views[1].camera = good;
	f->pictures[2][17] = NAN;
	expect_refusal(f, engine, VIEWS, 0, DVSM_BAD_ARG, "view 2");
	f->pictures[2][17] = 0.5f;
	f->views[2].rgb = NULL;
	expect_refusal(f, engine, VIEWS, 0, DVSM_BAD_ARG, "view 2");
	f->views[2].rgb = f->pictures[2];
	f->model->config.prior_dim = 384;
	expect_refusal(f, engine, VIEWS, 0, DVSM_UNSUPPORTED, "384");
	f->model->config.prior_dim = 0;
	dvsm_engine_destroy(engine);
}

static void bad_targets_and_foreign_scenes_leave_the_picture_untouched(void **state)
{
	struct fixture *f = *state;
	struct dvsm_engine *engine = make_engine(f, 1);
	struct dvsm_scene *scene = make_scene(f, engine);
	struct dvsm_camera bad = f->target;
	float pixel = 7;

	bad.fy = NAN;
	assert_int_equal(dvsm_render(engine, scene, &bad, 0, &pixel, NULL, &f->error),
			 DVSM_BAD_ARG);
	bad = f->target;
	bad.world_from_camera[3] = INFINITY;
	assert_int_equal(dvsm_render(engine, scene, &bad, 0, &pixel, NULL, &f->error),
			 DVSM_BAD_ARG);
	assert_int_equal(dvsm_render(engine, scene, &f->target, 300, &pixel, NULL, &f->error),
			 DVSM_BAD_ARG);
	assert_int_equal(dvsm_render(engine, scene, &f->target, 0, NULL, NULL, &f->error),
			 DVSM_BAD_ARG);
	assert_int_equal(dvsm_render(engine, NULL, &f->target, 0, &pixel, NULL, &f->error),
			 DVSM_BAD_ARG);
	const char digit = f->model->sha256[5];

	f->model->sha256[5] = digit == 'f' ? '0' : 'f';
	assert_int_equal(dvsm_render(engine, scene, &f->target, 0, &pixel, NULL, &f->error),
			 DVSM_MISMATCH);
	assert_non_null(strstr(f->error.text, f->model->sha256));
	f->model->sha256[5] = digit;
	assert_true(pixel == 7);
	dvsm_scene_destroy(scene);
	dvsm_engine_destroy(engine);
}

/* ---- invariances ---- */

static void expect_close(const float *a, const float *b, size_t count, double tolerance)
{
	for (size_t i = 0; i < count; i++) {
		if (!(fabs((double)a[i] - (double)b[i]) <= tolerance))
			fail_msg("[%zu]: %.9g and %.9g", i, (double)a[i], (double)b[i]);
	}
}

static void views_of_different_sizes_may_come_in_any_order(void **state)
{
	struct fixture *f = *state;
	struct dvsm_engine *engine = make_engine(f, 2);
	size_t numbers = (size_t)f->target.width * f->target.height * 3;
	struct dvsm_scene *scene = make_scene(f, engine);
	float *first = make_picture(f, engine, scene), *second;
	struct dvsm_view swapped = f->views[0];

	/* 5 x 4, 3 x 5 and 8 x 3 tokens. */
	assert_int_equal(dvsm_scene_get_token_count(scene), 20 + 15 + 24);
	dvsm_scene_destroy(scene);
	f->views[0] = f->views[2];
	f->views[2] = swapped;
	scene = make_scene(f, engine);
	second = make_picture(f, engine, scene);
	expect_close(first, second, numbers, 1e-5);
	dvsm_scene_destroy(scene);
	free(first);
	free(second);
	dvsm_engine_destroy(engine);
}

static void moving_turning_and_scaling_the_rig_changes_no_pixel(void **state)
{
	struct fixture *f = *state;
	struct dvsm_engine *engine = make_engine(f, 2);
	size_t numbers = (size_t)f->target.width * f->target.height * 3;
	struct dvsm_scene *scene = make_scene(f, engine);
	float *first = make_picture(f, engine, scene), *second;
	struct dvsm_camera *cameras[VIEWS + 1] = {&f->views[0].camera, &f->views[1].camera,
						  &f->views[2].camera, &f->target};

	dvsm_scene_destroy(scene);
	for (size_t i = 0; i < VIEWS + 1; i++) {
		double *pose = cameras[i]->world_from_camera;

		/* A quarter turn about x, then 37 times as large, then somewhere else. */
		for (size_t j = 0; j < 4; j++) {
			double y = pose[4 + j], z = pose[8 + j];

			pose[4 + j] = -z;
			pose[8 + j] = y;
		}
		for (size_t row = 0; row < 3; row++)
			pose[4 * row + 3] = 37 * pose[4 * row + 3] + 100.0 * (double)(row + 1);
	}
	scene = make_scene(f, engine);
	second = make_picture(f, engine, scene);
	expect_close(first, second, numbers, 1e-5);
	dvsm_scene_destroy(scene);
	free(first);
	free(second);
	dvsm_engine_destroy(engine);
}

static void tiers_and_thread_counts_agree_on_sizes_that_fit_no_tile(void **state)
{
	struct fixture *f = *state;
	size_t numbers = (size_t)f->target.width * f->target.height * 3;
	float *reference = NULL;

	for (uint32_t cpu = DVSM_CPU_SCALAR; cpu <= DVSM_CPU_NEON; cpu <<= 1) {
		float *one = NULL;

		if (!(dvsm_cpu_detect() & cpu))
			continue;
		for (uint32_t threads = 1; threads <= 4; threads++) {
			const struct dvsm_engine_options options = {.threads = threads,
								    .cpu_mask = cpu};
			struct dvsm_engine *engine;
			struct dvsm_scene *scene;
			float *picture;

			assert_int_equal(dvsm_engine_create(f->model, &options, &engine, &f->error),
					 DVSM_OK);
			scene = make_scene(f, engine);
			picture = make_picture(f, engine, scene);
			if (one)
				assert_memory_equal(picture, one, numbers * sizeof(float));
			dvsm_scene_destroy(scene);
			dvsm_engine_destroy(engine);
			if (one)
				free(picture);
			else
				one = picture;
		}
		if (reference) {
			expect_close(one, reference, numbers, 1e-5);
			free(one);
		} else {
			reference = one;
		}
	}
	free(reference);
}

static void a_precision_that_this_build_lacks_is_refused(void **state)
{
	struct fixture *f = *state;
	const struct dvsm_engine_options options = {.precision = (enum dvsm_precision)99};
	struct dvsm_engine *engine = NULL;

	assert_int_equal(dvsm_engine_create(f->model, &options, &engine, &f->error),
			 DVSM_UNSUPPORTED);
	assert_null(engine);
	assert_non_null(strstr(f->error.text, "precision"));
}

int main(void)
{
#define TEST(name) cmocka_unit_test_setup_teardown(name, set_up, tear_down)
	const struct CMUnitTest tests[] = {
		TEST(render_allocates_nothing_after_reserve),
		TEST(render_without_reserve_grows_the_workspace_and_gives_the_same_bits),
		TEST(what_is_planned_is_what_is_used),
		TEST(a_plan_that_overflows_is_refused),
		TEST(a_cancelled_reconstruction_leaves_nothing_behind),
		TEST(progress_ends_at_one),
		TEST(bad_views_are_refused_by_name),
		TEST(bad_targets_and_foreign_scenes_leave_the_picture_untouched),
		TEST(views_of_different_sizes_may_come_in_any_order),
		TEST(moving_turning_and_scaling_the_rig_changes_no_pixel),
		TEST(a_precision_that_this_build_lacks_is_refused),
		TEST(tiers_and_thread_counts_agree_on_sizes_that_fit_no_tile),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
