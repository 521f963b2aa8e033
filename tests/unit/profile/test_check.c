/* diorama board check, run as a user runs it. */
#include "unit/app/fixture.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "profile/check.h"

static const char *shipped(const char *name)
{
	static char path[FIXTURE_PATH_SIZE];
	const char *source = getenv("DIO_SOURCE_DIR");

	snprintf(path, sizeof(path), "%s/board/%s", source ? source : ".", name);
	return path;
}

static void shipped_profiles_are_good(void **state)
{
	static const char *const names[] = {"rpi5.ini", "x86-sbc.ini", "vm.ini"};
	struct fixture_run run;

	(void)state;
	for (size_t i = 0; i < sizeof names / sizeof *names; i++) {
		fixture_diorama(&run, "board", "check", "--elsewhere", shipped(names[i]), NULL);
		if (run.code != 0)
			fail_msg("%s", run.err);
		assert_non_null(strstr(run.out, "good"));
	}
}

/* Run the check over a text; every line of stderr is one fault. */
static void check_text(struct fixture_run *run, const char *text, const char *flag)
{
	fixture_write("check.ini", text);
	fixture_diorama(run, "board", "check", fixture_path("check.ini"), flag, NULL);
}

static uint32_t count_lines(const char *text)
{
	uint32_t lines = 0;

	for (; *text; text++)
		lines += *text == '\n';
	return lines;
}

static void all_faults_of_the_file_are_listed_with_their_lines(void **state)
{
	struct fixture_run run;

	(void)state;
	check_text(&run, "[camera]\nwidht = 3\n[nope]\n[engine]\nthreads = many\n", NULL);
	assert_int_equal(run.code, 1);
	assert_int_equal(count_lines(run.err), 3);
	assert_non_null(strstr(run.err, "check.ini:2: widht: no such key"));
	assert_non_null(strstr(run.err, "check.ini:3: [nope]: no such section"));
	assert_non_null(strstr(run.err, "check.ini:5: threads: 'many'"));
}

static void devices_that_are_missing_are_listed_with_their_lines(void **state)
{
	static const char TEXT[] = "[camera]\nsource = v4l2:/dev/video-of-nobody\n"
				   "[display]\noutput = kms:/dev/dri/card-of-nobody\n"
				   "[button a]\nline = line-of-nobody\nshort = play\n"
				   "[engine]\nmodel = /nowhere/model.safetensors\n"
				   "[buttons]\nkeyboard = /dev/input/of-nobody\n";
	struct fixture_run run;

	(void)state;
	check_text(&run, TEXT, NULL);
	assert_int_equal(run.code, 1);
	assert_int_equal(count_lines(run.err), 5);
	assert_non_null(strstr(run.err, "check.ini:2: source: camera /dev/video-of-nobody"));
	assert_non_null(strstr(run.err, "check.ini:4: output: display /dev/dri/card-of-nobody"));
	assert_non_null(strstr(run.err, "check.ini:6: line: line line-of-nobody"));
	assert_non_null(strstr(run.err, "check.ini:9: model: /nowhere"));
	assert_non_null(strstr(run.err, "check.ini:11: keyboard: /dev/input/of-nobody"));
	check_text(&run, TEXT, "--elsewhere");
	assert_int_equal(run.code, 0);
}

static void words_that_drivers_cannot_read_are_listed_even_elsewhere(void **state)
{
	struct fixture_run run;

	(void)state;
	check_text(&run,
		   "[camera]\nsource = sim:nothing\nwidth = 640\n[capture]\nboard = charuco:3\n"
		   "[display]\noutput = none\nmode = big\n[web]\naddress = localhost\n",
		   "--elsewhere");
	assert_int_equal(run.code, 1);
	assert_int_equal(count_lines(run.err), 5);
	assert_non_null(strstr(run.err, "check.ini:2: source: "));
	assert_non_null(strstr(run.err, "check.ini:3: width: give both"));
	assert_non_null(strstr(run.err, "check.ini:5: board: "));
	assert_non_null(strstr(run.err, "check.ini:8: mode: "));
	assert_non_null(strstr(run.err, "check.ini:10: address: "));
}

static void device_that_is_no_camera_is_told(void **state)
{
	struct fixture_run run;

	(void)state;
	check_text(&run, "[camera]\nsource = v4l2:/dev/null\n", NULL);
	assert_int_equal(run.code, 1);
	assert_non_null(strstr(run.err, "check.ini:2: source: camera /dev/null: not a video"));
}

static void profile_without_devices_is_good_here(void **state)
{
	struct fixture_run run;

	(void)state;
	check_text(&run, "[camera]\nsource = sim:table?seed=1\n[button a]\nkey = f1\nlong = save\n",
		   NULL);
	assert_int_equal(run.code, 0);
	assert_non_null(strstr(run.out, "1 buttons"));
}

static void default_that_does_not_fit_here_is_told_without_a_line(void **state)
{
	struct fixture_run run;

	(void)state;
	if (system("test -e /dev/video0") == 0)
		skip();
	check_text(&run, "[display]\noutput = none\n", NULL);
	assert_int_equal(run.code, 1);
	assert_non_null(strstr(run.err, "check.ini: source: camera /dev/video0"));
}

static void wrong_usage_is_told(void **state)
{
	struct fixture_run run;

	(void)state;
	fixture_diorama(&run, "board", "check", NULL);
	fixture_expect_refusal(&run, 2, "board check");
	fixture_diorama(&run, "board", "check", "/nowhere/profile.ini", NULL);
	fixture_expect_refusal(&run, 1, "/nowhere/profile.ini");
}

/* The words of the report and those of the drivers must not drift apart. */
static void names_of_patterns_and_states_are_keys_of_the_profile(void **state)
{
	struct dio_profile profile;
	struct dio_error error = {""};
	char text[256];

	(void)state;
	for (int i = 0; i < DIO_LED_STATE_COUNT; i++)
		for (int k = 0; k < DIO_LED_PATTERN_COUNT; k++) {
			snprintf(text, sizeof(text), "[led x]\nline = A\n%s = %s\n",
				 dio_led_state_name(i), dio_led_pattern_name(k));
			fixture_write("led.ini", text);
			if (dio_profile_read(fixture_path("led.ini"), &profile, NULL, &error) !=
			    DIO_OK)
				fail_msg("%s", error.text);
			assert_int_equal(profile.leds[0].patterns[i], k);
		}
	for (int i = 0; i <= DIO_ACTION_SHUTDOWN; i++) {
		snprintf(text, sizeof(text), "[button x]\nkey = f1\nshort = play\nlong = %s\n",
			 dio_action_name(i));
		fixture_write("action.ini", text);
		if (dio_profile_read(fixture_path("action.ini"), &profile, NULL, &error) != DIO_OK)
			fail_msg("%s", error.text);
		assert_int_equal(profile.presses[0].long_press, i);
	}
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(shipped_profiles_are_good),
		cmocka_unit_test(all_faults_of_the_file_are_listed_with_their_lines),
		cmocka_unit_test(devices_that_are_missing_are_listed_with_their_lines),
		cmocka_unit_test(words_that_drivers_cannot_read_are_listed_even_elsewhere),
		cmocka_unit_test(device_that_is_no_camera_is_told),
		cmocka_unit_test(profile_without_devices_is_good_here),
		cmocka_unit_test(default_that_does_not_fit_here_is_told_without_a_line),
		cmocka_unit_test(wrong_usage_is_told),
		cmocka_unit_test(names_of_patterns_and_states_are_keys_of_the_profile),
	};

	return cmocka_run_group_tests(tests, fixture_setup, fixture_teardown);
}
