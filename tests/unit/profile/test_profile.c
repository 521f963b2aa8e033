#include "profile/profile.h"

#include "unit/app/fixture.h"

#include <linux/input-event-codes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* Read a text as a profile. */
static enum dio_status read_text(const char *text, struct dio_profile *profile,
				 struct dio_profile_report *report, struct dio_error *error)
{
	fixture_write("profile.ini", text);
	return dio_profile_read(fixture_path("profile.ini"), profile, report, error);
}

static void expect_good(const char *text, struct dio_profile *profile)
{
	struct dio_error error = {""};

	if (read_text(text, profile, NULL, &error) != DIO_OK)
		fail_msg("%s", error.text);
}

/* A text with exactly one fault: in that line, with that word. */
static void expect_fault(const char *text, uint32_t line, const char *word)
{
	struct dio_profile profile = {.name = "untouched"};
	struct dio_profile_report report = {0};
	struct dio_error error = {""};

	assert_int_equal(read_text(text, &profile, &report, &error), DIO_BAD_FILE);
	assert_string_equal(profile.name, "untouched");
	if (report.fault_count != 1 || report.faults[0].line != line ||
	    !strstr(report.faults[0].text, word))
		fail_msg("%zu faults in '%s', first in line %u: %s", report.fault_count, text,
			 report.faults[0].line, report.faults[0].text);
	assert_non_null(strstr(error.text, word));
	dio_profile_report_deinit(&report);
}

static void profile_that_says_nothing_has_the_defaults(void **state)
{
	struct dio_profile profile, defaults;

	(void)state;
	dio_profile_init(&defaults);
	expect_good("; nothing\n\n# at all\n", &profile);
	assert_memory_equal(&profile, &defaults, sizeof(profile));
	assert_int_equal(profile.capture.ring_slots, 8);
	assert_string_equal(profile.web.address, "127.0.0.1");
	assert_false(profile.web.enabled);
}

static void every_kind_of_value_is_read(void **state)
{
	struct dio_profile profile;

	(void)state;
	expect_good("[camera]\nsource = sim:table?seed=7 ; a comment\nwidth=640\nheight = 480\n"
		    "frames_per_second = 59.94\nanti_flicker = 60\nlock = no\n"
		    "calibration = /var/lib/diorama/cam era.yaml\n"
		    "[engine]\nprecision = int8\ndeblock = off\n[web]\nenabled = yes\n",
		    &profile);
	assert_string_equal(profile.camera.source, "sim:table?seed=7");
	assert_int_equal(profile.camera.width, 640);
	assert_int_equal(profile.camera.height, 480);
	assert_true(profile.camera.frames_per_second == 59.94);
	assert_int_equal(profile.camera.flicker, DIO_FLICKER_60HZ);
	assert_false(profile.camera.lock);
	assert_string_equal(profile.camera.calibration, "/var/lib/diorama/cam era.yaml");
	assert_int_equal(profile.engine.precision, DIO_PRECISION_INT8);
	assert_int_equal(profile.engine.deblock, DIO_PROFILE_DEBLOCK_OFF);
	assert_true(profile.web.enabled);
}

static void buttons_and_leds_are_read_with_their_names(void **state)
{
	struct dio_button_event event = {.button = 1};
	struct dio_buttons_options options;
	struct dio_profile profile;

	(void)state;
	expect_good("[button go]\nline = GPIO17\nshort = capture\n"
		    "[button  stop ]\nline = gpiochip0:4\npull = up\nactive_low = yes\nkey = f3\n"
		    "debounce_us = 0\nlong = shutdown\nlong_ms = 1500\ndouble = cancel\n"
		    "[led a]\nline = GPIO1\nview = slow\n",
		    &profile);
	options = dio_profile_get_buttons(&profile);
	assert_int_equal(options.count, 2);
	assert_string_equal(options.buttons[0].name, "go");
	assert_string_equal(options.buttons[0].line.name, "GPIO17");
	assert_int_equal(options.buttons[0].debounce_us, 5000);
	/* What it cannot be asked for is not waited for. */
	assert_int_equal(options.buttons[0].long_ms, 0);
	assert_int_equal(options.buttons[0].double_ms, 0);
	assert_string_equal(options.buttons[1].name, "stop");
	assert_string_equal(options.buttons[1].line.chip, "gpiochip0");
	assert_int_equal(options.buttons[1].line.offset, 4);
	assert_int_equal(options.buttons[1].pull, DIO_GPIO_PULL_UP);
	assert_int_equal(options.buttons[1].key, KEY_F3);
	assert_int_equal(options.buttons[1].debounce_us, 0);
	assert_int_equal(options.buttons[1].long_ms, 1500);
	assert_int_equal(options.buttons[1].double_ms, 300);
	event.press = DIO_PRESS_LONG;
	assert_int_equal(dio_profile_get_action(&profile, &event), DIO_ACTION_SHUTDOWN);
	event.press = DIO_PRESS_DOUBLE;
	assert_int_equal(dio_profile_get_action(&profile, &event), DIO_ACTION_CANCEL);
	event.press = DIO_PRESS_SHORT;
	assert_int_equal(dio_profile_get_action(&profile, &event), DIO_ACTION_NONE);
	assert_int_equal(profile.led_count, 1);
	assert_int_equal(profile.leds[0].patterns[DIO_LED_STATE_VIEW], DIO_LED_SLOW);
	assert_int_equal(profile.leds[0].patterns[DIO_LED_STATE_ERROR], DIO_LED_FAST);
}

