/* The view store: what was kept is there after a kill at any moment, and only that. */
#include "unit/app/fixture.h"

#include <fcntl.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include "core/path.h"
#include "viewd/store.h"

#define WIDTH  24u
#define HEIGHT 18u
#define KILLS  25

static const struct dio_camera_model CAMERA = {
	.width = WIDTH, .height = HEIGHT, .fx = 20, .fy = 20.25, .cx = 11.5, .cy = 8.5};

static struct dio_error error;

static void check(enum dio_status status)
{
	if (status != DIO_OK)
		fail_msg("%s", error.text);
}

/* A pose that tells its number. */
static struct dio_pose pose_of(uint32_t number)
{
	return (struct dio_pose){
		{1, 0, 0, number / 3.0, 0, 1, 0, number * 1e-7, 0, 0, 1, -2, 0, 0, 0, 1}};
}

static void append(struct dio_store *store, uint32_t number)
{
	const struct dio_pose pose = pose_of(number);
	struct dio_picture picture = {0};

	check(dio_picture_init(&picture, WIDTH, HEIGHT));
	for (size_t i = 0; i < (size_t)WIDTH * HEIGHT * 3; i++)
		picture.rgb[i] = (uint8_t)(i * number + number);
	check(dio_store_append(store, &picture, &pose, number + 1, &error));
	dio_picture_deinit(&picture);
}

static struct dio_store *open_store(const char *name, struct dio_store_report *report)
{
	struct dio_store *store;

	check(dio_store_open(fixture_path(name), 0, &store, report, &error));
	return store;
}

/* Views 0..count-1, in order, to the last bit. */
static void expect_views(const struct dio_store *store, uint32_t count)
{
	struct dio_view_set set = {0};

	assert_int_equal(dio_store_get_count(store), count);
	if (count == 0)
		return;
	check(dio_store_load(store, &set, &error));
	assert_int_equal(set.context_count, count);
	for (uint32_t n = 0; n < count; n++) {
		const struct dio_pose pose = pose_of(n);

		assert_memory_equal(&set.context[n].pose, &pose, sizeof pose);
		assert_memory_equal(&dio_store_get_poses(store)[n], &pose, sizeof pose);
		for (size_t i = 0; i < (size_t)WIDTH * HEIGHT * 3; i++)
			assert_int_equal(set.context[n].picture.rgb[i], (uint8_t)(i * n + n));
	}
	dio_view_set_deinit(&set);
}

static void views_are_there_after_reopening(void **state)
{
	struct dio_store_report report;
	struct dio_store *store = open_store("reopen", &report);
	struct dio_scene_file scene = {0};

	(void)state;
	assert_null(dio_store_get_camera(store));
	check(dio_store_begin(store, &CAMERA, &error));
	for (uint32_t n = 0; n < 5; n++)
		append(store, n);
	expect_views(store, 5);
	dio_store_close(store);
	store = open_store("reopen", &report);
	assert_string_equal(report.text, "");
	assert_memory_equal(dio_store_get_camera(store), &CAMERA, sizeof CAMERA);
	expect_views(store, 5);
	append(store, 5);
	expect_views(store, 6);
	/* Every other program reads the same. */
	check(dio_scene_file_read(dio_store_get_folder(store), &scene, &error));
	assert_int_equal(scene.frame_count, 6);
	dio_scene_file_deinit(&scene);
	dio_store_close(store);
}

static void append_without_a_capture_or_of_another_size_is_refused(void **state)
{
	const struct dio_pose pose = pose_of(0);
	struct dio_picture picture = {0};
	struct dio_store *store = open_store("wrong", NULL);

	(void)state;
	check(dio_picture_init(&picture, 10, 10));
	assert_int_equal(dio_store_append(store, &picture, &pose, 0, &error), DIO_BAD_ARG);
	check(dio_store_begin(store, &CAMERA, &error));
	assert_int_equal(dio_store_append(store, &picture, &pose, 0, &error), DIO_BAD_ARG);
	expect_views(store, 0);
	dio_picture_deinit(&picture);
	dio_store_close(store);
}

/* Append until killed; say each view that is kept through the pipe. */
static void append_for_ever(const char *path, int out)
{
	struct dio_store *store;

	if (dio_store_open(path, 0, &store, NULL, &error) != DIO_OK)
		_exit(1);
	if (dio_store_get_count(store) == 0 && dio_store_begin(store, &CAMERA, &error) != DIO_OK)
		_exit(1);
	for (uint32_t n = dio_store_get_count(store);; n++) {
		const struct dio_pose pose = pose_of(n);
		struct dio_picture picture = {0};

		if (dio_picture_init(&picture, WIDTH, HEIGHT) != DIO_OK)
			_exit(1);
		for (size_t i = 0; i < (size_t)WIDTH * HEIGHT * 3; i++)
			picture.rgb[i] = (uint8_t)(i * n + n);
		if (dio_store_append(store, &picture, &pose, n + 1, &error) != DIO_OK ||
		    write(out, "", 1) != 1)
			_exit(1);
		dio_picture_deinit(&picture);
	}
}

