/* Imports: axes, pixel centres and intrinsics against values worked out by hand. */
#include "unit/app/fixture.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "core/import.h"
#include "core/tum.h"

#define OPENGL_IDENTITY "[[1,0,0,0],[0,1,0,0],[0,0,1,0],[0,0,0,1]]"

static void expect_numbers(const double *got, const double *wanted, int count)
{
	for (int i = 0; i < count; i++)
		if (!(fabs(got[i] - wanted[i]) <= 1e-12))
			fail_msg("number %d: %.15g instead of %.15g", i, got[i], wanted[i]);
}

static struct dio_scene_file import_transforms(const char *name)
{
	struct dio_scene_file scene = {0};
	struct dio_error error = {0};

	if (dio_import_transforms(fixture_path(name), fixture_path(""), &scene, &error) != DIO_OK)
		fail_msg("%s", error.text);
	return scene;
}

static void opengl_axes_turn_to_opencv_axes(void **state)
{
	/* An OpenGL camera at (1,2,3) without rotation looks along -z with y up. */
	const double wanted[16] = {1, 0, 0, 1, 0, -1, 0, 2, 0, 0, -1, 3, 0, 0, 0, 1};
	struct dio_scene_file scene;

	(void)state;
	fixture_write_picture("gl/images/a.png", 40, 30);
	fixture_write("gl/transforms.json",
		      "{\"fl_x\":50,\"fl_y\":51,\"cx\":20,\"cy\":15,\"w\":40,\"h\":30,\"k1\":0.1,"
		      "\"k2\":-0.2,\"p1\":0.001,\"p2\":0.002,\"frames\":[{\"file_path\":"
		      "\"./images/a.png\",\"transform_matrix\":[[1,0,0,1],[0,1,0,2],[0,0,1,3],"
		      "[0,0,0,1]]}]}");
	scene = import_transforms("gl/transforms.json");
	assert_int_equal(scene.frame_count, 1);
	expect_numbers(scene.frames[0].pose.world_from_camera, wanted, 16);
	/* The middle of a picture 40 wide is at 20 from its corner, at 19.5 between pixel centres.
	 */
	expect_numbers(&scene.frames[0].camera.fx, (double[]){50, 51, 19.5, 14.5}, 4);
	expect_numbers(scene.frames[0].camera.dist, (double[]){0.1, -0.2, 0.001, 0.002, 0}, 5);
	assert_string_equal(scene.frames[0].file, "gl/images/a.png");
	dio_scene_file_deinit(&scene);
}

static void a_blender_set_has_its_focal_length_from_the_angle_and_no_file_endings(void **state)
{
	const double angle = 0.6911112070083618;
	struct dio_scene_file scene;

	(void)state;
	fixture_write_picture("blender/train/r_0.png", 100, 80);
	fixture_write("blender/transforms.json",
		      "{\"camera_angle_x\":0.6911112070083618,\"frames\":[{\"file_path\":"
		      "\"./train/r_0\",\"rotation\":0.01,\"transform_matrix\":" OPENGL_IDENTITY
		      "}]}");
	scene = import_transforms("blender/transforms.json");
	assert_int_equal(scene.frames[0].camera.width, 100);
	assert_int_equal(scene.frames[0].camera.height, 80);
	expect_numbers(&scene.frames[0].camera.fx,
		       (double[]){50 / tan(angle / 2), 50 / tan(angle / 2), 49.5, 39.5}, 4);
	assert_string_equal(scene.frames[0].file, "blender/train/r_0.png");
	dio_scene_file_deinit(&scene);
}

static void a_frame_s_own_intrinsics_go_before_the_file_s(void **state)
{
	struct dio_scene_file scene;

	(void)state;
	fixture_write_picture("own/a.png", 40, 30);
	fixture_write_picture("own/b.png", 20, 10);
	fixture_write(
		"own/transforms.json",
		"{\"fl_x\":50,\"cx\":20,\"cy\":15,\"w\":40,\"h\":30,\"frames\":[{\"file_path\":"
		"\"a.png\",\"transform_matrix\":" OPENGL_IDENTITY
		"},{\"file_path\":\"b.png\",\"fl_x\":33,\"cx\":11,\"cy\":5,\"w\":20,\"h\":10,"
		"\"transform_matrix\":" OPENGL_IDENTITY "}]}");
	scene = import_transforms("own/transforms.json");
	expect_numbers(&scene.frames[0].camera.fx, (double[]){50, 50, 19.5, 14.5}, 4);
	expect_numbers(&scene.frames[1].camera.fx, (double[]){33, 33, 10.5, 4.5}, 4);
	assert_int_equal(scene.frames[1].camera.width, 20);
	dio_scene_file_deinit(&scene);
}

