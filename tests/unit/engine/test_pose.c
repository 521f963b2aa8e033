#include "geometry/pose.h"

#include <math.h>
#include <string.h>

#include "base/error.h"
#include "check.h"
#include "file_fixture.h"
#include "rig_fixture.h"

#define RIG 5

static void assert_same_pose(const struct dvsm_pose *a, const struct dvsm_pose *b, double tolerance)
{
	for (int i = 0; i < 9; i++)
		assert_true(fabs(a->rotation[i] - b->rotation[i]) <= tolerance);
	for (int i = 0; i < 3; i++)
		assert_true(fabs(a->centre[i] - b->centre[i]) <= tolerance);
}

static void assert_invariant(double angle_rad, double scale, const double move[3], double tolerance)
{
	/* The last camera is a target: it takes no part in the normalisation. */
	struct dvsm_camera rig[RIG + 1], moved[RIG + 1];
	rig_make_arc(rig, RIG + 1);
	memcpy(moved, rig, sizeof(rig));
	rig_transform(moved, RIG + 1, angle_rad, scale, move);
	struct dvsm_normalisation n = dvsm_normalisation_compute(rig, RIG);
	struct dvsm_normalisation m = dvsm_normalisation_compute(moved, RIG);
	for (int i = 0; i <= RIG; i++) {
		struct dvsm_pose a = dvsm_normalisation_apply(&n, rig[i].world_from_camera);
		struct dvsm_pose b = dvsm_normalisation_apply(&m, moved[i].world_from_camera);
		assert_same_pose(&a, &b, tolerance);
	}
}

static void moving_the_rig_changes_no_normalised_pose(void **state)
{
	(void)state;
	const double move[3] = {130, -20, 7.5};
	assert_invariant(0, 1, move, 1e-12);
}

static void turning_the_rig_changes_no_normalised_pose(void **state)
{
	(void)state;
	const double still[3] = {0, 0, 0};
	for (double angle = 0.3; angle < 6.3; angle += 0.7)
		assert_invariant(angle, 1, still, 1e-13);
}

static void scaling_the_rig_changes_no_normalised_pose(void **state)
{
	(void)state;
	const double still[3] = {0, 0, 0};
	assert_invariant(0, 1000, still, 1e-13);
	assert_invariant(0, 1e-6, still, 1e-13);
}

static void all_three_together_change_no_normalised_pose(void **state)
{
	(void)state;
	const double move[3] = {-4, 9, 2};
	assert_invariant(2.1, 0.01, move, 1e-12);
}

static void the_rig_fills_the_cube_to_its_margin(void **state)
{
	(void)state;
	struct dvsm_camera rig[RIG];
	rig_make_arc(rig, RIG);
	struct dvsm_normalisation n = dvsm_normalisation_compute(rig, RIG);
	double largest = 0, mean[3] = {0}, mean_z[3] = {0};
	for (int i = 0; i < RIG; i++) {
		struct dvsm_pose pose = dvsm_normalisation_apply(&n, rig[i].world_from_camera);
		for (int c = 0; c < 3; c++) {
			largest = fmax(largest, fabs(pose.centre[c]));
			mean[c] += pose.centre[c];
			mean_z[c] += pose.rotation[3 * c + 2];
		}
	}
	assert_true(fabs(largest - 1 / 1.35) < 1e-14);
	for (int c = 0; c < 3; c++)
		assert_true(fabs(mean[c]) < 1e-14);
	/* The mean viewing direction is the new z axis. */
	assert_true(fabs(mean_z[0]) < 1e-14 && fabs(mean_z[1]) < 1e-14 && mean_z[2] > 0);
}

