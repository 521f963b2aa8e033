/* What MODEL.md promises of whole pictures, through the public interface alone. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "check.h"
#include "file_fixture.h"
#include "rig_fixture.h"
#include "scene_fixture.h"

#define WIDTH  48
#define HEIGHT 32
#define FLOATS ((size_t)WIDTH * HEIGHT * 3)

/* Three context views and, last, a viewpoint to render. */
struct world {
	struct dvsm_model *model;
	struct dvsm_engine *engine;
	struct dvsm_camera rig[SCENE_FIXTURE_VIEWS + 1];
	float *pictures; /* [views][HEIGHT][WIDTH][3] */
};

static int set_up(void **state)
{
	struct world *world = calloc(1, sizeof(*world));
	const struct dvsm_engine_options options = {.threads = 2};
	struct dvsm_error error = {""};
	assert_non_null(world);
	world->model = scene_fixture_model();
	if (dvsm_engine_create(world->model, &options, &world->engine, &error) != DVSM_OK)
		fail_msg("%s", error.text);
	rig_make_arc(world->rig, SCENE_FIXTURE_VIEWS + 1);
	world->pictures = malloc(SCENE_FIXTURE_VIEWS * FLOATS * sizeof(float));
	assert_non_null(world->pictures);
	uint64_t seed = 4;
	for (size_t i = 0; i < SCENE_FIXTURE_VIEWS * FLOATS; i++)
		world->pictures[i] = (float)(0.5 + 0.5 * fixture_random(&seed));
	*state = world;
	return 0;
}

static int tear_down(void **state)
{
	struct world *world = *state;
	dvsm_engine_destroy(world->engine);
	dvsm_model_close(world->model);
	free(world->pictures);
	free(world);
	return 0;
}

static struct dvsm_scene *reconstruct(const struct world *world, const struct dvsm_camera *rig)
{
	struct dvsm_view views[SCENE_FIXTURE_VIEWS];
	struct dvsm_scene *scene = NULL;
	struct dvsm_error error = {""};
	for (size_t i = 0; i < SCENE_FIXTURE_VIEWS; i++)
		views[i] = (struct dvsm_view){rig[i], world->pictures + i * FLOATS};
	if (dvsm_reconstruct(world->engine, views, SCENE_FIXTURE_VIEWS, 4, NULL, NULL, &scene, NULL,
			     &error) != DVSM_OK)
		fail_msg("%s", error.text);
	return scene;
}

static void render(const struct world *world, const struct dvsm_scene *scene,
		   const struct dvsm_camera *camera, float *out)
{
	struct dvsm_error error = {""};
	if (dvsm_render(world->engine, scene, camera, 4, out, NULL, &error) != DVSM_OK)
		fail_msg("%s", error.text);
}

static void a_saved_scene_renders_the_same_bits(void **state)
{
	const struct world *world = *state;
	static float before[FLOATS], after[FLOATS];
	char folder[256], path[300];
	fixture_make_folder(folder);
	snprintf(path, sizeof(path), "%s/s.scene.safetensors", folder);
	struct dvsm_scene *made = reconstruct(world, world->rig), *read = NULL;
	render(world, made, &world->rig[SCENE_FIXTURE_VIEWS], before);
	assert_int_equal(dvsm_scene_save(made, path, NULL), DVSM_OK);
	assert_int_equal(dvsm_scene_open(path, world->model, &read, NULL), DVSM_OK);
	render(world, read, &world->rig[SCENE_FIXTURE_VIEWS], after);
	assert_memory_equal(before, after, sizeof(before));
	dvsm_scene_destroy(made);
	dvsm_scene_destroy(read);
	fixture_remove_folder(folder);
}

