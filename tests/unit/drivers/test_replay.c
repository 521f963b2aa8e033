#include "check.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "dio/camera.h"
#include "dio/clock.h"
#include "folder.h"
#include "scratch.h"

#define SECOND_NS 1000000000ll

/* A picture that says its number in every pixel. */
static void write_numbered(const char *folder, const char *name, uint8_t number)
{
	struct dio_picture picture;
	struct dio_error error;

	assert_int_equal(dio_picture_init(&picture, 16, 12), DIO_OK);
	memset(picture.rgb, number, 3 * 16 * 12);
	assert_ok(dio_picture_write(scratch_path(folder, name), &picture, &error), error);
	dio_picture_deinit(&picture);
}

static struct dio_camera *start(const char *spec, const struct dio_camera_options *options)
{
	struct dio_camera *camera = NULL;
	struct dio_error error;

	assert_ok(dio_camera_open(spec, options, &camera, &error), error);
	assert_ok(dio_camera_start(camera, &error), error);
	return camera;
}

static void names_are_ordered_as_people_count(void **state)
{
	static const char *const ordered[] = {"",
					      "0.png",
					      "1.png",
					      "01.png",
					      "2.png",
					      "10.png",
					      "a.png",
					      "a1b2.png",
					      "a1b10.png",
					      "a02b1.png",
					      "a2b1.png",
					      "a10.png",
					      "b",
					      "view99999999999999999999998.png",
					      "view99999999999999999999999.png"};
	const size_t n = sizeof(ordered) / sizeof(ordered[0]);

	(void)state;
	for (size_t i = 0; i < n; i++) {
		assert_int_equal(dio_natural_compare(ordered[i], ordered[i]), 0);
		for (size_t j = i + 1; j < n; j++) {
			/* Leading zeros decide only between names that are equal otherwise. */
			bool zeros = strstr(ordered[i], "1.png") && strstr(ordered[j], "01.png");
			int order = dio_natural_compare(ordered[i], ordered[j]);

			if ((order < 0) != (dio_natural_compare(ordered[j], ordered[i]) > 0))
				fail_msg("%s and %s each before the other", ordered[i], ordered[j]);
			if (!zeros && order >= 0)
				fail_msg("%s is not before %s", ordered[i], ordered[j]);
		}
	}
}

static void a_folder_comes_in_natural_order_and_ends(void **state)
{
	const char *names[] = {"view1.png", "view2.PNG", "view10.png", "view11.jpg"};
	struct dio_camera_info info;
	struct dio_camera *camera;
	struct dio_frame frame;
	struct dio_error error;

	for (uint8_t i = 0; i < 4; i++)
		write_numbered(*state, names[i], (uint8_t)(40 * i));
	scratch_write(scratch_path(*state, "notes.txt"), "no picture", 10);
	scratch_write(scratch_path(*state, ".view3.png"), "hidden", 6);
	camera = start(*state, NULL);
	dio_camera_get_info(camera, &info);
	assert_int_equal(info.frame_count, 4);
	assert_int_equal(info.width, 16);
	assert_int_equal(info.height, 12);
	assert_string_equal(dio_camera_get_frame_name(camera), "");
	for (uint64_t i = 0; i < 4; i++) {
		assert_ok(dio_camera_acquire(camera, &frame, 0, &error), error);
		assert_string_equal(dio_camera_get_frame_name(camera), names[i]);
		assert_int_equal(frame.sequence, i);
		assert_int_equal(frame.format, DIO_PIXEL_RGB24);
		assert_in_range(frame.data[0], 40 * i, 40 * i + 1);
	}
	assert_fails(dio_camera_acquire(camera, &frame, 0, &error), DIO_END, error, "all 4");
	assert_fails(dio_camera_acquire(camera, &frame, 0, &error), DIO_END, error, "all 4");
	dio_camera_close(camera);
}

static void a_damaged_picture_is_named_and_the_next_call_goes_on(void **state)
{
	struct dio_camera_counters counters;
	struct dio_camera *camera;
	struct dio_frame frame;
	struct dio_error error;

	scratch_write(scratch_path(*state, "1.png"), "garbage", 7);
	write_numbered(*state, "2.png", 2);
	write_numbered(*state, "3.png", 3);
	assert_int_equal(truncate(scratch_path(*state, "3.png"), 60), 0);
	write_numbered(*state, "4.png", 4);
	camera = start(*state, NULL);
	assert_fails(dio_camera_acquire(camera, &frame, 0, &error), DIO_BAD_FILE, error, "1.png");
	assert_ok(dio_camera_acquire(camera, &frame, 0, &error), error);
	assert_fails(dio_camera_acquire(camera, &frame, 0, &error), DIO_BAD_FILE, error, "3.png");
	assert_int_equal(remove(scratch_path(*state, "4.png")), 0);
	assert_fails(dio_camera_acquire(camera, &frame, 0, &error), DIO_BAD_FILE, error, "4.png");
	assert_int_equal(dio_camera_acquire(camera, &frame, 0, &error), DIO_END);
	dio_camera_get_counters(camera, &counters);
	assert_int_equal(counters.delivered, 1);
	assert_int_equal(counters.broken, 3);
	dio_camera_close(camera);
}