static void views_and_cameras_give_the_same_normalisation(void **state)
{
	(void)state;
	struct dvsm_camera rig[RIG];
	struct dvsm_view views[RIG] = {0};
	rig_make_arc(rig, RIG);
	for (int i = 0; i < RIG; i++)
		views[i].camera = rig[i];
	struct dvsm_normalisation a = dvsm_normalisation_compute(rig, RIG);
	struct dvsm_normalisation b = dvsm_normalisation_from_views(views, RIG);
	assert_memory_equal(&a, &b, sizeof(a));
}

static void assert_first_camera_frame(const struct dvsm_camera *rig, uint32_t count)
{
	struct dvsm_normalisation n = dvsm_normalisation_compute(rig, count);
	const double *pose = rig[0].world_from_camera;
	for (int i = 0; i < 3; i++) {
		for (int j = 0; j < 3; j++)
			assert_true(fabs(n.axes[3 * i + j] - pose[4 * j + i]) < 1e-15);
	}
	assert_true(isfinite(n.scale) && n.scale > 0);
}

static void cameras_that_face_each_other_take_the_first_ones_axes(void **state)
{
	(void)state;
	const double left[3] = {-1, 0, 0}, right[3] = {1, 0, 0};
	const struct dvsm_camera rig[2] = {rig_camera(left, right), rig_camera(right, left)};
	assert_first_camera_frame(rig, 2);
}

static void a_mean_y_axis_along_z_takes_the_first_ones_axes(void **state)
{
	(void)state;
	/* z axes +-60 degrees about x from forward: the y axes' mean is parallel to their mean. */
	struct dvsm_camera rig[2];
	memset(rig, 0, sizeof(rig));
	for (int i = 0; i < 2; i++) {
		double *pose = rig[i].world_from_camera;
		double s = i ? -1 : 1, c = 0.5, k = sqrt(0.75);
		/* x = s e_x, z = c e_z + s k e_y, y = z cross x. */
		pose[0] = s;
		pose[6] = s * k;
		pose[10] = c;
		pose[5] = c * s;
		pose[9] = -k;
		pose[15] = 1;
		rig[i].width = rig[i].height = 32;
		rig[i].fx = rig[i].fy = 30;
		struct dvsm_error error = {""};
		if (dvsm_camera_check(&rig[i], "rig", &error) != DVSM_OK)
			fail_msg("%s", error.text);
	}
	assert_first_camera_frame(rig, 2);
}

static void a_single_camera_keeps_its_scale_and_becomes_the_frame(void **state)
{
	(void)state;
	const double eye[3] = {10, 20, 30}, target[3] = {0, 0, 0};
	const struct dvsm_camera camera = rig_camera(eye, target);
	struct dvsm_normalisation n = dvsm_normalisation_compute(&camera, 1);
	struct dvsm_pose pose = dvsm_normalisation_apply(&n, camera.world_from_camera);
	const struct dvsm_pose identity = {{1, 0, 0, 0, 1, 0, 0, 0, 1}, {0, 0, 0}};
	assert_true(n.scale == 1);
	assert_same_pose(&pose, &identity, 1e-15);
}

static void cameras_at_one_place_keep_their_scale_however_far_away(void **state)
{
	(void)state;
	struct dvsm_camera rig[7];
	for (unsigned count = 2; count <= 7; count++) {
		for (double away = 1; away <= 1e12; away *= 10) {
			const double eye[3] = {0.1 * away, 0.7 * away, -0.3 * away};
			for (unsigned i = 0; i < count; i++) {
				const double target[3] = {eye[0] + away, eye[1] + i * away, eye[2]};
				rig[i] = rig_camera(eye, target);
			}
			struct dvsm_normalisation n = dvsm_normalisation_compute(rig, count);
			assert_true(n.scale == 1);
			assert_memory_equal(n.origin, eye, sizeof(eye));
		}
	}
}

static void a_sound_camera_passes(void **state)
{
	(void)state;
	struct dvsm_camera rig[RIG];
	rig_make_arc(rig, RIG);
	for (int i = 0; i < RIG; i++)
		assert_int_equal(dvsm_camera_check(&rig[i], "view", NULL), DVSM_OK);
	/* Just inside the tolerance. */
	for (int i = 0; i < 3; i++)
		rig[0].world_from_camera[5 * i] *= 1.0004;
	assert_int_equal(dvsm_camera_check(&rig[0], "view", NULL), DVSM_OK);
}