static void moving_turning_or_scaling_the_rig_changes_no_pixel(void **state)
{
	const struct world *world = *state;
	static float still[FLOATS], changed[FLOATS];
	static const struct {
		double angle_rad, scale, move[3];
	} changes[] = {
		{0, 1, {50, -3, 8}},
		{1.9, 1, {0, 0, 0}},
		{0, 250, {0, 0, 0}},
		{-2.6, 0.004, {-1, 2, 3}},
	};
	struct dvsm_scene *scene = reconstruct(world, world->rig);
	render(world, scene, &world->rig[SCENE_FIXTURE_VIEWS], still);
	dvsm_scene_destroy(scene);
	for (size_t i = 0; i < sizeof(changes) / sizeof(changes[0]); i++) {
		struct dvsm_camera rig[SCENE_FIXTURE_VIEWS + 1];
		memcpy(rig, world->rig, sizeof(rig));
		rig_transform(rig, SCENE_FIXTURE_VIEWS + 1, changes[i].angle_rad, changes[i].scale,
			      changes[i].move);
		scene = reconstruct(world, rig);
		render(world, scene, &rig[SCENE_FIXTURE_VIEWS], changed);
		dvsm_scene_destroy(scene);
		/* Rounding of the poses, in double, moves a ray by at most one float. */
		for (size_t k = 0; k < FLOATS; k++)
			assert_true(fabsf(changed[k] - still[k]) <= 2e-5f);
	}
}

static void a_picture_depends_on_where_it_is_seen_from(void **state)
{
	const struct world *world = *state;
	static float one[FLOATS], other[FLOATS];
	struct dvsm_scene *scene = reconstruct(world, world->rig);
	render(world, scene, &world->rig[0], one);
	render(world, scene, &world->rig[SCENE_FIXTURE_VIEWS], other);
	dvsm_scene_destroy(scene);
	float largest = 0;
	for (size_t k = 0; k < FLOATS; k++)
		largest = fmaxf(largest, fabsf(one[k] - other[k]));
	assert_true(largest > 1e-2f);
}

static void another_models_scene_is_not_rendered(void **state)
{
	const struct world *world = *state;
	static float out[FLOATS];
	struct dvsm_error error = {""};
	struct dvsm_scene *scene = reconstruct(world, world->rig);
	scene->model_sha256[5] ^= 1;
	assert_int_equal(dvsm_render(world->engine, scene, &world->rig[0], 4, out, NULL, &error),
			 DVSM_MISMATCH);
	assert_text_has(&error, dvsm_model_get_sha256(world->model));
	dvsm_scene_destroy(scene);
}

static void a_pose_or_a_pixel_that_is_bad_is_refused_by_view(void **state)
{
	const struct world *world = *state;
	struct dvsm_view views[SCENE_FIXTURE_VIEWS];
	struct dvsm_scene *scene = NULL;
	struct dvsm_error error = {""};
	for (size_t i = 0; i < SCENE_FIXTURE_VIEWS; i++)
		views[i] = (struct dvsm_view){world->rig[i], world->pictures + i * FLOATS};
	views[1].camera.world_from_camera[5] += 0.01;
	assert_int_equal(dvsm_reconstruct(world->engine, views, SCENE_FIXTURE_VIEWS, 4, NULL, NULL,
					  &scene, NULL, &error),
			 DVSM_BAD_ARG);
	assert_text_has(&error, "view 1: the rotation is off orthonormal");
	views[1].camera = world->rig[1];
	world->pictures[2 * FLOATS] = NAN;
	assert_int_equal(dvsm_reconstruct(world->engine, views, SCENE_FIXTURE_VIEWS, 4, NULL, NULL,
					  &scene, NULL, &error),
			 DVSM_BAD_ARG);
	assert_text_has(&error, "view 2: pixel (0, 0)");
	assert_int_equal(
		dvsm_reconstruct(world->engine, views, 0, 4, NULL, NULL, &scene, NULL, &error),
		DVSM_BAD_ARG);
	assert_null(scene);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test_setup_teardown(a_saved_scene_renders_the_same_bits, set_up,
						tear_down),
		cmocka_unit_test_setup_teardown(moving_turning_or_scaling_the_rig_changes_no_pixel,
						set_up, tear_down),
		cmocka_unit_test_setup_teardown(a_picture_depends_on_where_it_is_seen_from, set_up,
						tear_down),
		cmocka_unit_test_setup_teardown(another_models_scene_is_not_rendered, set_up,
						tear_down),
		cmocka_unit_test_setup_teardown(a_pose_or_a_pixel_that_is_bad_is_refused_by_view,
						set_up, tear_down),
	};
	return cmocka_run_group_tests(tests, NULL, NULL);
}
