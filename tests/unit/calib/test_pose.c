/* Poses, undistortion and metrics against cameras and pictures that are known. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "support.h"

static const struct dio_camera_model camera = {
	640, 480, 620, 615, 325, 236, {-0.22, 0.08, 0.0006, -0.0004, 0},
};

static double turn_deg(const struct dio_pose *a, const struct dio_pose *b)
{
	double trace = 0;

	for (int i = 0; i < 3; i++)
		for (int j = 0; j < 3; j++)
			trace += a->world_from_camera[4 * i + j] * b->world_from_camera[4 * i + j];
	return acos(fmax(-1, fmin(1, (trace - 1) / 2))) * 180 / M_PI;
}

static double shift_m(const struct dio_pose *a, const struct dio_pose *b)
{
	double sum = 0;

	for (int i = 0; i < 3; i++)
		sum += pow(a->world_from_camera[4 * i + 3] - b->world_from_camera[4 * i + 3], 2);
	return sqrt(sum);
}

static void known_pose_is_found(const char *spec, double noise_px)
{
	struct dio_board board = board_of(spec);
	uint64_t seed = 3;

	for (int i = 0; i < 24; i++) {
		struct dio_pose truth =
			orbit(15 * i, 35 + 10 * (i % 5), 0.4 + 0.03 * (i % 4), 25.0 * i);
		struct dio_pose_estimate estimate = {0};
		struct dio_corners corners = {0};
		struct dio_error error = {""};

		project_corners(&board, &camera, &truth, noise_px, &seed, &corners);
		if (dio_pose_from_corners(&board, &camera, &corners, &estimate, &error) != DIO_OK)
			fail_msg("view %d: %s", i, error.text);
		assert_int_equal(estimate.corners, corners.count);
		assert_true(estimate.rms_px < 1e-3 + 1.6 * noise_px);
		assert_true(turn_deg(&estimate.pose, &truth) < 0.005 + 1.5 * noise_px);
		assert_true(shift_m(&estimate.pose, &truth) < 1e-5 + 0.012 * noise_px);
		assert_true(estimate.pose.world_from_camera[15] == 1);
		dio_corners_deinit(&corners);
	}
}

static void exact_corners_give_the_exact_pose(void **state)
{
	(void)state;
	known_pose_is_found("charuco:9x7:0.025:0.018:DICT_5X5_100", 0);
	known_pose_is_found("chessboard:9x6:0.025", 0);
}

static void noisy_corners_give_a_near_pose(void **state)
{
	(void)state;
	known_pose_is_found("charuco:9x7:0.025:0.018:DICT_5X5_100", 0.2);
	known_pose_is_found("chessboard:8x6:0.025", 0.2);
}

static void world_has_z_up_and_its_origin_at_the_centre(void **state)
{
	struct dio_board board = board_of("charuco:8x6:0.03:0.02:DICT_4X4_50:modern");
	/* Straight above, top of the picture towards +y: columns run right, rows down. */
	const double eye[3] = {0, 0, 0.5}, centre[3] = {0, 0, 0};
	const struct dio_camera_model pinhole = {640, 480, 600, 600, 319.5, 239.5, {0}};
	struct dio_pose pose = look_at(eye, centre, 0);
	float px[64][2];
	uint32_t count = 0;

	(void)state;
	assert_int_equal(dio_pose_project_board(&board, &pinhole, &pose, px, 64, &count), DIO_OK);
	assert_int_equal(count, 7 * 5);
	/* The middle corner of 7 x 5 is the board's centre. */
	assert_true(fabs(px[17][0] - 319.5) < 0.01 && fabs(px[17][1] - 239.5) < 0.01);
	/* Three columns left, two rows up: 90 and 60 mm at half a metre. */
	assert_true(fabs(px[0][0] - (319.5 - 108)) < 0.2 && fabs(px[0][1] - (239.5 - 72)) < 0.2);
	assert_int_equal(dio_pose_project_board(&board, &pinhole, &pose, px, 34, &count),
			 DIO_BAD_ARG);
}

