#include "check.h"

#include <errno.h>
#include <sched.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mount.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include "dio/atomic_file.h"
#include "dio/file.h"
#include "dio/frame.h"
#include "scratch.h"

static void assert_holds(const char *path, const char *text)
{
	struct dio_error error;
	uint8_t *bytes;
	size_t size;

	assert_ok(dio_file_read(path, 1000, &bytes, &size, &error), error);
	assert_int_equal(size, strlen(text));
	assert_string_equal((char *)bytes, text);
	free(bytes);
}

static void every_status_has_words_of_its_own(void **state)
{
	(void)state;
	for (int a = DIO_OK; a <= DIO_REFUSED; a++) {
		assert_string_not_equal(dio_status_text((enum dio_status)a), "unknown status");
		for (int b = DIO_OK; b < a; b++)
			assert_string_not_equal(dio_status_text((enum dio_status)a),
						dio_status_text((enum dio_status)b));
	}
	assert_string_equal(dio_status_text((enum dio_status)99), "unknown status");
}

static void errno_values_become_the_status_they_stand_for(void **state)
{
	(void)state;
	assert_int_equal(dio_status_from_errno(ENOSPC), DIO_NO_SPACE);
	assert_int_equal(dio_status_from_errno(EBUSY), DIO_BUSY);
	assert_int_equal(dio_status_from_errno(ENODEV), DIO_GONE);
	assert_int_equal(dio_status_from_errno(ENOENT), DIO_NOT_FOUND);
	assert_int_equal(dio_status_from_errno(ENOMEM), DIO_NO_MEM);
	assert_int_equal(dio_status_from_errno(EACCES), DIO_IO);
}

static void fail_cuts_a_long_line_and_takes_no_error(void **state)
{
	struct dio_error error;
	char longer[2000];

	(void)state;
	memset(longer, 'x', sizeof(longer));
	longer[sizeof(longer) - 1] = '\0';
	assert_int_equal(dio_fail(&error, DIO_IO, "%s", longer), DIO_IO);
	assert_int_equal(strlen(error.text), sizeof(error.text) - 1);
	assert_int_equal(dio_fail(NULL, DIO_BUSY, "%s", longer), DIO_BUSY);
}

static void commit_replaces_the_file_and_leaves_no_part(void **state)
{
	const char *path = scratch_path(*state, "a.txt");
	struct dio_atomic_file *file;
	struct dio_error error;

	scratch_write(path, "old", 3);
	assert_ok(dio_atomic_file_open(path, &file, &error), error);
	fputs("new", dio_atomic_file_stream(file));
	assert_holds(path, "old");
	assert_ok(dio_atomic_file_commit(file, &error), error);
	assert_holds(path, "new");
	assert_int_equal(scratch_count(*state), 1);
}

static void discard_keeps_the_old_file_and_leaves_no_part(void **state)
{
	const char *path = scratch_path(*state, "a.txt");
	struct dio_atomic_file *file;
	struct dio_error error;

	scratch_write(path, "old", 3);
	assert_ok(dio_atomic_file_open(path, &file, &error), error);
	fputs("new", dio_atomic_file_stream(file));
	dio_atomic_file_discard(file);
	dio_atomic_file_discard(NULL);
	assert_holds(path, "old");
	assert_int_equal(scratch_count(*state), 1);
}

static void two_writers_of_one_path_do_not_share_a_part(void **state)
{
	const char *path = scratch_path(*state, "a.txt");
	struct dio_atomic_file *first, *second;
	struct dio_error error;

	assert_ok(dio_atomic_file_open(path, &first, &error), error);
	assert_ok(dio_atomic_file_open(path, &second, &error), error);
	fputs("first", dio_atomic_file_stream(first));
	fputs("second", dio_atomic_file_stream(second));
	assert_ok(dio_atomic_file_commit(second, &error), error);
	assert_holds(path, "second");
	assert_ok(dio_atomic_file_commit(first, &error), error);
	assert_holds(path, "first");
}

static void writing_follows_a_symbolic_link(void **state)
{
	const char *path = scratch_path(*state, "a.txt"), *link = scratch_path(*state, "link");
	struct dio_error error;
	struct stat st;

	scratch_write(path, "old", 3);
	assert_int_equal(symlink("a.txt", link), 0);
	assert_ok(dio_atomic_file_write(link, "new", 3, &error), error);
	assert_holds(path, "new");
	assert_int_equal(lstat(link, &st), 0);
	assert_true(S_ISLNK(st.st_mode));
}