static void bad_transforms_are_refused(void **state)
{
	const struct {
		const char *text, *words;
		enum dio_status status;
	} bad[] = {
		{"{", "not JSON", DIO_BAD_FILE},
		{"{}", "frames", DIO_BAD_FILE},
		{"{\"frames\":[{}]}", "frame 0 (no file_path)", DIO_BAD_FILE},
		{"{\"frames\":[{\"file_path\":\"zz.png\"}]}", "missing", DIO_BAD_FILE},
		{"{\"frames\":[{\"file_path\":\"a.png\"}]}", "neither fl_x nor camera_angle_x",
		 DIO_BAD_FILE},
		{"{\"camera_angle_x\":7,\"frames\":[{\"file_path\":\"a.png\"}]}", "camera_angle_x",
		 DIO_BAD_FILE},
		{"{\"fl_x\":9,\"frames\":[{\"file_path\":\"a.png\"}]}", "transform_matrix",
		 DIO_BAD_FILE},
		{"{\"fl_x\":0,\"frames\":[{\"file_path\":\"a.png\",\"transform_"
		 "matrix\":" OPENGL_IDENTITY "}]}",
		 "focal length", DIO_BAD_FILE},
		{"{\"fl_x\":9,\"frames\":[{\"file_path\":\"a.png\",\"transform_matrix\":[[2,0,0,0],"
		 "[0,2,0,0],[0,0,2,0],[0,0,0,1]]}]}",
		 "not orthonormal", DIO_BAD_FILE},
		{"{\"camera_model\":\"OPENCV_FISHEYE\",\"fl_x\":9,\"frames\":[{\"file_path\":\"a."
		 "png\"}]}",
		 "undistort", DIO_UNSUPPORTED},
		{"{\"k4\":0.1,\"fl_x\":9,\"frames\":[{\"file_path\":\"a.png\"}]}", "undistort",
		 DIO_UNSUPPORTED},
		{"{\"w\":-3,\"h\":1e300,\"fl_x\":9,\"frames\":[{\"file_path\":\"a.png\"}]}",
		 "w or h", DIO_BAD_FILE},
	};

	(void)state;
	fixture_write_picture("badgl/a.png", 8, 8);
	for (size_t i = 0; i < sizeof bad / sizeof *bad; i++) {
		struct dio_scene_file scene = {0};
		struct dio_error error = {0};

		fixture_write("badgl/t.json", bad[i].text);
		assert_int_equal(dio_import_transforms(fixture_path("badgl/t.json"),
						       fixture_path(""), &scene, &error),
				 bad[i].status);
		if (!strstr(error.text, bad[i].words) || !strstr(error.text, "t.json"))
			fail_msg("\"%s\" is not in: %s", bad[i].words, error.text);
	}
}

/* A COLMAP model whose camera stands at (1,2,3), turned by 90 degrees about y. */
static void write_colmap(const char *camera)
{
	char text[512];

	fixture_write_picture("colmap/images/sub/b b.png", 40, 30);
	fixture_write_picture("colmap/images/a.png", 40, 30);
	snprintf(text, sizeof text, "# cameras\n%s\n", camera);
	fixture_write("colmap/sparse/0/cameras.txt", text);
	/* R_cam_world turns x to z: camera x = world z reversed; t = -R c. */
	fixture_write("colmap/sparse/0/images.txt",
		      "# images\n"
		      "7 0.70710678118654757 0 0.70710678118654757 0 -3 -2 1 4 sub/b b.png\n"
		      "1.5 2.5 -1 3.5 4.5 12\n"
		      "3 1 0 0 0 -1 -2 -3 4 a.png\n"
		      "\n");
}

static struct dio_scene_file import_colmap(void)
{
	struct dio_scene_file scene = {0};
	struct dio_error error = {0};

	if (dio_import_colmap(fixture_path("colmap/sparse/0"), NULL, fixture_path("colmap"), &scene,
			      &error) != DIO_OK)
		fail_msg("%s", error.text);
	return scene;
}

static void colmap_poses_are_inverted_and_sorted_by_name(void **state)
{
	const double straight[16] = {1, 0, 0, 1, 0, 1, 0, 2, 0, 0, 1, 3, 0, 0, 0, 1};
	/* R_cam_world = [[0,0,1],[0,1,0],[-1,0,0]]; its transpose is world_from_camera. */
	const double turned[16] = {0, 0, -1, 1, 0, 1, 0, 2, 1, 0, 0, 3, 0, 0, 0, 1};
	struct dio_scene_file scene;

	(void)state;
	write_colmap("4 PINHOLE 40 30 50 51 20 15");
	scene = import_colmap();
	assert_int_equal(scene.frame_count, 2);
	assert_string_equal(scene.frames[0].file, "images/a.png");
	assert_string_equal(scene.frames[1].file, "images/sub/b b.png");
	expect_numbers(scene.frames[0].pose.world_from_camera, straight, 16);
	expect_numbers(scene.frames[1].pose.world_from_camera, turned, 16);
	dio_scene_file_deinit(&scene);
}

