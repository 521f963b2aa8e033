/* eval: its baseline is baselines.py's, its scores are those of the pictures that render writes. */
#include "unit/app/fixture.h"

#include <cjson/cJSON.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define PYTHON "/usr/bin/python3" /* Debian's, which has python3-opencv */

static struct fixture_run run;

static double number(const cJSON *root, const char *key)
{
	const cJSON *item = cJSON_GetObjectItemCaseSensitive(root, key);

	if (!cJSON_IsNumber(item))
		fail_msg("no number \"%s\"", key);
	return item->valuedouble;
}

/* A set cut by the shared tool, small so that the test is quick; false with a printed reason. */
static bool prepare_set(const char *set, const char *out)
{
	char tool[FIXTURE_PATH_SIZE], folder[64];
	const char *path = fixture_shared("eval/prepare.py");

	if (!path)
		return false;
	snprintf(tool, sizeof tool, "%s", path);
	snprintf(folder, sizeof folder, "data/views/%s", set);
	path = fixture_shared(folder);
	if (!path)
		return false;
	fixture_program(&run, PYTHON, tool, path, out, "--size", "64", "--views", "4", NULL);
	if (run.code != 0) {
		printf("skipped: %s needs python3-opencv: %s\n", tool, run.err);
		return false;
	}
	return true;
}

static cJSON *evaluate(const char *set)
{
	cJSON *root;

	fixture_diorama(&run, "eval", "--scene", set, "--json", NULL);
	if (run.code != 0)
		fail_msg("%s", run.err);
	root = cJSON_Parse(run.out);
	assert_non_null(root);
	return root;
}

static void expect_near(double got, double wanted, double tolerance, const char *what)
{
	printf("  %s: %.4f, tool says %.4f\n", what, got, wanted);
	if (!(fabs(got - wanted) <= tolerance))
		fail_msg("%s: %g instead of %g", what, got, wanted);
}

static void the_baseline_is_that_of_the_tool(const char *set, const cJSON *root)
{
	double psnr_db, ssim;
	const char *at;

	fixture_program(&run, PYTHON, fixture_shared("eval/baselines.py"), set, NULL);
	if (run.code != 0)
		fail_msg("%s", run.err);
	at = strstr(run.out, "nearest");
	assert_non_null(at);
	assert_int_equal(sscanf(at, "nearest %lf dB %lf", &psnr_db, &ssim), 2);
	/* The tool prints two and three digits: half of the last one, and 0.01 dB and 0.001. */
	expect_near(number(root, "nearest_psnr_db"), psnr_db, 0.01, "nearest PSNR");
	expect_near(number(root, "nearest_ssim"), ssim, 0.0015, "nearest SSIM");
}

static void the_scores_are_those_of_the_written_pictures(const char *set, const cJSON *root)
{
	const char *out = fixture_path("written");
	double psnr_db, ssim;
	const char *at;

	fixture_diorama(&run, "render", "--scene", set, "--out", out, NULL);
	if (run.code != 0)
		fail_msg("%s", run.err);
	fixture_program(&run, PYTHON, fixture_shared("eval/baselines.py"), "--score", set, out,
			NULL);
	if (run.code != 0)
		fail_msg("%s", run.err);
	at = strstr(run.out, " dB");
	assert_non_null(at);
	while (at > run.out && at[-1] != ' ')
		at--;
	assert_int_equal(sscanf(at, "%lf dB SSIM %lf", &psnr_db, &ssim), 2);
	expect_near(number(root, "psnr_db"), psnr_db, 0.01, "PSNR");
	expect_near(number(root, "ssim"), ssim, 0.0015, "SSIM");
}

static void eval_agrees_with_the_shared_tool(void **state)
{
	static const char *const SETS[] = {"fox", "temple_ring", "mary_rose_tankard"};

	(void)state;
	for (size_t i = 0; i < sizeof SETS / sizeof *SETS; i++) {
		char set[FIXTURE_PATH_SIZE];
		cJSON *root;

		snprintf(set, sizeof set, "%s", fixture_path(SETS[i]));
		if (!prepare_set(SETS[i], set))
			skip();
		printf("%s\n", SETS[i]);
		root = evaluate(set);
		the_baseline_is_that_of_the_tool(set, root);
		the_scores_are_those_of_the_written_pictures(set, root);
		cJSON_Delete(root);
	}
}

static void a_scene_without_true_pictures_is_refused(void **state)
{
	(void)state;
	fixture_write_picture("none/a.png", 16, 16);
	fixture_write(
		"none/scene.json",
		"{\"camera\":{\"width\":16,\"height\":16,\"fx\":9,\"fy\":9,\"cx\":7.5,\"cy\":7.5},"
		"\"frames\":[{\"file\":\"a.png\",\"world_from_camera\":"
		"[1,0,0,0,0,1,0,0,0,0,1,0,0,0,0,1]}]}");
	fixture_diorama(&run, "eval", "--scene", fixture_path("none"), NULL);
	fixture_expect_refusal(&run, 1, "no target has a picture");
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(eval_agrees_with_the_shared_tool),
		cmocka_unit_test(a_scene_without_true_pictures_is_refused),
	};

	return cmocka_run_group_tests(tests, fixture_setup, fixture_teardown);
}
