/* diorama demo: all its files are there, and its figures hold. */
#include "unit/app/fixture.h"

#include <cjson/cJSON.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

#include "dio/frame.h"

static struct fixture_run run;

static const char *model(void)
{
	static char path[FIXTURE_PATH_SIZE];

	snprintf(path, sizeof path, "%s/models/diorama-s.safetensors", getenv("DIO_SOURCE_DIR"));
	return path;
}

static cJSON *read_json(const char *path)
{
	static char text[65536];
	FILE *file = fopen(path, "rb");
	size_t size;
	cJSON *root;

	if (!file)
		fail_msg("%s is not there", path);
	size = fread(text, 1, sizeof text - 1, file);
	text[size] = '\0';
	fclose(file);
	root = cJSON_Parse(text);
	assert_non_null(root);
	return root;
}

static double number(const cJSON *root, const char *key)
{
	const cJSON *item = cJSON_GetObjectItem(root, key);

	if (!cJSON_IsNumber(item))
		fail_msg("no number \"%s\" in the summary", key);
	return item->valuedouble;
}

static void expect_files(const char *folder)
{
	static const char *const NAMES[] = {"camera.yaml", "scene.json", "scene.safetensors",
					    "sheet.png",   "orbit.mp4",  "summary.md",
					    "summary.json"};
	struct stat about;

	for (size_t i = 0; i < sizeof NAMES / sizeof *NAMES; i++) {
		char path[2 * FIXTURE_PATH_SIZE];

		snprintf(path, sizeof path, "%s/%s", folder, NAMES[i]);
		if (stat(path, &about) != 0 || about.st_size < 100)
			fail_msg("%s is missing or next to empty", path);
	}
}

static void run_small_demo(void)
{
	fixture_diorama(&run, "demo", "--out", fixture_path("demo"), "--model", model(), "--seed",
			"3", "--stands", "16", "--frames", "18", "--context", "4", "--orbit-frames",
			"6", NULL);
	if (run.code != 0)
		fail_msg("%s", run.err);
}

static void the_demo_leaves_its_files_and_good_figures(void **state)
{
	const cJSON *truth, *rendered;
	cJSON *root;

	(void)state;
	run_small_demo();
	expect_files(fixture_path("demo"));
	root = read_json(fixture_path("demo/summary.json"));
	truth = cJSON_GetObjectItem(root, "truth");
	rendered = cJSON_GetObjectItem(root, "rendered");
	assert_true(number(root, "calibration_rms_px") < 0.2);
	assert_true(number(root, "posed") >= 12);
	assert_true(number(truth, "poses") == number(root, "posed"));
	assert_true(fabs(number(truth, "fx_error_px")) < 5);
	assert_true(number(truth, "ray_mean_px") < 4);
	assert_true(number(truth, "position_mean_mm") < 8);
	assert_true(number(truth, "rotation_mean_deg") < 0.5);
	/* Exactly nothing would mean that the estimates had seen the truth. */
	assert_true(number(truth, "ray_mean_px") > 1e-4);
	assert_true(number(truth, "position_mean_mm") > 1e-4);
	assert_true(number(rendered, "targets") >= 2);
	assert_true(number(rendered, "psnr_db") > 8);
	assert_true(number(root, "peak_memory_mib") > 10);
	assert_true(number(root, "seconds") > 0);
	assert_int_equal(cJSON_GetArraySize(cJSON_GetObjectItem(root, "stages")), 6);
	cJSON_Delete(root);
}

static void the_demo_scores_as_eval_does(void **state)
{
	cJSON *summary = read_json(fixture_path("demo/summary.json")), *eval;
	const cJSON *rendered = cJSON_GetObjectItem(summary, "rendered"), *mean;

	(void)state;
	fixture_diorama(&run, "eval", "--model", model(), "--scene",
			fixture_path("demo/scene.json"), "--json", NULL);
	if (run.code != 0)
		fail_msg("%s", run.err);
	eval = cJSON_Parse(run.out);
	assert_non_null(eval);
	mean = cJSON_GetObjectItem(eval, "mean");
	mean = mean ? mean : eval;
	assert_true(fabs(number(mean, "psnr_db") - number(rendered, "psnr_db")) < 0.01);
	cJSON_Delete(eval);
	cJSON_Delete(summary);
}

static void a_second_demo_takes_the_place_of_the_first(void **state)
{
	(void)state;
	run_small_demo();
	expect_files(fixture_path("demo"));
}

static void the_contact_sheet_shows_inputs_rendered_and_true(void **state)
{
	struct dio_picture sheet = {0};
	struct dio_error error = {""};
	double sum = 0, squares = 0;
	size_t count;

	(void)state;
	assert_int_equal(dio_picture_read(fixture_path("demo/sheet.png"), &sheet, &error), DIO_OK);
	assert_true(sheet.width >= 4 * 128);
	assert_true(sheet.height >= 4 * 128);
	count = (size_t)sheet.width * sheet.height * 3;
	for (size_t i = 0; i < count; i++) {
		sum += sheet.rgb[i];
		squares += (double)sheet.rgb[i] * sheet.rgb[i];
	}
	/* Something is drawn: grey levels spread widely. */
	assert_true(sqrt(squares / (double)count - pow(sum / (double)count, 2)) > 20);
	dio_picture_deinit(&sheet);
}

static void real_photos_go_the_same_way_without_a_truth(void **state)
{
	const char *photos = fixture_shared("data/calibration/charuco_remote_a_full/images");
	cJSON *root;

	(void)state;
	if (!photos)
		skip();
	fixture_diorama(&run, "demo", photos, "--board", "charuco:10x7:0.0285:0.0171:DICT_6X6_250",
			"--out", fixture_path("real"), "--model", model(), "--orbit-frames", "6",
			NULL);
	if (run.code != 0)
		fail_msg("%s", run.err);
	expect_files(fixture_path("real"));
	root = read_json(fixture_path("real/summary.json"));
	assert_true(number(root, "posed") >= 19);
	assert_true(number(root, "pictures") == 21);
	assert_true(cJSON_IsNull(cJSON_GetObjectItem(root, "truth")));
	cJSON_Delete(root);
}

static void bad_requests_are_told_in_one_line(void **state)
{
	(void)state;
	fixture_diorama(&run, "demo", fixture_path("nothing"), "--out", fixture_path("x"), NULL);
	fixture_expect_refusal(&run, 1, "nothing");
	fixture_diorama(&run, "demo", "--board", "domino", "--out", fixture_path("x"), NULL);
	fixture_expect_refusal(&run, 1, "domino");
	fixture_write("file", "");
	fixture_diorama(&run, "demo", "--out", fixture_path("file/x"), NULL);
	fixture_expect_refusal(&run, 1, "file");
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(the_demo_leaves_its_files_and_good_figures),
		cmocka_unit_test(the_demo_scores_as_eval_does),
		cmocka_unit_test(a_second_demo_takes_the_place_of_the_first),
		cmocka_unit_test(the_contact_sheet_shows_inputs_rendered_and_true),
		cmocka_unit_test(real_photos_go_the_same_way_without_a_truth),
		cmocka_unit_test(bad_requests_are_told_in_one_line),
	};

	return cmocka_run_group_tests(tests, fixture_setup, fixture_teardown);
}
