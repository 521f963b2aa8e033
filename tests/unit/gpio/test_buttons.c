#include "check.h"

#include <errno.h>
#include <linux/input-event-codes.h>
#include <poll.h>
#include <string.h>

#include "fake_gpio.h"

#define MS 1000000u

static const struct dio_button_options BUTTONS[] = {
	{.name = "capture",
	 .line = {.name = "A3"},
	 .pull = DIO_GPIO_PULL_UP,
	 .active_low = true,
	 .debounce_us = 5000,
	 .key = KEY_F2,
	 .long_ms = 800,
	 .double_ms = 300},
	{.name = "view", .line = {.chip = "second", .offset = 6}, .debounce_us = 5000},
};

struct fixture {
	struct fake_gpio fake;
	struct dio_buttons *buttons;
	struct dio_button_event event;
	struct dio_error error;
};

static int set_up(void **state)
{
	static struct fixture fixture;

	fixture = (struct fixture){0};
	fake_gpio_init(&fixture.fake);
	*state = &fixture;
	return 0;
}

static int tear_down(void **state)
{
	struct fixture *fixture = *state;

	dio_buttons_close(fixture->buttons);
	return fake_gpio_in_use(&fixture->fake) ? -1 : 0;
}

static enum dio_status open_buttons(struct fixture *fixture)
{
	const struct dio_buttons_options options = {.buttons = BUTTONS, .count = 2};

	return dio_buttons_open_on(&fixture->fake.system, &options, &fixture->buttons,
				   &fixture->error);
}

static enum dio_status read_press(struct fixture *fixture)
{
	return dio_buttons_read(fixture->buttons, &fixture->event, &fixture->error);
}

static void expect(struct fixture *fixture, uint32_t button, enum dio_press press, uint64_t ms)
{
	assert_ok(read_press(fixture), fixture->error);
	assert_int_equal(fixture->event.button, button);
	assert_int_equal(fixture->event.press, press);
	assert_int_equal(fixture->event.timestamp_ns, ms * MS);
}

static bool is_readable(const struct fixture *fixture, int timeout_ms)
{
	struct pollfd waiting = {.fd = dio_buttons_get_fd(fixture->buttons), .events = POLLIN};

	return poll(&waiting, 1, timeout_ms) == 1;
}

static void lines_are_taken_as_the_options_say(void **state)
{
	struct fixture *fixture = *state;
	struct fake_line *line = fake_gpio_line(&fixture->fake, "A3");

	assert_ok(open_buttons(fixture), fixture->error);
	assert_true(line->held && line->request.active_low && !line->request.output);
	assert_int_equal(line->request.pull, DIO_GPIO_PULL_UP);
	assert_int_equal(line->request.debounce_us, 5000);
	assert_true(fake_gpio_line(&fixture->fake, "B6")->held);
	assert_int_equal(read_press(fixture), DIO_AGAIN);
}

static void press_of_an_active_low_button_is_recognised(void **state)
{
	struct fixture *fixture = *state;

	assert_ok(open_buttons(fixture), fixture->error);
	fake_gpio_at(&fixture->fake, 2000);
	fake_gpio_drive(&fixture->fake, "A3", false);
	assert_true(is_readable(fixture, 0));
	assert_int_equal(read_press(fixture), DIO_AGAIN);
	fake_gpio_at(&fixture->fake, 2100);
	fake_gpio_drive(&fixture->fake, "A3", true);
	assert_int_equal(read_press(fixture), DIO_AGAIN);
	fake_gpio_at(&fixture->fake, 2399);
	assert_int_equal(read_press(fixture), DIO_AGAIN);
	fake_gpio_at(&fixture->fake, 2400);
	expect(fixture, 0, DIO_PRESS_SHORT, 2000);
	assert_int_equal(read_press(fixture), DIO_AGAIN);
}