static void windows_files_and_indents_are_fine(void **state)
{
	struct dio_profile profile;

	(void)state;
	expect_good("\xEF\xBB\xBF[camera]\r\n\twidth = 320\r\n\r\n  height = 240", &profile);
	assert_int_equal(profile.camera.width, 320);
	assert_int_equal(profile.camera.height, 240);
}

static void each_fault_is_told_with_its_line(void **state)
{
	static const struct {
		const char *text;
		uint32_t line;
		const char *word;
	} cases[] = {
		{"x = 1\n", 1, "before any [section]"},
		{"[camera]\n\nsorce = a\n", 3, "sorce: no such key in [camera]"},
		{"[camera]\nsorce = a\n", 2, "there are source, width"},
		{"[kamera]\nsource = a\n", 1, "[kamera]: no such section"},
		{"[kamera]\n", 1, "there are board, camera"},
		{"[camera x]\nwidth = 1\n", 1, "[camera x]: no such section"},
		{"[camera\nwidth = 1\n", 1, "']' is missing"},
		{"[camera]\nwidth 640\n", 2, "neither [section]"},
		{"[camera]\nwidth = 12x\n", 2, "'12x' is not a whole number"},
		{"[camera]\nwidth = -3\n", 2, "'-3' is not a whole number"},
		{"[camera]\nwidth = 1e3\n", 2, "'1e3' is not a whole number"},
		{"[camera]\nwidth =\n", 2, "'' is not a whole number"},
		{"[camera]\nwidth = 99999999999999999999\n", 2, "out of range"},
		{"[camera]\nwidth = 16385\n", 2, "0 to 16384 can be"},
		{"[camera]\nframes_per_second = nan\n", 2, "'nan' is not a number"},
		{"[camera]\nframes_per_second = 1001\n", 2, "0 to 1000"},
		{"[camera]\nlock = maybe\n", 2, "neither yes nor no"},
		{"[camera]\nanti_flicker = 55\n", 2, "none of: auto, off, 50, 60"},
		{"[camera]\ncalibration = camera.yaml\n", 2, "begin it with /"},
		{"[camera]\nsource =\n", 2, "source: empty"},
		{"[camera]\nwidth = 1\nwidth = 2\n", 3, "stands in line 2 already"},
		{"[camera]\nwidth = 1\n[web]\n[camera]\nheight = 1\n", 4, "stands in line 1"},
		{"[capture]\nring_slots = 2\n", 2, "3 to 64"},
		{"[capture]\nviews_max = 4\nviews_min = 9\n", 3, "more than views_max, 4"},
		{"[paths]\nstate =\n", 1, "cannot be empty"},
		{"[button]\nline = A\n", 1, "write [button NAME]"},
		{"[button x]\nshort = play\n", 1, "neither line nor key"},
		{"[button x]\nline = A\n", 1, "does nothing"},
		{"[button x]\nline = A\nshort = dance\n", 3, "none of: none, calibrate"},
		{"[button x]\nkey = hyper\nshort = play\nline = A\n", 2, "no key 'hyper'"},
		{"[button x]\nline = A\nshort = play\n[led y]\nline = A\n", 5,
		 "[button x] has it already"},
		{"[button x2345678901234567890123456789012]\nkey = f1\n", 1, "at most 31"},
		{"[led x]\nidle = on\n", 1, "line is missing"},
		{"[led x]\nline = A\nidle = dim\n", 3, "none of: off, on"},
	};

	(void)state;
	for (size_t i = 0; i < sizeof cases / sizeof *cases; i++)
		expect_fault(cases[i].text, cases[i].line, cases[i].word);
}

