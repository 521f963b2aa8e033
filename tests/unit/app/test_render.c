/* render through the program: the oracle's numbers, caches, paths, names. */
#include "unit/app/fixture.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

#include "core/path.h"
#include "dio/frame.h"
#include "support/files.h"
#include "support/golden_case.h"

#define TOLERANCE 1e-5 /* MODEL.md section 9 */

static struct fixture_run run;

static void expect_success(void)
{
	if (run.code != 0)
		fail_msg("exit code %d: %s", run.code, run.err);
}

/* The floats of a format 1.0 .npy file behind its header; the shape is checked. */
static float *read_npy(const char *path, const size_t shape[3], size_t *count)
{
	size_t size, header;
	unsigned char *bytes = support_read_file(path, &size);
	char wanted[96];
	float *numbers;

	assert_non_null(bytes);
	assert_true(size > 10);
	assert_memory_equal(bytes, "\x93NUMPY\x01\x00", 8);
	header = 10u + bytes[8] + 256u * bytes[9];
	assert_int_equal(header % 64, 0);
	bytes[header - 1] = '\0';
	snprintf(wanted, sizeof wanted, "'shape': (%zu, %zu, %zu, 3)", shape[0], shape[1],
		 shape[2]);
	if (!strstr((char *)bytes + 10, wanted) || !strstr((char *)bytes + 10, "'<f4'"))
		fail_msg("%s has header %s", path, (char *)bytes + 10);
	*count = shape[0] * shape[1] * shape[2] * 3;
	assert_int_equal(size, header + *count * sizeof(float));
	numbers = malloc(*count * sizeof *numbers);
	assert_non_null(numbers);
	memcpy(numbers, bytes + header, *count * sizeof *numbers);
	free(bytes);
	return numbers;
}

static double worst_difference(const float *got, const struct support_array *wanted)
{
	double worst = 0;

	for (size_t i = 0; i < wanted->count; i++) {
		double off = fabs(got[i] - wanted->data[i]);

		worst = off <= worst ? worst : isfinite(off) ? off : INFINITY;
	}
	return worst;
}

static void check_case(const char *folder)
{
	struct support_case *item = support_case_read(folder);
	char scene[1100], model[1100], recon[16], render[16], npy[128], out[96];
	size_t count;
	float *got;

	assert_non_null(item);
	snprintf(scene, sizeof scene, "%s/scene.json", folder);
	snprintf(model, sizeof model, "%s/model.safetensors", folder);
	snprintf(recon, sizeof recon, "%u", item->recon_patch_px);
	snprintf(render, sizeof render, "%u", item->render_patch_px);
	snprintf(out, sizeof out, "golden/%s", item->name);
	fixture_diorama(&run, "render", "--model", model, "--scene", scene, "--out",
			fixture_path(out), "--raw", "--patch-recon", recon, "--patch-render",
			render, NULL);
	expect_success();
	snprintf(npy, sizeof npy, "%s/frames.npy", out);
	got = read_npy(fixture_path(npy), item->render.shape, &count);
	assert_int_equal(count, item->render.count);
	printf("%-16s %.1e\n", item->name, worst_difference(got, &item->render));
	assert_true(worst_difference(got, &item->render) <= TOLERANCE);
	free(got);
	support_case_free(item);
}

static void raw_frames_are_the_oracle_s_numbers(void **state)
{
	static char folders[SUPPORT_MAX_CASES][1024];
	size_t count = support_case_list(folders);

	(void)state;
	if (count == 0) {
		printf("skipped: no golden cases\n");
		skip();
	}
	for (size_t i = 0; i < count; i++)
		check_case(folders[i]);
}

/* Paths of the `tiny` case; false (with a printed line) when it is absent. */
static bool find_tiny(char *model, char *scene)
{
	const char *path = fixture_shared("golden/tiny/model.safetensors");

	if (!path)
		return false;
	snprintf(model, FIXTURE_PATH_SIZE, "%s", path);
	snprintf(scene, FIXTURE_PATH_SIZE, "%s", fixture_shared("golden/tiny/scene.json"));
	return true;
}

static void expect_same_file(const char *a, const char *b)
{
	size_t size_a, size_b;
	unsigned char *x = support_read_file(a, &size_a), *y = support_read_file(b, &size_b);

	assert_non_null(x);
	assert_non_null(y);
	assert_int_equal(size_a, size_b);
	assert_memory_equal(x, y, size_a);
	free(x);
	free(y);
}

/* Pictures of the tiny case by a model whose card asks for deblocking. */
static void render_tiny(const char *out, const char *scene, const char *deblock, bool raw)
{
	fixture_diorama(&run, "render", "--model", fixture_path("seamed.safetensors"), "--scene",
			scene, "--out", fixture_path(out), "--deblock", deblock,
			raw ? "--raw" : NULL, NULL);
	expect_success();
}

