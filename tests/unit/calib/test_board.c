/* Board specifications, drawings and detection in synthetic pictures with known truth. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "support.h"

static const struct dio_camera_model camera = {
	640, 480, 620, 615, 325, 236, {-0.22, 0.08, 0.0006, -0.0004, 0},
};

static void refuse(const char *spec, const char *part)
{
	struct dio_board board = {.cols = 77};
	struct dio_error error = {""};

	assert_int_equal(dio_board_parse(spec, &board, &error), DIO_BAD_ARG);
	assert_int_equal(board.cols, 77);
	if (!strstr(error.text, part))
		fail_msg("'%s' does not name '%s'", error.text, part);
}

static void specification_is_read_and_written_back(void **state)
{
	const char *specs[] = {
		"charuco:10x7:0.0285:0.0171:DICT_6X6_250",
		"charuco:10x8:0.0285:0.0171:DICT_6X6_250:legacy",
		"charuco:5x4:0.04:0.03:DICT_4X4_50:modern",
		"chessboard:9x6:0.025",
	};

	(void)state;
	for (size_t i = 0; i < sizeof(specs) / sizeof(specs[0]); i++) {
		struct dio_board board = board_of(specs[i]);
		char text[128];

		dio_board_format(&board, text, sizeof(text));
		assert_string_equal(text, specs[i]);
	}
	struct dio_board board = board_of(specs[0]);
	assert_int_equal(board.cols, 10);
	assert_int_equal(board.rows, 7);
	assert_int_equal(board.dictionary, 10);
	assert_int_equal(board.layout, DIO_LAYOUT_AUTO);
}

static void unreadable_specification_is_refused_by_its_part(void **state)
{
	(void)state;
	refuse("", "kind");
	refuse("checkers:9x6:0.025", "checkers");
	refuse("chessboard", "COLSxROWS");
	refuse("chessboard:9x6", "COLSxROWS");
	refuse("chessboard:9by6:0.025", "9by6");
	refuse("chessboard:-9x6:0.025", "-9x6");
	refuse("chessboard:2x6:0.025", "2x6");
	refuse("chessboard:99999999999x6:0.025", "99999999999x6");
	refuse("chessboard:9x6:nan", "nan");
	refuse("chessboard:9x6:25mm", "25mm");
	refuse("chessboard:9x6:0", "0");
	refuse("chessboard:9x6:0.025:extra", "extra");
	refuse("charuco:10x7:0.0285", "DICTIONARY");
	refuse("charuco:10x7:0.0285:0.03:DICT_6X6_250", "0.03");
	refuse("charuco:10x7:0.0285:0.0171:DICT_9X9_1", "DICT_9X9_1");
	refuse("charuco:20x20:0.0285:0.0171:DICT_6X6_50", "larger dictionary");
	refuse("charuco:10x7:0.0285:0.0171:DICT_6X6_250:ancient", "ancient");
	refuse("charuco:10x7:0.0285:0.0171:DICT_6X6_250:legacy:x", "COLSxROWS");
	assert_int_equal(dio_board_parse(NULL, NULL, NULL), DIO_BAD_ARG);
}

/* Draws, renders, detects; answers the largest and the RMS distance from the truth in pixels. */
static void detect_rendered(const struct dio_board *drawn, const struct dio_board *searched,
			    const struct dio_pose *pose, struct dio_corners *corners,
			    double *worst_px, double *rms_px)
{
	struct dio_board_detector *detector = NULL;
	struct dio_picture picture = {0};
	struct dio_error error = {""};
	float truth[512][2];
	uint32_t count = 0;

	render_board(drawn, &camera, pose, &picture);
	assert_int_equal(dio_board_detector_create(searched, &detector, &error), DIO_OK);
	assert_int_equal(dio_board_detect(detector, &picture, corners, &error), DIO_OK);
	assert_int_equal(dio_pose_project_board(drawn, &camera, pose, truth, 512, &count), DIO_OK);
	*worst_px = *rms_px = 0;
	for (uint32_t i = 0; i < corners->count; i++) {
		const float *at = corners->image_px[i], *is = truth[corners->ids[i]];
		double distance = hypot(at[0] - is[0], at[1] - is[1]);

		*worst_px = fmax(*worst_px, distance);
		*rms_px += distance * distance / corners->count;
	}
	*rms_px = sqrt(*rms_px);
	dio_board_detector_destroy(detector);
	dio_picture_deinit(&picture);
}

