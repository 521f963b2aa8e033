/* scene.json: what is right comes back, what is wrong is refused with file, frame and fault. */
#include "unit/app/fixture.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "core/scene_file.h"

#define CAMERA                  "\"camera\":{\"width\":16,\"height\":12,\"fx\":20,\"fy\":20,\"cx\":7.5,\"cy\":5.5}"
#define IDENTITY                "[1,0,0,0, 0,1,0,0, 0,0,1,0, 0,0,0,1]"
#define FRAME(file, pose, more) "{\"file\":\"" file "\",\"world_from_camera\":" pose more "}"
#define SCENE(camera, frames)   "{\"name\":\"t\"," camera ",\"frames\":[" frames "]}"
#define GOOD_FRAME              FRAME("a.png", IDENTITY, "")

static const struct bad_scene {
	const char *what, *text, *words;
} BAD[] = {
	{"missing picture", SCENE(CAMERA, GOOD_FRAME "," FRAME("gone.png", IDENTITY, "")),
	 "frame 1|gone.png|missing"},
	{"singular pose",
	 SCENE(CAMERA, GOOD_FRAME "," FRAME("a.png", "[1,0,0,0, 0,1,0,0, 0,0,0,0, 0,0,0,1]", "")),
	 "frame 1|a.png|singular"},
	{"pose with a scale of 1.002",
	 SCENE(CAMERA, FRAME("a.png", "[1.002,0,0,0, 0,1.002,0,0, 0,0,1.002,0, 0,0,0,1]", "")),
	 "frame 0|not orthonormal"},
	{"sheared pose",
	 SCENE(CAMERA, FRAME("a.png", "[1,0.0011,0,0, 0,1,0,0, 0,0,1,0, 0,0,0,1]", "")),
	 "frame 0|not orthonormal"},
	{"mirroring pose",
	 SCENE(CAMERA, FRAME("a.png", "[1,0,0,0, 0,1,0,0, 0,0,-1,0, 0,0,0,1]", "")),
	 "frame 0|mirrors"},
	{"last row", SCENE(CAMERA, FRAME("a.png", "[1,0,0,0, 0,1,0,0, 0,0,1,0, 0,0,1,1]", "")),
	 "frame 0|last row"},
	{"pose of 12 numbers", SCENE(CAMERA, FRAME("a.png", "[1,0,0,0, 0,1,0,0, 0,0,1,0]", "")),
	 "frame 0|world_from_camera|16 numbers"},
	{"pose with a text",
	 SCENE(CAMERA, FRAME("a.png", "[1,0,0,\"x\", 0,1,0,0, 0,0,1,0, 0,0,0,1]", "")),
	 "frame 0|world_from_camera|not a number"},
	{"pose beyond double",
	 SCENE(CAMERA, FRAME("a.png", "[1,0,0,1e999, 0,1,0,0, 0,0,1,0, 0,0,0,1]", "")),
	 "frame 0|world_from_camera|not finite"},
	{"NaN", SCENE(CAMERA, FRAME("a.png", "[1,0,0,NaN, 0,1,0,0, 0,0,1,0, 0,0,0,1]", "")),
	 "line 1|not finite"},
	{"no pose", SCENE(CAMERA, "{\"file\":\"a.png\"}"), "frame 0|a.png|world_from_camera"},
	{"zero focal length",
	 SCENE("\"camera\":{\"width\":16,\"height\":12,\"fx\":0,\"fy\":20,\"cx\":7.5,\"cy\":5.5}",
	       GOOD_FRAME),
	 "focal length fx|above zero"},
	{"zero focal length of one frame",
	 SCENE(CAMERA, GOOD_FRAME "," FRAME("a.png", IDENTITY,
					    ",\"camera\":{\"width\":16,\"height\":12,\"fx\":20,"
					    "\"fy\":-1,\"cx\":7.5,\"cy\":5.5}")),
	 "frame 1|a.png|focal length fy"},
	{"no camera", "{\"name\":\"t\",\"frames\":[" GOOD_FRAME "]}", "frame 0|no \"camera\""},
	{"camera without cx",
	 SCENE("\"camera\":{\"width\":16,\"height\":12,\"fx\":20,\"fy\":20,\"cy\":5.5}",
	       GOOD_FRAME),
	 "camera has no \"cx\""},
	{"half a pixel",
	 SCENE("\"camera\":{\"width\":16.5,\"height\":12,\"fx\":20,\"fy\":20,\"cx\":1,\"cy\":5.5}",
	       GOOD_FRAME),
	 "width|16.5"},
	{"huge picture",
	 SCENE("\"camera\":{\"width\":1e9,\"height\":12,\"fx\":20,\"fy\":20,\"cx\":1,\"cy\":5.5}",
	       GOOD_FRAME),
	 "width|16384"},
	{"camera of six distortion terms",
	 SCENE("\"camera\":{\"width\":16,\"height\":12,\"fx\":20,\"fy\":20,\"cx\":1,\"cy\":5.5,"
	       "\"dist\":[0,0,0,0,0,0]}",
	       GOOD_FRAME),
	 "dist|5 numbers"},
	{"no context view", SCENE(CAMERA, FRAME("a.png", IDENTITY, ",\"role\":\"target\"")),
	 "no context view"},
	{"no frame", SCENE(CAMERA, ""), "no context view"},
	{"unknown role", SCENE(CAMERA, FRAME("a.png", IDENTITY, ",\"role\":\"contxt\"")),
	 "frame 0|a.png|contxt"},
	{"context without file", SCENE(CAMERA, "{\"world_from_camera\":" IDENTITY "}"),
	 "frame 0|no file"},
	{"a line break in a name", SCENE(CAMERA, FRAME("a\\nb.png", IDENTITY, "")),
	 "a?b.png|missing"},
	{"no frames", "{\"name\":\"t\"," CAMERA "}", "frames"},
	{"a list", "[1,2]", "object"},
	{"cut short", "{\"name\":\"t\",\"frames\":[", "ends too early"},
	{"words", "hello", "line 1, column 1|not JSON"},
	{"more behind the end", SCENE(CAMERA, GOOD_FRAME) " x", "not JSON"},
	{"empty file", "", "ends too early"},
};

