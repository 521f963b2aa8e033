/* Calibration and poses of real pictures with published results (calibration/<set>/reference.json).
 */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>

#include "support.h"

static void calibrate_set(struct corner_set *set, struct dio_calibration *calibration)
{
	struct dio_error error = {""};

	if (dio_calibrate(&set->board, set->corners, set->count, set->width, set->height, NULL,
			  calibration, &error) != DIO_OK)
		fail_msg("%s", error.text);
	print_message(
		"f %.2f %.2f (sigma %.2f %.2f) rms %.4f held out %.4f, coverage %.2f, tilt %.0f\n",
		calibration->model.fx, calibration->model.fy, calibration->sigma_fx,
		calibration->sigma_fy, calibration->rms_px, calibration->heldout_rms_px,
		calibration->coverage, calibration->tilt_deg);
}

static void load(struct corner_set *set, const char *spec, const char *folder, const char *prefix)
{
	char buffer[512];

	if (!shared_folder(folder, buffer, sizeof(buffer)))
		skip();
	corner_set_load(set, spec, buffer, prefix);
}

static void opencv_left_set_calibrates_to_its_reference(void **state)
{
	struct corner_set set;
	struct dio_calibration calibration = {0};

	(void)state;
	load(&set, "chessboard:9x6:0.025", "data/calibration/opencv_left_right/images", "left");
	calibrate_set(&set, &calibration);
	assert_true(fabs(calibration.model.fx - 532.8) <= 1.5);
	assert_true(fabs(calibration.model.fy - 532.8) <= 1.5);
	assert_true(calibration.rms_px <= 0.21);
	assert_int_equal(calibration.views_used, 13);
	dio_calibration_deinit(&calibration);
	corner_set_free(&set);
}

static void opencv_right_set_calibrates_near_its_reference(void **state)
{
	struct corner_set set;
	struct dio_calibration calibration = {0};

	(void)state;
	load(&set, "chessboard:9x6:0.025", "data/calibration/opencv_left_right/images", "right");
	calibrate_set(&set, &calibration);
	assert_true(fabs(calibration.model.fx - 537.45) <= 1.5);
	assert_true(fabs(calibration.model.fy - 536.97) <= 1.5);
	assert_true(calibration.rms_px <= 0.21);
	dio_calibration_deinit(&calibration);
	corner_set_free(&set);
}

static void boofcv_chess_set_calibrates_to_its_reference(void **state)
{
	struct corner_set set;
	struct dio_calibration calibration = {0};

	(void)state;
	load(&set, "chessboard:4x6:0.030", "data/calibration/boofcv_sony_chess/images", "frame");
	calibrate_set(&set, &calibration);
	assert_true(fabs(calibration.model.fx - 701.01) <= 0.8);
	assert_true(fabs(calibration.model.fy - 698.65) <= 0.8);
	assert_int_equal(calibration.views_used, 13);
	dio_calibration_deinit(&calibration);
	corner_set_free(&set);
}

static void charuco_photos_calibrate_and_are_posed(void **state)
{
	struct corner_set set;
	struct dio_calibration calibration = {0};
	uint32_t posed = 0;

	(void)state;
	load(&set, "charuco:10x7:0.0285:0.0171:DICT_6X6_250:legacy",
	     "data/calibration/charuco_remote_a_full/images", "");
	assert_int_equal(set.count, 21);
	calibrate_set(&set, &calibration);
	assert_true(calibration.model.fx > 1440 && calibration.model.fx < 1580);
	assert_true(calibration.rms_px < 1.65);
	for (uint32_t i = 0; i < set.count; i++) {
		struct dio_pose_estimate estimate = {0};

		if (dio_pose_from_corners(&set.board, &calibration.model, &set.corners[i],
					  &estimate, NULL) != DIO_OK)
			continue;
		posed++;
		assert_true(estimate.rms_px < 3);
		/* All photos are taken from above the table, 30 to 50 cm away. */
		assert_true(estimate.pose.world_from_camera[11] > 0.3);
		assert_true(estimate.pose.world_from_camera[11] < 0.5);
	}
	assert_true(posed >= 19);
	dio_calibration_deinit(&calibration);
	corner_set_free(&set);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(opencv_left_set_calibrates_to_its_reference),
		cmocka_unit_test(opencv_right_set_calibrates_near_its_reference),
		cmocka_unit_test(boofcv_chess_set_calibrates_to_its_reference),
		cmocka_unit_test(charuco_photos_calibrate_and_are_posed),
	};
	const char *shared = getenv("DIO_SHARED_DIR");
	char folder[512];

	if (!shared || !shared_folder("data/calibration", folder, sizeof(folder)))
		return 77;
	return cmocka_run_group_tests(tests, NULL, NULL);
}
