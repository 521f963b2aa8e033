/* Training data: the same from any split, true to its cameras, rarely empty. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "dio/sim_batch.h"
#include "support.h"

enum { SCENES = 24, VIEWS = 4, SIDE = 32, PICTURE = SIDE * SIDE * 3 };

static uint8_t pictures[SCENES * VIEWS * PICTURE];
static float floats[SCENES * VIEWS * PICTURE];
static float poses[SCENES * VIEWS * 16], intrinsics[SCENES * VIEWS * 4];

static void scene_depends_on_its_own_seed_alone(void **state)
{
	static uint8_t one[VIEWS * PICTURE];
	static float pose[VIEWS * 16], camera[VIEWS * 4];

	(void)state;
	assert_int_equal(
		dio_sim_batch(900, SCENES, VIEWS, SIDE, SIDE, 0, pictures, poses, intrinsics), 0);
	for (uint32_t i = 0; i < SCENES; i += 5) {
		assert_int_equal(dio_sim_batch(900 + i, 1, VIEWS, SIDE, SIDE, 0, one, pose, camera),
				 0);
		assert_memory_equal(one, pictures + (size_t)i * sizeof(one), sizeof(one));
		assert_memory_equal(pose, poses + (size_t)i * VIEWS * 16, sizeof(pose));
		assert_memory_equal(camera, intrinsics + (size_t)i * VIEWS * 4, sizeof(camera));
	}
}

static void floats_and_bytes_are_the_same_picture(void **state)
{
	(void)state;
	assert_int_equal(dio_sim_batch(50, 6, VIEWS, SIDE, SIDE, 0, pictures, poses, intrinsics),
			 0);
	assert_int_equal(dio_sim_batch(50, 6, VIEWS, SIDE, SIDE, DIO_SIM_BATCH_FLOAT, floats, poses,
				       intrinsics),
			 0);
	for (size_t i = 0; i < (size_t)6 * VIEWS * PICTURE; i++)
		assert_true(fabsf(floats[i] * 255 - pictures[i]) <= 0.501f);
}

static void cameras_are_rigid_and_lenses_ordinary(void **state)
{
	(void)state;
	assert_int_equal(dio_sim_batch(4000, SCENES, VIEWS, SIDE, SIDE, DIO_SIM_BATCH_CLEAN,
				       pictures, poses, intrinsics),
			 0);
	for (int v = 0; v < SCENES * VIEWS; v++) {
		const float *m = poses + 16 * v, *k = intrinsics + 4 * v;
		double degrees = 2 * atan(0.5 * SIDE / k[0]) * 180 / 3.14159265358979;

		for (int a = 0; a < 3; a++)
			for (int b = 0; b < 3; b++)
				assert_true(fabs(m[a] * m[b] + m[4 + a] * m[4 + b] +
						 m[8 + a] * m[8 + b] - (a == b)) < 1e-5);
		assert_true(m[15] == 1 && m[12] == 0 && m[13] == 0 && m[14] == 0);
		assert_true(degrees > 16 && degrees < 86);
		assert_true(fabs(k[1] / k[0] - 1) < 0.05);
		assert_true(fabs(k[2] - 15.5) < 0.15 * SIDE && fabs(k[3] - 15.5) < 0.15 * SIDE);
	}
}

/* Update the figure when scenes change on purpose; gcc and clang must agree on it. */
static void bytes_are_the_same_with_every_compiler(void **state)
{
	(void)state;
	assert_int_equal(
		dio_sim_batch(2026, SCENES, VIEWS, SIDE, SIDE, 0, pictures, poses, intrinsics), 0);
	assert_int_equal(test_hash(pictures, sizeof(pictures)), 0xfcf6a9173a118d4full);
}

static double spread_of(const uint8_t *rgb)
{
	double sum = 0, sum2 = 0;

	for (int i = 0; i < PICTURE; i++) {
		sum += rgb[i];
		sum2 += (double)rgb[i] * rgb[i];
	}
	sum /= PICTURE;
	return sqrt(fmax(sum2 / PICTURE - sum * sum, 0));
}

static void few_pictures_show_nothing(void **state)
{
	uint32_t empty = 0;

	(void)state;
	for (uint64_t seed = 0; seed < 10 * SCENES; seed += SCENES) {
		assert_int_equal(dio_sim_batch(seed, SCENES, VIEWS, SIDE, SIDE, DIO_SIM_BATCH_CLEAN,
					       pictures, poses, intrinsics),
				 0);
		for (int v = 0; v < SCENES * VIEWS; v++)
			empty += spread_of(pictures + (size_t)v * PICTURE) < 4;
	}
	print_message("%u of %d pictures are nearly uniform\n", empty, 10 * SCENES * VIEWS);
	assert_true(empty < 10 * SCENES * VIEWS / 25);
}

static void kinds_can_be_chosen_and_sizes_are_checked(void **state)
{
	static uint8_t streets[2 * VIEWS * PICTURE], tables[2 * VIEWS * PICTURE];

	(void)state;
	assert_int_equal(dio_sim_batch(1, 2, VIEWS, SIDE, SIDE, DIO_SIM_BATCH_STREETS, streets,
				       poses, intrinsics),
			 0);
	assert_int_equal(dio_sim_batch(1, 2, VIEWS, SIDE, SIDE, DIO_SIM_BATCH_TABLES, tables, poses,
				       intrinsics),
			 0);
	assert_memory_not_equal(streets, tables, sizeof(tables));
	assert_int_equal(dio_sim_batch(1, 1, 0, SIDE, SIDE, 0, tables, poses, intrinsics), -1);
	assert_int_equal(dio_sim_batch(1, 1, VIEWS, 0, SIDE, 0, tables, poses, intrinsics), -1);
	assert_int_equal(dio_sim_batch(1, 1, 100000, SIDE, SIDE, 0, tables, poses, intrinsics), -1);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(scene_depends_on_its_own_seed_alone),
		cmocka_unit_test(floats_and_bytes_are_the_same_picture),
		cmocka_unit_test(cameras_are_rigid_and_lenses_ordinary),
		cmocka_unit_test(bytes_are_the_same_with_every_compiler),
		cmocka_unit_test(few_pictures_show_nothing),
		cmocka_unit_test(kinds_can_be_chosen_and_sizes_are_checked),
	};

	return cmocka_run_group_tests_name("sim_batch", tests, NULL, NULL);
}
