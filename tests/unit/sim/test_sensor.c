/* The sensor does what its numbers say. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "sensor.h"
#include "vec.h"

enum { WIDTH = 128, HEIGHT = 96, VALUES = WIDTH * HEIGHT * 3 };

static const struct dio_sim_camera camera = {.width = WIDTH, .height = HEIGHT};

static void fill(float *rgb, float light)
{
	for (int i = 0; i < VALUES; i++)
		rgb[i] = light;
}

static double exact_encode(double x)
{
	return x <= 0.0031308 ? 12.92 * x : 1.055 * pow(x, 1 / 2.4) - 0.055;
}

static void curve_is_srgb_within_a_level(void **state)
{
	(void)state;
	for (int i = 0; i <= 1000; i++) {
		float x = (float)i / 1000;

		assert_true(fabs(srgb_encode(x) - exact_encode(x)) < 0.004);
		assert_true(fabs(srgb_decode((float)exact_encode(x)) - x) < 0.003);
	}
}

static void elementary_functions_are_close_to_the_library(void **state)
{
	(void)state;
	for (int i = -2000; i <= 2000; i++) {
		float x = (float)i / 700, y = (float)(i * 37 % 2001) / 300;
		double turns = atan2(y, x) / (2 * 3.14159265358979323846);

		assert_true(fabs(sin_turns(x) - sin(2 * 3.14159265358979323846 * x)) < 5e-4);
		assert_true(fabs(atan2_turns(y, x) - turns) < 2e-5);
		assert_int_equal(floor_int(x), (int)floorf(x));
	}
}

static void one_stop_doubles_the_light(void **state)
{
	static float bright[VALUES], plain[VALUES];
	struct dio_sim_sensor s = {.exposure_stops = 1};

	(void)state;
	fill(bright, 0.15f);
	fill(plain, 0.30f);
	assert_true(sim_sensor_expose(&s, &camera, 1, bright));
	s.exposure_stops = 0;
	assert_true(sim_sensor_expose(&s, &camera, 1, plain));
	assert_true(fabsf(bright[0] - plain[0]) < 1e-3f);
}

static void light_never_leaves_the_unit_range(void **state)
{
	static float rgb[VALUES];
	struct dio_sim_sensor s = {.exposure_stops = 3, .noise = 0.2f, .shot_noise = 0.2f};

	(void)state;
	for (int i = 0; i < VALUES; i++)
		rgb[i] = (float)(i % 100) / 20;
	assert_true(sim_sensor_expose(&s, &camera, 1, rgb));
	sim_sensor_add_noise(&s, VALUES, rgb);
	for (int i = 0; i < VALUES; i++)
		assert_true(rgb[i] >= 0 && rgb[i] <= 1);
}

static void noise_has_the_deviation_asked_for(void **state)
{
	static float rgb[VALUES];
	struct dio_sim_sensor s = {.noise = 0.02f, .shot_noise = 0.03f, .noise_seed = 9};
	double sum = 0, sum2 = 0, want = sqrt(0.02 * 0.02 + 0.5 * 0.03 * 0.03), across = 0;

	(void)state;
	fill(rgb, 0.5f);
	sim_sensor_add_noise(&s, VALUES, rgb);
	for (int i = 0; i < VALUES; i++) {
		sum += rgb[i] - 0.5;
		sum2 += (rgb[i] - 0.5) * (rgb[i] - 0.5);
		if (i > 0)
			across += (rgb[i] - 0.5) * (rgb[i - 1] - 0.5);
	}
	assert_true(fabs(sum / VALUES) < 4 * want / sqrt(VALUES));
	assert_true(fabs(sqrt(sum2 / VALUES) / want - 1) < 0.02);
	assert_true(fabs(across / sum2) < 0.03);
}

static void blur_spreads_a_point_and_keeps_its_light(void **state)
{
	static float rgb[VALUES];
	struct dio_sim_sensor s = {.blur_px = 1.5f};
	size_t middle = ((size_t)48 * WIDTH + 64) * 3;
	double sum = 0, second = 0;

	(void)state;
	memset(rgb, 0, sizeof(rgb));
	rgb[middle] = 0.69f;
	assert_true(sim_sensor_expose(&s, &camera, 1, rgb));
	for (int x = 44; x < 85; x++) {
		for (int y = 28; y < 69; y++) {
			double e = rgb[((size_t)y * WIDTH + (size_t)x) * 3];
			double light = e <= 0.04045 ? e / 12.92 : pow((e + 0.055) / 1.055, 2.4);

			sum += light;
			second += light * (x - 64) * (x - 64);
		}
	}
	assert_true(fabs(sum / 0.69 - 1) < 0.02);
	assert_true(fabs(sqrt(second / sum) / 1.5 - 1) < 0.05);
}

static void corners_lose_the_light_of_the_vignette(void **state)
{
	static float rgb[VALUES];
	struct dio_sim_sensor s = {.vignetting = 0.5f};

	(void)state;
	fill(rgb, 0.4f);
	assert_true(sim_sensor_expose(&s, &camera, 1, rgb));
	assert_true(fabs(rgb[0] - exact_encode(0.2)) < 0.01);
	assert_true(fabs(rgb[(48 * WIDTH + 64) * 3] - exact_encode(0.4)) < 0.01);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(curve_is_srgb_within_a_level),
		cmocka_unit_test(elementary_functions_are_close_to_the_library),
		cmocka_unit_test(one_stop_doubles_the_light),
		cmocka_unit_test(light_never_leaves_the_unit_range),
		cmocka_unit_test(noise_has_the_deviation_asked_for),
		cmocka_unit_test(blur_spreads_a_point_and_keeps_its_light),
		cmocka_unit_test(corners_lose_the_light_of_the_vignette),
	};

	return cmocka_run_group_tests_name("sim_sensor", tests, NULL, NULL);
}