static void unwritable_places_are_named(void **state)
{
	struct dio_error error;
	struct stat st;

	assert_fails(dio_atomic_file_write(scratch_path(*state, "no/a.txt"), "x", 1, &error),
		     DIO_NOT_FOUND, error, "no/a.txt");
	assert_fails(dio_atomic_file_write(*state, "x", 1, &error), DIO_IO, error, "directory");
	/* A device is written straight, and is still a device afterwards. */
	assert_fails(dio_atomic_file_write("/dev/full", "x", 1, &error), DIO_NO_SPACE, error,
		     "/dev/full: the disk is full");
	assert_int_equal(stat("/dev/full", &st), 0);
	assert_true(S_ISCHR(st.st_mode));
	assert_ok(dio_atomic_file_write("/dev/null", "x", 1, &error), error);
}

/* In a child with a mount namespace of its own: exits 0, or 77 when no file system may be mounted.
 */
static int fill_a_small_disk(const char *folder)
{
	enum { SIDE = 512 };
	static struct dio_picture noise;
	struct dio_error error = {{0}};

	if ((unshare(CLONE_NEWNS) != 0 && unshare(CLONE_NEWUSER | CLONE_NEWNS) != 0) ||
	    mount("none", "/", NULL, MS_REC | MS_PRIVATE, NULL) != 0 ||
	    mount("tmpfs", folder, "tmpfs", 0, "size=64k") != 0)
		return 77;
	if (dio_picture_init(&noise, SIDE, SIDE) != DIO_OK)
		return 1;
	for (uint32_t i = 0, x = 1; i < 3 * SIDE * SIDE; i++, x = x * 1664525 + 1013904223)
		noise.rgb[i] = (uint8_t)(x >> 24);
	if (dio_atomic_file_write(scratch_path(folder, "small.txt"), "small", 5, &error) != DIO_OK)
		return 2;
	if (dio_picture_write(scratch_path(folder, "large.png"), &noise, &error) != DIO_NO_SPACE ||
	    !strstr(error.text, "large.png: the disk is full"))
		return 3;
	/* The part is removed, so that the small things still fit. */
	if (scratch_count(folder) != 1)
		return 4;
	if (dio_atomic_file_write(scratch_path(folder, "more.txt"), "more", 4, &error) != DIO_OK)
		return 5;
	dio_picture_deinit(&noise);
	return 0;
}

static void a_full_disk_is_reported_and_the_part_removed(void **state)
{
	pid_t child = fork();
	int status;

	if (child == 0)
		_exit(fill_a_small_disk(*state));
	assert_int_equal(waitpid(child, &status, 0), child);
	assert_true(WIFEXITED(status));
	if (WEXITSTATUS(status) == 77) {
		print_message("no tmpfs may be mounted here\n");
		skip();
	}
	assert_int_equal(WEXITSTATUS(status), 0);
}

static void reading_names_what_is_no_file(void **state)
{
	const char *path = scratch_path(*state, "a.txt"), *fifo = scratch_path(*state, "fifo");
	struct dio_error error;
	uint8_t *bytes = NULL;
	size_t size;

	scratch_write(path, "hello", 5);
	assert_int_equal(mkfifo(fifo, 0600), 0);
	assert_fails(dio_file_read(path, 4, &bytes, &size, &error), DIO_BAD_FILE, error, "5 bytes");
	assert_fails(dio_file_read(*state, 100, &bytes, &size, &error), DIO_BAD_FILE, error,
		     "folder");
	assert_fails(dio_file_read(fifo, 100, &bytes, &size, &error), DIO_BAD_FILE, error, "fifo");
	assert_fails(dio_file_read(scratch_path(*state, "b.txt"), 100, &bytes, &size, &error),
		     DIO_NOT_FOUND, error, "b.txt");
	assert_null(bytes);
	assert_holds(path, "hello");
}

#define scratch_test(function)                                                                     \
	cmocka_unit_test_setup_teardown(function, scratch_make, scratch_remove)

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(every_status_has_words_of_its_own),
		cmocka_unit_test(errno_values_become_the_status_they_stand_for),
		cmocka_unit_test(fail_cuts_a_long_line_and_takes_no_error),
		scratch_test(commit_replaces_the_file_and_leaves_no_part),
		scratch_test(discard_keeps_the_old_file_and_leaves_no_part),
		scratch_test(two_writers_of_one_path_do_not_share_a_part),
		scratch_test(writing_follows_a_symbolic_link),
		scratch_test(unwritable_places_are_named),
		scratch_test(a_full_disk_is_reported_and_the_part_removed),
		scratch_test(reading_names_what_is_no_file),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