static void assert_camera_refused(const struct dvsm_camera *camera, const char *needle)
{
	struct dvsm_error error = {""};
	assert_int_equal(dvsm_camera_check(camera, "view 7", &error), DVSM_BAD_ARG);
	assert_text_has(&error, "view 7: ");
	assert_text_has(&error, needle);
}

static void a_pose_that_is_not_rigid_is_refused(void **state)
{
	(void)state;
	struct dvsm_camera good, bad;
	rig_make_arc(&good, 1);
	bad = good;
	for (int i = 0; i < 3; i++) /* scaled */
		for (int j = 0; j < 3; j++)
			bad.world_from_camera[4 * i + j] *= 1.002;
	assert_camera_refused(&bad, "orthonormal");
	bad = good;
	memset(bad.world_from_camera, 0, 12 * sizeof(double)); /* singular */
	assert_camera_refused(&bad, "orthonormal");
	bad = good;
	for (int i = 0; i < 3; i++) /* mirrored */
		bad.world_from_camera[4 * i] *= -1;
	assert_camera_refused(&bad, "mirrored");
	bad = good;
	bad.world_from_camera[12] = 0.5;
	assert_camera_refused(&bad, "last row");
	bad = good;
	bad.world_from_camera[15] = 0;
	assert_camera_refused(&bad, "last row");
	bad = good;
	bad.world_from_camera[7] = NAN;
	assert_camera_refused(&bad, "row 1 column 3 is not finite");
	bad = good;
	bad.world_from_camera[3] = 1e300;
	assert_camera_refused(&bad, "beyond");
}

static void intrinsics_out_of_range_are_refused(void **state)
{
	(void)state;
	struct dvsm_camera good, bad;
	rig_make_arc(&good, 1);
	static const uint32_t sides[] = {0, 16385, UINT32_MAX};
	for (int i = 0; i < 3; i++) {
		bad = good;
		bad.width = sides[i];
		assert_camera_refused(&bad, "picture size");
		bad = good;
		bad.height = sides[i];
		assert_camera_refused(&bad, "picture size");
	}
	static const double focals[] = {0, -1, NAN, INFINITY, 1e-300, 1e300};
	for (int i = 0; i < 6; i++) {
		bad = good;
		bad.fx = focals[i];
		assert_camera_refused(&bad, "focal length");
		bad = good;
		bad.fy = focals[i];
		assert_camera_refused(&bad, "focal length");
	}
	static const double points[] = {NAN, -INFINITY, 1e300};
	for (int i = 0; i < 3; i++) {
		bad = good;
		bad.cx = points[i];
		assert_camera_refused(&bad, "principal point");
		bad = good;
		bad.cy = points[i];
		assert_camera_refused(&bad, "principal point");
	}
}