static void every_bad_scene_is_refused_by_the_program_in_one_line(void **state)
{
	static struct fixture_run run;

	(void)state;
	fixture_write_picture("bad/a.png", 16, 12);
	for (size_t i = 0; i < sizeof BAD / sizeof *BAD; i++) {
		printf("%s\n", BAD[i].what);
		fixture_write("bad/scene.json", BAD[i].text);
		fixture_diorama(&run, "info", fixture_path("bad/scene.json"), NULL);
		fixture_expect_refusal(&run, 1, "scene.json");
		fixture_expect_refusal(&run, 1, BAD[i].words);
	}
}

static void refuse_with(const char *command, const char *words)
{
	static struct fixture_run run;

	fixture_diorama(&run, command, "--scene", fixture_path("size/scene.json"), "--out",
			fixture_path("size/out"), NULL);
	fixture_expect_refusal(&run, 1, words);
}

static void a_picture_of_another_size_than_its_camera_is_refused(void **state)
{
	(void)state;
	fixture_write_picture("size/a.png", 16, 12);
	fixture_write_picture("size/b.png", 12, 16);
	fixture_write("size/scene.json",
		      SCENE(CAMERA, GOOD_FRAME "," FRAME("b.png", IDENTITY, "")));
	refuse_with("reconstruct", "b.png|frame 1|12x16|16x12");
	refuse_with("render", "b.png|frame 1|12x16|16x12");
}

static void a_picture_that_does_not_decode_is_refused(void **state)
{
	(void)state;
	fixture_write("size/a.png", "no picture");
	fixture_write("size/scene.json", SCENE(CAMERA, GOOD_FRAME));
	refuse_with("reconstruct", "a.png");
}

static void a_scene_that_is_not_there_is_refused(void **state)
{
	static struct fixture_run run;

	(void)state;
	fixture_diorama(&run, "info", fixture_path("nowhere/scene.json"), NULL);
	fixture_expect_refusal(&run, 1, "nowhere/scene.json");
}

