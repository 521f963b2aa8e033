/* Undistortion to the engine's pinhole camera, and the picture metrics. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "support.h"

static const struct dio_camera_model camera = {
	640, 480, 620, 615, 331, 229, {-0.25, 0.1, 0.0006, -0.0004, 0},
};

static struct dio_undistorter *create(const struct dio_camera_model *model, uint32_t width,
				      uint32_t height, struct dio_camera_model *pinhole)
{
	struct dio_undistorter *undistorter = NULL;
	struct dio_error error = {""};

	if (dio_undistorter_create(model, width, height, pinhole, &undistorter, &error) != DIO_OK)
		fail_msg("%s", error.text);
	return undistorter;
}

static void pinhole_has_square_pixels_and_a_centred_axis(void **state)
{
	const uint32_t sizes[][2] = {{640, 480}, {256, 256}, {64, 64}, {200, 400}};

	(void)state;
	for (size_t i = 0; i < sizeof(sizes) / sizeof(sizes[0]); i++) {
		struct dio_camera_model pinhole;
		struct dio_undistorter *undistorter =
			create(&camera, sizes[i][0], sizes[i][1], &pinhole);

		assert_int_equal(pinhole.width, sizes[i][0]);
		assert_int_equal(pinhole.height, sizes[i][1]);
		assert_true(pinhole.fx == pinhole.fy);
		assert_true(pinhole.cx == (sizes[i][0] - 1) / 2.0);
		assert_true(pinhole.cy == (sizes[i][1] - 1) / 2.0);
		for (int k = 0; k < 5; k++)
			assert_true(pinhole.dist[k] == 0);
		dio_undistorter_destroy(undistorter);
	}
}

static void lens_without_distortion_is_left_as_it_is(void **state)
{
	const struct dio_camera_model straight = {64, 48, 60, 60, 31.5, 23.5, {0}};
	struct dio_camera_model pinhole;
	struct dio_undistorter *undistorter = create(&straight, 64, 48, &pinhole);
	struct dio_picture in = {0}, out = {0};
	uint64_t seed = 4;

	(void)state;
	assert_true(fabs(pinhole.fx - 60) < 1e-6);
	assert_int_equal(dio_picture_init(&in, 64, 48), DIO_OK);
	for (size_t i = 0; i < 3 * 64 * 48; i++)
		in.rgb[i] = (uint8_t)fmax(0, fmin(255, 128 + 60 * noise(&seed)));
	assert_int_equal(dio_undistorter_apply(undistorter, &in, &out, NULL), DIO_OK);
	assert_memory_equal(in.rgb, out.rgb, 3 * 64 * 48);
	dio_picture_deinit(&in);
	dio_picture_deinit(&out);
	dio_undistorter_destroy(undistorter);
}

/* White inside, so that any sample from outside would show as darker. */
static void field_of_view_is_the_largest_fully_covered(void **state)
{
	const double k1[] = {-0.25, 0.2, -0.05};

	(void)state;
	for (size_t i = 0; i < 3; i++) {
		struct dio_camera_model model = camera, pinhole;
		struct dio_undistorter *undistorter;
		double nearest = 1e9;

		model.dist[0] = k1[i];
		undistorter = create(&model, 320, 240, &pinhole);
		/* Some border pixel must map to the border of the distorted picture, none beyond.
		 */
		for (int j = 0; j <= 2000; j++) {
			double along = (j % 501) / 500.0;
			double u = j % 4 == 0 ? -0.5 : j % 4 == 1 ? 319.5 : 320 * along - 0.5;
			double v = j % 4 == 2 ? -0.5 : j % 4 == 3 ? 239.5 : 240 * along - 0.5;
			double x = (u - pinhole.cx) / pinhole.fx, y = (v - pinhole.cy) / pinhole.fy;
			double r2 = x * x + y * y;
			double radial = 1 + r2 * (model.dist[0] +
						  r2 * (model.dist[1] + r2 * model.dist[4]));
			double xd = x * radial + 2 * model.dist[2] * x * y +
				    model.dist[3] * (r2 + 2 * x * x);
			double yd = y * radial + model.dist[2] * (r2 + 2 * y * y) +
				    2 * model.dist[3] * x * y;
			double ud = model.fx * xd + model.cx, vd = model.fy * yd + model.cy;

			nearest = fmin(nearest, fmin(fmin(ud, 639 - ud), fmin(vd, 479 - vd)) + 0.5);
		}
		print_message("k1 %.2f: focal length %.1f, margin %.3f px\n", k1[i], pinhole.fx,
			      nearest);
		assert_true(nearest > -0.02 && nearest < 0.2);
		dio_undistorter_destroy(undistorter);
	}
}

