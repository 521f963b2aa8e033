/* The board is where the true camera says, and its markers read as the dictionary has them. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>

#include <cmocka.h>

#include "board.h"
#include "support.h"

#define SQUARE 0.0285
#define MARKER 0.0171

static bool black(uint32_t rows, bool legacy, int column, int row)
{
	bool odd_start = legacy && rows % 2 == 0;

	return (column + row) % 2 == (odd_start ? 1 : 0);
}

static bool inside(const struct dio_sim_camera *c, struct pixel p, double margin)
{
	return p.u > margin && p.v > margin && p.u < c->width - 1 - margin &&
	       p.v < c->height - 1 - margin;
}

/* Pixels from the projected middle of the edge left of (column, row) to where the light crosses
 * half way between the two squares, along the row; NAN when out of the picture or shadowed. */
static double edge_error(const float *rgb, const struct dio_sim_camera *c, double x, double y)
{
	struct pixel a = test_project(c, x - 0.004, y, 0), b = test_project(c, x + 0.004, y, 0);
	struct pixel mid = test_project(c, x, y, 0), here;
	double length = hypot(b.u - a.u, b.v - a.v), low, high, before;
	double du = (b.u - a.u) / length, dv = (b.v - a.v) / length;

	if (!inside(c, a, 3) || !inside(c, b, 3) || length < 8)
		return NAN;
	low = test_light_at(rgb, c, (struct pixel){mid.u - 3.5 * du, mid.v - 3.5 * dv});
	high = test_light_at(rgb, c, (struct pixel){mid.u + 3.5 * du, mid.v + 3.5 * dv});
	if (fabs(high - low) < 0.05)
		return NAN;
	before = low;
	for (double t = -3.5; t < 3.5; t += 0.01) {
		double now;

		here.u = mid.u + t * du;
		here.v = mid.v + t * dv;
		now = test_light_at(rgb, c, here);
		if ((before - (low + high) / 2) * (now - (low + high) / 2) <= 0)
			return t;
		before = now;
	}
	return 3.5;
}

static void check_edges(bool distorted, uint32_t style)
{
	struct dio_sim_scene *scene = test_scene(11, 10, 7, false);
	struct dio_sim_camera c = test_camera(distorted);
	float *rgb = malloc(sizeof(float) * 3 * c.width * c.height);
	double sum = 0, sum2 = 0;
	uint32_t count = 0;

	assert_non_null(scene);
	assert_non_null(rgb);
	for (int view = 0; view < 4; view++) {
		dio_sim_viewpoint(scene, style, 1.5 * view + 0.3, c.world_from_camera);
		assert_true(dio_sim_render_float(scene, &c, NULL, 4, rgb));
		for (int row = 0; row < 7; row++) {
			for (int column = 1; column < 10; column++) {
				double e = edge_error(rgb, &c, (column - 5) * SQUARE,
						      (3 - row) * SQUARE);

				if (isnan(e))
					continue;
				sum += e;
				sum2 += e * e;
				count++;
			}
		}
	}
	print_message("%u edges: mean %.4f px, rms %.4f px\n", count, sum / count,
		      sqrt(sum2 / count));
	assert_true(count > 100);
	assert_true(fabs(sum / count) < 0.02);
	assert_true(sqrt(sum2 / count) < 0.1);
	free(rgb);
	dio_sim_scene_destroy(scene);
}

static void board_edges_lie_where_a_pinhole_camera_puts_them(void **state)
{
	(void)state;
	check_edges(false, 1);
}

static void board_edges_lie_where_a_distorted_camera_puts_them(void **state)
{
	(void)state;
	check_edges(true, 1);
}

/* Straight above the board, upright in the picture. */
static void look_down(struct dio_sim_camera *c, double height)
{
	const double pose[16] = {1, 0, 0, 0, 0, -1, 0, 0, 0, 0, -1, height, 0, 0, 0, 1};

	for (int i = 0; i < 16; i++)
		c->world_from_camera[i] = pose[i];
}

