/* The benchmark's parts that do not measure, and one small measurement through the program. */
#include "unit/app/fixture.h"

#include <cjson/cJSON.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "bench/count.h"
#include "bench/peak.h"
#include "bench/sweep.h"
#include "bench/work.h"
#include "core/npy.h"
#include "core/text.h"

static struct fixture_run run;

static void lists_are_taken_apart(void **state)
{
	struct dio_error error = {0};
	struct dio_list list = {0};

	(void)state;
	assert_int_equal(dio_list_parse("4,8,16", "views", 1, 16, &list, &error), DIO_OK);
	assert_int_equal(list.count, 3);
	assert_int_equal(list.values[0], 4);
	assert_int_equal(list.values[2], 16);
	assert_int_equal(dio_list_parse_precisions("fixed,f32", &list, &error), DIO_OK);
	assert_int_equal(list.count, 2);
	assert_int_equal(list.values[0], DVSM_PRECISION_FIXED);
	assert_int_equal(list.values[1], DVSM_PRECISION_F32);
}

static void wrong_lists_are_refused(void **state)
{
	static const char *const WRONG[] = {"", ",", "4,", "4,,8", "0", "17", "-1", "4,x", "8,4,8"};
	struct dio_error error = {0};
	struct dio_list list = {0};

	(void)state;
	for (size_t i = 0; i < sizeof WRONG / sizeof *WRONG; i++) {
		if (dio_list_parse(WRONG[i], "views", 1, 16, &list, &error) != DIO_BAD_ARG)
			fail_msg("'%s' was taken", WRONG[i]);
		assert_non_null(strstr(error.text, "--views"));
	}
	assert_int_equal(dio_list_parse_precisions("f16", &list, &error), DIO_BAD_ARG);
	assert_int_equal(dio_list_parse_precisions("f32,", &list, &error), DIO_BAD_ARG);
	assert_int_equal(list.count, 0);
}

/* One block of D 2, one head, MLP 1, patch 1, one view of three tokens: counted by hand. */
static void operations_are_those_of_the_model(void **state)
{
	const struct dvsm_model_config config = {
		.dim = 2, .heads = 1, .layers = 1, .patch_px = 1, .mlp_ratio = 1};
	const struct dvsm_camera camera = {.width = 7, .height = 2};
	const double tokens = dio_count_tokens(&camera, 2);
	/* A token and matrix: 8. Query, key, value, output, up, down: 6 of them; attention to one
	 * key: 8; colours and rays: 9 channels, 36. */
	const double half = 3 * 6 * 8;

	(void)state;
	assert_true(tokens == 4);
	assert_true(dio_count_reconstruct(&config, (const double[]){3}, 1) ==
		    half + 9 * 8 + 3 * 2 * 8 + 3 * 36);
	assert_true(dio_count_render(&config, 3, 5) == half + 9 * 8 + 3 * 4 * 8 + 15 * 8 + 3 * 36);
}

static void peaks_are_numbers_of_this_machine(void **state)
{
	struct dio_peak peak = {0};
	struct dio_error error = {0};

	(void)state;
	assert_int_equal(dio_peak_measure(1, 0, &peak, &error), DIO_OK);
	assert_true(peak.read_bytes_per_s > 1e6);
	assert_non_null(dio_peak_for(&peak, DVSM_PRECISION_F32)->instruction);
	assert_true(dio_peak_for(&peak, DVSM_PRECISION_F32)->operations_per_s > 1e6);
	for (int unit = 0; unit < DIO_UNIT_COUNT; unit++)
		assert_true(isfinite(peak.units[unit].operations_per_s));
}

static void arrays_come_back_as_they_were_written(void **state)
{
	const float rgb[2][6] = {{0, 1, -2, 3.5f, 0x1p-30f, 5}, {6, 7, 8, 9, 10, 11}};
	struct dio_npy_array array = {0};
	struct dio_error error = {0};
	struct dio_npy *npy = NULL;
	const char *path = fixture_path("pictures.npy");

	(void)state;
	assert_int_equal(dio_npy_open(path, 2, 1, 2, &npy, &error), DIO_OK);
	for (int i = 0; i < 2; i++)
		assert_int_equal(dio_npy_append(npy, rgb[i], &error), DIO_OK);
	assert_int_equal(dio_npy_close(npy, &error), DIO_OK);
	assert_int_equal(dio_npy_read(path, &array, &error), DIO_OK);
	assert_int_equal(array.rank, 4);
	assert_int_equal(array.shape[0], 2);
	assert_int_equal(array.shape[2], 2);
	for (int i = 0; i < 12; i++)
		assert_true(array.values[i] == (double)rgb[i / 6][i % 6]);
	dio_npy_array_deinit(&array);
}

static void arrays_of_other_kinds_are_refused(void **state)
{
	static const char *const HEADS[] = {
		"{'descr': '<i4', 'fortran_order': False, 'shape': (2,), }",
		"{'descr': '<f4', 'fortran_order': True, 'shape': (2,), }",
		"{'descr': '<f4', 'fortran_order': False, 'shape': (3,), }",
		"{'descr': '<f8', 'fortran_order': False, 'shape': (2,), }",
		"{'descr': '<f4', 'fortran_order': False, 'shape': (2",
		"{}",
		"{'descr': '<f4', 'fortran_order': False, 'shape': (99999999999, 99999999999), }",
	};
	struct dio_npy_array array = {0};
	struct dio_error error = {0};
	const char *path = fixture_path("odd.npy");

	(void)state;
	for (size_t i = 0; i < sizeof HEADS / sizeof *HEADS; i++) {
		FILE *file = fopen(path, "wb");

		assert_non_null(file);
		fwrite("\x93NUMPY\x01\x00\x76\x00", 1, 10, file);
		fprintf(file, "%-117s\n%8s", HEADS[i], "");
		fclose(file);
		if (dio_npy_read(path, &array, &error) != DIO_BAD_FILE)
			fail_msg("taken: %s", HEADS[i]);
		assert_non_null(strstr(error.text, "odd.npy"));
	}
	fixture_write("short.npy", "\x93NUMPY\x01");
	assert_int_equal(dio_npy_read(fixture_path("short.npy"), &array, &error), DIO_BAD_FILE);
	assert_null(array.values);
}

