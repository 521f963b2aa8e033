/* What the display loop is made of: figures, pace, viewpoint, the composed picture. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>
#include <math.h>
#include <string.h>

#include "viewd/figures.h"
#include "viewd/pace.h"
#include "viewd/screen.h"
#include "viewd/viewpoint.h"

#define MS UINT64_C(1000000)
#define PI 3.14159265358979323846

static void latency_is_median_and_p99_of_what_was_timed(void **state)
{
	static struct dio_figures figures;
	double median, p99;

	(void)state;
	dio_figures_clear(&figures);
	dio_figures_get_latency(&figures, &median, &p99);
	assert_true(median == 0 && p99 == 0);
	/* 1..200 ms; pictures of no camera, and clocks that run backward, do not count. */
	for (uint64_t i = 1; i <= 200; i++) {
		dio_figures_note(&figures, 1000 * MS, 1000 * MS + i * MS);
		dio_figures_note(&figures, 0, 5000 * MS);
		dio_figures_note(&figures, 7000 * MS, 6000 * MS);
	}
	dio_figures_get_latency(&figures, &median, &p99);
	assert_true(fabs(median - 101) < 1e-9);
	assert_true(fabs(p99 - 199) < 1e-9);
}

static void rate_counts_the_last_second_and_a_half(void **state)
{
	static struct dio_figures figures;
	uint64_t now = 1;

	(void)state;
	dio_figures_clear(&figures);
	for (int i = 0; i < 500; i++, now += 20 * MS)
		dio_figures_note(&figures, 0, now);
	assert_true(fabs(dio_figures_get_rate(&figures, now) - 50) < 0.5);
	assert_true(dio_figures_get_rate(&figures, now + 5000 * MS) == 0);
}

static void note_times(struct dio_pace *pace, uint64_t time_ns)
{
	for (int i = 0; i < DIO_PACE_SAMPLES; i++)
		dio_pace_note(pace, time_ns);
}

static void pace_takes_coarser_patches_when_time_is_short_and_finer_when_there_is_time(void **state)
{
	struct dio_pace pace;

	(void)state;
	dio_pace_init(&pace, 256, 192, 16, 33 * MS);
	assert_int_equal(dio_pace_get_patch(&pace), 16);
	note_times(&pace, 20 * MS);
	assert_int_equal(dio_pace_get_patch(&pace), 16);
	note_times(&pace, 60 * MS);
	assert_int_equal(dio_pace_get_patch(&pace), 20);
	/* A finer rung would take 26 ms * 192 / 130: too near the budget. */
	note_times(&pace, 26 * MS);
	assert_int_equal(dio_pace_get_patch(&pace), 20);
	note_times(&pace, 10 * MS);
	assert_int_equal(dio_pace_get_patch(&pace), 16);
	/* One slow picture among nine is no reason. */
	for (int i = 0; i < 100; i++)
		dio_pace_note(&pace, i % 9 == 0 ? 500 * MS : 20 * MS);
	assert_int_equal(dio_pace_get_patch(&pace), 16);
	/* There is an end. */
	for (int i = 0; i < 10; i++)
		note_times(&pace, 900 * MS);
	assert_int_equal(dio_pace_get_patch(&pace), 32);
}

static void a_ladder_has_no_rung_twice(void **state)
{
	struct dio_pace pace;

	(void)state;
	dio_pace_init(&pace, 16, 16, 16, MS);
	assert_int_equal(pace.rungs, 1);
	dio_pace_init(&pace, 64, 48, 1, MS);
	for (uint32_t i = 1; i < pace.rungs; i++)
		assert_true(pace.tokens[i] < pace.tokens[i - 1]);
	dio_pace_init(&pace, 4096, 4096, 256, MS);
	assert_int_equal(dio_pace_get_patch(&pace), 256);
}

/* Cameras on a half circle of radius 2 that look at the origin. */
static void make_rig(struct dio_pose poses[8])
{
	const struct dio_orbit orbit = {.up = {0, 0, 1}, .east = {1, 0, 0}, .north = {0, 1, 0}};

	for (int i = 0; i < 8; i++)
		dio_orbit_look(&orbit, i * PI / 8, 1, 2, &poses[i]);
}

