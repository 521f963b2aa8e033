/* Camera files: what is written reads back the same, what is wrong is refused by file and key. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "support.h"

static const struct dio_camera_model camera = {
	640, 480, 532.8123456789012, 532.9, 342.25, 233.9 / 3, {-0.29, 0.1 / 3, 1e-17, -0.0001, 0},
};

static char folder[256];

static int make_folder(void **state)
{
	const char *base = getenv("TMPDIR");

	(void)state;
	snprintf(folder, sizeof(folder), "%s/dio-camera-XXXXXX", base ? base : "/tmp");
	return mkdtemp(folder) ? 0 : -1;
}

static int remove_folder(void **state)
{
	(void)state;
	return rmdir(folder);
}

static void path_in_folder(char *path, size_t size, const char *name)
{
	snprintf(path, size, "%s/%s", folder, name);
}

static void assert_same_model(const struct dio_camera_model *a, const struct dio_camera_model *b)
{
	assert_int_equal(a->width, b->width);
	assert_int_equal(a->height, b->height);
	assert_true(a->fx == b->fx && a->fy == b->fy && a->cx == b->cx && a->cy == b->cy);
	for (int i = 0; i < 5; i++)
		assert_true(a->dist[i] == b->dist[i]);
}

static void check_round_trip(enum dio_camera_file kind, const struct dio_calibration *calibration)
{
	struct dio_camera_model model = {0};
	struct dio_error error = {""};
	char path[512];

	path_in_folder(path, sizeof(path), "camera.yaml");
	if (dio_camera_model_write(path, kind, &camera, calibration, &error) != DIO_OK)
		fail_msg("%s", error.text);
	if (dio_camera_model_read(path, &model, &error) != DIO_OK)
		fail_msg("%s", error.text);
	assert_same_model(&camera, &model);
	assert_int_equal(unlink(path), 0);
}

static void files_read_back_to_the_same_bits(void **state)
{
	struct dio_calibration calibration = {.model = camera, .rms_px = 0.2, .views_used = 12};

	(void)state;
	check_round_trip(DIO_CAMERA_FILE_OPENCV, NULL);
	check_round_trip(DIO_CAMERA_FILE_OPENCV, &calibration);
	check_round_trip(DIO_CAMERA_FILE_ROS, NULL);
	check_round_trip(DIO_CAMERA_FILE_ROS, &calibration);
}

static void file_has_the_keys_its_readers_expect(void **state)
{
	const char *ros[] = {"image_width: 640",
			     "camera_name:",
			     "camera_matrix:\n  rows: 3\n  cols: 3\n  data: [",
			     "distortion_model: plumb_bob",
			     "distortion_coefficients:\n  rows: 1\n  cols: 5\n  data: [",
			     "rectification_matrix:\n",
			     "projection_matrix:\n  rows: 3\n  cols: 4\n"};
	const char *opencv[] = {"%YAML:1.0", "image_width: 640", "camera_matrix: !!opencv-matrix",
				"distortion_coefficients: !!opencv-matrix"};
	char path[512], text[4096];

	(void)state;
	path_in_folder(path, sizeof(path), "camera.yaml");
	for (int ros_file = 0; ros_file < 2; ros_file++) {
		const char **keys = ros_file ? ros : opencv;
		size_t count =
			ros_file ? sizeof(ros) / sizeof(*ros) : sizeof(opencv) / sizeof(*opencv);
		enum dio_camera_file kind = ros_file ? DIO_CAMERA_FILE_ROS : DIO_CAMERA_FILE_OPENCV;

		assert_int_equal(dio_camera_model_write(path, kind, &camera, NULL, NULL), DIO_OK);
		FILE *file = fopen(path, "r");
		assert_non_null(file);
		text[fread(text, 1, sizeof(text) - 1, file)] = '\0';
		fclose(file);
		for (size_t i = 0; i < count; i++)
			if (!strstr(text, keys[i]))
				fail_msg("'%s' is not in:\n%s", keys[i], text);
	}
	unlink(path);
}

static const char good[] = "image_width: 640\n"
			   "image_height: 480\n"
			   "camera_name: narrow_stereo\n"
			   "camera_matrix:\n"
			   "  rows: 3\n"
			   "  cols: 3\n"
			   "  data: [500.5, 0., 320, 0, 501, 240, 0, 0, 1]\n"
			   "distortion_model: plumb_bob\n"
			   "distortion_coefficients:\n"
			   "  rows: 1\n"
			   "  cols: 5\n"
			   "  data: [-0.1, 0.02, 0, 0, 0]\n";

static enum dio_status read_text(const char *text, struct dio_camera_model *model,
				 struct dio_error *error)
{
	char path[512];

	path_in_folder(path, sizeof(path), "typed.yaml");
	FILE *file = fopen(path, "w");
	assert_non_null(file);
	fputs(text, file);
	fclose(file);
	enum dio_status status = dio_camera_model_read(path, model, error);
	unlink(path);
	return status;
}

/* `good` with its first `from` replaced. */
static enum dio_status read_edited(const char *from, const char *to, struct dio_error *error)
{
	struct dio_camera_model model = {.width = 4711};
	const char *at = strstr(good, from);
	char text[2048];

