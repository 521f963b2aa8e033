/* diorama capture: what is counted is what is on the disk, whatever goes wrong. */
#include "unit/app/fixture.h"

#include <cjson/cJSON.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "dio/camera.h"

#define SIM "sim:table?seed=2&width=160&height=120&samples=1"

static struct fixture_run run;

/* Frames that a folder plays back. */
static int count_frames(const char *folder)
{
	const struct dio_camera_options options = {.as_fast_as_possible = true,
						   .every_frame = true};
	struct dio_error error = {""};
	struct dio_camera *camera;
	struct dio_frame frame;
	int count = 0;

	if (dio_camera_open(folder, &options, &camera, &error) != DIO_OK)
		fail_msg("%s", error.text);
	assert_int_equal(dio_camera_start(camera, &error), DIO_OK);
	while (dio_camera_acquire(camera, &frame, 1000000000, &error) == DIO_OK)
		count++;
	dio_camera_close(camera);
	return count;
}

static void frames_asked_for_are_recorded_and_counted(void **state)
{
	cJSON *root;

	(void)state;
	fixture_diorama(&run, "capture", SIM, "--frames", "7", "--out", fixture_path("seven"),
			"--json", NULL);
	if (run.code != 0)
		fail_msg("%s", run.err);
	root = cJSON_Parse(run.out);
	assert_non_null(root);
	assert_int_equal(cJSON_GetObjectItem(root, "frames")->valueint, 7);
	assert_int_equal(cJSON_GetObjectItem(root, "delivered")->valueint, 7);
	assert_int_equal(cJSON_GetObjectItem(root, "lost")->valueint, 0);
	cJSON_Delete(root);
	assert_int_equal(count_frames(fixture_path("seven")), 7);
}

static void seconds_are_those_of_the_frames(void **state)
{
	(void)state;
	fixture_diorama(&run, "capture", SIM, "--fps", "4", "--seconds", "2", "--out",
			fixture_path("two"), NULL);
	assert_int_equal(run.code, 0);
	assert_non_null(strstr(run.out, "delivered"));
	/* At 0, 0.25, ... 2 s. */
	assert_int_equal(count_frames(fixture_path("two")), 9);
}

static void an_existing_recording_is_not_overwritten(void **state)
{
	(void)state;
	fixture_diorama(&run, "capture", SIM, "--frames", "2", "--out", fixture_path("once"), NULL);
	assert_int_equal(run.code, 0);
	fixture_diorama(&run, "capture", SIM, "--frames", "3", "--out", fixture_path("once"), NULL);
	fixture_expect_refusal(&run, 1, "once");
	assert_int_equal(count_frames(fixture_path("once")), 2);
}

static void a_camera_that_is_not_there_is_named(void **state)
{
	(void)state;
	fixture_diorama(&run, "capture", "v4l2:/dev/video99", "--out", fixture_path("x"), NULL);
	fixture_expect_refusal(&run, 1, "/dev/video99");
	fixture_diorama(&run, "capture", "sim:table?width=3", "--out", fixture_path("x"), NULL);
	fixture_expect_refusal(&run, 1, "width=3");
	fixture_write("file", "");
	fixture_diorama(&run, "capture", SIM, "--frames", "2", "--out", fixture_path("file/x"),
			NULL);
	fixture_expect_refusal(&run, 1, "file/x");
}

static void ctrl_c_ends_a_recording_in_good_order(void **state)
{
	char command[2 * FIXTURE_PATH_SIZE];

	(void)state;
	/* Wait for the first frames on disk, however slow the machine, then interrupt. */
	snprintf(command, sizeof command,
		 "%s/diorama capture '%s' --out %s & pid=$!; "
		 "for i in $(seq 300); do [ -e %s/frames/000002.png ] && break; sleep 0.1; done; "
		 "kill -INT $pid; wait $pid",
		 getenv("DIO_BIN_DIR"), SIM, fixture_path("cut"), fixture_path("cut"));
	fixture_program(&run, "bash", "-c", command, NULL);
	if (run.code != 0)
		fail_msg("exit code %d: %s", run.code, run.err);
	assert_non_null(strstr(run.out, "recorded"));
	assert_true(count_frames(fixture_path("cut")) >= 3);
}

/* A file system of its own, two megabytes small: needs the right to make a user namespace. */
static void a_full_disk_ends_the_recording_and_what_was_written_stays(void **state)
{
	char command[4 * FIXTURE_PATH_SIZE];

	(void)state;
	fixture_program(&run, "unshare", "-rm", "true", NULL);
	if (run.code != 0) {
		print_message("skipped: no user namespace may be made here\n");
		skip();
	}
	fixture_write("disk/.keep", "");
	snprintf(command, sizeof command,
		 "mount -t tmpfs -o size=2m none %s && "
		 "%s/diorama capture 'sim:table?seed=2&samples=1' --out %s/r >&2; code=$?; "
		 "cp -r %s/r %s; exit $code",
		 fixture_path("disk"), getenv("DIO_BIN_DIR"), fixture_path("disk"),
		 fixture_path("disk"), fixture_path("saved"));
	fixture_program(&run, "unshare", "-rm", "bash", "-c", command, NULL);
	assert_int_equal(run.code, 1);
	if (!strstr(run.err, "disk is full") || !strstr(run.err, "frames are kept"))
		fail_msg("said: %s", run.err);
	assert_true(count_frames(fixture_path("saved")) >= 1);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(frames_asked_for_are_recorded_and_counted),
		cmocka_unit_test(seconds_are_those_of_the_frames),
		cmocka_unit_test(an_existing_recording_is_not_overwritten),
		cmocka_unit_test(a_camera_that_is_not_there_is_named),
		cmocka_unit_test(ctrl_c_ends_a_recording_in_good_order),
		cmocka_unit_test(a_full_disk_ends_the_recording_and_what_was_written_stays),
	};

	return cmocka_run_group_tests(tests, fixture_setup, fixture_teardown);
}