static void viewpoint_is_tracked_then_orbits_then_is_tracked_again(void **state)
{
	struct dio_viewpoint viewpoint = {0};
	struct dio_pose poses[8], pose, seen;
	struct dio_error error;
	uint64_t taken;

	(void)state;
	make_rig(poses);
	assert_int_equal(dio_viewpoint_set_scene(&viewpoint, poses, 8, &error), DIO_OK);
	assert_int_equal(dio_viewpoint_get(&viewpoint, 1000 * MS, &pose, &taken),
			 DIO_VIEWPOINT_ORBIT);
	assert_int_equal(taken, 0);
	seen = poses[3];
	dio_viewpoint_track(&viewpoint, &seen, 1100 * MS, 1150 * MS);
	assert_int_equal(dio_viewpoint_get(&viewpoint, 1200 * MS, &pose, &taken),
			 DIO_VIEWPOINT_TRACKED);
	assert_int_equal(taken, 1100 * MS);
	assert_memory_equal(&pose, &seen, sizeof pose);
	assert_int_equal(dio_viewpoint_get(&viewpoint, 2150 * MS, &pose, &taken),
			 DIO_VIEWPOINT_ORBIT);
	dio_viewpoint_track(&viewpoint, &seen, 2200 * MS, 2205 * MS);
	assert_int_equal(dio_viewpoint_get(&viewpoint, 2210 * MS, &pose, &taken),
			 DIO_VIEWPOINT_TRACKED);
	dio_viewpoint_deinit(&viewpoint);
}

static void a_path_is_played_in_its_own_time_and_starts_over(void **state)
{
	struct dio_viewpoint viewpoint = {0};
	struct dio_trajectory path = {0};
	struct dio_pose poses[8], pose;
	struct dio_error error;
	uint64_t taken;

	(void)state;
	make_rig(poses);
	assert_int_equal(dio_viewpoint_set_scene(&viewpoint, poses, 8, &error), DIO_OK);
	assert_int_equal(dio_trajectory_init(&path, 4), DIO_OK);
	for (int i = 0; i < 4; i++) {
		path.time_s[i] = 5 + i; /* 0, 1, 2, 3 s from its start */
		path.poses[i] = poses[i];
	}
	dio_viewpoint_set_path(&viewpoint, &path);
	assert_null(path.poses);
	dio_viewpoint_play(&viewpoint, true, 1000 * MS);
	for (int i = 0; i < 5; i++) {
		assert_int_equal(dio_viewpoint_get(&viewpoint, (1500 + 1000u * (unsigned)i) * MS,
						   &pose, &taken),
				 DIO_VIEWPOINT_PATH);
		assert_memory_equal(&pose, &poses[i % 3], sizeof pose);
	}
	dio_viewpoint_deinit(&viewpoint);
}

static void a_hand_holds_the_viewpoint_until_it_lets_go(void **state)
{
	struct dio_viewpoint viewpoint = {0};
	struct dio_pose poses[8], pose, turned;
	struct dio_error error;
	uint64_t taken;

	(void)state;
	make_rig(poses);
	assert_int_equal(dio_viewpoint_set_scene(&viewpoint, poses, 8, &error), DIO_OK);
	dio_viewpoint_track(&viewpoint, &poses[0], 1000 * MS, 1000 * MS);
	dio_viewpoint_turn(&viewpoint, 0, 0, 0);
	assert_int_equal(dio_viewpoint_get(&viewpoint, 1001 * MS, &pose, &taken),
			 DIO_VIEWPOINT_HAND);
	dio_viewpoint_turn(&viewpoint, 0.5, 0.1, -1);
	dio_viewpoint_get(&viewpoint, 1002 * MS, &turned, &taken);
	assert_memory_not_equal(&pose, &turned, sizeof pose);
	dio_viewpoint_follow(&viewpoint);
	assert_int_equal(dio_viewpoint_get(&viewpoint, 1003 * MS, &pose, &taken),
			 DIO_VIEWPOINT_TRACKED);
	dio_viewpoint_deinit(&viewpoint);
}

static void paint(struct dio_picture *picture, uint32_t width, uint32_t height)
{
	assert_int_equal(dio_picture_init(picture, width, height), DIO_OK);
	for (size_t i = 0; i < (size_t)width * height * 3; i++)
		picture->rgb[i] = (uint8_t)(i * 37 + i / 7);
}

