/* diorama calibrate on the simulated camera, whose true lens is known, and on poor input. */
#include "unit/app/fixture.h"

#include <cjson/cJSON.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "camera/sim_truth.h"
#include "dio/calibration.h"

#define BOARD "charuco:7x5:0.04:0.03:DICT_6X6_250"
#define SIM   "sim:table?seed=5&fov=40&samples=1&board=" BOARD

static struct fixture_run run;

static void read_truth(const char *spec, struct dio_sim_camera *truth)
{
	const struct dio_camera_options options = {.as_fast_as_possible = true};
	struct dio_error error = {""};
	struct dio_camera *camera;
	struct dio_frame frame;

	assert_int_equal(dio_camera_open(spec, &options, &camera, &error), DIO_OK);
	assert_int_equal(dio_camera_start(camera, &error), DIO_OK);
	assert_int_equal(dio_camera_acquire(camera, &frame, 1000000000, &error), DIO_OK);
	assert_true(dio_sim_camera_get_truth(camera, truth));
	dio_camera_close(camera);
}

static void expect_near(const char *name, double is, double was, double tolerance)
{
	print_message("%s %.3f, true %.3f\n", name, is, was);
	if (!(fabs(is - was) <= tolerance))
		fail_msg("%s is %.4f, the truth %.4f, more than %.4f apart", name, is, was,
			 tolerance);
}

static double number(const cJSON *root, const char *key)
{
	const cJSON *item = cJSON_GetObjectItem(root, key);

	if (!cJSON_IsNumber(item))
		fail_msg("no number \"%s\" in the JSON", key);
	return item->valuedouble;
}

static void the_simulated_camera_is_calibrated_near_its_truth(void **state)
{
	struct dio_camera_model model, ros;
	struct dio_sim_camera truth;
	struct dio_error error = {""};
	cJSON *root;

	(void)state;
	read_truth(SIM, &truth);
	fixture_diorama(&run, "calibrate", SIM, "--board", BOARD, "--frames", "24", "--out",
			fixture_path("camera.yaml"), "--ros", fixture_path("ros.yaml"), "--json",
			NULL);
	if (run.code != 0)
		fail_msg("%s", run.err);
	assert_int_equal(dio_camera_model_read(fixture_path("camera.yaml"), &model, &error),
			 DIO_OK);
	assert_int_equal(dio_camera_model_read(fixture_path("ros.yaml"), &ros, &error), DIO_OK);
	expect_near("fx", model.fx, truth.fx, 0.004 * truth.fx);
	expect_near("fy", model.fy, truth.fy, 0.004 * truth.fy);
	expect_near("cx", model.cx, truth.cx, 3);
	expect_near("cy", model.cy, truth.cy, 3);
	expect_near("ROS fx", ros.fx, model.fx, 1e-6);
	assert_int_equal(ros.width, 640);

	root = cJSON_Parse(run.out);
	assert_non_null(root);
	assert_true(number(root, "rms_px") < 0.2);
	assert_true(number(root, "heldout_rms_px") < 0.3);
	assert_true(number(root, "views_used") >= 20);
	assert_true(number(root, "coverage") > 0.5);
	assert_true(number(root, "tilt_deg") > 30);
	assert_true(number(cJSON_GetObjectItem(root, "sigma"), "fx") < 2);
	cJSON_Delete(root);
}

/* Photos: pictures of a recording, looked at as a folder. */
static void make_photos(const char *name, const char *frames)
{
	fixture_diorama(&run, "capture", SIM "&style=dance", "--fps", "0.66667", "--frames", frames,
			"--out", fixture_path(name), NULL);
	if (run.code != 0)
		fail_msg("%s", run.err);
}

static void a_corrupt_picture_is_named_and_the_others_are_used(void **state)
{
	cJSON *root;

	(void)state;
	make_photos("photos", "16");
	fixture_write("photos/frames/000004.png", "this is no picture");
	fixture_diorama(&run, "calibrate", fixture_path("photos/frames"), "--board", BOARD, "--out",
			fixture_path("photos.yaml"), "--json", NULL);
	if (run.code != 0)
		fail_msg("%s", run.err);
	assert_non_null(strstr(run.err, "000004.png"));
	root = cJSON_Parse(run.out);
	assert_non_null(root);
	assert_true(number(root, "unreadable") == 1);
	assert_true(number(root, "views_total") == 15);
	cJSON_Delete(root);
}

