/* A camera that is pulled out, goes silent or sends rubbish while the program works with it.
 * The linker wraps dio_camera_acquire(): behind the wrap is the simulated camera. */
#include "unit/app/fixture.h"

#include <stdlib.h>
#include <string.h>

#include "capture/calibrating.h"
#include "capture/posing.h"
#include "capture/recording_run.h"

#define BOARD "charuco:7x5:0.04:0.03:DICT_6X6_250"
#define SIM   "sim:table?seed=5&fov=40&samples=1&board=" BOARD

enum dio_status __real_dio_camera_acquire(struct dio_camera *camera, struct dio_frame *frame,
					  int64_t timeout_ns, struct dio_error *error);
enum dio_status __wrap_dio_camera_acquire(struct dio_camera *camera, struct dio_frame *frame,
					  int64_t timeout_ns, struct dio_error *error);

/* After how many frames it happens, and what. */
static int frames_left;
static enum dio_status fault;
static bool fault_passes;

enum dio_status __wrap_dio_camera_acquire(struct dio_camera *camera, struct dio_frame *frame,
					  int64_t timeout_ns, struct dio_error *error)
{
	if (frames_left-- > 0)
		return __real_dio_camera_acquire(camera, frame, timeout_ns, error);
	if (fault_passes)
		frames_left = 1000;
	return dio_fail(error, fault, "camera test: %s", dio_status_text(fault));
}

static void arrange(int frames, enum dio_status what, bool passes)
{
	frames_left = frames;
	fault = what;
	fault_passes = passes;
}

static enum dio_status record(const char *name, struct dio_recording_result *result,
			      struct dio_error *error)
{
	const struct dio_recording_options options = {.frames = 20};

	return dio_recording_run("sim:table?width=160&height=120&samples=1", fixture_path(name),
				 &options, result, error);
}

static uint64_t frames_played_back(const char *name)
{
	struct dio_recording_result result = {0};
	const struct dio_recording_options options = {0};
	struct dio_error error = {""};

	arrange(1000, DIO_GONE, false);
	if (dio_recording_run(fixture_path(name), fixture_path("copy"), &options, &result,
			      &error) != DIO_OK)
		fail_msg("%s", error.text);
	return result.frames;
}

static void a_recording_keeps_what_came_before_the_camera_was_pulled_out(void **state)
{
	struct dio_recording_result result = {0};
	struct dio_error error = {""};

	(void)state;
	arrange(5, DIO_GONE, false);
	assert_int_equal(record("pulled", &result, &error), DIO_GONE);
	assert_int_equal(result.frames, 5);
	assert_non_null(strstr(error.text, "5 frames are kept"));
	assert_int_equal(frames_played_back("pulled"), 5);
}

static void a_silent_camera_is_told_with_the_frames_before(void **state)
{
	struct dio_recording_result result = {0};
	struct dio_error error = {""};

	(void)state;
	arrange(3, DIO_AGAIN, false);
	assert_int_equal(record("silent", &result, &error), DIO_NO_SIGNAL);
	assert_non_null(strstr(error.text, "no frame for"));
	assert_non_null(strstr(error.text, "cable"));
	assert_int_equal(result.frames, 3);
}

static void a_damaged_frame_is_passed_over(void **state)
{
	struct dio_recording_result result = {0};
	struct dio_error error = {""};

	(void)state;
	arrange(4, DIO_BAD_FILE, true);
	assert_int_equal(record("damaged", &result, &error), DIO_OK);
	assert_int_equal(result.frames, 20);
	assert_int_equal(result.unreadable, 1);
}

static void a_camera_that_sends_nothing_but_damage_is_given_up(void **state)
{
	struct dio_recording_result result = {0};
	struct dio_error error = {""};

	(void)state;
	arrange(2, DIO_BAD_FILE, false);
	assert_int_equal(record("rubbish", &result, &error), DIO_BAD_FILE);
	assert_int_equal(result.frames, 2);
}

static void parse_board(struct dio_board *board)
{
	struct dio_error error = {""};

	assert_int_equal(dio_board_parse(BOARD, board, &error), DIO_OK);
}

static void a_calibration_goes_on_with_the_views_before(void **state)
{
	struct dio_calibrating_options options;
	struct dio_calibrating result = {0};
	struct dio_error error = {""};
	struct dio_board board;

	(void)state;
	parse_board(&board);
	dio_calibrating_defaults(&options);
	arrange(20, DIO_GONE, false);
	if (dio_calibrating_run(SIM, &board, &options, &result, &error) != DIO_OK)
		fail_msg("%s", error.text);
	assert_int_equal(result.views.frames, 20);
	assert_true(result.calibration.views_used >= 10);
	dio_calibrating_deinit(&result);
}

static void a_calibration_without_any_view_says_why(void **state)
{
	struct dio_calibrating_options options;
	struct dio_calibrating result = {0};
	struct dio_error error = {""};
	struct dio_board board;

	(void)state;
	parse_board(&board);
	dio_calibrating_defaults(&options);
	arrange(0, DIO_GONE, false);
	assert_int_equal(dio_calibrating_run(SIM, &board, &options, &result, &error), DIO_GONE);
	assert_non_null(strstr(error.text, "camera test"));
	dio_calibrating_deinit(&result);
}

static void posing_goes_on_with_the_pictures_before(void **state)
{
	/* What the simulated lens is on paper: near enough for a pose to exist. */
	const struct dio_camera_model model = {
		.width = 640, .height = 480, .fx = 879, .fy = 879, .cx = 319.5, .cy = 239.5};
	struct dio_posing_options options;
	struct dio_posing result = {0};
	struct dio_error error = {""};
	struct dio_board board;

	(void)state;
	parse_board(&board);
	dio_posing_defaults(&options);
	arrange(6, DIO_GONE, false);
	if (dio_posing_run(SIM, &model, &board, &options, &result, &error) != DIO_OK)
		fail_msg("%s", error.text);
	assert_in_range(result.posed, 1, 6);
	dio_posing_deinit(&result);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(a_recording_keeps_what_came_before_the_camera_was_pulled_out),
		cmocka_unit_test(a_silent_camera_is_told_with_the_frames_before),
		cmocka_unit_test(a_damaged_frame_is_passed_over),
		cmocka_unit_test(a_camera_that_sends_nothing_but_damage_is_given_up),
		cmocka_unit_test(a_calibration_goes_on_with_the_views_before),
		cmocka_unit_test(a_calibration_without_any_view_says_why),
		cmocka_unit_test(posing_goes_on_with_the_pictures_before),
	};

	return cmocka_run_group_tests(tests, fixture_setup, fixture_teardown);
}