static void check_detection(const char *drawn_spec, const char *searched_spec,
			    enum dio_board_layout layout)
{
	struct dio_board drawn = board_of(drawn_spec), searched = board_of(searched_spec);
	const double views[][4] = {
		{10, 80, 0.45, 0},
		{60, 50, 0.5, 30},
		{200, 55, 0.42, -20},
		{300, 45, 0.5, 170},
	};
	uint32_t extra = drawn.kind == DIO_BOARD_CHESSBOARD ? 1 : 0;
	uint32_t expected = (drawn.cols - 1 + extra) * (drawn.rows - 1 + extra);

	for (size_t i = 0; i < sizeof(views) / sizeof(views[0]); i++) {
		struct dio_pose pose = orbit(views[i][0], views[i][1], views[i][2], views[i][3]);
		struct dio_corners corners = {0};
		double worst_px, rms_px;

		detect_rendered(&drawn, &searched, &pose, &corners, &worst_px, &rms_px);
		print_message("%s view %zu: %u corners, rms %.3f px, worst %.3f px\n", drawn_spec,
			      i, corners.count, rms_px, worst_px);
		assert_true(corners.count >= expected * 9 / 10);
		assert_true(rms_px < 0.1);
		assert_true(worst_px < 0.35);
		assert_int_equal(corners.layout, layout);
		dio_corners_deinit(&corners);
	}
}

static void charuco_corners_are_found_where_they_are(void **state)
{
	(void)state;
	check_detection("charuco:9x7:0.025:0.018:DICT_5X5_100",
			"charuco:9x7:0.025:0.018:DICT_5X5_100", DIO_LAYOUT_MODERN);
}

static void modern_layout_of_even_rows_is_told_from_the_picture(void **state)
{
	(void)state;
	check_detection("charuco:9x6:0.025:0.018:DICT_5X5_100:modern",
			"charuco:9x6:0.025:0.018:DICT_5X5_100", DIO_LAYOUT_MODERN);
}

static void legacy_layout_of_even_rows_is_told_from_the_picture(void **state)
{
	(void)state;
	check_detection("charuco:9x6:0.025:0.018:DICT_5X5_100:legacy",
			"charuco:9x6:0.025:0.018:DICT_5X5_100", DIO_LAYOUT_LEGACY);
	check_detection("charuco:10x8:0.022:0.016:DICT_4X4_50:legacy",
			"charuco:10x8:0.022:0.016:DICT_4X4_50", DIO_LAYOUT_LEGACY);
}

static void detector_remembers_the_layout_it_saw(void **state)
{
	struct dio_board drawn = board_of("charuco:9x6:0.025:0.018:DICT_5X5_100:legacy");
	struct dio_board searched = board_of("charuco:9x6:0.025:0.018:DICT_5X5_100");
	struct dio_board_detector *detector = NULL;
	struct dio_picture picture = {0};
	struct dio_corners corners = {0};
	struct dio_pose pose = orbit(30, 60, 0.45, 0);

	(void)state;
	render_board(&drawn, &camera, &pose, &picture);
	assert_int_equal(dio_board_detector_create(&searched, &detector, NULL), DIO_OK);
	assert_int_equal(dio_board_detector_get_board(detector)->layout, DIO_LAYOUT_AUTO);
	assert_int_equal(dio_board_detect(detector, &picture, &corners, NULL), DIO_OK);
	assert_int_equal(dio_board_detector_get_board(detector)->layout, DIO_LAYOUT_LEGACY);
	dio_corners_deinit(&corners);
	dio_picture_deinit(&picture);
	dio_board_detector_destroy(detector);
}

static void wrong_layout_stated_finds_no_board_instead_of_wrong_corners(void **state)
{
	struct dio_board drawn = board_of("charuco:10x8:0.022:0.016:DICT_4X4_50:legacy");
	struct dio_board searched = board_of("charuco:10x8:0.022:0.016:DICT_4X4_50:modern");
	struct dio_pose pose = orbit(30, 60, 0.45, 0);
	struct dio_corners corners = {0};
	double worst_px, rms_px;

	(void)state;
	detect_rendered(&drawn, &searched, &pose, &corners, &worst_px, &rms_px);
	assert_true(corners.count < 6);
	dio_corners_deinit(&corners);
}

static void chessboard_corners_are_found_in_board_order(void **state)
{
	(void)state;
	/* An odd sum tells the two ends apart, so that even a camera upside down numbers them
	 * right. */
	check_detection("chessboard:9x6:0.025", "chessboard:9x6:0.025", DIO_LAYOUT_MODERN);
	check_detection("chessboard:6x5:0.03", "chessboard:6x5:0.03", DIO_LAYOUT_MODERN);
}

