#include <dirent.h>
#include <errno.h>
#include <sched.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mount.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <unistd.h>

#include "check.h"
#include "file_fixture.h"
#include "files/safetensors.h"
#include "scene_fixture.h"

static size_t count_files(const char *folder)
{
	size_t count = 0;
	DIR *open_folder = opendir(folder);
	assert_non_null(open_folder);
	while (readdir(open_folder))
		count++;
	closedir(open_folder);
	return count - 2; /* . and .. */
}

static void put_text(const char *path, const char *text)
{
	FILE *file = fopen(path, "w");
	assert_non_null(file);
	assert_true(fputs(text, file) >= 0);
	assert_int_equal(fclose(file), 0);
}

static void assert_old_file_stands(const char *path)
{
	size_t size;
	unsigned char *bytes = scene_fixture_read(path, &size);
	assert_int_equal(size, 3);
	assert_memory_equal(bytes, "old", 3);
	free(bytes);
}

static enum dvsm_status save(const char *path, struct dvsm_error *error)
{
	struct dvsm_model *model = scene_fixture_model();
	struct dvsm_scene *scene = scene_fixture_make(model);
	enum dvsm_status status = dvsm_scene_save(scene, path, error);
	dvsm_scene_destroy(scene);
	dvsm_model_close(model);
	return status;
}

static void an_old_file_is_replaced_whole(void **state)
{
	(void)state;
	char folder[256], path[300], left_over[400];
	struct dvsm_scene_info info;
	fixture_make_folder(folder);
	snprintf(path, sizeof(path), "%s/s.safetensors", folder);
	snprintf(left_over, sizeof(left_over), "%s.part-%ld-0", path, (long)getpid());
	put_text(path, "old");
	put_text(left_over, "of a crash"); /* in the way of the first name tried */
	assert_int_equal(save(path, NULL), DVSM_OK);
	assert_int_equal(dvsm_scene_probe(path, &info, NULL), DVSM_OK);
	assert_int_equal(count_files(folder), 2);
	fixture_remove_folder(folder);
}

static void a_new_file_has_the_modes_that_the_user_asked_for(void **state)
{
	(void)state;
	char folder[256], path[300];
	struct stat status;
	fixture_make_folder(folder);
	snprintf(path, sizeof(path), "%s/s.safetensors", folder);
	mode_t old = umask(027);
	assert_int_equal(save(path, NULL), DVSM_OK);
	umask(old);
	assert_int_equal(stat(path, &status), 0);
	assert_int_equal(status.st_mode & 0777, 0640);
	fixture_remove_folder(folder);
}

static void assert_unwritable(const char *path, const char *needle)
{
	struct dvsm_error error = {""};
	assert_int_equal(save(path, &error), DVSM_IO);
	assert_text_has(&error, needle);
}

static void a_place_that_cannot_be_written_is_told(void **state)
{
	(void)state;
	assert_unwritable("/nonexistent/s.safetensors", "cannot be created: No such file");
	assert_unwritable("/proc/s.safetensors", "/proc/s.safetensors: cannot be created");
	assert_unwritable("/", "not a regular file");
	/* Renaming over a device would replace it. */
	assert_unwritable("/dev/full", "/dev/full: is there and is not a regular file");
}

static void a_file_size_limit_leaves_the_old_file_and_nothing_beside(void **state)
{
	(void)state;
	char folder[256], path[300];
	struct rlimit old;
	fixture_make_folder(folder);
	snprintf(path, sizeof(path), "%s/s.safetensors", folder);
	put_text(path, "old");
	assert_int_equal(getrlimit(RLIMIT_FSIZE, &old), 0);
	signal(SIGXFSZ, SIG_IGN);
	for (rlim_t limit = 0; limit < 2500; limit += 499) {
		const struct rlimit small = {limit, old.rlim_max};
		struct dvsm_error error = {""};
		assert_int_equal(setrlimit(RLIMIT_FSIZE, &small), 0);
		enum dvsm_status status = save(path, &error);
		assert_int_equal(setrlimit(RLIMIT_FSIZE, &old), 0);
		assert_int_equal(status, DVSM_IO);
		assert_text_has(&error, "s.safetensors: cannot be written: File too large");
		assert_old_file_stands(path);
		assert_int_equal(count_files(folder), 1);
	}
	signal(SIGXFSZ, SIG_DFL);
	fixture_remove_folder(folder);
}

/* A disk of one page, seen by this process alone. */
static bool mount_small_disk(const char *folder)
{
	return unshare(CLONE_NEWNS) == 0 &&
	       mount(NULL, "/", NULL, MS_REC | MS_PRIVATE, NULL) == 0 &&
	       mount("none", folder, "tmpfs", 0, "size=4k") == 0;
}