static bool same_pictures(const char *a, const char *b)
{
	char first[96], second[96];
	struct dio_picture x = {0}, y = {0};
	bool same;

	snprintf(first, sizeof first, "%s/%s", a, "target_000.png");
	snprintf(second, sizeof second, "%s/%s", b, "target_000.png");
	assert_int_equal(dio_picture_read(fixture_path(first), &x, NULL), DIO_OK);
	assert_int_equal(dio_picture_read(fixture_path(second), &y, NULL), DIO_OK);
	assert_int_equal(x.width, y.width);
	assert_int_equal(x.height, y.height);
	same = memcmp(x.rgb, y.rgb, (size_t)x.width * x.height * 3) == 0;
	dio_picture_deinit(&x);
	dio_picture_deinit(&y);
	return same;
}

static void a_model_s_card_asks_for_deblocking_but_not_of_raw_numbers(void **state)
{
	char model[FIXTURE_PATH_SIZE], scene[FIXTURE_PATH_SIZE];

	(void)state;
	if (!find_tiny(model, scene))
		skip();
	fixture_write("seamed.json", "{\"deblock\": true}");
	fixture_program(&run, "cp", model, fixture_path("seamed.safetensors"), NULL);
	render_tiny("seams/auto", scene, "auto", false);
	render_tiny("seams/on", scene, "on", false);
	render_tiny("seams/off", scene, "off", false);
	render_tiny("seams/raw", scene, "auto", true);
	render_tiny("seams/raw_on", scene, "on", true);
	assert_true(same_pictures("seams/auto", "seams/on"));
	assert_false(same_pictures("seams/on", "seams/off"));
	assert_true(same_pictures("seams/raw", "seams/off"));
	assert_true(same_pictures("seams/raw_on", "seams/on"));
	fixture_write("seamed.json", "{}");
	render_tiny("seams/auto", scene, "auto", false);
	assert_true(same_pictures("seams/auto", "seams/off"));
}

static void a_scene_cache_renders_the_same_bytes_on_any_number_of_threads(void **state)
{
	char model[FIXTURE_PATH_SIZE], scene[FIXTURE_PATH_SIZE];

	(void)state;
	if (!find_tiny(model, scene))
		skip();
	fixture_diorama(&run, "reconstruct", "--model", model, "--scene", scene, "--out",
			fixture_path("tiny.scene.safetensors"), "--threads", "1", NULL);
	expect_success();
	fixture_diorama(&run, "render", "--model", model, "--scene", scene, "--scene-cache",
			fixture_path("tiny.scene.safetensors"), "--raw", "--threads", "3", "--out",
			fixture_path("cached"), NULL);
	expect_success();
	fixture_diorama(&run, "render", "--model", model, "--scene", scene, "--raw", "--out",
			fixture_path("direct"), NULL);
	expect_success();
	expect_same_file(fixture_path("cached/frames.npy"), fixture_path("direct/frames.npy"));
}

static void a_cache_of_another_model_is_refused(void **state)
{
	char model[FIXTURE_PATH_SIZE], scene[FIXTURE_PATH_SIZE];

	(void)state;
	if (!find_tiny(model, scene))
		skip();
	fixture_diorama(&run, "reconstruct", "--model", model, "--scene", scene, "--out",
			fixture_path("mine.scene.safetensors"), NULL);
	expect_success();
	fixture_diorama(&run, "render", "--model", fixture_shared("golden/ring/model.safetensors"),
			"--scene-cache", fixture_path("mine.scene.safetensors"), "--out",
			fixture_path("never"), NULL);
	fixture_expect_refusal(&run, 1, "mine.scene.safetensors|model");
	fixture_diorama(&run, "render", "--model", model, "--scene-cache",
			fixture_path("mine.scene.safetensors"), "--path", "targets", "--out",
			fixture_path("never"), NULL);
	fixture_expect_refusal(&run, 1, "--path targets|--scene");
}

static void a_path_becomes_a_film_of_its_name(void **state)
{
	char model[FIXTURE_PATH_SIZE], scene[FIXTURE_PATH_SIZE];
	const size_t shape[3] = {2, 32, 48};
	size_t count;
	float *frames;

	(void)state;
	if (!find_tiny(model, scene))
		skip();
	fixture_diorama(&run, "render", "--model", model, "--scene", scene, "--path", "orbit",
			"--frames", "5", "--out", fixture_path("film"), NULL);
	expect_success();
	assert_true(dio_path_is_file(fixture_path("film/orbit.mp4")));
	fixture_write("walk.tum", "0 0 0 -2 0 0 0 1\n1 0.1 0 -2 0 0 0 1\n");
	fixture_diorama(&run, "render", "--model", model, "--scene", scene, "--path",
			fixture_path("walk.tum"), "--raw", "--out", fixture_path("film"), NULL);
	expect_success();
	assert_true(dio_path_is_file(fixture_path("film/walk.mp4")));
	frames = read_npy(fixture_path("film/frames.npy"), shape, &count);
	free(frames);
	fixture_write("walk.tum", "0 0 0 -2 0 0 0 1\n1 0.1 0 -2 0 0 0 x\n");
	fixture_diorama(&run, "render", "--model", model, "--scene", scene, "--path",
			fixture_path("walk.tum"), "--out", fixture_path("film"), NULL);
	fixture_expect_refusal(&run, 1, "walk.tum|line 2");
}