	assert_non_null(at);
	snprintf(text, sizeof(text), "%.*s%s%s", (int)(at - good), good, to, at + strlen(from));
	enum dio_status status = read_text(text, &model, error);
	if (status != DIO_OK)
		assert_int_equal(model.width, 4711);
	return status;
}

static void expect_bad(const char *from, const char *to, const char *key)
{
	struct dio_error error = {""};

	assert_int_equal(read_edited(from, to, &error), DIO_BAD_FILE);
	if (!strstr(error.text, key) || !strstr(error.text, "typed.yaml") ||
	    strchr(error.text, '\n'))
		fail_msg("'%s' -> '%s': '%s' is not one line with '%s'", from, to, error.text, key);
}

static void hand_written_files_are_read(void **state)
{
	struct dio_camera_model model = {0};
	struct dio_error error = {""};
	char text[2048];

	(void)state;
	if (read_text(good, &model, &error) != DIO_OK)
		fail_msg("%s", error.text);
	assert_true(model.fx == 500.5 && model.cy == 240 && model.dist[0] == -0.1);
	snprintf(text, sizeof(text), "---\n# by hand\n%s", good);
	assert_int_equal(read_text(text, &model, &error), DIO_OK);
	snprintf(text, sizeof(text), "%%YAML:1.0\n---\n%s", good);
	assert_int_equal(read_text(text, &model, &error), DIO_OK);
	assert_int_equal(read_edited("cols: 5\n  data: [-0.1, 0.02, 0, 0, 0]",
				     "cols: 4\n  data: [-0.1, 0.02, 0, 0]", &error),
			 DIO_OK);
	assert_int_equal(
		read_edited("data: [500.5, 0., 320, 0,", "data: [500.5, 0., 320,\n    0,", &error),
		DIO_OK);
}

static void missing_or_wrong_keys_are_named(void **state)
{
	(void)state;
	expect_bad("image_width: 640\n", "", "image_width");
	expect_bad("image_height: 480\n", "", "image_height");
	expect_bad("image_width: 640", "image_width: 0", "image_width");
	expect_bad("image_width: 640", "image_width: -3", "image_width");
	expect_bad("image_width: 640", "image_width: 640.5", "image_width");
	expect_bad("image_width: 640", "image_width: wide", "image_width");
	expect_bad("camera_matrix:", "other_matrix:", "camera_matrix");
	expect_bad("distortion_coefficients:", "other:", "distortion_coefficients");
	expect_bad("500.5", "0", "focal length");
	expect_bad("500.5", "-500", "focal length");
	expect_bad("500.5", ".nan", "camera_matrix");
	expect_bad("500.5", ".inf", "camera_matrix");
	expect_bad("500.5", "1e999", "camera_matrix");
	expect_bad("500.5", "many", "camera_matrix");
	expect_bad("500.5, 0.", "500.5, 3", "camera_matrix");
	expect_bad("0, 0, 1]", "0, 0, 2]", "camera_matrix");
	expect_bad("0, 0, 1]", "0, 0]", "camera_matrix");
	expect_bad("rows: 3", "rows: 4", "camera_matrix");
	expect_bad("  rows: 3\n", "", "rows");
	expect_bad("[-0.1, 0.02, 0, 0, 0]", "7", "distortion_coefficients");
	expect_bad("[-0.1, 0.02,", "[-0.1, .nan,", "distortion_coefficients");
}

static void models_beyond_five_coefficients_are_unsupported(void **state)
{
	struct dio_error error = {""};

	(void)state;
	assert_int_equal(read_edited("plumb_bob", "equidistant", &error), DIO_UNSUPPORTED);
	assert_non_null(strstr(error.text, "equidistant"));
	assert_int_equal(read_edited("cols: 5\n  data: [-0.1, 0.02, 0, 0, 0]",
				     "cols: 8\n  data: [-0.1, 0.02, 0, 0, 0, 0.3, 0, 0]", &error),
			 DIO_UNSUPPORTED);
}