static void views_are_checked_one_by_one_and_named(void **state)
{
	(void)state;
	static float rgb[48 * 32 * 3];
	struct dvsm_camera rig[3];
	struct dvsm_view views[3];
	struct dvsm_error error = {""};
	rig_make_arc(rig, 3);
	for (int i = 0; i < 3; i++)
		views[i] = (struct dvsm_view){.camera = rig[i], .rgb = rgb};
	assert_int_equal(dvsm_views_check(views, 3, &error), DVSM_OK);
	assert_int_equal(dvsm_views_check(views, 0, &error), DVSM_BAD_ARG);
	assert_text_has(&error, "no context views");
	assert_int_equal(dvsm_views_check(NULL, 3, &error), DVSM_BAD_ARG);

	views[2].camera.fx = 0;
	assert_int_equal(dvsm_views_check(views, 3, &error), DVSM_BAD_ARG);
	assert_text_has(&error, "view 2: focal length");
	views[2].camera.fx = 30;
	views[1].rgb = NULL;
	assert_int_equal(dvsm_views_check(views, 3, &error), DVSM_BAD_ARG);
	assert_text_has(&error, "view 1: has no picture");
	views[1].rgb = rgb;
	rgb[(5 * 48 + 9) * 3 + 2] = NAN;
	assert_int_equal(dvsm_views_check(views, 3, &error), DVSM_BAD_ARG);
	assert_text_has(&error, "view 0: pixel (9, 5) channel 2 is nan");
	rgb[(5 * 48 + 9) * 3 + 2] = 255;
	assert_int_equal(dvsm_views_check(views, 3, &error), DVSM_BAD_ARG);
	assert_text_has(&error, "divide 8-bit values by 255");
	rgb[(5 * 48 + 9) * 3 + 2] = -0.1f;
	assert_int_equal(dvsm_views_check(views, 3, &error), DVSM_OK);
}

static void a_target_in_another_unit_is_refused(void **state)
{
	(void)state;
	struct dvsm_camera rig[RIG];
	rig_make_arc(rig, RIG);
	struct dvsm_normalisation n = dvsm_normalisation_compute(rig, RIG);
	struct dvsm_camera target = rig[2];
	struct dvsm_error error = {""};
	target.world_from_camera[3] = 1e6;
	assert_int_equal(dvsm_target_check(&target, &n, "target camera", &error), DVSM_OK);
	target.world_from_camera[3] = -1e11;
	assert_int_equal(dvsm_target_check(&target, &n, "target camera", &error), DVSM_BAD_ARG);
	assert_text_has(&error, "target camera: stands");
	target.fx = 0;
	assert_int_equal(dvsm_target_check(&target, &n, "target camera", &error), DVSM_BAD_ARG);
	assert_text_has(&error, "target camera: focal length");
}

static void an_error_text_is_one_line_whatever_a_file_brings(void **state)
{
	(void)state;
	struct dvsm_error error;
	assert_int_equal(dvsm_fail(&error, DVSM_IO, "a%sb", "\n\x1b[2J\t"), DVSM_IO);
	assert_string_equal(error.text, "a??[2J?b");
	assert_int_equal(dvsm_fail(NULL, DVSM_NO_MEM, "x"), DVSM_NO_MEM);
	for (int i = DVSM_OK; i <= DVSM_CANCELLED; i++)
		assert_string_not_equal(dvsm_status_text((enum dvsm_status)i), "unknown status");
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(moving_the_rig_changes_no_normalised_pose),
		cmocka_unit_test(turning_the_rig_changes_no_normalised_pose),
		cmocka_unit_test(scaling_the_rig_changes_no_normalised_pose),
		cmocka_unit_test(all_three_together_change_no_normalised_pose),
		cmocka_unit_test(the_rig_fills_the_cube_to_its_margin),
		cmocka_unit_test(views_and_cameras_give_the_same_normalisation),
		cmocka_unit_test(cameras_that_face_each_other_take_the_first_ones_axes),
		cmocka_unit_test(a_mean_y_axis_along_z_takes_the_first_ones_axes),
		cmocka_unit_test(a_single_camera_keeps_its_scale_and_becomes_the_frame),
		cmocka_unit_test(cameras_at_one_place_keep_their_scale_however_far_away),
		cmocka_unit_test(a_sound_camera_passes),
		cmocka_unit_test(a_pose_that_is_not_rigid_is_refused),
		cmocka_unit_test(intrinsics_out_of_range_are_refused),
		cmocka_unit_test(views_are_checked_one_by_one_and_named),
		cmocka_unit_test(a_target_in_another_unit_is_refused),
		cmocka_unit_test(an_error_text_is_one_line_whatever_a_file_brings),
	};
	return cmocka_run_group_tests(tests, NULL, NULL);
}
