/* Outputs that cannot be written: refused with one line, and what was there before stays. */
#include "unit/app/fixture.h"

#include <dirent.h>
#include <errno.h>
#include <sched.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mount.h>
#include <sys/stat.h>
#include <unistd.h>

#include "core/tum.h"
#include "dio/frame.h"
#include "support/files.h"

static struct fixture_run run;
static char model[FIXTURE_PATH_SIZE], scene[FIXTURE_PATH_SIZE];

static bool find_case(void)
{
	const char *path = fixture_shared("golden/tiny/model.safetensors");

	if (!path)
		return false;
	snprintf(model, sizeof model, "%s", path);
	snprintf(scene, sizeof scene, "%s", fixture_shared("golden/tiny/scene.json"));
	return true;
}

static void reconstruct_to(const char *out)
{
	fixture_diorama(&run, "reconstruct", "--model", model, "--scene", scene, "--out", out,
			NULL);
}

static void render_to(const char *out)
{
	fixture_diorama(&run, "render", "--model", model, "--scene", scene, "--raw", "--out", out,
			NULL);
}

static void a_folder_that_is_not_there_or_no_folder_is_refused(void **state)
{
	(void)state;
	if (!find_case())
		skip();
	fixture_write("plain", "a file");
	reconstruct_to(fixture_path("nowhere/s.safetensors"));
	fixture_expect_refusal(&run, 1, "nowhere/s.safetensors");
	reconstruct_to(fixture_path("plain/s.safetensors"));
	fixture_expect_refusal(&run, 1, "plain/s.safetensors");
	render_to(fixture_path("plain"));
	fixture_expect_refusal(&run, 1, "plain|not a folder");
	render_to(fixture_path("plain/deeper"));
	fixture_expect_refusal(&run, 1, "plain/deeper");
	render_to("/proc/nothing-here");
	fixture_expect_refusal(&run, 1, "/proc/nothing-here");
}

static void a_folder_without_permission_is_refused(void **state)
{
	(void)state;
	if (!find_case())
		skip();
	if (geteuid() == 0) {
		printf("skipped: root may write anywhere\n");
		skip();
	}
	assert_int_equal(mkdir(fixture_path("locked"), 0555), 0);
	reconstruct_to(fixture_path("locked/s.safetensors"));
	fixture_expect_refusal(&run, 1, "locked/s.safetensors|ermission");
	render_to(fixture_path("locked"));
	fixture_expect_refusal(&run, 1, "locked|ermission");
}

static void expect_text(const char *path, const char *text)
{
	size_t size;
	unsigned char *bytes = support_read_file(path, &size);

	assert_non_null(bytes);
	assert_string_equal((char *)bytes, text);
	free(bytes);
}

/* Nothing half written is left behind. */
static void expect_no_parts(const char *folder)
{
	DIR *list = opendir(folder);
	const struct dirent *entry;

	assert_non_null(list);
	while ((entry = readdir(list)))
		if (strstr(entry->d_name, ".part"))
			fail_msg("%s is left", entry->d_name);
	closedir(list);
}

/* A file system of 16 KiB that only this process and its children see. */
static bool mount_small_disk(const char *folder)
{
	assert_int_equal(mkdir(folder, 0777), 0);
	if (unshare(CLONE_NEWNS) == 0 && mount("none", "/", NULL, MS_REC | MS_PRIVATE, NULL) == 0 &&
	    mount("none", folder, "tmpfs", 0, "size=16k") == 0)
		return true;
	printf("skipped: a small disk cannot be mounted (%s)\n", strerror(errno));
	return false;
}

static void long_trajectory_does_not_fit(const char *path)
{
	struct dio_trajectory trajectory = {0};
	struct dio_error error = {0};

	assert_int_equal(dio_trajectory_init(&trajectory, 1000), DIO_OK);
	for (uint32_t i = 0; i < 1000; i++)
		for (int k = 0; k < 16; k += 5)
			trajectory.poses[i].world_from_camera[k] = 1;
	assert_int_equal(dio_tum_write(path, &trajectory, &error), DIO_NO_SPACE);
	assert_non_null(strstr(error.text, path));
	dio_trajectory_deinit(&trajectory);
}

static void a_full_disk_is_told_and_what_was_there_stays(void **state)
{
	(void)state;
	if (!find_case())
		skip();
	if (!mount_small_disk(fixture_path("small")))
		skip();
	fixture_write("small/s.safetensors", "precious");
	fixture_write("small/frames.npy", "precious too");
	fixture_write("small/p.tum", "precious as well");
	reconstruct_to(fixture_path("small/s.safetensors"));
	fixture_expect_refusal(&run, 1, "s.safetensors");
	render_to(fixture_path("small"));
	fixture_expect_refusal(&run, 1, "small/");
	long_trajectory_does_not_fit(fixture_path("small/p.tum"));
	expect_text(fixture_path("small/s.safetensors"), "precious");
	expect_text(fixture_path("small/frames.npy"), "precious too");
	expect_text(fixture_path("small/p.tum"), "precious as well");
	expect_no_parts(fixture_path("small"));
	assert_int_equal(umount(fixture_path("small")), 0);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(a_folder_that_is_not_there_or_no_folder_is_refused),
		cmocka_unit_test(a_folder_without_permission_is_refused),
		cmocka_unit_test(a_full_disk_is_told_and_what_was_there_stays),
	};

	return cmocka_run_group_tests(tests, fixture_setup, fixture_teardown);
}
