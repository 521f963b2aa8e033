/* Glass, mirrors, shadows and photographs, in scenes small enough to know the answer. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "build.h"
#include "dio/sim_batch.h"
#include "render.h"
#include "support.h"

enum { SIDE = 33, MIDDLE = 3 * (SIDE * (SIDE / 2) + SIDE / 2) };

static struct dio_sim_scene *scene;
static struct builder builder;
static struct rng rng;

/* A grey void; the camera looks along +y from y = -2. */
static int start(void **state)
{
	(void)state;
	rng = rng_seeded(1);
	scene = calloc(1, sizeof(*scene));
	if (!scene)
		return -1;
	scene->surround = SURROUND_PLAIN;
	scene->sky[0] = v3(0.5f, 0.5f, 0.5f);
	scene->extent = 1;
	scene->ambient_up = scene->ambient_down = v3(0.2f, 0.2f, 0.2f);
	return sim_thing_begin(&builder, scene, &rng, v3(0, 0, 0), sim_turned(0)) ? 0 : -1;
}

static int stop(void **state)
{
	(void)state;
	free(scene);
	return 0;
}

static struct v3 middle_of_picture(void)
{
	static float rgb[SIDE * SIDE * 3];
	struct dio_sim_camera c = {.width = SIDE, .height = SIDE, .fx = 60, .fy = 60};
	const double pose[16] = {1, 0, 0, 0, 0, 0, 1, -2, 0, -1, 0, 0, 0, 0, 0, 1};

	c.cx = c.cy = SIDE / 2;
	memcpy(c.world_from_camera, pose, sizeof(pose));
	assert_true(sim_render_linear(scene, &c, 1, rgb));
	return v3(rgb[MIDDLE], rgb[MIDDLE + 1], rgb[MIDDLE + 2]);
}

static void assert_colour(struct v3 got, struct v3 want, float within)
{
	if (absf(got.x - want.x) > within || absf(got.y - want.y) > within ||
	    absf(got.z - want.z) > within)
		fail_msg("colour %.4f %.4f %.4f where %.4f %.4f %.4f was due", (double)got.x,
			 (double)got.y, (double)got.z, (double)want.x, (double)want.y,
			 (double)want.z);
}

static struct material clear_glass(struct v3 tint)
{
	struct material m = sim_material_plain(v3(0, 0, 0));

	m.clear = 0.8f;
	m.tint = tint;
	return m;
}

static void glass_shows_what_is_behind_it_in_its_own_tint(void **state)
{
	struct material glass = clear_glass(v3(1, 0.5f, 0.25f));

	(void)state;
	sim_add(&builder, SHAPE_BOX, v3(0, 0, 0), v3(0.3f, 0.05f, 0.3f), 0, &glass);
	sim_thing_end(&builder, true);
	assert_colour(middle_of_picture(), v3(0.4f, 0.2f, 0.1f), 1e-3f);
}

static void panes_darken_one_another(void **state)
{
	struct material glass = clear_glass(v3(1, 1, 1));
	struct material wall = sim_material_plain(v3(0, 0, 0));

	(void)state;
	wall.emission = 0.9f;
	wall.colour[0] = v3(1, 1, 1);
	sim_add(&builder, SHAPE_BOX, v3(0, 0, 0), v3(0.3f, 0.05f, 0.3f), 0, &glass);
	sim_add(&builder, SHAPE_ELLIPSOID, v3(0, 0.5f, 0), v3(0.3f, 0.05f, 0.3f), 0, &glass);
	assert_colour(middle_of_picture(), v3(0.5f, 0.5f, 0.5f), 1e-6f); /* things not yet there */
	sim_add(&builder, SHAPE_BOX, v3(0, 1, 0), v3(1, 0.05f, 1), 0, &wall);
	sim_thing_end(&builder, false);
	/* 0.9 of its own and 0.2 that it throws back, through 0.8 twice. */
	assert_colour(middle_of_picture(), v3(0.704f, 0.704f, 0.704f), 0.01f);
}

/* A floor seen from above the pane's shadow. */
static float floor_light(bool pane, float clear)
{
	struct material glass = clear_glass(v3(1, 1, 1));
	struct material wall = sim_material_plain(v3(0.5f, 0.5f, 0.5f));

	glass.clear = clear;
	scene->light_count = 1;
	scene->light[0].directional = true;
	scene->light[0].at = v3_unit(v3(0, -1, 1));
	scene->light[0].colour = v3(1, 1, 1);
	sim_add(&builder, SHAPE_BOX, v3(0, 0.1f, 0), v3(1, 0.1f, 1), 0, &wall);
	if (pane)
		sim_add(&builder, SHAPE_BOX, v3(0, -0.6f, 0.6f), v3(0.2f, 0.2f, 0.1f), 0, &glass);
	sim_thing_end(&builder, false);
	return middle_of_picture().x;
}

static void nothing_stands_before_the_lamp(void **state)
{
	(void)state;
	assert_true(fabsf(floor_light(false, 0) - 0.5f * (0.2f + 0.7071f)) < 0.01f);
}

static void a_solid_pane_throws_a_full_shadow(void **state)
{
	(void)state;
	assert_true(fabsf(floor_light(true, 0) - 0.5f * 0.2f) < 0.01f);
}