/* --raw renders them one at a time. */
static void pictures_of_a_path_are_those_of_one_at_a_time(void **state)
{
	char model[FIXTURE_PATH_SIZE], scene[FIXTURE_PATH_SIZE], *alone, *together;

	(void)state;
	if (!find_tiny(model, scene))
		skip();
	fixture_diorama(&run, "render", "--model", model, "--scene", scene, "--path", "orbit",
			"--frames", "7", "--raw", "--hash", "--threads", "1", "--out",
			fixture_path("hashes"), NULL);
	expect_success();
	alone = strdup(strchr(run.out, '\n'));
	fixture_diorama(&run, "render", "--model", model, "--scene", scene, "--path", "orbit",
			"--frames", "7", "--hash", "--threads", "2", "--out",
			fixture_path("hashes"), NULL);
	expect_success();
	together = strchr(run.out, '\n');
	assert_non_null(strstr(together, "cache"));
	assert_string_equal(together, alone);
	free(alone);
}

static void pictures_are_called_after_their_targets(void **state)
{
	char model[FIXTURE_PATH_SIZE], text[2048];
	const char *path = fixture_shared("golden/tiny/model.safetensors");
	struct dio_picture picture = {0};

	(void)state;
	if (!path)
		skip();
	snprintf(model, sizeof model, "%s", path);
	fixture_write_picture("named/images/one.png", 32, 24);
	snprintf(text, sizeof text,
		 "{\"camera\":{\"width\":32,\"height\":24,\"fx\":30,\"fy\":30,\"cx\":15.5,\"cy\":"
		 "11.5},"
		 "\"frames\":[{\"file\":\"images/one.png\",\"world_from_camera\":%s},"
		 "{\"file\":\"images/one.png\",\"role\":\"target\",\"world_from_camera\":%s},"
		 "{\"role\":\"target\",\"world_from_camera\":%s}]}",
		 "[1,0,0,0,0,1,0,0,0,0,1,0,0,0,0,1]", "[1,0,0,0,0,1,0,0,0,0,1,0,0,0,0,1]",
		 "[1,0,0,1,0,1,0,0,0,0,1,0,0,0,0,1]");
	fixture_write("named/scene.json", text);
	fixture_diorama(&run, "render", "--model", model, "--scene", fixture_path("named"), "--out",
			fixture_path("named/deep/out"), NULL);
	expect_success();
	assert_int_equal(dio_picture_read(fixture_path("named/deep/out/one.png"), &picture, NULL),
			 DIO_OK);
	assert_int_equal(picture.width, 32);
	assert_int_equal(picture.height, 24);
	assert_true(dio_path_is_file(fixture_path("named/deep/out/target_001.png")));
	dio_picture_deinit(&picture);
}

/* The numbers are the engine's affair; here: the table, its worst line, JSON, and refusals. */
static void quantize_compares_layers_on_a_scene(void **state)
{
	char model[FIXTURE_PATH_SIZE], scene[FIXTURE_PATH_SIZE];

	(void)state;
	if (!find_tiny(model, scene))
		skip();
	fixture_diorama(&run, "quantize", model, "--out", fixture_path("m8.safetensors"),
			"--calibration", scene, NULL);
	expect_success();
	assert_non_null(strstr(run.out, "block 0   cross"));
	assert_non_null(strstr(run.out, "\nworst: "));
	fixture_diorama(&run, "quantize", model, "--out", fixture_path("m8.safetensors"),
			"--calibration", scene, "--json", NULL);
	expect_success();
	assert_non_null(strstr(run.out, "\"layers\""));
	assert_non_null(strstr(run.out, "\"output_db\""));
	fixture_diorama(&run, "quantize", model, "--out", fixture_path("m8.safetensors"), NULL);
	expect_success();
	assert_null(strstr(run.out, "block 0"));
	fixture_diorama(&run, "quantize", model, "--out", fixture_path("m8.safetensors"),
			"--calibration", fixture_path("nowhere.json"), NULL);
	fixture_expect_refusal(&run, 1, "nowhere.json");
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(raw_frames_are_the_oracle_s_numbers),
		cmocka_unit_test(a_model_s_card_asks_for_deblocking_but_not_of_raw_numbers),
		cmocka_unit_test(a_scene_cache_renders_the_same_bytes_on_any_number_of_threads),
		cmocka_unit_test(a_cache_of_another_model_is_refused),
		cmocka_unit_test(a_path_becomes_a_film_of_its_name),
		cmocka_unit_test(pictures_of_a_path_are_those_of_one_at_a_time),
		cmocka_unit_test(pictures_are_called_after_their_targets),
		cmocka_unit_test(quantize_compares_layers_on_a_scene),
	};

	return cmocka_run_group_tests(tests, fixture_setup, fixture_teardown);
}