static void what_was_kept_survives_kills(void **state)
{
	uint32_t kept = 0;

	(void)state;
	for (int kill_number = 0; kill_number < KILLS; kill_number++) {
		struct dio_store_report report;
		struct dio_store *store;
		char byte[64];
		ssize_t got;
		pid_t child;
		int ends[2];

		assert_int_equal(pipe(ends), 0);
		child = fork();
		assert_true(child >= 0);
		if (child == 0)
			append_for_ever(fixture_path("killed"), ends[1]);
		close(ends[1]);
		/* Some views, then a moment that is another each time. */
		assert_int_equal(read(ends[0], byte, 1), 1);
		kept++;
		usleep((useconds_t)(kill_number * 137 % 1500));
		kill(child, SIGKILL);
		assert_int_equal(waitpid(child, NULL, 0), child);
		while ((got = read(ends[0], byte, sizeof byte)) > 0)
			kept += (uint32_t)got;
		close(ends[0]);
		store = open_store("killed", &report);
		assert_int_equal(report.views_lost, 0);
		/* One more may have been whole before it could say so. */
		assert_true(dio_store_get_count(store) >= kept &&
			    dio_store_get_count(store) <= kept + 1);
		kept = dio_store_get_count(store);
		if (kill_number % 5 == 4)
			expect_views(store, kept);
		dio_store_close(store);
	}
}

static void damage(const char *path, long at, int byte)
{
	FILE *file = fopen(path, "r+b");

	assert_non_null(file);
	assert_int_equal(fseek(file, at, at < 0 ? SEEK_END : SEEK_SET), 0);
	assert_int_not_equal(fputc(byte, file), EOF);
	assert_int_equal(fclose(file), 0);
}

static void damaged_views_are_left_out_and_said(void **state)
{
	struct dio_store_report report;
	struct dio_store *store = open_store("damaged", NULL);

	(void)state;
	check(dio_store_begin(store, &CAMERA, &error));
	for (uint32_t n = 0; n < 4; n++)
		append(store, n);
	dio_store_close(store);
	damage(fixture_path("damaged/captures/000001/images/003.png"), 60, 0x55);
	store = open_store("damaged", &report);
	assert_int_equal(report.views_lost, 1);
	assert_non_null(strstr(report.text, "3 are whole"));
	expect_views(store, 3);
	dio_store_close(store);
	/* The journal was put right: the next opening is silent. */
	store = open_store("damaged", &report);
	assert_string_equal(report.text, "");
	dio_store_close(store);
	/* A digit of the last line, somewhere in its pose. */
	damage(fixture_path("damaged/captures/000001/views.journal"), -20, '7');
	store = open_store("damaged", &report);
	assert_true(report.tail_lost);
	expect_views(store, 2);
	append(store, 2);
	dio_store_close(store);
	store = open_store("damaged", &report);
	expect_views(store, 3);
	dio_store_close(store);
}

static void a_capture_cut_off_before_its_first_view_leaves_the_one_before(void **state)
{
	struct dio_store *store = open_store("cut", NULL);

	(void)state;
	check(dio_store_begin(store, &CAMERA, &error));
	append(store, 0);
	check(dio_store_begin(store, &CAMERA, &error));
	assert_int_equal(dio_store_get_count(store), 0);
	dio_store_close(store);
	store = open_store("cut", NULL);
	expect_views(store, 1);
	/* Its number is not used again. */
	check(dio_store_begin(store, &CAMERA, &error));
	assert_string_equal(dio_path_name(dio_store_get_folder(store)), "000003");
	dio_store_close(store);
}

static void a_full_disk_is_refused_before_anything_is_written(void **state)
{
	struct dio_store *store;
	const struct dio_pose pose = pose_of(0);
	struct dio_picture picture = {0};

	(void)state;
	check(dio_store_open(fixture_path("full"), UINT64_MAX / 4, &store, NULL, &error));
	assert_int_equal(dio_store_begin(store, &CAMERA, &error), DIO_NO_SPACE);
	assert_non_null(strstr(error.text, "free some space"));
	assert_null(dio_store_get_folder(store));
	dio_store_close(store);
	/* The same in the middle of a capture: what is there stays. */
	store = open_store("full", NULL);
	check(dio_store_begin(store, &CAMERA, &error));
	append(store, 0);
	dio_store_close(store);
	check(dio_store_open(fixture_path("full"), UINT64_MAX / 4, &store, NULL, &error));
	check(dio_picture_init(&picture, WIDTH, HEIGHT));
	assert_int_equal(dio_store_append(store, &picture, &pose, 1, &error), DIO_NO_SPACE);
	expect_views(store, 1);
	dio_picture_deinit(&picture);
	dio_store_close(store);
}