static void straight_lines_of_the_board_become_straight(void **state)
{
	struct dio_board board = board_of("chessboard:9x6:0.025");
	struct dio_pose pose = orbit(280, 60, 0.33, 5);
	struct dio_camera_model pinhole;
	struct dio_undistorter *undistorter = create(&camera, 640, 480, &pinhole);
	struct dio_board_detector *detector = NULL;
	struct dio_picture seen = {0}, straight = {0};
	struct dio_corners corners = {0};
	float expected[64][2];
	uint32_t count;
	double worst = 0;

	(void)state;
	render_board(&board, &camera, &pose, &seen);
	assert_int_equal(dio_undistorter_apply(undistorter, &seen, &straight, NULL), DIO_OK);
	assert_int_equal(dio_board_detector_create(&board, &detector, NULL), DIO_OK);
	assert_int_equal(dio_board_detect(detector, &straight, &corners, NULL), DIO_OK);
	assert_int_equal(corners.count, 54);
	assert_int_equal(dio_pose_project_board(&board, &pinhole, &pose, expected, 64, &count),
			 DIO_OK);
	for (uint32_t i = 0; i < corners.count; i++)
		worst = fmax(worst, hypot(corners.image_px[i][0] - expected[corners.ids[i]][0],
					  corners.image_px[i][1] - expected[corners.ids[i]][1]));
	print_message("worst corner %.3f px from the pinhole's projection\n", worst);
	assert_true(worst < 0.2);
	dio_corners_deinit(&corners);
	dio_board_detector_destroy(detector);
	dio_picture_deinit(&seen);
	dio_picture_deinit(&straight);
	dio_undistorter_destroy(undistorter);
}

static void shrinking_averages_instead_of_aliasing(void **state)
{
	const struct dio_camera_model large = {
		640, 480, 620, 620, 319.5, 239.5, {-0.1, 0, 0, 0, 0}};
	struct dio_camera_model pinhole;
	struct dio_undistorter *undistorter = create(&large, 32, 24, &pinhole);
	struct dio_picture in = {0}, out = {0};

	(void)state;
	assert_int_equal(dio_picture_init(&in, 640, 480), DIO_OK);
	/* Single-pixel stripes: any fair average is mid grey. */
	for (uint32_t i = 0; i < 640 * 480; i++)
		memset(in.rgb + 3 * (size_t)i, i % 2 ? 255 : 0, 3);
	assert_int_equal(dio_undistorter_apply(undistorter, &in, &out, NULL), DIO_OK);
	for (uint32_t i = 0; i < 3 * 32 * 24; i++)
		assert_in_range(out.rgb[i], 108, 148);
	dio_picture_deinit(&in);
	dio_picture_deinit(&out);
	dio_undistorter_destroy(undistorter);
}