static void a_picture_of_the_displays_size_is_shown_bit_for_bit(void **state)
{
	struct dio_picture picture = {0};
	struct dio_screen screen = {0};
	struct dio_error error;

	(void)state;
	paint(&picture, 61, 43);
	for (int smooth = 0; smooth < 2; smooth++) {
		assert_int_equal(
			dio_screen_compose(&screen, &picture, 61, 43, smooth, NULL, &error),
			DIO_OK);
		assert_memory_equal(screen.canvas.rgb, picture.rgb, (size_t)61 * 43 * 3);
	}
	/* Twice the size, not smooth: each pixel four times. */
	assert_int_equal(dio_screen_compose(&screen, &picture, 122, 86, false, NULL, &error),
			 DIO_OK);
	for (uint32_t y = 0; y < 86; y++)
		for (uint32_t x = 0; x < 122; x++)
			assert_memory_equal(screen.canvas.rgb + 3 * (y * 122 + x),
					    picture.rgb + 3 * (y / 2 * 61 + x / 2), 3);
	dio_picture_deinit(&picture);
	dio_screen_deinit(&screen);
}

static void proportions_are_kept_and_the_rest_is_black(void **state)
{
	struct dio_picture picture = {0};
	struct dio_screen screen = {0};
	struct dio_error error;

	(void)state;
	assert_int_equal(dio_picture_init(&picture, 40, 30), DIO_OK);
	memset(picture.rgb, 200, (size_t)40 * 30 * 3);
	assert_int_equal(dio_screen_compose(&screen, &picture, 160, 90, true, NULL, &error),
			 DIO_OK);
	for (uint32_t x = 0; x < 160; x++)
		assert_int_equal(screen.canvas.rgb[3 * (45 * 160 + x)],
				 x >= 20 && x < 140 ? 200 : 0);
	/* No picture: black. */
	assert_int_equal(dio_screen_compose(&screen, NULL, 160, 90, true, NULL, &error), DIO_OK);
	for (size_t i = 0; i < (size_t)160 * 90 * 3; i++)
		assert_int_equal(screen.canvas.rgb[i], 0);
	dio_picture_deinit(&picture);
	dio_screen_deinit(&screen);
}

static void an_overlay_fits_any_display(void **state)
{
	static const uint32_t SIZES[][2] = {{1, 1}, {7, 300}, {64, 48}, {640, 480}, {1921, 1079}};
	struct dio_overlay overlay = {.state = "reconstruct",
				      .lines = {"one", "", "three"},
				      .figures = "30 fps 40 ms",
				      .progress = 2,
				      .show_cells = true,
				      .corners = {{0, 0}, {0.999f, 0.999f}, {1, 1}},
				      .corner_count = 3};
	struct dio_picture picture = {0};
	struct dio_screen screen = {0};
	struct dio_error error;

	(void)state;
	memset(overlay.message, 'M', sizeof overlay.message - 1);
	memset(overlay.cells, 1, sizeof overlay.cells);
	paint(&picture, 32, 24);
	for (size_t i = 0; i < sizeof SIZES / sizeof *SIZES; i++)
		assert_int_equal(dio_screen_compose(&screen, &picture, SIZES[i][0], SIZES[i][1],
						    true, &overlay, &error),
				 DIO_OK);
	dio_picture_deinit(&picture);
	dio_screen_deinit(&screen);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(latency_is_median_and_p99_of_what_was_timed),
		cmocka_unit_test(rate_counts_the_last_second_and_a_half),
		cmocka_unit_test(
			pace_takes_coarser_patches_when_time_is_short_and_finer_when_there_is_time),
		cmocka_unit_test(a_ladder_has_no_rung_twice),
		cmocka_unit_test(viewpoint_is_tracked_then_orbits_then_is_tracked_again),
		cmocka_unit_test(a_path_is_played_in_its_own_time_and_starts_over),
		cmocka_unit_test(a_hand_holds_the_viewpoint_until_it_lets_go),
		cmocka_unit_test(a_picture_of_the_displays_size_is_shown_bit_for_bit),
		cmocka_unit_test(proportions_are_kept_and_the_rest_is_black),
		cmocka_unit_test(an_overlay_fits_any_display),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