static void a_reconstruction_stays_due_until_it_is_settled(void **state)
{
	struct dio_store *store = open_store("due", NULL);
	char *scene;

	(void)state;
	check(dio_store_begin(store, &CAMERA, &error));
	append(store, 0);
	check(dio_store_begin(store, &CAMERA, &error));
	append(store, 0);
	assert_false(dio_store_is_due(store));
	check(dio_store_set_due(store, true, &error));
	dio_store_close(store);
	store = open_store("due", NULL);
	assert_true(dio_store_is_due(store));
	assert_false(dio_store_has_scene(store));
	scene = dio_store_scene_path(store);
	fixture_write("due/captures/000002/scene.safetensors", "a scene");
	assert_true(dio_path_is_file(scene));
	check(dio_store_settle(store, &error));
	assert_false(dio_store_is_due(store));
	assert_true(dio_store_has_scene(store));
	assert_false(dio_path_is_folder(fixture_path("due/captures/000001")));
	expect_views(store, 1);
	free(scene);
	dio_store_close(store);
}

static void saving_is_whole_and_keeps_to_its_folder(void **state)
{
	char too_long[66];
	const char *const BAD[] = {"../x", ".x", "a/b", "a b", "x\n", too_long};
	struct dio_store *store = open_store("saved", NULL);
	struct dio_scene_file scene = {0};
	struct dio_picture seen = {0}, picture = {0};
	struct dio_store_shot shot = {.picture = &picture, .camera = &CAMERA, .pose = pose_of(7)};
	struct dio_trajectory path = {0};
	char *folder = NULL;

	(void)state;
	memset(too_long, 'a', sizeof too_long - 1);
	too_long[sizeof too_long - 1] = '\0';
	assert_int_equal(dio_store_save(store, "x", NULL, &folder, &error), DIO_BAD_ARG);
	check(dio_store_begin(store, &CAMERA, &error));
	append(store, 0);
	append(store, 1);
	for (size_t i = 0; i < sizeof BAD / sizeof *BAD; i++)
		assert_int_equal(dio_store_save(store, BAD[i], NULL, &folder, &error), DIO_BAD_ARG);
	assert_null(folder);
	check(dio_picture_init(&picture, WIDTH, HEIGHT));
	memset(picture.rgb, 99, (size_t)WIDTH * HEIGHT * 3);
	check(dio_store_save(store, "garden", &shot, &folder, &error));
	assert_string_equal(folder, fixture_path("saved/scenes/garden"));
	check(dio_scene_file_read(folder, &scene, &error));
	assert_int_equal(scene.frame_count, 2);
	check(dio_picture_read(fixture_path("saved/scenes/garden/view.png"), &seen, &error));
	assert_memory_equal(seen.rgb, picture.rgb, (size_t)WIDTH * HEIGHT * 3);
	check(dio_tum_read(fixture_path("saved/scenes/garden/view.tum"), &path, &error));
	assert_int_equal(path.count, 1);
	free(folder);
	/* The name is taken now; a name made of the time is not. */
	assert_int_equal(dio_store_save(store, "garden", NULL, &folder, &error), DIO_BAD_ARG);
	check(dio_store_save(store, "", NULL, &folder, &error));
	free(folder);
	dio_trajectory_deinit(&path);
	dio_scene_file_deinit(&scene);
	dio_picture_deinit(&seen);
	dio_picture_deinit(&picture);
	dio_store_close(store);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(views_are_there_after_reopening),
		cmocka_unit_test(append_without_a_capture_or_of_another_size_is_refused),
		cmocka_unit_test(what_was_kept_survives_kills),
		cmocka_unit_test(damaged_views_are_left_out_and_said),
		cmocka_unit_test(a_capture_cut_off_before_its_first_view_leaves_the_one_before),
		cmocka_unit_test(a_full_disk_is_refused_before_anything_is_written),
		cmocka_unit_test(a_reconstruction_stays_due_until_it_is_settled),
		cmocka_unit_test(saving_is_whole_and_keeps_to_its_folder),
	};

	return cmocka_run_group_tests(tests, fixture_setup, fixture_teardown);
}