static void bounces_are_ours_to_settle_when_the_kernel_does_not(void **state)
{
	struct fixture *fixture = *state;

	assert_ok(open_buttons(fixture), fixture->error);
	for (int i = 0; i < 6; i++) {
		fake_gpio_at(&fixture->fake, 2000 + i);
		fake_gpio_drive(&fixture->fake, "B6", i % 2 == 0);
	}
	fake_gpio_at(&fixture->fake, 3000);
	assert_int_equal(read_press(fixture), DIO_AGAIN);
}

static void edges_count_as_they_come_when_the_kernel_debounces(void **state)
{
	struct fixture *fixture = *state;

	fixture->fake.system.debounces = true;
	assert_ok(open_buttons(fixture), fixture->error);
	fake_gpio_at(&fixture->fake, 2000);
	fake_gpio_drive(&fixture->fake, "B6", true);
	fake_gpio_at(&fixture->fake, 2001);
	fake_gpio_drive(&fixture->fake, "B6", false);
	expect(fixture, 1, DIO_PRESS_SHORT, 2000);
}

static void line_that_bounced_past_the_queue_is_asked_how_it_stands(void **state)
{
	struct fixture *fixture = *state;

	assert_ok(open_buttons(fixture), fixture->error);
	/* 17 edges: the last, the one that stays, does not fit. */
	for (int i = 0; i < FAKE_EDGES + 1; i++) {
		fake_gpio_at(&fixture->fake, 2000 + 0.1 * i);
		fake_gpio_drive(&fixture->fake, "B6", i % 2 == 0);
	}
	fake_gpio_at(&fixture->fake, 2002);
	assert_int_equal(read_press(fixture), DIO_AGAIN);
	fake_gpio_at(&fixture->fake, 2200);
	fake_gpio_drive(&fixture->fake, "B6", false);
	fake_gpio_at(&fixture->fake, 2205);
	assert_ok(read_press(fixture), fixture->error);
	assert_int_equal(fixture->event.press, DIO_PRESS_SHORT);
}

static void button_held_while_opening_is_no_press(void **state)
{
	struct fixture *fixture = *state;

	fake_gpio_drive(&fixture->fake, "B6", true);
	assert_ok(open_buttons(fixture), fixture->error);
	fake_gpio_at(&fixture->fake, 5000);
	fake_gpio_drive(&fixture->fake, "B6", false);
	fake_gpio_at(&fixture->fake, 6000);
	assert_int_equal(read_press(fixture), DIO_AGAIN);
}

static void key_does_the_same_as_its_button(void **state)
{
	struct fixture *fixture = *state;

	assert_ok(open_buttons(fixture), fixture->error);
	dio_buttons_feed_key(fixture->buttons, KEY_F2, true, (uint64_t)2000 * MS);
	fake_gpio_at(&fixture->fake, 2800);
	expect(fixture, 0, DIO_PRESS_LONG, 2000);
	dio_buttons_feed_key(fixture->buttons, KEY_F2, false, (uint64_t)2900 * MS);
	dio_buttons_feed_key(fixture->buttons, KEY_F9, true, (uint64_t)2900 * MS);
	dio_buttons_feed_key(fixture->buttons, 0, true, (uint64_t)2900 * MS);
	fake_gpio_at(&fixture->fake, 9000);
	assert_int_equal(read_press(fixture), DIO_AGAIN);
}

static void descriptor_wakes_while_presses_wait_and_sleeps_after(void **state)
{
	struct fixture *fixture = *state;

	assert_ok(open_buttons(fixture), fixture->error);
	assert_false(is_readable(fixture, 0));
	for (uint64_t i = 0; i < 2; i++) {
		dio_buttons_feed_key(fixture->buttons, KEY_F2, true, (2000 + 1000 * i) * MS);
		dio_buttons_feed_key(fixture->buttons, KEY_F2, false, (2100 + 1000 * i) * MS);
	}
	fake_gpio_at(&fixture->fake, 9000);
	assert_true(is_readable(fixture, 1000));
	expect(fixture, 0, DIO_PRESS_SHORT, 2000);
	assert_true(is_readable(fixture, 1000));
	expect(fixture, 0, DIO_PRESS_SHORT, 3000);
	assert_int_equal(read_press(fixture), DIO_AGAIN);
	assert_false(is_readable(fixture, 0));
}