static void every_colmap_camera_model_is_read(void **state)
{
	const struct {
		const char *line;
		double intrinsics[4], dist[5];
	} cases[] = {
		{"4 SIMPLE_PINHOLE 40 30 50 20 15", {50, 50, 19.5, 14.5}, {0}},
		{"4 PINHOLE 40 30 50 51 20 15", {50, 51, 19.5, 14.5}, {0}},
		{"4 SIMPLE_RADIAL 40 30 50 20 15 0.1", {50, 50, 19.5, 14.5}, {0.1}},
		{"4 RADIAL 40 30 50 20 15 0.1 0.2", {50, 50, 19.5, 14.5}, {0.1, 0.2}},
		{"4 OPENCV 40 30 50 51 20 15 0.1 0.2 0.3 0.4",
		 {50, 51, 19.5, 14.5},
		 {0.1, 0.2, 0.3, 0.4}},
	};

	(void)state;
	for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
		struct dio_scene_file scene;

		write_colmap(cases[i].line);
		scene = import_colmap();
		expect_numbers(&scene.frames[0].camera.fx, cases[i].intrinsics, 4);
		expect_numbers(scene.frames[0].camera.dist, cases[i].dist, 5);
		dio_scene_file_deinit(&scene);
	}
}

static void bad_colmap_models_are_refused(void **state)
{
	const struct {
		const char *camera, *image, *words;
	} bad[] = {
		{"4 FULL_OPENCV 40 30 1 1 1 1 0 0 0 0 0 0 0 0", "1 1 0 0 0 0 0 0 4 a.png\n",
		 "cameras.txt: line 1|FULL_OPENCV|image_undistorter"},
		{"4 PINHOLE 40 30 50 51 20", "1 1 0 0 0 0 0 0 4 a.png\n", "line 1|too few"},
		{"4 PINHOLE 40 30 50 51 20 15 1", "1 1 0 0 0 0 0 0 4 a.png\n", "line 1|too many"},
		{"4 PINHOLE 0 30 50 51 20 15", "1 1 0 0 0 0 0 0 4 a.png\n", "width"},
		{"4 PINHOLE", "1 1 0 0 0 0 0 0 4 a.png\n", "width"},
		{"x", "1 1 0 0 0 0 0 0 4 a.png\n", "no camera number"},
		{"4 PINHOLE 40 30 50 51 20 15", "1 1 0 0 0 0 0 0 5 a.png\n",
		 "images.txt: line 1|cameras.txt"},
		{"4 PINHOLE 40 30 50 51 20 15", "1 1 0 0 0 0 0 0 4 no.png\n", "no.png|missing"},
		{"4 PINHOLE 40 30 50 51 20 15", "1 1 0 0 0 0 0 0 4\n", "no name"},
		{"4 PINHOLE 40 30 50 51 20 15", "1 2 0 0 0 0 0 0 4 a.png\n", "length 1"},
		{"4 PINHOLE 40 30 50 51 20 15", "1 1 0 0\n", "IMAGE_ID"},
		{"4 PINHOLE 40 30 50 51 20 15", "", "no context view"},
	};

	(void)state;
	fixture_write_picture("badcm/images/a.png", 40, 30);
	for (size_t i = 0; i < sizeof bad / sizeof *bad; i++) {
		static struct fixture_run run;

		fixture_write("badcm/cameras.txt", bad[i].camera);
		fixture_write("badcm/images.txt", bad[i].image);
		fixture_diorama(&run, "import", fixture_path("badcm"), "--out",
				fixture_path("badcm/scene.json"), NULL);
		fixture_expect_refusal(&run, 1, bad[i].words);
	}
}

static void the_command_writes_a_scene_with_held_out_targets(void **state)
{
	static struct fixture_run run;
	struct dio_scene_file scene = {0};
	struct dio_error error = {0};

	(void)state;
	write_colmap("4 PINHOLE 40 30 50 51 20 15");
	fixture_diorama(&run, "import", fixture_path("colmap/sparse/0"), "--out",
			fixture_path("colmap/scene.json"), "--hold-out", "2", "--name", "made",
			NULL);
	if (run.code != 0)
		fail_msg("%s", run.err);
	if (dio_scene_file_read(fixture_path("colmap/scene.json"), &scene, &error) != DIO_OK)
		fail_msg("%s", error.text);
	assert_string_equal(scene.name, "made");
	assert_int_equal(scene.frames[0].role, DIO_ROLE_TARGET);
	assert_int_equal(scene.frames[1].role, DIO_ROLE_CONTEXT);
	dio_scene_file_deinit(&scene);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(opengl_axes_turn_to_opencv_axes),
		cmocka_unit_test(
			a_blender_set_has_its_focal_length_from_the_angle_and_no_file_endings),
		cmocka_unit_test(a_frame_s_own_intrinsics_go_before_the_file_s),
		cmocka_unit_test(bad_transforms_are_refused),
		cmocka_unit_test(colmap_poses_are_inverted_and_sorted_by_name),
		cmocka_unit_test(every_colmap_camera_model_is_read),
		cmocka_unit_test(bad_colmap_models_are_refused),
		cmocka_unit_test(the_command_writes_a_scene_with_held_out_targets),
	};

	return cmocka_run_group_tests(tests, fixture_setup, fixture_teardown);
}