static void rendered_board_is_posed(void **state)
{
	struct dio_board board = board_of("charuco:9x6:0.025:0.018:DICT_5X5_100:legacy");
	struct dio_board_detector *detector = NULL;
	struct dio_pose truth = orbit(40, 50, 0.45, 15);
	struct dio_picture picture = {0};
	struct dio_corners corners = {0};
	struct dio_pose_estimate estimate = {0};

	(void)state;
	render_board(&board, &camera, &truth, &picture);
	assert_int_equal(dio_board_detector_create(&board, &detector, NULL), DIO_OK);
	assert_int_equal(dio_board_detect(detector, &picture, &corners, NULL), DIO_OK);
	assert_int_equal(dio_pose_from_corners(&board, &camera, &corners, &estimate, NULL), DIO_OK);
	print_message("rendered: %.4f degrees, %.3f mm off\n", turn_deg(&estimate.pose, &truth),
		      1e3 * shift_m(&estimate.pose, &truth));
	assert_true(turn_deg(&estimate.pose, &truth) < 0.1);
	assert_true(shift_m(&estimate.pose, &truth) < 0.0005);
	dio_corners_deinit(&corners);
	dio_picture_deinit(&picture);
	dio_board_detector_destroy(detector);
}

static enum dio_status pose_of(const struct dio_board *board, const struct dio_camera_model *model,
			       const struct dio_corners *corners, struct dio_error *error)
{
	struct dio_pose_estimate estimate = {.corners = 4711};
	enum dio_status status = dio_pose_from_corners(board, model, corners, &estimate, error);

	if (status != DIO_OK)
		assert_int_equal(estimate.corners, 4711);
	return status;
}

static void too_few_or_collinear_corners_are_refused(void **state)
{
	struct dio_board board = board_of("chessboard:9x6:0.025");
	struct dio_pose pose = orbit(40, 50, 0.45, 15);
	struct dio_corners corners = {0};
	struct dio_error error = {""};
	uint64_t seed = 1;

	(void)state;
	project_corners(&board, &camera, &pose, 0, &seed, &corners);
	corners.count = 5;
	assert_int_equal(pose_of(&board, &camera, &corners, &error), DIO_REFUSED);
	assert_non_null(strstr(error.text, "5 corners"));
	corners.count = 9;
	assert_int_equal(pose_of(&board, &camera, &corners, &error), DIO_REFUSED);
	assert_non_null(strstr(error.text, "line"));
	dio_corners_deinit(&corners);
}

static void far_board_whose_tilt_cannot_be_told_is_refused(void **state)
{
	struct dio_board board = board_of("chessboard:9x6:0.025");
	uint32_t refused = 0, wrong = 0;
	uint64_t seed = 9;

	(void)state;
	/* 12 metres away the board is 12 pixels wide: perspective is lost in the noise. */
	for (int i = 0; i < 20; i++) {
		struct dio_pose truth = orbit(18 * i, 65, 12, 0);
		struct dio_pose_estimate estimate = {0};
		struct dio_corners corners = {0};

		project_corners(&board, &camera, &truth, 0.2, &seed, &corners);
		if (dio_pose_from_corners(&board, &camera, &corners, &estimate, NULL) ==
		    DIO_REFUSED)
			refused++;
		else
			wrong += turn_deg(&estimate.pose, &truth) > 20;
		dio_corners_deinit(&corners);
	}
	print_message("%u of 20 refused, %u of the others flipped\n", refused, wrong);
	assert_true(refused >= 15);
	assert_int_equal(wrong, 0);
}

static void camera_model_without_a_focal_length_is_refused(void **state)
{
	struct dio_board board = board_of("chessboard:9x6:0.025");
	struct dio_pose pose = orbit(40, 50, 0.45, 15);
	struct dio_corners corners = {0};
	struct dio_error error = {""};
	struct dio_camera_model model = camera;
	uint64_t seed = 1;

	(void)state;
	project_corners(&board, &camera, &pose, 0, &seed, &corners);
	model.fy = 0;
	assert_int_equal(pose_of(&board, &model, &corners, &error), DIO_BAD_ARG);
	assert_non_null(strstr(error.text, "focal length"));
	model = camera;
	model.dist[4] = NAN;
	assert_int_equal(pose_of(&board, &model, &corners, &error), DIO_BAD_ARG);
	dio_corners_deinit(&corners);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(exact_corners_give_the_exact_pose),
		cmocka_unit_test(noisy_corners_give_a_near_pose),
		cmocka_unit_test(world_has_z_up_and_its_origin_at_the_centre),
		cmocka_unit_test(rendered_board_is_posed),
		cmocka_unit_test(too_few_or_collinear_corners_are_refused),
		cmocka_unit_test(far_board_whose_tilt_cannot_be_told_is_refused),
		cmocka_unit_test(camera_model_without_a_focal_length_is_refused),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