static void a_clear_pane_throws_a_faint_shadow(void **state)
{
	float light;

	(void)state;
	light = floor_light(true, 0.8f);
	assert_true(light > 0.5f * (0.2f + 0.5f * 0.7071f));
	assert_true(light < 0.5f * (0.2f + 0.8f * 0.7071f));
}

static void a_mirror_shows_what_stands_before_it(void **state)
{
	struct material mirror = sim_material_plain(v3(0, 0, 0));
	struct material lamp = sim_material_plain(v3(0, 1, 0));

	(void)state;
	mirror.specular = 0.9f;
	mirror.gloss_log2 = 9;
	mirror.reflects = true;
	lamp.emission = 0.6f;
	sim_add(&builder, SHAPE_BOX, v3(0, 0.1f, 0), v3(0.5f, 0.1f, 0.5f), 0, &mirror);
	sim_add(&builder, SHAPE_BOX, v3(0, -4, 0), v3(0.5f, 0.1f, 0.5f), 0, &lamp);
	sim_thing_end(&builder, false);
	assert_colour(middle_of_picture(), v3(0, 0.9f * 0.8f, 0), 0.02f);
}

enum { PHOTO = 16, COUNT = 12, VIEWS = 2, PICTURE = 24 * 24 * 3, BYTES = COUNT * VIEWS * PICTURE };

static void draw_batch(uint8_t *pictures)
{
	static float poses[COUNT * VIEWS * 16], intrinsics[COUNT * VIEWS * 4];

	assert_int_equal(dio_sim_batch(600, COUNT, VIEWS, 24, 24, DIO_SIM_BATCH_CLEAN, pictures,
				       poses, intrinsics),
			 0);
}

static void photographs_show_on_some_things_until_they_are_taken_away(void **state)
{
	static uint8_t photos[2 * PHOTO * PHOTO * 3], plain[BYTES], shown[BYTES], again[BYTES];
	uint32_t changed = 0;

	(void)state;
	for (size_t i = 0; i < sizeof(photos); i++)
		photos[i] = i % 3 == 1 ? 255 : 0;
	draw_batch(plain);
	assert_int_equal(dio_sim_photos_set(photos, PHOTO, 2), 0);
	draw_batch(shown);
	assert_int_equal(dio_sim_photos_set(NULL, 0, 0), 0);
	draw_batch(again);
	assert_memory_equal(plain, again, sizeof(plain));
	for (size_t i = 0; i < COUNT; i++)
		changed += memcmp(plain + i * VIEWS * PICTURE, shown + i * VIEWS * PICTURE,
				  VIEWS * PICTURE) != 0;
	assert_true(changed > 0 && changed < COUNT);
}

static void photographs_of_odd_sides_are_refused(void **state)
{
	static const uint8_t pixels[12 * 12 * 3];

	(void)state;
	assert_int_equal(dio_sim_photos_set(pixels, 12, 1), -1);
	assert_int_equal(dio_sim_photos_set(pixels, 0, 1), -1);
}

static void a_photograph_is_bilinear_mirrored_and_filtered(void **state)
{
	static uint8_t pixels[3 * (16 + 4 + 1)];
	struct sim_photos photos = {.pixels = pixels, .side = 4, .count = 1};
	struct v3 c;

	(void)state;
	memset(pixels, 0, sizeof(pixels));
	for (int y = 0; y < 4; y++)
		memset(pixels + 3 * (4 * y + 2), 255, 6); /* the right half is white */
	memset(pixels + 3 * 16 + 3, 255, 3);
	memset(pixels + 3 * 16 + 9, 255, 3);
	memset(pixels + 3 * 20, 128, 3);
	c = photo_colour(&photos, 0, 0.1f, 0.5f, 0.01f);
	assert_true(c.x < 1e-3f);
	c = photo_colour(&photos, 0, 0.9f, 0.5f, 0.01f);
	assert_true(c.x > 0.99f);
	c = photo_colour(&photos, 0, 1.9f, 0.5f, 0.01f); /* mirrored past the edge */
	assert_true(c.x < 1e-3f);
	c = photo_colour(&photos, 0, 0.5f, 0.5f, 0.01f); /* half way between two pixels */
	assert_true(fabsf(c.y - srgb_decode(0.5f)) < 1e-3f);
	c = photo_colour(&photos, 0, 0.9f, 0.5f, 1); /* one pixel for all */
	assert_true(fabsf(c.z - srgb_decode(128 / 255.0f)) < 1e-3f);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test_setup_teardown(glass_shows_what_is_behind_it_in_its_own_tint,
						start, stop),
		cmocka_unit_test_setup_teardown(panes_darken_one_another, start, stop),
		cmocka_unit_test_setup_teardown(nothing_stands_before_the_lamp, start, stop),
		cmocka_unit_test_setup_teardown(a_solid_pane_throws_a_full_shadow, start, stop),
		cmocka_unit_test_setup_teardown(a_clear_pane_throws_a_faint_shadow, start, stop),
		cmocka_unit_test_setup_teardown(a_mirror_shows_what_stands_before_it, start, stop),
		cmocka_unit_test(photographs_show_on_some_things_until_they_are_taken_away),
		cmocka_unit_test(photographs_of_odd_sides_are_refused),
		cmocka_unit_test(a_photograph_is_bilinear_mirrored_and_filtered),
	};

	return cmocka_run_group_tests_name("sim_light", tests, NULL, NULL);
}