/* A member of the only measurement in a file. */
static double measured(const char *path, const char *object, const char *key)
{
	struct dio_error error = {0};
	size_t size;
	char *text;
	double value = NAN;

	assert_int_equal(dio_text_read(path, 1 << 20, &text, &size, &error), DIO_OK);

	cJSON *root = cJSON_Parse(text);
	const cJSON *all = cJSON_GetObjectItem(root, "measured");

	assert_int_equal(cJSON_GetArraySize(all), 1);

	const cJSON *item = cJSON_GetArrayItem(all, 0);
	const cJSON *inner =
		cJSON_GetObjectItem(object ? cJSON_GetObjectItem(item, object) : item, key);

	if (cJSON_IsNumber(inner))
		value = inner->valuedouble;
	cJSON_Delete(root);
	free(text);
	return value;
}

/* `render` does the saved work; what it writes is then the reference, which must be met. */
static void the_saved_work_is_the_work_measured(void **state)
{
	char folder[FIXTURE_PATH_SIZE], name[FIXTURE_PATH_SIZE], json[FIXTURE_PATH_SIZE];
	char model[FIXTURE_PATH_SIZE + 32], scene[FIXTURE_PATH_SIZE + 32];
	char raw[FIXTURE_PATH_SIZE + 32], wanted[FIXTURE_PATH_SIZE + 32];

	(void)state;
	snprintf(folder, sizeof folder, "%s", fixture_path("work"));
	snprintf(json, sizeof json, "%s", fixture_path("bench.json"));
	snprintf(name, sizeof name, "%s", fixture_path("bench.svg"));
	snprintf(model, sizeof model, "%s/model.safetensors", folder);
	snprintf(scene, sizeof scene, "%s/v3/scene.json", folder);
	/* What three views are does not depend on what else was asked for. */
	fixture_diorama(&run, "bench", "--views", "3,5", "--patch", "64", "--save", folder, NULL);
	assert_int_equal(run.code, 0);
	fixture_diorama(&run, "render", "--model", model, "--scene", scene, "--out", folder,
			"--raw", "--patch-recon", "64", "--patch-render", "64", "--threads", "1",
			NULL);
	assert_int_equal(run.code, 0);
	snprintf(raw, sizeof raw, "%s/frames.npy", folder);
	snprintf(wanted, sizeof wanted, "%s/v3_p64.npy", folder);
	assert_int_equal(rename(raw, wanted), 0);
	fixture_diorama(&run, "bench", "--views", "3", "--patch", "64", "--threads", "1", "--runs",
			"2", "--precision", "f32", "--reference", folder, "--json", json, "--plot",
			name, NULL);
	/* Nothing to plot on a logarithmic axis: the error is exactly 0. */
	assert_int_equal(run.code, 1);
	assert_non_null(strstr(run.out, "f32"));
	assert_true(measured(json, "from_float64", "largest") == 0);
	assert_true(measured(json, "reconstruct", "median_ms") > 0);
	assert_true(measured(json, "render", "gop_per_s") > 0);
	assert_true(measured(json, NULL, "tokens") == 4);
	/* Fewer views of the same rig make another picture: the error is told and drawn. */
	snprintf(raw, sizeof raw, "%s/v1_p64.npy", folder);
	assert_int_equal(rename(wanted, raw), 0);
	fixture_diorama(&run, "bench", "--model", model, "--scene", scene, "--views", "1",
			"--patch", "64", "--threads", "1", "--runs", "1", "--precision", "f32",
			"--reference", folder, "--json", json, "--plot", name, NULL);
	assert_int_equal(run.code, 0);
	assert_true(measured(json, "from_float64", "rms") > 1e-3);
	fixture_program(&run, "grep", "-c", "<circle class='f32' cx=.*patch 64, 1 views", name,
			NULL);
	assert_int_equal(run.code, 0);
}

static void what_cannot_be_measured_is_refused_first(void **state)
{
	(void)state;
	fixture_diorama(&run, "bench", "--config", "huge", NULL);
	fixture_expect_refusal(&run, 1, "--config huge|small or paper");
	fixture_diorama(&run, "bench", "--views", "2,x", NULL);
	fixture_expect_refusal(&run, 1, "--views 2,x|commas");
	fixture_diorama(&run, "bench", "--views", "1", "--plot", "x.svg", NULL);
	fixture_expect_refusal(&run, 1, "--plot|--reference");
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(lists_are_taken_apart),
		cmocka_unit_test(wrong_lists_are_refused),
		cmocka_unit_test(operations_are_those_of_the_model),
		cmocka_unit_test(peaks_are_numbers_of_this_machine),
		cmocka_unit_test(arrays_come_back_as_they_were_written),
		cmocka_unit_test(arrays_of_other_kinds_are_refused),
		cmocka_unit_test(the_saved_work_is_the_work_measured),
		cmocka_unit_test(what_cannot_be_measured_is_refused_first),
	};

	return cmocka_run_group_tests(tests, fixture_setup, fixture_teardown);
}