static void all_faults_are_told_in_the_order_of_the_file(void **state)
{
	struct dio_profile_report report = {0};
	struct dio_profile profile;
	struct dio_error error = {""};

	(void)state;
	assert_int_equal(read_text("[button x]\n[camera]\nwidth = a\nheight = b\nnope\n", &profile,
				   &report, &error),
			 DIO_BAD_FILE);
	/* The button does nothing and has no line: both told where it begins. */
	assert_int_equal(report.fault_count, 5);
	for (size_t i = 1; i < report.fault_count; i++)
		assert_true(report.faults[i - 1].line <= report.faults[i].line);
	assert_non_null(strstr(error.text, "profile.ini:1:"));
	assert_non_null(strstr(error.text, "4 more"));
	dio_profile_report_deinit(&report);
}

static void one_device_too_many_is_told(void **state)
{
	char text[4096] = "";

	(void)state;
	for (int i = 0; i <= DIO_BUTTONS_MAX; i++)
		snprintf(text + strlen(text), sizeof(text) - strlen(text),
			 "[button b%d]\nkey = f1\nshort = play\n", i);
	expect_fault(text, 3 * DIO_BUTTONS_MAX + 1, "one button too many; 16 can be");
}

static void long_lines_are_refused_and_not_cut(void **state)
{
	char text[400] = "[camera]\nsource = ";

	(void)state;
	memset(text + strlen(text), 'x', 300);
	expect_fault(text, 2, "characters in a line");
	/* A value may fill its line, and fits its place. */
	text[9 + 198] = '\0';
	struct dio_profile profile;
	expect_good(text, &profile);
	assert_int_equal(strlen(profile.camera.source), 198 - strlen("source = "));
	snprintf(text, sizeof(text), "[display]\nmode = %064d\n", 1);
	expect_fault(text, 2, "64 characters; at most 63");
}

static void file_that_is_no_text_or_absent_is_refused(void **state)
{
	struct dio_profile profile;
	struct dio_error error = {""};
	FILE *file;

	(void)state;
	assert_int_equal(dio_profile_read(fixture_path("absent.ini"), &profile, NULL, &error),
			 DIO_NOT_FOUND);
	fixture_write("zero.ini", "");
	file = fopen(fixture_path("zero.ini"), "wb");
	assert_non_null(file);
	assert_int_equal(fwrite("[camera]\0", 1, 9, file), 9);
	assert_int_equal(fclose(file), 0);
	assert_int_equal(dio_profile_read(fixture_path("zero.ini"), &profile, NULL, &error),
			 DIO_BAD_FILE);
	assert_non_null(strstr(error.text, "zero byte"));
}

/* Whatever a file holds, it is answered: every prefix and many mutations of a good one. */
static void damaged_profiles_are_answered(void **state)
{
	static const char GOOD[] = "[board]\nname = x\n[button a]\nline = b:1\nshort = play\n"
				   "[led c]\nline = d\nidle = on\n[camera]\nwidth = 3 ; x\n";
	struct dio_profile profile;
	struct dio_error error;
	uint32_t seed = 1;

	(void)state;
	for (size_t i = 0; i < 300; i++) {
		struct dio_profile_report report = {0};
		char text[sizeof(GOOD)];

		memcpy(text, GOOD, sizeof(GOOD));
		if (i < sizeof(GOOD))
			text[i] = '\0';
		for (int k = 0; i >= sizeof(GOOD) && k < 4; k++) {
			seed = seed * 1664525u + 1013904223u;
			text[seed / 65536 % (sizeof(GOOD) - 1)] = (char)(1 + (seed >> 8) % 255);
		}
		enum dio_status status = read_text(text, &profile, &report, &error);
		assert_true(status == DIO_OK || status == DIO_BAD_FILE);
		assert_int_equal(status == DIO_OK, report.fault_count == 0);
		dio_profile_report_deinit(&report);
	}
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(profile_that_says_nothing_has_the_defaults),
		cmocka_unit_test(every_kind_of_value_is_read),
		cmocka_unit_test(buttons_and_leds_are_read_with_their_names),
		cmocka_unit_test(windows_files_and_indents_are_fine),
		cmocka_unit_test(each_fault_is_told_with_its_line),
		cmocka_unit_test(all_faults_are_told_in_the_order_of_the_file),
		cmocka_unit_test(one_device_too_many_is_told),
		cmocka_unit_test(long_lines_are_refused_and_not_cut),
		cmocka_unit_test(file_that_is_no_text_or_absent_is_refused),
		cmocka_unit_test(damaged_profiles_are_answered),
	};

	return cmocka_run_group_tests(tests, fixture_setup, fixture_teardown);
}