static void a_full_disk_is_told_and_nothing_is_left_on_it(void **state)
{
	(void)state;
	char folder[256], path[300];
	struct dvsm_error error = {""};
	static char page[4097];
	fixture_make_folder(folder);
	snprintf(path, sizeof(path), "%s/filler", folder);
	if (!mount_small_disk(folder)) {
		print_message("no full disk to try: mounting a small one: %s\n", strerror(errno));
		rmdir(folder);
		skip();
	}
	memset(page, 'x', sizeof(page) - 1);
	put_text(path, page);
	snprintf(path, sizeof(path), "%s/s.safetensors", folder);
	assert_int_equal(save(path, &error), DVSM_IO);
	assert_text_has(&error, "cannot be written: No space left on device: free space");
	assert_int_equal(count_files(folder), 1);
	assert_int_equal(umount(folder), 0);
	rmdir(folder);
}

static void any_metadata_text_survives_the_header(void **state)
{
	(void)state;
	static const char text[] = "{\"a\": \"b\\\\c\"}\n\t\x01 \xc3\xa9";
	char folder[256], path[300];
	fixture_make_folder(folder);
	snprintf(path, sizeof(path), "%s/t.safetensors", folder);
	const struct dvsm_metadata_out metadata[] = {{"k\"ey", text}, {"empty", ""}};
	const uint16_t numbers[3] = {1, 2, 0xffff};
	const struct dvsm_tensor_out tensors[] = {
		{"n", DVSM_DTYPE_U16, 2, {1, 3}, numbers, sizeof(numbers)},
		{"scalar", DVSM_DTYPE_U16, 0, {0}, numbers + 2, 2},
		{"none", DVSM_DTYPE_F64, 1, {0}, NULL, 0},
	};
	struct dvsm_error error = {""};
	assert_int_equal(dvsm_safetensors_write(path, metadata, 2, tensors, 3, &error), DVSM_OK);

	struct dvsm_safetensors file;
	if (dvsm_safetensors_open(path, &file, &error) != DVSM_OK)
		fail_msg("%s", error.text);
	assert_string_equal(dvsm_safetensors_get_metadata(&file, "k\"ey"), text);
	assert_string_equal(dvsm_safetensors_get_metadata(&file, "empty"), "");
	assert_null(dvsm_safetensors_get_metadata(&file, "other"));
	assert_int_equal(file.source.position % 8, 0);
	uint16_t read[3] = {0}, scalar = 0;
	dvsm_safetensors_find(&file, "n")->destination = read;
	dvsm_safetensors_find(&file, "scalar")->destination = &scalar;
	assert_int_equal(dvsm_safetensors_load(&file, NULL, NULL, &error), DVSM_OK);
	assert_memory_equal(read, numbers, sizeof(numbers));
	assert_int_equal(scalar, 0xffff);
	dvsm_safetensors_close(&file);
	fixture_remove_folder(folder);
}

static void a_file_that_shrinks_while_read_is_an_error_and_no_crash(void **state)
{
	(void)state;
	char folder[256], path[300];
	fixture_make_folder(folder);
	snprintf(path, sizeof(path), "%s/s.safetensors", folder);
	assert_int_equal(save(path, NULL), DVSM_OK);
	struct dvsm_safetensors file;
	struct dvsm_error error = {""};
	assert_int_equal(dvsm_safetensors_open(path, &file, &error), DVSM_OK);
	assert_int_equal(truncate(path, (off_t)file.source.position + 100), 0);
	assert_int_equal(dvsm_safetensors_load(&file, NULL, NULL, &error), DVSM_IO);
	assert_text_has(&error, "changed while being read");
	dvsm_safetensors_close(&file);
	fixture_remove_folder(folder);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(an_old_file_is_replaced_whole),
		cmocka_unit_test(a_new_file_has_the_modes_that_the_user_asked_for),
		cmocka_unit_test(a_place_that_cannot_be_written_is_told),
		cmocka_unit_test(a_file_size_limit_leaves_the_old_file_and_nothing_beside),
		cmocka_unit_test(any_metadata_text_survives_the_header),
		cmocka_unit_test(a_file_that_shrinks_while_read_is_an_error_and_no_crash),
		/* Last: it changes what this process sees of the file system. */
		cmocka_unit_test(a_full_disk_is_told_and_nothing_is_left_on_it),
	};
	return cmocka_run_group_tests(tests, NULL, NULL);
}
