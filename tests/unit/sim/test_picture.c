/* Pictures depend on their arguments and on nothing else. */
#include <math.h>
#include <pthread.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "render.h"
#include "support.h"

enum { WIDTH = 160, HEIGHT = 120, BYTES = WIDTH * HEIGHT * 3 };

static struct dio_sim_camera small_camera(bool distorted)
{
	struct dio_sim_camera c = test_camera(distorted);

	c.width = WIDTH;
	c.height = HEIGHT;
	c.fx /= 4;
	c.fy /= 4;
	c.cx = 79.5;
	c.cy = 59.5;
	return c;
}

static struct dio_sim_scene *scene_of(enum dio_sim_kind kind, uint64_t seed)
{
	struct dio_sim_scene_options o = {.seed = seed, .kind = kind};

	return dio_sim_scene_create(&o);
}

struct job {
	const struct dio_sim_scene *scene;
	uint64_t hash;
};

static void *render_job(void *argument)
{
	struct job *job = argument;
	struct dio_sim_camera c = small_camera(true);
	struct dio_sim_sensor s = {.noise = 0.01f, .blur_px = 0.7f, .noise_seed = 5};
	uint8_t *rgb = malloc(BYTES);

	dio_sim_viewpoint(job->scene, 0, 3, c.world_from_camera);
	if (rgb && dio_sim_render(job->scene, &c, &s, 2, rgb))
		job->hash = test_hash(rgb, BYTES);
	free(rgb);
	return NULL;
}

static void threads_and_calls_agree_on_every_byte(void **state)
{
	(void)state;
	for (int kind = DIO_SIM_TABLE; kind <= DIO_SIM_STREET; kind++) {
		struct dio_sim_scene *scene = scene_of((enum dio_sim_kind)kind, 77);
		struct dio_sim_scene *again = scene_of((enum dio_sim_kind)kind, 77);
		struct job alone = {.scene = again}, jobs[4];
		pthread_t threads[4];

		assert_non_null(scene);
		assert_non_null(again);
		render_job(&alone);
		assert_true(alone.hash != 0);
		for (int i = 0; i < 4; i++) {
			jobs[i] = (struct job){.scene = scene};
			assert_int_equal(pthread_create(&threads[i], NULL, render_job, &jobs[i]),
					 0);
		}
		for (int i = 0; i < 4; i++) {
			pthread_join(threads[i], NULL);
			assert_true(jobs[i].hash == alone.hash);
		}
		dio_sim_scene_destroy(again);
		dio_sim_scene_destroy(scene);
	}
}

static void other_seeds_give_other_pictures(void **state)
{
	uint64_t seen[8];

	(void)state;
	for (uint64_t i = 0; i < 8; i++) {
		struct dio_sim_scene *scene = scene_of(DIO_SIM_TABLE, i);
		struct job job = {.scene = scene};

		render_job(&job);
		seen[i] = job.hash;
		for (uint64_t k = 0; k < i; k++)
			assert_true(seen[k] != seen[i]);
		dio_sim_scene_destroy(scene);
	}
}

static void more_samples_converge(void **state)
{
	static float two[BYTES], four[BYTES], eight[BYTES];
	struct dio_sim_camera c = small_camera(false);
	double coarse = 0, fine = 0;

	(void)state;
	for (uint64_t seed = 1; seed < 5; seed++) {
		struct dio_sim_scene *scene = scene_of(DIO_SIM_TABLE, seed);

		dio_sim_viewpoint(scene, 0, 2, c.world_from_camera);
		assert_true(dio_sim_render_float(scene, &c, NULL, 2, two));
		assert_true(dio_sim_render_float(scene, &c, NULL, 4, four));
		assert_true(dio_sim_render_float(scene, &c, NULL, 8, eight));
		for (int i = 0; i < BYTES; i++) {
			coarse += pow(two[i] - eight[i], 2);
			fine += pow(four[i] - eight[i], 2);
		}
		dio_sim_scene_destroy(scene);
	}
	assert_true(fine < coarse);
	assert_true(sqrt(coarse / (4 * BYTES)) < 0.02);
}

