/* The capture daemon's parts by themselves. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "captured/rate.h"
#include "captured/settings.h"
#include "captured/steady.h"

#define MS 1000000ull

static void the_rate_is_that_of_the_last_frames(void **state)
{
	struct dio_rate rate = {0};
	uint64_t time = 5000 * MS;

	(void)state;
	assert_true(dio_rate_get(&rate) == 0);
	dio_rate_add(&rate, time);
	assert_true(dio_rate_get(&rate) == 0);
	for (int i = 0; i < 100; i++)
		dio_rate_add(&rate, time += 40 * MS);
	assert_true(fabs(dio_rate_get(&rate) - 25) < 1e-9);
	for (uint32_t i = 0; i < DIO_RATE_FRAMES; i++)
		dio_rate_add(&rate, time += 10 * MS);
	assert_true(fabs(dio_rate_get(&rate) - 100) < 1e-9);
	/* Clocks that stand or step back give no rate rather than a wrong one. */
	for (uint32_t i = 0; i < DIO_RATE_FRAMES; i++)
		dio_rate_add(&rate, time -= MS);
	assert_true(dio_rate_get(&rate) == 0);
	dio_rate_reset(&rate);
	assert_true(dio_rate_get(&rate) == 0);
}

/* Look at n grey frames, 60 ms apart, whose level is given; whether the last look says rest. */
static bool look(struct dio_steady *steady, uint64_t *time, int n, int (*level)(int))
{
	uint8_t data[32 * 32];
	bool rest = false;

	for (int i = 0; i < n; i++) {
		const struct dio_frame frame = {.format = DIO_PIXEL_GRAY8,
						.width = 32,
						.height = 32,
						.pitch_bytes = 32,
						.timestamp_ns = *time += 60 * MS,
						.data = data,
						.size_bytes = sizeof(data)};

		memset(data, level(i), sizeof(data));
		rest = dio_steady_look(steady, &frame);
	}
	return rest;
}

static int constant(int i)
{
	(void)i;
	return 128;
}

static int swaying(int i)
{
	return 128 + (i % 2 ? 6 : -6);
}

static int rising(int i)
{
	return 60 + 3 * i;
}

static void a_still_or_swaying_picture_is_at_rest_and_a_drifting_one_is_not(void **state)
{
	struct dio_steady steady = {0};
	uint64_t time = 1000 * MS;

	(void)state;
	assert_false(look(&steady, &time, DIO_STEADY_SAMPLES - 1, constant));
	assert_true(look(&steady, &time, 1, constant));
	dio_steady_reset(&steady);
	assert_true(look(&steady, &time, 20, swaying));
	assert_false(look(&steady, &time, 20, rising));
	assert_true(look(&steady, &time, DIO_STEADY_SAMPLES, constant));
	dio_steady_deinit(&steady);
}

static void frames_that_follow_too_fast_are_not_looked_at(void **state)
{
	struct dio_steady steady = {0};
	uint8_t data[4] = {0};
	struct dio_frame frame = {.format = DIO_PIXEL_GRAY8,
				  .width = 2,
				  .height = 2,
				  .pitch_bytes = 2,
				  .timestamp_ns = 1000 * MS,
				  .data = data,
				  .size_bytes = sizeof(data)};

	(void)state;
	for (int i = 0; i < 100; i++) {
		assert_false(dio_steady_look(&steady, &frame));
		frame.timestamp_ns += MS / 10;
	}
	assert_int_equal(steady.count, 1);
	/* What does not convert is no sample. */
	frame.timestamp_ns += 60 * MS;
	frame.pitch_bytes = 1;
	assert_false(dio_steady_look(&steady, &frame));
	assert_int_equal(steady.count, 1);
	dio_steady_deinit(&steady);
}

static enum dio_settings_result read_settings(struct dio_captured_settings *settings,
					      const char *const *words)
{
	char copies[16][300], *arguments[17] = {0};
	int n = 0;

	for (; words[n]; n++) {
		snprintf(copies[n], sizeof(copies[n]), "%s", words[n]);
		arguments[n] = copies[n];
	}
	return dio_captured_settings_read(settings, n, arguments);
}

static void options_override_the_profile(void **state)
{
	const char *folder = getenv("TMPDIR") ? getenv("TMPDIR") : "/tmp";
	struct dio_captured_settings settings;
	char path[256];
	FILE *file;

	(void)state;
	snprintf(path, sizeof(path), "%s/dio-settings-%d.ini", folder, (int)getpid());
	file = fopen(path, "w");
	assert_non_null(file);
	fputs("[camera]\nsource = sim:room\nwidth = 320\nheight = 240\nexposure_us = 5000\n"
	      "anti_flicker = 50\nlock = no\n[capture]\nstalled_ms = 700\nring_slots = 5\n"
	      "[paths]\nruntime = /run/here\nstate = /var/there\n",
	      file);
	fclose(file);
	assert_int_equal(
		read_settings(&settings, (const char *const[]){"x", "--profile", path, "--size",
							       "64x48", "--bus", "none", NULL}),
		DIO_SETTINGS_RUN);
	unlink(path);
	assert_string_equal(settings.camera, "sim:room");
	assert_int_equal(settings.options.width, 64);
	assert_int_equal(settings.options.height, 48);
	assert_false(settings.options.every_frame);
	assert_int_equal(settings.wish.exposure_us, 5000);
	assert_int_equal(settings.wish.flicker, DIO_CAMERA_FLICKER_50HZ);
	assert_false(settings.wish.hold);
	assert_int_equal(settings.stalled_ms, 700);
	assert_int_equal(settings.ring_slots, 5);
	assert_string_equal(settings.socket, "/run/here/frames");
	assert_string_equal(settings.recordings, "/var/there/recordings");
	assert_string_equal(settings.bus, "none");
}

static void a_device_delivers_every_frame_and_a_simulation_the_newest(void **state)
{
	static const struct {
		const char *camera;
		bool every_frame;
	} cases[] = {{"v4l2:/dev/video3", true}, {"/dev/video0", true}, {"libcamera:0", true},
		     {"sim:table", false},       {"replay:/x", false},  {"/home/x", false}};
	struct dio_captured_settings settings;

	(void)state;
	for (size_t i = 0; i < sizeof(cases) / sizeof(cases[0]); i++) {
		assert_int_equal(
			read_settings(&settings, (const char *const[]){"x", "--camera",
								       cases[i].camera, NULL}),
			DIO_SETTINGS_RUN);
		assert_int_equal(settings.options.every_frame, cases[i].every_frame);
	}
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(the_rate_is_that_of_the_last_frames),
		cmocka_unit_test(a_still_or_swaying_picture_is_at_rest_and_a_drifting_one_is_not),
		cmocka_unit_test(frames_that_follow_too_fast_are_not_looked_at),
		cmocka_unit_test(options_override_the_profile),
		cmocka_unit_test(a_device_delivers_every_frame_and_a_simulation_the_newest),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