static void chip_that_goes_away_is_told(void **state)
{
	struct fixture *fixture = *state;

	assert_ok(open_buttons(fixture), fixture->error);
	fixture->fake.gone = true;
	assert_fails(read_press(fixture), DIO_GONE, fixture->error, "button capture");
}

static void line_in_use_is_refused_with_its_holder(void **state)
{
	struct fixture *fixture = *state;

	fake_gpio_line(&fixture->fake, "B6")->consumer = "fan";
	assert_fails(open_buttons(fixture), DIO_BUSY, fixture->error, "second:6 is in use by fan");
	assert_int_equal(fake_gpio_in_use(&fixture->fake), 0);
}

static void line_without_interrupt_is_refused(void **state)
{
	struct fixture *fixture = *state;

	fake_gpio_line(&fixture->fake, "A3")->request_errno = ENXIO;
	assert_fails(open_buttons(fixture), DIO_UNSUPPORTED, fixture->error, "no interrupt");
}

static void no_buttons_at_all_is_fine(void **state)
{
	struct fixture *fixture = *state;
	const struct dio_buttons_options none = {.keyboard = "auto"};

	assert_ok(dio_buttons_open_on(&fixture->fake.system, &none, &fixture->buttons,
				      &fixture->error),
		  fixture->error);
	assert_int_equal(read_press(fixture), DIO_AGAIN);
	assert_false(is_readable(fixture, 0));
}

static void keyboard_that_is_no_path_is_refused(void **state)
{
	struct fixture *fixture = *state;
	const struct dio_buttons_options options = {
		.buttons = BUTTONS, .count = 2, .keyboard = "usb"};

	assert_fails(dio_buttons_open_on(&fixture->fake.system, &options, &fixture->buttons,
					 &fixture->error),
		     DIO_BAD_ARG, fixture->error, "'usb'");
	assert_int_equal(fake_gpio_in_use(&fixture->fake), 0);
}

static void keyboard_that_is_absent_is_no_error(void **state)
{
	struct fixture *fixture = *state;
	const struct dio_buttons_options options = {
		.buttons = BUTTONS, .count = 2, .keyboard = "/dev/input/none-of-that-name"};

	assert_ok(dio_buttons_open_on(&fixture->fake.system, &options, &fixture->buttons,
				      &fixture->error),
		  fixture->error);
	assert_int_equal(read_press(fixture), DIO_AGAIN);
}

#define over_fake(test) cmocka_unit_test_setup_teardown(test, set_up, tear_down)

int main(void)
{
	const struct CMUnitTest tests[] = {
		over_fake(lines_are_taken_as_the_options_say),
		over_fake(press_of_an_active_low_button_is_recognised),
		over_fake(bounces_are_ours_to_settle_when_the_kernel_does_not),
		over_fake(edges_count_as_they_come_when_the_kernel_debounces),
		over_fake(line_that_bounced_past_the_queue_is_asked_how_it_stands),
		over_fake(button_held_while_opening_is_no_press),
		over_fake(key_does_the_same_as_its_button),
		over_fake(descriptor_wakes_while_presses_wait_and_sleeps_after),
		over_fake(chip_that_goes_away_is_told),
		over_fake(line_in_use_is_refused_with_its_holder),
		over_fake(line_without_interrupt_is_refused),
		over_fake(no_buttons_at_all_is_fine),
		over_fake(keyboard_that_is_no_path_is_refused),
		over_fake(keyboard_that_is_absent_is_no_error),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
