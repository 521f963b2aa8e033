/* The orbit: it looks at what the cameras look at and stays where they have been. */
#include "unit/app/fixture.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "core/orbit.h"

#define POSES 12

/* Cameras on a circle of radius 2 at height 1 over (5, 6, 7), z up, from azimuth a0 over `arc`. */
static void make_ring(struct dio_pose *poses, uint32_t count, double a0, double arc)
{
	const struct dio_orbit ring = {
		.centre = {5, 6, 7}, .up = {0, 0, 1}, .east = {1, 0, 0}, .north = {0, 1, 0}};

	for (uint32_t i = 0; i < count; i++)
		dio_orbit_look(&ring, a0 + arc * i / count, 1, 2, &poses[i]);
}

static double dot3(const double *a, const double *b)
{
	return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

static void expect_rigid(const struct dio_pose *pose)
{
	const double *m = pose->world_from_camera;

	for (int i = 0; i < 3; i++)
		for (int j = 0; j < 3; j++)
			assert_float_equal(dot3(m + 4 * i, m + 4 * j), i == j, 1e-9);
	assert_float_equal(m[15], 1, 0);
}

static void a_ring_gives_its_centre_its_axis_and_a_full_circle(void **state)
{
	struct dio_pose poses[POSES];
	struct dio_orbit orbit;

	(void)state;
	make_ring(poses, POSES, 0.3, 2 * M_PI);
	dio_orbit_fit(poses, POSES, &orbit);
	assert_true(orbit.closed);
	for (int i = 0; i < 3; i++) {
		assert_float_equal(orbit.centre[i], 5 + i, 1e-4);
		assert_float_equal(orbit.up[i], i == 2, 1e-6);
	}
	assert_float_equal(orbit.radius, 2, 1e-3);
	assert_float_equal(orbit.height, 1, 1e-3);
}

static void the_path_looks_at_the_centre_and_closes(void **state)
{
	const double centre[3] = {5, 6, 7};
	struct dio_trajectory path = {0};
	struct dio_pose poses[POSES];

	(void)state;
	make_ring(poses, POSES, 0, 2 * M_PI);
	assert_int_equal(dio_orbit_path(poses, POSES, 90, 30, &path), DIO_OK);
	assert_int_equal(path.count, 90);
	assert_float_equal(path.time_s[30], 1, 1e-9);
	for (uint32_t i = 0; i < path.count; i++) {
		const double *m = path.poses[i].world_from_camera;
		const double *next = path.poses[(i + 1) % path.count].world_from_camera;
		double to[3], z[3] = {m[2], m[6], m[10]}, step = 0, length;

		expect_rigid(&path.poses[i]);
		for (int k = 0; k < 3; k++) {
			to[k] = centre[k] - m[4 * k + 3];
			step += pow(next[4 * k + 3] - m[4 * k + 3], 2);
		}
		length = sqrt(dot3(to, to));
		assert_float_equal(dot3(to, z) / length, 1, 1e-4);
		assert_float_equal(length, sqrt(5), 1e-2);
		assert_true(sqrt(step) < 2 * M_PI * 2 / 90 * 1.05);
		/* The picture stands upright: the camera's y points down. */
		assert_true(m[9] < 0);
	}
	dio_trajectory_deinit(&path);
}

static void a_path_stays_inside_the_arc_that_the_cameras_span(void **state)
{
	struct dio_trajectory path = {0};
	struct dio_pose poses[POSES];
	/* Azimuths 3 to 3 + 1.1 (over the seam at pi). */
	const double from = 3, arc = 1.2, to = from + arc * (POSES - 1) / POSES;

	(void)state;
	make_ring(poses, POSES, from, arc);
	assert_int_equal(dio_orbit_path(poses, POSES, 100, 30, &path), DIO_OK);
	for (uint32_t i = 0; i < path.count; i++) {
		const double *m = path.poses[i].world_from_camera;
		double azimuth = atan2(m[7] - 6, m[3] - 5);

		azimuth = azimuth < 0 ? azimuth + 2 * M_PI : azimuth;
		assert_in_range((uintmax_t)(1000 * azimuth), (uintmax_t)(1000 * from) - 2,
				(uintmax_t)(1000 * to) + 2);
	}
	dio_trajectory_deinit(&path);
}

static void odd_rigs_still_give_rigid_finite_paths(void **state)
{
	struct dio_pose rigs[5][3];
	const uint32_t counts[5] = {1, 2, 3, 3, 2};

	(void)state;
	make_ring(rigs[0], 1, 1, 1); /* one camera */
	make_ring(rigs[1], 2, 0, 0); /* two in one place */
	make_ring(rigs[2], 3, 0, 2 * M_PI);
	for (int i = 0; i < 3; i++) { /* parallel axes side by side, far from the origin */
		const struct dio_pose flat = {
			{1, 0, 0, 1e6 + i, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1}};

		rigs[3][i] = flat;
	}
	for (int i = 0; i < 2; i++) { /* back to back: no mean direction, looking away */
		const struct dio_pose away = {{i ? 1 : -1, 0, 0, 0, 0, 1, 0, 0, 0, 0, i ? 1 : -1,
					       i ? 1 : -1, 0, 0, 0, 1}};

		rigs[4][i] = away;
	}
	for (int rig = 0; rig < 5; rig++) {
		struct dio_trajectory path = {0};

		assert_int_equal(dio_orbit_path(rigs[rig], counts[rig], 20, 30, &path), DIO_OK);
		for (uint32_t i = 0; i < path.count; i++) {
			for (int k = 0; k < 16; k++)
				assert_true(isfinite(path.poses[i].world_from_camera[k]));
			expect_rigid(&path.poses[i]);
		}
		dio_trajectory_deinit(&path);
	}
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(a_ring_gives_its_centre_its_axis_and_a_full_circle),
		cmocka_unit_test(the_path_looks_at_the_centre_and_closes),
		cmocka_unit_test(a_path_stays_inside_the_arc_that_the_cameras_span),
		cmocka_unit_test(odd_rigs_still_give_rigid_finite_paths),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