static void every_kind_survives_odd_sizes_and_places(void **state)
{
	static const uint32_t sizes[][2] = {{1, 1}, {7, 3}, {9, 17}, {64, 1}, {33, 40}};
	uint8_t rgb[64 * 64 * 3 + 1];

	(void)state;
	for (int kind = DIO_SIM_TABLE; kind <= DIO_SIM_STREET; kind++) {
		for (uint64_t seed = 0; seed < 6; seed++) {
			struct dio_sim_scene *scene = scene_of((enum dio_sim_kind)kind, seed);
			struct dio_sim_camera c = small_camera(seed % 2);
			size_t bytes;

			c.width = sizes[seed % 5][0];
			c.height = sizes[seed % 5][1];
			dio_sim_viewpoint(scene, (uint32_t)seed % 2, 7.0 * (double)seed,
					  c.world_from_camera);
			if (seed == 5) /* under the table, inside of things */
				c.world_from_camera[11] = -0.01;
			bytes = (size_t)c.width * c.height * 3;
			rgb[bytes] = 0xa5;
			assert_true(dio_sim_render(scene, &c, NULL, 1 + (uint32_t)seed, rgb));
			assert_int_equal(rgb[bytes], 0xa5);
			dio_sim_scene_destroy(scene);
		}
	}
}

static void viewpoints_are_rigid_and_move_smoothly(void **state)
{
	struct dio_sim_scene *scene = scene_of(DIO_SIM_TABLE, 4);
	double last[16], now[16];

	(void)state;
	dio_sim_viewpoint(scene, 0, 0, last);
	for (int i = 1; i < 400; i++) {
		double moved = 0;

		dio_sim_viewpoint(scene, 0, i / 30.0, now);
		for (int a = 0; a < 3; a++) {
			for (int b = 0; b < 3; b++) {
				double dot = 0;

				for (int k = 0; k < 3; k++)
					dot += now[4 * k + a] * now[4 * k + b];
				assert_true(fabs(dot - (a == b)) < 1e-12);
			}
			moved += pow(now[4 * a + 3] - last[4 * a + 3], 2);
		}
		assert_true(sqrt(moved) < 0.05);
		memcpy(last, now, sizeof(now));
	}
	dio_sim_scene_destroy(scene);
}

#ifdef DIO_SIM_HAVE_WIDE
typedef bool render_fn(const struct dio_sim_scene *scene, const struct dio_sim_camera *camera,
		       uint32_t samples, float *rgb);

/* Scenes of every kind, with board and without, distorted lenses too, a pixel's rays at 1, 4, 9. */
static void check_tracer(render_fn *render)
{
	enum { SCENES = 96 };
	static float plain[WIDTH * HEIGHT * 3], wide[WIDTH * HEIGHT * 3];

	for (uint32_t i = 0; i < SCENES; i++) {
		struct dio_sim_scene_options o = {.seed = 40 + i,
						  .kind = (enum dio_sim_kind)(i % 4)};
		struct dio_sim_camera c = small_camera(i % 3 == 0);
		uint32_t samples = 1 + i / 4 % 3;
		struct dio_sim_scene *scene;

		if (i % 8 == 0)
			o.board = (struct dio_sim_board){10, 7, 0.0285, 0.0171, false};
		scene = dio_sim_scene_create(&o);
		assert_non_null(scene);
		c.width = 31 + i / 2;
		c.height = 24 + i / 3;
		dio_sim_viewpoint(scene, i % 2, 3, c.world_from_camera);
		assert_true(sim_render_linear(scene, &c, samples, plain));
		assert_true(render(scene, &c, samples, wide));
		assert_memory_equal(plain, wide, (size_t)c.width * c.height * 3 * sizeof(float));
		dio_sim_scene_destroy(scene);
	}
}
#endif

/* One ray at a time, eight or sixteen side by side; which of them runs must not show. */
static void processors_agree_on_every_bit(void **state)
{
	bool any = false;

	(void)state;
#ifdef DIO_SIM_HAVE_WIDE
	if (__builtin_cpu_supports("avx2")) {
		any = true;
		check_tracer(sim_render_linear_avx2);
	}
	if (__builtin_cpu_supports("avx512f"))
		check_tracer(sim_render_linear_avx512);
#endif
	if (!any) {
		print_message("skipped: one tracer only on this processor\n");
		skip();
	}
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(threads_and_calls_agree_on_every_byte),
		cmocka_unit_test(other_seeds_give_other_pictures),
		cmocka_unit_test(more_samples_converge),
		cmocka_unit_test(every_kind_survives_odd_sizes_and_places),
		cmocka_unit_test(viewpoints_are_rigid_and_move_smoothly),
		cmocka_unit_test(processors_agree_on_every_bit),
	};

	return cmocka_run_group_tests_name("sim_picture", tests, NULL, NULL);
}
