/* Trajectories: poses come back, quaternions are right whatever component is largest. */
#include "unit/app/fixture.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

#include "core/tum.h"

static void expect_pose(const struct dio_pose *got, const struct dio_pose *wanted, double tolerance)
{
	for (int i = 0; i < 16; i++)
		if (!(fabs(got->world_from_camera[i] - wanted->world_from_camera[i]) <= tolerance))
			fail_msg("entry %d: %.12g instead of %.12g", i, got->world_from_camera[i],
				 wanted->world_from_camera[i]);
}

static void known_rotations_have_their_quaternions(void **state)
{
	/* A quarter turn about z, and half turns about each axis. */
	const struct {
		struct dio_pose pose;
		double q[4];
	} cases[] = {
		{{{0, -1, 0, 0, 1, 0, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1}}, {0, 0, M_SQRT1_2, M_SQRT1_2}},
		{{{1, 0, 0, 0, 0, -1, 0, 0, 0, 0, -1, 0, 0, 0, 0, 1}}, {1, 0, 0, 0}},
		{{{-1, 0, 0, 0, 0, 1, 0, 0, 0, 0, -1, 0, 0, 0, 0, 1}}, {0, 1, 0, 0}},
		{{{-1, 0, 0, 0, 0, -1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1}}, {0, 0, 1, 0}},
		{{{1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1}}, {0, 0, 0, 1}},
	};

	(void)state;
	for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
		double q[4];

		dio_quaternion_from_pose(&cases[i].pose, q);
		for (int k = 0; k < 4; k++)
			assert_float_equal(fabs(q[k]), cases[i].q[k], 1e-12);
	}
}

static void a_trajectory_comes_back(void **state)
{
	struct dio_trajectory out = {0}, back = {0};
	struct dio_error error = {0};

	(void)state;
	assert_int_equal(dio_trajectory_init(&out, 200), DIO_OK);
	for (uint32_t i = 0; i < out.count; i++) {
		double q[4] = {sin(i * 1.1), cos(i * 0.7), sin(i * 0.3 + 1), cos(i * 2.3)};
		double norm = sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]);
		const double position[3] = {i * 0.1, -1.0 / (i + 1), 1e3 + i};

		for (int k = 0; k < 4; k++)
			q[k] /= norm;
		dio_pose_from_quaternion(q, position, &out.poses[i]);
		out.time_s[i] = 1700000000.0 + i / 30.0;
	}
	if (dio_tum_write(fixture_path("path.tum"), &out, &error) != DIO_OK ||
	    dio_tum_read(fixture_path("path.tum"), &back, &error) != DIO_OK)
		fail_msg("%s", error.text);
	assert_int_equal(back.count, out.count);
	for (uint32_t i = 0; i < out.count; i++) {
		expect_pose(&back.poses[i], &out.poses[i], 1e-5);
		assert_float_equal(back.time_s[i], out.time_s[i], 1e-6);
		for (int k = 0; k < 3; k++) /* the rotation is stated to nine digits */
			assert_float_equal(back.poses[i].world_from_camera[k],
					   out.poses[i].world_from_camera[k], 1e-8);
	}
	dio_trajectory_deinit(&out);
	dio_trajectory_deinit(&back);
}

static void a_file_by_hand_is_read(void **state)
{
	const struct dio_pose wanted = {{0, -1, 0, 1, 1, 0, 0, 2, 0, 0, 1, 3, 0, 0, 0, 1}};
	struct dio_trajectory path = {0};
	struct dio_error error = {0};

	(void)state;
	fixture_write("hand.tum", "# timestamp tx ty tz qx qy qz qw\r\n\r\n"
				  "0.5 1 2 3 0 0 0.7071068 0.7071068\r\n  \n"
				  "1.5\t1 2 3 0 0 -0.7071068 -0.7071068");
	if (dio_tum_read(fixture_path("hand.tum"), &path, &error) != DIO_OK)
		fail_msg("%s", error.text);
	assert_int_equal(path.count, 2);
	assert_float_equal(path.time_s[0], 0.5, 0);
	expect_pose(&path.poses[0], &wanted, 1e-7);
	expect_pose(&path.poses[1], &wanted, 1e-7);
	dio_trajectory_deinit(&path);
}

static void bad_lines_are_named(void **state)
{
	const struct {
		const char *text, *words;
	} bad[] = {
		{"", "no pose"},
		{"# only a comment\n", "no pose"},
		{"0 1 2 3 0 0 0 1\n1 1 2 3 0 0 0\n", "line 2: eight numbers"},
		{"0 1 2 3 0 0 0 1 9\n", "line 1: more than eight"},
		{"0 1 2 3 0 0 0 0.5\n", "line 1: the quaternion"},
		{"0 1 2 nan 0 0 0 1\n", "line 1: a number is not finite"},
		{"0 1 2 3 0 0 0 x\n", "line 1: eight numbers"},
	};

	(void)state;
	for (size_t i = 0; i < sizeof bad / sizeof *bad; i++) {
		struct dio_trajectory path = {0};
		struct dio_error error = {0};

		fixture_write("bad.tum", bad[i].text);
		assert_int_equal(dio_tum_read(fixture_path("bad.tum"), &path, &error),
				 DIO_BAD_FILE);
		if (!strstr(error.text, bad[i].words) || !strstr(error.text, "bad.tum"))
			fail_msg("\"%s\" is not in: %s", bad[i].words, error.text);
		assert_null(path.poses);
	}
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(known_rotations_have_their_quaternions),
		cmocka_unit_test(a_trajectory_comes_back),
		cmocka_unit_test(a_file_by_hand_is_read),
		cmocka_unit_test(bad_lines_are_named),
	};

	return cmocka_run_group_tests(tests, fixture_setup, fixture_teardown);
}