static void folders_without_a_readable_picture_are_refused(void **state)
{
	struct dio_camera *camera = NULL;
	struct dio_error error;
	char spec[600];

	assert_fails(dio_camera_open(*state, NULL, &camera, &error), DIO_NOT_FOUND, error, ".png");
	scratch_write(scratch_path(*state, "1.png"), "garbage", 7);
	assert_fails(dio_camera_open(*state, NULL, &camera, &error), DIO_BAD_FILE, error, "1.png");
	assert_fails(dio_camera_open(scratch_path(*state, "1.png"), NULL, &camera, &error),
		     DIO_BAD_ARG, error, "not a folder");
	assert_fails(dio_camera_open(scratch_path(*state, "none"), NULL, &camera, &error),
		     DIO_NOT_FOUND, error, "none");
	snprintf(spec, sizeof(spec), "replay:%s/none", (const char *)*state);
	assert_fails(dio_camera_open(spec, NULL, &camera, &error), DIO_NOT_FOUND, error, "none");
	assert_fails(dio_camera_open("", NULL, &camera, &error), DIO_BAD_ARG, error, "empty");
	assert_null(camera);
}

static void wishes_out_of_range_are_refused(void **state)
{
	const struct dio_camera_options large = {.width = 20000};
	const struct dio_camera_options negative = {.frames_per_second = -1};
	const struct dio_camera_options undefined = {.frames_per_second = 0.0 / 0.0};
	struct dio_camera *camera = NULL;
	struct dio_error error;

	(void)state;
	assert_fails(dio_camera_open("/", &large, &camera, &error), DIO_BAD_ARG, error, "20000");
	assert_fails(dio_camera_open("/", &negative, &camera, &error), DIO_BAD_ARG, error, "-1");
	assert_fails(dio_camera_open("/", &undefined, &camera, &error), DIO_BAD_ARG, error, "nan");
}

static void a_folder_keeps_the_pace_that_is_wished(void **state)
{
	const struct dio_camera_options slow = {.frames_per_second = 20, .every_frame = true};
	const struct dio_camera_options fast = {.frames_per_second = 20,
						.as_fast_as_possible = true};
	struct dio_camera *camera;
	struct dio_frame frame;
	struct dio_error error;
	uint64_t begun;

	write_numbered(*state, "1.png", 1);
	write_numbered(*state, "2.png", 2);
	write_numbered(*state, "3.png", 3);
	camera = start(*state, &slow);
	begun = dio_clock_ns();
	assert_ok(dio_camera_acquire(camera, &frame, 0, &error), error);
	assert_fails(dio_camera_acquire(camera, &frame, 0, &error), DIO_AGAIN, error, "not due");
	assert_ok(dio_camera_acquire(camera, &frame, SECOND_NS, &error), error);
	assert_ok(dio_camera_acquire(camera, &frame, SECOND_NS, &error), error);
	assert_true(dio_clock_ns() - begun > 90000000);
	/* By the clock that cameras stamp with. */
	assert_in_range(frame.timestamp_ns, begun + 90000000, dio_clock_ns());
	dio_camera_close(camera);

	camera = start(*state, &fast);
	for (int i = 0; i < 3; i++)
		assert_ok(dio_camera_acquire(camera, &frame, 0, &error), error);
	assert_int_equal(frame.timestamp_ns, 100000000);
	dio_camera_close(camera);
}

static void a_slow_reader_of_a_paced_folder_gets_the_newest(void **state)
{
	const struct dio_camera_options options = {.frames_per_second = 200};
	struct dio_camera_counters counters;
	struct dio_camera *camera;
	struct dio_frame frame;
	struct dio_error error;
	char name[32];

	for (uint8_t i = 0; i < 10; i++) {
		snprintf(name, sizeof(name), "%u.png", i);
		write_numbered(*state, name, i);
	}
	camera = start(*state, &options);
	usleep(32000);
	assert_ok(dio_camera_acquire(camera, &frame, 0, &error), error);
	dio_camera_get_counters(camera, &counters);
	assert_true(frame.sequence >= 6);
	assert_int_equal(counters.drained, frame.sequence);
	dio_camera_close(camera);
}

#define scratch_test(function)                                                                     \
	cmocka_unit_test_setup_teardown(function, scratch_make, scratch_remove)

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(names_are_ordered_as_people_count),
		scratch_test(a_folder_comes_in_natural_order_and_ends),
		scratch_test(a_damaged_picture_is_named_and_the_next_call_goes_on),
		scratch_test(folders_without_a_readable_picture_are_refused),
		cmocka_unit_test(wishes_out_of_range_are_refused),
		scratch_test(a_folder_keeps_the_pace_that_is_wished),
		scratch_test(a_slow_reader_of_a_paced_folder_gets_the_newest),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