static void files_that_are_no_yaml_are_refused(void **state)
{
	char brackets[5000] = "a: ";
	const char *texts[] = {"",
			       "   \n",
			       "{\"image_width\": 640}",
			       "<?xml version=\"1.0\"?><opencv_storage/>",
			       "%YAML:1.0\n---\n",
			       "%YAML:1.0",
			       "just words",
			       "- 1\n- 2\n",
			       "image_width: [1, 2",
			       "image_width: \"unterminated",
			       "image_width: !!opencv-matrix\n  rows: 99999999\n",
			       "\t\tx: 1",
			       brackets};

	(void)state;
	memset(brackets + 3, '[', sizeof(brackets) - 4);
	for (size_t i = 0; i < sizeof(texts) / sizeof(texts[0]); i++) {
		struct dio_camera_model model = {0};
		struct dio_error error = {""};

		if (read_text(texts[i], &model, &error) != DIO_BAD_FILE)
			fail_msg("'%.30s' is not refused", texts[i]);
		if (!strstr(error.text, "typed.yaml") || strchr(error.text, '\n'))
			fail_msg("'%.30s': '%s' is not one line with the file's name", texts[i],
				 error.text);
	}
}

/* Every truncation and many flipped bytes: an answer, never a crash, never half a model. */
static void damaged_files_never_crash(void **state)
{
	struct dio_camera_model model;
	char text[sizeof(good)];

	(void)state;
	for (size_t length = 0; length < sizeof(good) - 1; length++) {
		snprintf(text, sizeof(text), "%.*s", (int)length, good);
		model = (struct dio_camera_model){0};
		if (read_text(text, &model, NULL) == DIO_OK)
			assert_true(model.fx == 500.5 && model.fy == 501);
		else
			assert_true(model.fx == 0);
	}
	for (size_t at = 0; at < sizeof(good) - 1; at++)
		for (int bit = 0; bit < 7; bit += 2) {
			memcpy(text, good, sizeof(good));
			text[at] = (char)(text[at] ^ (1 << bit));
			model = (struct dio_camera_model){0};
			if (read_text(text, &model, NULL) == DIO_OK)
				assert_true(model.fx > 0 && isfinite(model.fx) &&
					    isfinite(model.dist[1]));
		}
}

static void absent_or_unwritable_files_are_named(void **state)
{
	struct dio_camera_model model = {0};
	struct dio_error error = {""};
	char path[512];

	(void)state;
	path_in_folder(path, sizeof(path), "absent.yaml");
	assert_int_equal(dio_camera_model_read(path, &model, &error), DIO_NOT_FOUND);
	assert_non_null(strstr(error.text, "absent.yaml"));
	path_in_folder(path, sizeof(path), "no/such/folder.yaml");
	assert_true(dio_camera_model_write(path, DIO_CAMERA_FILE_ROS, &camera, NULL, &error) !=
		    DIO_OK);
	assert_non_null(strstr(error.text, "folder.yaml"));
	assert_int_equal(
		dio_camera_model_write("/dev/full", DIO_CAMERA_FILE_ROS, &camera, NULL, &error),
		DIO_NO_SPACE);
}

static void model_that_is_no_camera_is_not_written(void **state)
{
	struct dio_camera_model model = camera;
	struct dio_error error = {""};
	char path[512];

	(void)state;
	model.fx = NAN;
	path_in_folder(path, sizeof(path), "bad.yaml");
	assert_int_equal(dio_camera_model_write(path, DIO_CAMERA_FILE_OPENCV, &model, NULL, &error),
			 DIO_BAD_ARG);
	assert_int_equal(access(path, F_OK), -1);
}

static void published_opencv_files_are_read(void **state)
{
	struct dio_camera_model model = {0};
	struct dio_error error = {""};
	char buffer[512], path[600];

	(void)state;
	if (!shared_folder("data/calibration/aruco_lib_board_and_markers/yml", buffer,
			   sizeof(buffer)))
		skip();
	snprintf(path, sizeof(path), "%s/board_intrinsics.yml", buffer);
	if (dio_camera_model_read(path, &model, &error) != DIO_OK)
		fail_msg("%s", error.text);
	assert_int_equal(model.width, 640);
	assert_true(model.fx > 100 && model.fy > 100);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(files_read_back_to_the_same_bits),
		cmocka_unit_test(file_has_the_keys_its_readers_expect),
		cmocka_unit_test(hand_written_files_are_read),
		cmocka_unit_test(missing_or_wrong_keys_are_named),
		cmocka_unit_test(models_beyond_five_coefficients_are_unsupported),
		cmocka_unit_test(files_that_are_no_yaml_are_refused),
		cmocka_unit_test(damaged_files_never_crash),
		cmocka_unit_test(absent_or_unwritable_files_are_named),
		cmocka_unit_test(model_that_is_no_camera_is_not_written),
		cmocka_unit_test(published_opencv_files_are_read),
	};

	return cmocka_run_group_tests(tests, make_folder, remove_folder);
}
