/* diorama poses: as near to the simulated truth as a board allows, and nothing guessed. */
#include "unit/app/fixture.h"

#include <cjson/cJSON.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "camera/sim_truth.h"
#include "core/scene_file.h"
#include "core/view.h"
#include "dio/calibration.h"

#define BOARD  "charuco:7x5:0.04:0.03:DICT_6X6_250"
#define SIM    "sim:table?seed=5&fov=40&samples=1&board=" BOARD
#define FRAMES 12

static struct fixture_run run;
static struct dio_sim_camera truth[FRAMES];

/* A recording of the walk, its true cameras, and the true lens as a camera file. */
static int record(void **state)
{
	const struct dio_camera_options options = {.as_fast_as_possible = true,
						   .frames_per_second = 0.3};
	struct dio_camera_model model = {0};
	struct dio_error error = {""};
	struct dio_camera *camera;
	struct dio_frame frame;

	if (fixture_setup(state) != 0)
		return -1;
	fixture_diorama(&run, "capture", SIM, "--fps", "0.3", "--frames", "12", "--out",
			fixture_path("walk"), NULL);
	if (run.code != 0 || dio_camera_open(SIM, &options, &camera, &error) != DIO_OK ||
	    dio_camera_start(camera, &error) != DIO_OK)
		return -1;
	for (int i = 0; i < FRAMES; i++)
		if (dio_camera_acquire(camera, &frame, 1000000000, &error) != DIO_OK ||
		    !dio_sim_camera_get_truth(camera, &truth[i]))
			return -1;
	dio_camera_close(camera);
	model = (struct dio_camera_model){.width = truth[0].width,
					  .height = truth[0].height,
					  .fx = truth[0].fx,
					  .fy = truth[0].fy,
					  .cx = truth[0].cx,
					  .cy = truth[0].cy};
	memcpy(model.dist, truth[0].dist, sizeof model.dist);
	return dio_camera_model_write(fixture_path("camera.yaml"), DIO_CAMERA_FILE_OPENCV, &model,
				      NULL, &error) == DIO_OK
		       ? 0
		       : -1;
}

static void pose_walk(const char *out)
{
	fixture_diorama(&run, "poses", fixture_path("walk"), "--camera",
			fixture_path("camera.yaml"), "--board", BOARD, "--out", fixture_path(out),
			"--json", NULL);
	if (run.code != 0)
		fail_msg("%s", run.err);
}

/* The frame number behind "images/NNN.png": the recording is posed frame by frame. */
static int frame_number(const char *file)
{
	int number = -1;

	assert_int_equal(sscanf(file, "images/%d.png", &number), 1);
	assert_in_range(number, 0, FRAMES - 1);
	return number;
}

static void poses_are_within_millimetres_and_tenths_of_degrees(void **state)
{
	struct dio_scene_file scene = {0};
	struct dio_error error = {""};
	double worst_mm = 0, worst_deg = 0;

	(void)state;
	pose_walk("a/scene.json");
	assert_int_equal(dio_scene_file_read(fixture_path("a/scene.json"), &scene, &error), DIO_OK);
	assert_true(scene.frame_count >= 10);
	for (uint32_t i = 0; i < scene.frame_count; i++) {
		const double *is = scene.frames[i].pose.world_from_camera;
		const double *was = truth[frame_number(scene.frames[i].file)].world_from_camera;
		double sum = 0;

		for (int row = 0; row < 3; row++)
			for (int col = 0; col < 3; col++)
				sum += pow(is[4 * row + col] - was[4 * row + col], 2);
		worst_deg = fmax(worst_deg, 2 * asin(sqrt(sum / 8)) * 180 / acos(-1));
		worst_mm = fmax(worst_mm, 1000 * hypot(hypot(is[3] - was[3], is[7] - was[7]),
						       is[11] - was[11]));
	}
	print_message("worst pose %.2f mm, %.3f degrees\n", worst_mm, worst_deg);
	assert_true(worst_mm < 8);
	assert_true(worst_deg < 0.5);
	dio_scene_file_deinit(&scene);
}

static void the_scene_holds_pinhole_pictures_and_both_roles(void **state)
{
	struct dio_scene_file scene = {0};
	struct dio_view_set set = {0};
	struct dio_error error = {""};

	(void)state;
	fixture_diorama(&run, "poses", fixture_path("walk"), "--camera",
			fixture_path("camera.yaml"), "--board", BOARD, "--out",
			fixture_path("b/scene.json"), "--hold-out", "3", "--context", "4",
			"--width", "128", "--height", "128", NULL);
	assert_int_equal(run.code, 0);
	assert_int_equal(dio_scene_file_read(fixture_path("b/scene.json"), &scene, &error), DIO_OK);
	assert_int_equal(dio_scene_file_count(&scene, DIO_ROLE_CONTEXT), 4);
	assert_in_range(dio_scene_file_count(&scene, DIO_ROLE_TARGET), 3, 4);
	for (uint32_t i = 0; i < scene.frame_count; i++) {
		const struct dio_camera_model *camera = &scene.frames[i].camera;

		assert_int_equal(camera->width, 128);
		assert_int_equal(camera->height, 128);
		assert_true(camera->fx == camera->fy);
		for (int k = 0; k < 5; k++)
			assert_true(camera->dist[k] == 0);
	}
	assert_int_equal(dio_view_set_load(&scene, DIO_LOAD_ALL, &set, &error), DIO_OK);
	dio_view_set_deinit(&set);
	dio_scene_file_deinit(&scene);
}

