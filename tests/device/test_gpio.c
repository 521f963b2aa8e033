/* Buttons and LEDs on lines of the kernel's gpio-sim: presses made on one side, told on the other.
 */
#include "check.h"

#include <poll.h>
#include <stdio.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "device.h"
#include "dio/clock.h"
#include "dio/gpio.h"

#define CONFIG         "/sys/kernel/config/gpio-sim"
#define CHIP           CONFIG "/diorama"
#define BANK           CHIP "/bank"
#define PATH_MAX_BYTES 512

enum { BUTTON, OTHER, LED, LINES };

static const char *const NAMES[LINES] = {"sim-button", "sim-other", "sim-led"};

struct fixture {
	struct dio_buttons *buttons;
	struct dio_leds *leds;
	struct dio_button_event event;
	struct dio_error error;
};

/* A chip of three named lines, made through configfs. */
static bool make_chip(void)
{
	char path[PATH_MAX_BYTES];

	if (access(CONFIG, W_OK) != 0 || mkdir(CHIP, 0755) != 0 || mkdir(BANK, 0755) != 0 ||
	    !device_write(BANK "/num_lines", "3"))
		return false;
	for (int i = 0; i < LINES; i++) {
		snprintf(path, sizeof(path), BANK "/line%d", i);
		if (mkdir(path, 0755) != 0)
			return false;
		snprintf(path, sizeof(path), BANK "/line%d/name", i);
		if (!device_write(path, NAMES[i]))
			return false;
	}
	return device_write(CHIP "/live", "1");
}

static void remove_chip(void)
{
	char path[PATH_MAX_BYTES];

	device_write(CHIP "/live", "0");
	for (int i = 0; i < LINES; i++) {
		snprintf(path, sizeof(path), BANK "/line%d", i);
		rmdir(path);
	}
	rmdir(BANK);
	rmdir(CHIP);
}

static void line_file(int line, const char *file, char *path)
{
	char device[64], chip[64];

	device_read(CHIP "/dev_name", device, sizeof(device));
	device_read(BANK "/chip_name", chip, sizeof(chip));
	snprintf(path, PATH_MAX_BYTES, "/sys/devices/platform/%s/%s/sim_gpio%d/%s", device, chip,
		 line, file);
}

/* A hand on the button: it pulls the line. */
static void pull(int line, bool up)
{
	char path[PATH_MAX_BYTES];

	line_file(line, "pull", path);
	assert_true(device_write(path, up ? "pull-up" : "pull-down"));
}

static bool is_high(int line)
{
	char path[PATH_MAX_BYTES], value[8];

	line_file(line, "value", path);
	device_read(path, value, sizeof(value));
	return strcmp(value, "1") == 0;
}

/* Keep the hand still for so long, reading as the appliance does; what comes must be nothing. */
static void hold_ms(struct fixture *fixture, int ms)
{
	const uint64_t end_ns = dio_clock_ns() + (uint64_t)ms * 1000000u;
	struct pollfd waiting = {.fd = dio_buttons_get_fd(fixture->buttons), .events = POLLIN};

	while (dio_clock_ns() < end_ns) {
		poll(&waiting, 1, (int)((end_ns - dio_clock_ns()) / 1000000u) + 1);
		assert_int_equal(
			dio_buttons_read(fixture->buttons, &fixture->event, &fixture->error),
			DIO_AGAIN);
	}
}

static void expect(struct fixture *fixture, uint32_t button, enum dio_press press)
{
	struct pollfd waiting = {.fd = dio_buttons_get_fd(fixture->buttons), .events = POLLIN};
	const uint64_t end_ns = dio_clock_ns() + 5000000000u;
	enum dio_status status;

	while ((status = dio_buttons_read(fixture->buttons, &fixture->event, &fixture->error)) ==
		       DIO_AGAIN &&
	       dio_clock_ns() < end_ns)
		poll(&waiting, 1, 5000);
	assert_ok(status, fixture->error);
	assert_int_equal(fixture->event.button, button);
	assert_int_equal(fixture->event.press, press);
	assert_true(fixture->event.timestamp_ns <= dio_clock_ns() &&
		    fixture->event.timestamp_ns + 5000000000u > dio_clock_ns());
}

static int set_up(void **state)
{
	static struct fixture fixture;
	static const struct dio_button_options buttons[] = {
		{.name = "low",
		 .line = {.name = "sim-button"},
		 .pull = DIO_GPIO_PULL_UP,
		 .active_low = true,
		 .debounce_us = 5000,
		 .long_ms = 600,
		 .double_ms = 250},
		/* Longer than a slow machine takes from one bounce to the next. */
		{.name = "high", .line = {.name = "sim-other"}, .debounce_us = 60000},
	};
	const struct dio_buttons_options options = {.buttons = buttons, .count = 2};
	struct dio_led_options led = {.name = "state", .line = {.name = "sim-led"}};

	led.patterns[DIO_LED_STATE_VIEW] = DIO_LED_ON;
	led.patterns[DIO_LED_STATE_ERROR] = DIO_LED_FAST;
	fixture = (struct fixture){0};
	*state = &fixture;
	pull(BUTTON, true);
	pull(OTHER, false);
	if (dio_buttons_open(&options, &fixture.buttons, &fixture.error) == DIO_OK &&
	    dio_leds_open(&led, 1, &fixture.leds, &fixture.error) == DIO_OK)
		return 0;
	fprintf(stderr, "%s\n", fixture.error.text);
	return -1;
}

