/* Specifications, and the displays that keep time without a screen. */
#include "check.h"

#include <poll.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "backend.h"

#define S_NS 1000000000

static void words_are_read_or_refused(void **state)
{
	static const struct {
		const char *spec, *mode;
		double rate;
		enum dio_status status;
		const char *word;
	} cases[] = {
		{"none", "", 0, DIO_OK, ""},
		{"none", "640x480@59.94", 60, DIO_OK, ""},
		{"window", NULL, 0, DIO_OK, ""},
		{"kms", NULL, 0, DIO_OK, ""},
		{"kms:/dev/dri/card7", NULL, 0, DIO_OK, ""},
		{"file:/tmp/x.mp4", NULL, 0, DIO_OK, ""},
		{NULL, NULL, 0, DIO_BAD_ARG, "say kms"},
		{"", NULL, 0, DIO_BAD_ARG, "say kms"},
		{"hdmi", NULL, 0, DIO_BAD_ARG, "'hdmi'"},
		{"nonesuch", NULL, 0, DIO_BAD_ARG, "say kms"},
		{"none:x", NULL, 0, DIO_BAD_ARG, "takes nothing"},
		{"window:0", NULL, 0, DIO_BAD_ARG, "takes nothing"},
		{"file:", NULL, 0, DIO_BAD_ARG, "name is missing"},
		{"file", NULL, 0, DIO_BAD_ARG, "name is missing"},
		{"none", "big", 0, DIO_BAD_ARG, "'big'"},
		{"none", "640", 0, DIO_BAD_ARG, "'640'"},
		{"none", "0x480", 0, DIO_BAD_ARG, "1920x1080"},
		{"none", "640x99999", 0, DIO_BAD_ARG, "1920x1080"},
		{"none", "640x480@", 0, DIO_BAD_ARG, "1920x1080"},
		{"none", "640x480@nan", 0, DIO_BAD_ARG, "1920x1080"},
		{"none", "640x480x3", 0, DIO_BAD_ARG, "1920x1080"},
		{"none", "-640x480", 0, DIO_BAD_ARG, "1920x1080"},
		{"none", NULL, -1, DIO_BAD_ARG, "frames a second"},
	};

	(void)state;
	for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
		const struct dio_display_options options = {.mode = cases[i].mode,
							    .frames_per_second = cases[i].rate};
		struct dio_error error = {""};

		assert_fails(dio_display_check(cases[i].spec, &options, false, &error),
			     cases[i].status, error, cases[i].word);
	}
}

static void device_or_folder_that_is_missing_is_told(void **state)
{
	const struct dio_display_options options = {.connector = "HDMI-Z-9"};
	struct dio_error error = {""};

	(void)state;
	assert_fails(dio_display_check("kms:/dev/dri/card-of-nobody", NULL, true, &error),
		     DIO_NOT_FOUND, error, "card-of-nobody");
	assert_fails(dio_display_check("kms:/dev/null", &options, true, &error), DIO_NOT_FOUND,
		     error, "HDMI-Z-9");
	assert_fails(dio_display_check("file:/nowhere/at/all.mp4", NULL, true, &error),
		     DIO_NOT_FOUND, error, "/nowhere/at");
	assert_ok(dio_display_check("file:/x.mp4", NULL, true, &error), error);
	assert_ok(dio_display_check("file:x.mp4", NULL, true, &error), error);
}

static void pictures_become_due_on_the_display_s_own_clock(void **state)
{
	const struct dio_display_options options = {.mode = "64x48", .frames_per_second = 100};
	struct dio_display *display = NULL;
	struct dio_display_event event;
	struct dio_display_info info;
	struct dio_picture picture;
	struct dio_error error = {""};
	uint64_t last_ns = 0;

	(void)state;
	assert_ok(dio_display_open("none", &options, &display, &error), error);
	dio_display_get_info(display, &info);
	assert_int_equal(info.state, DIO_DISPLAY_ON);
	assert_int_equal(info.width, 64);
	assert_true(info.refresh_hz == 100);
	assert_int_equal(dio_picture_init(&picture, 8, 8), DIO_OK);
	assert_int_equal(dio_display_poll(display, 0, &event, &error), DIO_AGAIN);
	for (uint64_t tag = 1; tag <= 5; tag++) {
		assert_ok(dio_display_show(display, &picture, tag, &error), error);
		assert_ok(dio_display_poll(display, 5 * (int64_t)S_NS, &event, &error), error);
		assert_int_equal(event.kind, DIO_DISPLAY_FLIPPED);
		assert_int_equal(event.tag, tag);
		/* Whole periods lie between two pictures. */
		if (last_ns)
			assert_int_equal((event.time_ns - last_ns) % 10000000, 0);
		assert_true(event.time_ns > last_ns);
		last_ns = event.time_ns;
	}
	dio_picture_deinit(&picture);
	assert_ok(dio_display_close(display, &error), error);
}