static void picture_without_a_board_gives_no_corners(void **state)
{
	const char *specs[] = {"charuco:9x7:0.025:0.018:DICT_5X5_100", "chessboard:9x6:0.025"};
	struct dio_picture picture = {0};
	uint64_t seed = 5;

	(void)state;
	assert_int_equal(dio_picture_init(&picture, 320, 240), DIO_OK);
	for (size_t i = 0; i < 3 * 320 * 240; i++)
		picture.rgb[i] = (uint8_t)fmax(0, fmin(255, 120 + 40 * noise(&seed)));
	for (size_t i = 0; i < 2; i++) {
		struct dio_board board = board_of(specs[i]);
		struct dio_board_detector *detector = NULL;
		struct dio_corners corners = {0};

		assert_int_equal(dio_board_detector_create(&board, &detector, NULL), DIO_OK);
		assert_int_equal(dio_board_detect(detector, &picture, &corners, NULL), DIO_OK);
		assert_int_equal(corners.count, 0);
		dio_board_detector_destroy(detector);
	}
	dio_picture_deinit(&picture);
}

static void picture_too_small_is_refused(void **state)
{
	struct dio_board board = board_of("chessboard:9x6:0.025");
	struct dio_board_detector *detector = NULL;
	struct dio_picture picture = {0};
	struct dio_corners corners = {0};
	struct dio_error error = {""};

	(void)state;
	assert_int_equal(dio_picture_init(&picture, 4, 4), DIO_OK);
	assert_int_equal(dio_board_detector_create(&board, &detector, NULL), DIO_OK);
	assert_int_equal(dio_board_detect(detector, &picture, &corners, &error), DIO_BAD_ARG);
	assert_non_null(strstr(error.text, "4x4"));
	dio_board_detector_destroy(detector);
	dio_picture_deinit(&picture);
}

static uint8_t grey_at(const struct dio_picture *picture, uint32_t x, uint32_t y)
{
	return picture->rgb[3 * ((size_t)y * picture->width + x)];
}

static void drawing_has_its_true_size_and_layout(void **state)
{
	struct dio_board modern = board_of("charuco:5x4:0.04:0.03:DICT_4X4_50:modern");
	struct dio_board legacy = board_of("charuco:5x4:0.04:0.03:DICT_4X4_50:legacy");
	struct dio_picture picture = {0};

	(void)state;
	assert_int_equal(dio_board_draw(&modern, 40, 10, &picture, NULL), DIO_OK);
	assert_int_equal(picture.width, 5 * 40 + 20);
	assert_int_equal(picture.height, 4 * 40 + 20);
	assert_int_equal(grey_at(&picture, 9, 9), 255);
	assert_int_equal(grey_at(&picture, 10, 10), 0);
	assert_int_equal(grey_at(&picture, 50, 10), 255);
	assert_int_equal(dio_board_draw(&legacy, 40, 10, &picture, NULL), DIO_OK);
	assert_int_equal(grey_at(&picture, 10, 10), 255);
	assert_int_equal(grey_at(&picture, 50, 10), 0);
	dio_picture_deinit(&picture);
}

static void drawing_too_large_or_too_fine_is_refused(void **state)
{
	struct dio_board board = board_of("charuco:10x7:0.0285:0.0171:DICT_6X6_250");
	struct dio_picture picture = {0};
	struct dio_error error = {""};

	(void)state;
	assert_int_equal(dio_board_draw(&board, 4000, 0, &picture, &error), DIO_BAD_ARG);
	assert_int_equal(dio_board_draw(&board, 4, 0, &picture, &error), DIO_BAD_ARG);
	assert_int_equal(dio_board_draw(&board, UINT32_MAX, UINT32_MAX, &picture, &error),
			 DIO_BAD_ARG);
	assert_null(picture.rgb);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(specification_is_read_and_written_back),
		cmocka_unit_test(unreadable_specification_is_refused_by_its_part),
		cmocka_unit_test(charuco_corners_are_found_where_they_are),
		cmocka_unit_test(modern_layout_of_even_rows_is_told_from_the_picture),
		cmocka_unit_test(legacy_layout_of_even_rows_is_told_from_the_picture),
		cmocka_unit_test(detector_remembers_the_layout_it_saw),
		cmocka_unit_test(wrong_layout_stated_finds_no_board_instead_of_wrong_corners),
		cmocka_unit_test(chessboard_corners_are_found_in_board_order),
		cmocka_unit_test(picture_without_a_board_gives_no_corners),
		cmocka_unit_test(picture_too_small_is_refused),
		cmocka_unit_test(drawing_has_its_true_size_and_layout),
		cmocka_unit_test(drawing_too_large_or_too_fine_is_refused),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