static void a_picture_without_a_board_is_listed_and_not_guessed(void **state)
{
	const cJSON *views, *view;
	cJSON *root;
	int seen = 0;

	(void)state;
	fixture_write_picture("walk/frames/blank.png", 640, 480);
	fixture_write_picture("walk/frames/small.png", 320, 240);
	fixture_diorama(&run, "poses", fixture_path("walk/frames"), "--camera",
			fixture_path("camera.yaml"), "--board", BOARD, "--out",
			fixture_path("c/scene.json"), "--json", NULL);
	assert_int_equal(run.code, 0);
	root = cJSON_Parse(run.out);
	assert_non_null(root);
	views = cJSON_GetObjectItem(root, "views");
	assert_int_equal(cJSON_GetArraySize(views), FRAMES + 2);
	cJSON_ArrayForEach(view, views)
	{
		const char *name = cJSON_GetObjectItem(view, "name")->valuestring;
		const char *use = cJSON_GetObjectItem(view, "use")->valuestring;

		if (strstr(name, "blank.png")) {
			assert_string_equal(use, "no board");
			assert_null(cJSON_GetObjectItem(view, "file"));
			seen++;
		} else if (strstr(name, "small.png")) {
			assert_string_equal(use, "no pose");
			assert_non_null(strstr(cJSON_GetObjectItem(view, "reason")->valuestring,
					       "320 x 240"));
			seen++;
		}
	}
	assert_int_equal(seen, 2);
	cJSON_Delete(root);
	assert_int_equal(unlink(fixture_path("walk/frames/blank.png")), 0);
	assert_int_equal(unlink(fixture_path("walk/frames/small.png")), 0);
}

static void pictures_of_another_size_than_the_camera_are_refused(void **state)
{
	struct dio_camera_model model;
	struct dio_error error = {""};

	(void)state;
	assert_int_equal(dio_camera_model_read(fixture_path("camera.yaml"), &model, &error),
			 DIO_OK);
	model.width = 1280;
	model.height = 960;
	assert_int_equal(dio_camera_model_write(fixture_path("large.yaml"), DIO_CAMERA_FILE_ROS,
						&model, NULL, &error),
			 DIO_OK);
	fixture_diorama(&run, "poses", fixture_path("walk"), "--camera", fixture_path("large.yaml"),
			"--board", BOARD, "--out", fixture_path("d/scene.json"), NULL);
	fixture_expect_refusal(&run, 1, "1280 x 960");
	assert_int_not_equal(access(fixture_path("d/scene.json"), F_OK), 0);
}

static void bad_requests_are_told_in_one_line(void **state)
{
	(void)state;
	fixture_diorama(&run, "poses", fixture_path("walk"), "--camera", fixture_path("none.yaml"),
			"--board", BOARD, "--out", fixture_path("e/scene.json"), NULL);
	fixture_expect_refusal(&run, 1, "none.yaml");
	fixture_diorama(&run, "poses", fixture_path("walk"), "--camera",
			fixture_path("camera.yaml"), "--board", "checkers", "--out",
			fixture_path("e/scene.json"), NULL);
	fixture_expect_refusal(&run, 1, "checkers");
	fixture_write("file", "");
	fixture_diorama(&run, "poses", fixture_path("walk"), "--camera",
			fixture_path("camera.yaml"), "--board", BOARD, "--out",
			fixture_path("file/scene.json"), NULL);
	fixture_expect_refusal(&run, 1, "file");
	fixture_diorama(&run, "poses", fixture_path("walk"), "--camera",
			fixture_path("camera.yaml"), "--board", "chessboard:9x6:0.025", "--out",
			fixture_path("e/scene.json"), NULL);
	fixture_expect_refusal(&run, 1, "no pose");
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(poses_are_within_millimetres_and_tenths_of_degrees),
		cmocka_unit_test(the_scene_holds_pinhole_pictures_and_both_roles),
		cmocka_unit_test(a_picture_without_a_board_is_listed_and_not_guessed),
		cmocka_unit_test(pictures_of_another_size_than_the_camera_are_refused),
		cmocka_unit_test(bad_requests_are_told_in_one_line),
	};

	return cmocka_run_group_tests(tests, record, fixture_teardown);
}