static void a_reader_sees_views_fit_and_every_parameter_with_its_sigma(void **state)
{
	static const char *const WORDS[] = {"board", "pictures", "views",    "coverage",
					    "tilt",  "RMS",      "held out", "fx",
					    "+-",    "k1",       "used"};

	(void)state;
	fixture_diorama(&run, "calibrate", fixture_path("photos/frames"), "--board", BOARD, "--out",
			fixture_path("reader.yaml"), NULL);
	if (run.code != 0)
		fail_msg("%s", run.err);
	for (size_t i = 0; i < sizeof WORDS / sizeof *WORDS; i++)
		if (!strstr(run.out, WORDS[i]))
			fail_msg("\"%s\" is not in: %s", WORDS[i], run.out);
}

static void too_few_views_are_refused_and_listed(void **state)
{
	cJSON *root;

	(void)state;
	make_photos("few", "2");
	fixture_diorama(&run, "calibrate", fixture_path("few/frames"), "--board", BOARD, "--out",
			fixture_path("few.yaml"), "--json", NULL);
	fixture_expect_refusal(&run, 1, "views");
	assert_int_not_equal(access(fixture_path("few.yaml"), F_OK), 0);
	root = cJSON_Parse(run.out);
	assert_non_null(root);
	assert_string_equal(cJSON_GetObjectItem(root, "status")->valuestring, "refused");
	assert_int_equal(cJSON_GetArraySize(cJSON_GetObjectItem(root, "views")), 2);
	cJSON_Delete(root);
}

static void the_wrong_board_is_refused(void **state)
{
	(void)state;
	make_photos("wrong", "4");
	fixture_diorama(&run, "calibrate", fixture_path("wrong/frames"), "--board",
			"chessboard:9x6:0.025", "--out", fixture_path("wrong.yaml"), NULL);
	assert_int_equal(run.code, 1);
	assert_int_not_equal(access(fixture_path("wrong.yaml"), F_OK), 0);
}

static void input_that_is_not_there_is_refused_in_one_line(void **state)
{
	static const struct {
		const char *input, *words;
	} CASES[] = {
		{"/nonexistent/folder", "/nonexistent/folder"},
		{"v4l2:/dev/video99", "/dev/video99"},
		{"sim:table?sede=7", "sede"},
		{"sim:moon", "moon"},
	};

	(void)state;
	for (size_t i = 0; i < sizeof CASES / sizeof *CASES; i++) {
		fixture_diorama(&run, "calibrate", CASES[i].input, "--board", BOARD, "--out",
				fixture_path("x.yaml"), NULL);
		fixture_expect_refusal(&run, 1, CASES[i].words);
	}
	fixture_write("empty/.keep", "");
	fixture_diorama(&run, "calibrate", fixture_path("empty"), "--board", BOARD, "--out",
			fixture_path("x.yaml"), NULL);
	fixture_expect_refusal(&run, 1, "empty");
	fixture_diorama(&run, "calibrate", SIM, "--board", "charuco:1x1", "--out",
			fixture_path("x.yaml"), NULL);
	fixture_expect_refusal(&run, 1, "charuco:1x1");
}

static void an_unwritable_camera_file_is_refused(void **state)
{
	(void)state;
	fixture_diorama(&run, "calibrate", SIM, "--board", BOARD, "--out",
			fixture_path("no/such/folder/camera.yaml"), NULL);
	fixture_expect_refusal(&run, 1, "no/such/folder/camera.yaml");
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(the_simulated_camera_is_calibrated_near_its_truth),
		cmocka_unit_test(a_corrupt_picture_is_named_and_the_others_are_used),
		cmocka_unit_test(a_reader_sees_views_fit_and_every_parameter_with_its_sigma),
		cmocka_unit_test(too_few_views_are_refused_and_listed),
		cmocka_unit_test(the_wrong_board_is_refused),
		cmocka_unit_test(input_that_is_not_there_is_refused_in_one_line),
		cmocka_unit_test(an_unwritable_camera_file_is_refused),
	};

	return cmocka_run_group_tests(tests, fixture_setup, fixture_teardown);
}