static void check_layout(uint32_t cols, uint32_t rows, bool legacy)
{
	struct dio_sim_scene *scene = test_scene(5, cols, rows, legacy);
	struct dio_sim_camera c = test_camera(false);
	float *rgb = malloc(sizeof(float) * 3 * c.width * c.height);
	uint32_t next = 0;

	assert_non_null(scene);
	assert_non_null(rgb);
	look_down(&c, 0.48);
	assert_true(dio_sim_render_float(scene, &c, NULL, 4, rgb));
	for (int row = 0; row < (int)rows; row++) {
		for (int column = 0; column < (int)cols; column++) {
			double x = (column + 0.5 - 0.5 * cols) * SQUARE;
			double y = (0.5 * rows - row - 0.5) * SQUARE, cell = MARKER / 8;
			double paper = test_light_at(
				rgb, &c, test_project(&c, x - 0.45 * SQUARE, y + 0.45 * SQUARE, 0));
			uint64_t bits = 0;

			if (black(rows, legacy, column, row)) {
				assert_true(paper < 0.12);
				continue;
			}
			assert_true(paper > 0.12);
			for (int i = 0; i < 36; i++) {
				struct pixel p = test_project(&c, x + (i % 6 - 2.5) * cell,
							      y - (i / 6 - 2.5) * cell, 0);

				bits = bits << 1 | (test_light_at(rgb, &c, p) > 0.5 * paper);
			}
			assert_int_equal(bits, sim_markers[next]);
			next++;
		}
	}
	assert_int_equal(next, cols * rows / 2);
	free(rgb);
	dio_sim_scene_destroy(scene);
}

static void markers_read_in_order_on_odd_and_even_boards(void **state)
{
	(void)state;
	check_layout(10, 7, false);
	check_layout(7, 8, false);
}

static void legacy_layout_starts_white_when_rows_are_even(void **state)
{
	(void)state;
	check_layout(7, 8, true);
	check_layout(10, 7, true);
}

static void markers_past_the_dictionary_stay_empty(void **state)
{
	const struct dio_sim_board b = {
		.cols = 30, .rows = 30, .square_m = 0.01, .marker_m = 0.006};

	(void)state;
	/* Id 449 would be in the last row; its square is white all over. */
	assert_true(board_white(&b, 0.145f - 0.01f, -0.145f, 1e-5f) > 0.99f);
	assert_true(board_marker_at(&b, 28, 29) > SIM_MARKER_COUNT);
}

static void board_stays_in_view_while_walking_and_calibrating(void **state)
{
	struct dio_sim_scene *scene = test_scene(3, 10, 7, false);
	struct dio_sim_camera c = test_camera(false);

	(void)state;
	for (double t = 0; t < 120; t += 0.37) {
		uint32_t seen[2] = {0, 0};

		for (uint32_t style = 0; style < 2; style++) {
			dio_sim_viewpoint(scene, style, t, c.world_from_camera);
			for (int i = 0; i < 54; i++) {
				struct pixel p = test_project(&c, (i % 9 - 4) * SQUARE,
							      (2.5 - i / 9) * SQUARE, 0);

				seen[style] += inside(&c, p, 0);
			}
		}
		assert_true(seen[0] == 54);
		assert_true(seen[1] >= 18);
	}
	dio_sim_scene_destroy(scene);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(board_edges_lie_where_a_pinhole_camera_puts_them),
		cmocka_unit_test(board_edges_lie_where_a_distorted_camera_puts_them),
		cmocka_unit_test(markers_read_in_order_on_odd_and_even_boards),
		cmocka_unit_test(legacy_layout_starts_white_when_rows_are_even),
		cmocka_unit_test(markers_past_the_dictionary_stay_empty),
		cmocka_unit_test(board_stays_in_view_while_walking_and_calibrating),
	};

	return cmocka_run_group_tests_name("sim_board", tests, NULL, NULL);
}