static void newer_picture_replaces_the_one_that_waits(void **state)
{
	const struct dio_display_options options = {.frames_per_second = 1};
	struct dio_display *display = NULL;
	struct dio_display_event event;
	struct dio_display_counters counters;
	struct dio_picture picture;
	struct dio_error error = {""};
	struct pollfd waiting = {.events = POLLIN};

	(void)state;
	assert_ok(dio_display_open("none", &options, &display, &error), error);
	assert_int_equal(dio_picture_init(&picture, 8, 8), DIO_OK);
	for (uint64_t tag = 1; tag <= 3; tag++)
		assert_ok(dio_display_show(display, &picture, tag, &error), error);
	waiting.fd = dio_display_get_fd(display);
	assert_int_equal(poll(&waiting, 1, 5000), 1);
	assert_ok(dio_display_poll(display, 0, &event, &error), error);
	assert_int_equal(event.tag, 3);
	assert_int_equal(poll(&waiting, 1, 0), 0);
	dio_display_get_counters(display, &counters);
	assert_int_equal(counters.shown, 1);
	assert_int_equal(counters.replaced, 2);
	dio_picture_deinit(&picture);
	dio_display_close(display, NULL);
}

/* A folder of a test's own. */
static void make_name(char *folder, char *name, size_t size)
{
	const char *base = getenv("TMPDIR");

	snprintf(folder, size, "%s/display-XXXXXX", base ? base : "/tmp");
	assert_non_null(mkdtemp(folder));
	snprintf(name, size, "%.200s/shown.mp4", folder);
}

static void file_receives_every_picture_shown(void **state)
{
	const struct dio_display_options options = {.mode = "64x48@200"};
	struct dio_display *display = NULL;
	struct dio_display_event event;
	struct dio_picture picture;
	struct dio_error error = {""};
	char folder[256], name[256], spec[300];
	struct stat st;

	(void)state;
	make_name(folder, name, sizeof(name));
	snprintf(spec, sizeof(spec), "file:%s", name);
	assert_ok(dio_display_open(spec, &options, &display, &error), error);
	assert_int_equal(dio_picture_init(&picture, 100, 20), DIO_OK);
	for (uint64_t tag = 1; tag <= 4; tag++) {
		memset(picture.rgb, (int)(50 * tag), 3 * 100 * 20);
		assert_ok(dio_display_show(display, &picture, tag, &error), error);
		assert_ok(dio_display_poll(display, 5 * (int64_t)S_NS, &event, &error), error);
	}
	dio_picture_deinit(&picture);
	/* Whole at the end, absent before. */
	assert_int_not_equal(stat(name, &st), 0);
	assert_ok(dio_display_close(display, &error), error);
	assert_int_equal(stat(name, &st), 0);
	assert_true(st.st_size > 500);
	unlink(name);
	assert_int_equal(rmdir(folder), 0);
}

static void file_that_was_shown_nothing_is_not_made(void **state)
{
	struct dio_display *display = NULL;
	struct dio_error error = {""};
	char folder[256], name[256], spec[300];

	(void)state;
	make_name(folder, name, sizeof(name));
	snprintf(spec, sizeof(spec), "file:%s", name);
	assert_ok(dio_display_open(spec, NULL, &display, &error), error);
	assert_ok(dio_display_close(display, &error), error);
	assert_int_equal(rmdir(folder), 0);
	assert_int_not_equal(dio_display_open(spec, NULL, &display, &error), DIO_OK);
}

static void no_picture_is_refused(void **state)
{
	const struct dio_picture none = {0};
	struct dio_display *display = NULL;
	struct dio_error error = {""};

	(void)state;
	assert_ok(dio_display_open("none", NULL, &display, &error), error);
	assert_fails(dio_display_show(display, &none, 1, &error), DIO_BAD_ARG, error, "no picture");
	dio_display_close(display, NULL);
	assert_ok(dio_display_close(NULL, &error), error);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(words_are_read_or_refused),
		cmocka_unit_test(device_or_folder_that_is_missing_is_told),
		cmocka_unit_test(pictures_become_due_on_the_display_s_own_clock),
		cmocka_unit_test(newer_picture_replaces_the_one_that_waits),
		cmocka_unit_test(file_receives_every_picture_shown),
		cmocka_unit_test(file_that_was_shown_nothing_is_not_made),
		cmocka_unit_test(no_picture_is_refused),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