static int tear_down(void **state)
{
	struct fixture *fixture = *state;

	dio_buttons_close(fixture->buttons);
	dio_leds_close(fixture->leds);
	return 0;
}

static void short_long_and_double_presses_are_told_apart(void **state)
{
	struct fixture *fixture = *state;

	for (int i = 0; i < 5; i++) {
		pull(BUTTON, false);
		hold_ms(fixture, 50);
		pull(BUTTON, true);
		expect(fixture, 0, DIO_PRESS_SHORT);
		pull(BUTTON, false);
		expect(fixture, 0, DIO_PRESS_LONG);
		pull(BUTTON, true);
		hold_ms(fixture, 50);
		pull(BUTTON, false);
		hold_ms(fixture, 50);
		pull(BUTTON, true);
		hold_ms(fixture, 50);
		pull(BUTTON, false);
		expect(fixture, 0, DIO_PRESS_DOUBLE);
		pull(BUTTON, true);
		hold_ms(fixture, 50);
	}
}

static void bouncing_contact_is_one_press(void **state)
{
	struct fixture *fixture = *state;

	for (int i = 0; i < 5; i++) {
		/* More edges than the kernel keeps. */
		for (int k = 0; k < 41; k++)
			pull(OTHER, k % 2 == 0);
		hold_ms(fixture, 150);
		for (int k = 0; k < 41; k++)
			pull(OTHER, k % 2 != 0);
		expect(fixture, 1, DIO_PRESS_SHORT);
		hold_ms(fixture, 150);
	}
}

static void line_that_is_held_is_refused_with_its_holder(void **state)
{
	struct fixture *fixture = *state;
	const struct dio_led_options thief = {.name = "thief", .line = {.name = "sim-led"}};
	struct dio_leds *leds = NULL;

	assert_fails(dio_leds_open(&thief, 1, &leds, &fixture->error), DIO_BUSY, fixture->error,
		     "sim-led is in use by diorama");
}

static void led_shows_the_state(void **state)
{
	struct fixture *fixture = *state;
	struct pollfd waiting = {.fd = dio_leds_get_fd(fixture->leds), .events = POLLIN};
	bool last = true;
	int changes = 0;

	assert_false(is_high(LED));
	assert_ok(dio_leds_set_state(fixture->leds, DIO_LED_STATE_VIEW, &fixture->error),
		  fixture->error);
	assert_true(is_high(LED));
	assert_ok(dio_leds_set_state(fixture->leds, DIO_LED_STATE_ERROR, &fixture->error),
		  fixture->error);
	for (int i = 0; i < 8; i++) {
		assert_int_equal(poll(&waiting, 1, 5000), 1);
		assert_ok(dio_leds_update(fixture->leds, &fixture->error), fixture->error);
		changes += is_high(LED) != last;
		last = is_high(LED);
	}
	assert_true(changes >= 6);
	assert_ok(dio_leds_set_state(fixture->leds, DIO_LED_STATE_IDLE, &fixture->error),
		  fixture->error);
	assert_false(is_high(LED));
}

static void lines_are_found_by_chip_too(void **state)
{
	struct fixture *fixture = *state;
	struct dio_gpio_line line = {.offset = 2};
	char chip[DIO_GPIO_NAME_MAX];

	device_read(BANK "/chip_name", chip, sizeof(chip));
	memcpy(line.chip, chip, sizeof(chip));
	assert_ok(dio_gpio_line_check(&line, &fixture->error), fixture->error);
	line.offset = 3;
	assert_fails(dio_gpio_line_check(&line, &fixture->error), DIO_NOT_FOUND, fixture->error,
		     "lines 0 to 2");
}

#define on_sim(test) cmocka_unit_test_setup_teardown(test, set_up, tear_down)

int main(void)
{
	const struct CMUnitTest tests[] = {
		on_sim(short_long_and_double_presses_are_told_apart),
		on_sim(bouncing_contact_is_one_press),
		on_sim(line_that_is_held_is_refused_with_its_holder),
		on_sim(led_shows_the_state),
		on_sim(lines_are_found_by_chip_too),
	};
	int failed;

	if (!device_tests_may_run("gpio-sim"))
		return DEVICE_SKIPPED;
	if (!make_chip()) {
		printf("skipped: gpio-sim is not there (modprobe gpio-sim, configfs, root)\n");
		remove_chip();
		return DEVICE_SKIPPED;
	}
	failed = cmocka_run_group_tests(tests, NULL, NULL);
	remove_chip();
	return failed;
}