static void picture_of_another_size_is_refused(void **state)
{
	struct dio_camera_model pinhole;
	struct dio_undistorter *undistorter = create(&camera, 64, 64, &pinhole);
	struct dio_picture in = {0}, out = {0};
	struct dio_error error = {""};

	(void)state;
	assert_int_equal(dio_picture_init(&in, 639, 480), DIO_OK);
	assert_int_equal(dio_undistorter_apply(undistorter, &in, &out, &error), DIO_BAD_ARG);
	assert_non_null(strstr(error.text, "639x480"));
	assert_non_null(strstr(error.text, "640x480"));
	assert_null(out.rgb);
	dio_picture_deinit(&in);
	dio_undistorter_destroy(undistorter);
}

static void models_that_cannot_be_undistorted_are_refused(void **state)
{
	struct dio_camera_model models[] = {camera, camera, camera};
	struct dio_undistorter *undistorter = NULL;
	struct dio_camera_model pinhole;

	(void)state;
	models[0].fx = -1;
	models[1].cx = 5000;
	models[2].width = 0;
	for (size_t i = 0; i < 3; i++) {
		struct dio_error error = {""};

		assert_int_equal(
			dio_undistorter_create(&models[i], 64, 64, &pinhole, &undistorter, &error),
			DIO_BAD_ARG);
		assert_true(strlen(error.text) > 0);
	}
	assert_int_equal(dio_undistorter_create(&camera, 0, 64, &pinhole, &undistorter, NULL),
			 DIO_BAD_ARG);
	assert_null(undistorter);
}

/* The pictures of the metric tests, on which eval/baselines.py gave the expected numbers. */
static void fill(struct dio_picture *a, struct dio_picture *b)
{
	uint32_t random = 12345;

	assert_int_equal(dio_picture_init(a, 48, 40), DIO_OK);
	assert_int_equal(dio_picture_init(b, 48, 40), DIO_OK);
	for (uint32_t y = 0; y < 40; y++)
		for (uint32_t x = 0; x < 48; x++)
			for (uint32_t c = 0; c < 3; c++) {
				size_t at = 3 * (y * 48 + x) + c;

				random = random * 1664525u + 1013904223u;
				a->rgb[at] = (uint8_t)((x * 5 + y * 3 * (c + 1)) % 256);
				b->rgb[at] = (uint8_t)((a->rgb[at] * 7 + (random >> 24)) / 8);
			}
}

static void metrics_agree_with_the_reference_script(void **state)
{
	struct dio_picture a = {0}, b = {0};

	(void)state;
	fill(&a, &b);
	print_message("psnr %.6f ssim %.6f\n", dio_metrics_psnr(&a, &b), dio_metrics_ssim(&a, &b));
	assert_true(fabs(dio_metrics_psnr(&a, &b) - 25.826093) < 1e-3);
	assert_true(fabs(dio_metrics_ssim(&a, &b) - 0.896286) < 1e-4);
	dio_picture_deinit(&a);
	dio_picture_deinit(&b);
}

static void equal_pictures_score_highest(void **state)
{
	struct dio_picture a = {0}, b = {0};

	(void)state;
	fill(&a, &b);
	assert_true(fabs(dio_metrics_psnr(&a, &a) - 120) < 1e-9);
	assert_true(fabs(dio_metrics_ssim(&a, &a) - 1) < 1e-6);
	b.height = 39;
	assert_true(isnan(dio_metrics_psnr(&a, &b)));
	assert_true(isnan(dio_metrics_ssim(&a, &b)));
	dio_picture_deinit(&a);
	dio_picture_deinit(&b);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(pinhole_has_square_pixels_and_a_centred_axis),
		cmocka_unit_test(lens_without_distortion_is_left_as_it_is),
		cmocka_unit_test(field_of_view_is_the_largest_fully_covered),
		cmocka_unit_test(straight_lines_of_the_board_become_straight),
		cmocka_unit_test(shrinking_averages_instead_of_aliasing),
		cmocka_unit_test(picture_of_another_size_is_refused),
		cmocka_unit_test(models_that_cannot_be_undistorted_are_refused),
		cmocka_unit_test(metrics_agree_with_the_reference_script),
		cmocka_unit_test(equal_pictures_score_highest),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