static void what_is_written_is_read_back(void **state)
{
	const struct dio_camera_model camera = {
		64, 48, 50.25, 51.5, 31.5, 23.5, {0.1, -0.02, 0, 0, 1e-17}};
	struct dio_camera_model other = camera;
	const struct dio_pose pose = {{0, -1, 0, 0.1, 1, 0, 0, 1e-9, 0, 0, 1, 1.0 / 3, 0, 0, 0, 1}};
	struct dio_scene_file scene = {.name = strdup("round trip")}, back = {0};
	struct dio_error error = {0};

	(void)state;
	other.fx = nextafter(77.1, 78); /* one bit from what 15 digits say */
	fixture_write_picture("round/images/a.png", 64, 48);
	for (int i = 0; i < 100; i++)
		assert_int_equal(dio_scene_file_append(&scene, "images/a.png",
						       i % 3 ? DIO_ROLE_CONTEXT : DIO_ROLE_TARGET,
						       i % 2 ? &camera : &other, &pose, &error),
				 DIO_OK);
	assert_int_equal(
		dio_scene_file_append(&scene, NULL, DIO_ROLE_TARGET, &camera, &pose, &error),
		DIO_OK);
	if (dio_scene_file_write(&scene, fixture_path("round/scene.json"), &error) != DIO_OK)
		fail_msg("%s", error.text);
	if (dio_scene_file_read(fixture_path("round"), &back, &error) != DIO_OK)
		fail_msg("%s", error.text);
	assert_string_equal(back.name, "round trip");
	assert_int_equal(back.frame_count, 101);
	assert_int_equal(dio_scene_file_count(&back, DIO_ROLE_TARGET), 35);
	assert_null(back.frames[100].file);
	for (uint32_t i = 0; i < back.frame_count; i++) {
		assert_int_equal(back.frames[i].role, scene.frames[i].role);
		assert_memory_equal(&back.frames[i].camera, &scene.frames[i].camera,
				    sizeof back.frames[i].camera);
		assert_memory_equal(&back.frames[i].pose, &pose, sizeof pose);
	}
	dio_scene_file_deinit(&scene);
	dio_scene_file_deinit(&back);
}

static void a_scene_that_would_be_refused_is_not_written(void **state)
{
	const struct dio_camera_model camera = {64, 48, 50, 50, 31.5, 23.5, {0}};
	const struct dio_pose pose = {{NAN}};
	struct dio_scene_file scene = {0};
	struct dio_error error = {0};

	(void)state;
	assert_int_equal(
		dio_scene_file_append(&scene, "a.png", DIO_ROLE_CONTEXT, &camera, &pose, &error),
		DIO_OK);
	assert_int_equal(dio_scene_file_write(&scene, fixture_path("never.json"), &error),
			 DIO_BAD_FILE);
	assert_non_null(strstr(error.text, "not finite"));
	dio_scene_file_deinit(&scene);
}

static void a_picture_may_lie_anywhere(void **state)
{
	struct dio_scene_file scene = {.folder = strdup("/data/set")};
	const struct dio_camera_model camera = {64, 48, 50, 50, 31.5, 23.5, {0}};
	const struct dio_pose pose = {{1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1}};
	const char *files[] = {"images/a.png", "../b.png", "/c.png"};
	const char *paths[] = {"/data/set/images/a.png", "/data/set/../b.png", "/c.png"};

	(void)state;
	for (uint32_t i = 0; i < 3; i++) {
		char *path;

		assert_int_equal(dio_scene_file_append(&scene, files[i], DIO_ROLE_CONTEXT, &camera,
						       &pose, NULL),
				 DIO_OK);
		path = dio_scene_file_picture_path(&scene, i);
		assert_string_equal(path, paths[i]);
		free(path);
	}
	dio_scene_file_deinit(&scene);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(every_bad_scene_is_refused_by_the_program_in_one_line),
		cmocka_unit_test(a_picture_of_another_size_than_its_camera_is_refused),
		cmocka_unit_test(a_picture_that_does_not_decode_is_refused),
		cmocka_unit_test(a_scene_that_is_not_there_is_refused),
		cmocka_unit_test(what_is_written_is_read_back),
		cmocka_unit_test(a_scene_that_would_be_refused_is_not_written),
		cmocka_unit_test(a_picture_may_lie_anywhere),
	};

	return cmocka_run_group_tests(tests, fixture_setup, fixture_teardown);
}
