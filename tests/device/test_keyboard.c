/* Keys of a keyboard that uinput makes, plugs in and pulls out. */
#include "check.h"

#include <fcntl.h>
#include <linux/uinput.h>
#include <poll.h>
#include <stdio.h>
#include <string.h>
#include <sys/ioctl.h>
#include <time.h>
#include <unistd.h>

#include "device.h"
#include "dio/clock.h"
#include "dio/gpio.h"

static const struct dio_button_options BUTTONS[] = {
	{.name = "one", .key = KEY_F1, .long_ms = 600},
	{.name = "two", .key = KEY_F2},
};

static int plug_in(uint32_t key)
{
	const struct uinput_setup setup = {.id = {.bustype = BUS_USB}, .name = "diorama test"};
	int fd = open("/dev/uinput", O_WRONLY | O_CLOEXEC);

	if (fd < 0)
		return -1;
	assert_true(ioctl(fd, UI_SET_EVBIT, EV_KEY) == 0 && ioctl(fd, UI_SET_KEYBIT, key) == 0 &&
		    ioctl(fd, UI_DEV_SETUP, &setup) == 0 && ioctl(fd, UI_DEV_CREATE) == 0);
	return fd;
}

static void press(int fd, uint32_t key, int value)
{
	const struct input_event events[2] = {
		{.type = EV_KEY, .code = (uint16_t)key, .value = value}, {.type = EV_SYN}};

	assert_int_equal(write(fd, events, sizeof(events)), sizeof(events));
}

static uint64_t now_ms(void)
{
	return dio_clock_ns() / 1000000u;
}

/* The next press within that time. */
static enum dio_status wait_for(struct dio_buttons *buttons, struct dio_button_event *event,
				uint64_t timeout_ms)
{
	struct pollfd waiting = {.fd = dio_buttons_get_fd(buttons), .events = POLLIN};
	const uint64_t end_ms = now_ms() + timeout_ms;
	enum dio_status status;

	while ((status = dio_buttons_read(buttons, event, NULL)) == DIO_AGAIN && now_ms() < end_ms)
		poll(&waiting, 1, (int)(end_ms - now_ms()));
	return status;
}

static void open_buttons(struct dio_buttons **buttons)
{
	const struct dio_buttons_options options = {
		.buttons = BUTTONS, .count = 2, .keyboard = "auto"};
	struct dio_error error = {""};

	assert_ok(dio_buttons_open(&options, buttons, &error), error);
}

static void keys_are_presses(void **state)
{
	int keyboard = plug_in(KEY_F1);
	struct dio_buttons *buttons = NULL;
	struct dio_button_event event;

	(void)state;
	assert_true(keyboard >= 0);
	open_buttons(&buttons);
	press(keyboard, KEY_F1, 1);
	press(keyboard, KEY_F1, 0);
	assert_int_equal(wait_for(buttons, &event, 5000), DIO_OK);
	assert_int_equal(event.button, 0);
	assert_int_equal(event.press, DIO_PRESS_SHORT);
	press(keyboard, KEY_F1, 1);
	/* The keyboard's own repetition is no press. */
	press(keyboard, KEY_F1, 2);
	press(keyboard, KEY_F1, 2);
	assert_int_equal(wait_for(buttons, &event, 5000), DIO_OK);
	assert_int_equal(event.press, DIO_PRESS_LONG);
	press(keyboard, KEY_F1, 0);
	assert_int_equal(wait_for(buttons, &event, 100), DIO_AGAIN);
	close(keyboard);
	assert_int_equal(wait_for(buttons, &event, 100), DIO_AGAIN);
	dio_buttons_close(buttons);
}

static void key_of_a_keyboard_pulled_out_comes_up(void **state)
{
	int keyboard = plug_in(KEY_F2);
	struct dio_buttons *buttons = NULL;
	struct dio_button_event event;

	(void)state;
	assert_true(keyboard >= 0);
	open_buttons(&buttons);
	press(keyboard, KEY_F2, 1);
	assert_int_equal(wait_for(buttons, &event, 300), DIO_AGAIN);
	close(keyboard);
	assert_int_equal(wait_for(buttons, &event, 5000), DIO_OK);
	assert_int_equal(event.button, 1);
	assert_int_equal(event.press, DIO_PRESS_SHORT);
	dio_buttons_close(buttons);
}

static void keyboard_plugged_in_later_is_heard(void **state)
{
	struct dio_buttons *buttons = NULL;
	struct dio_button_event event;
	int keyboard;

	(void)state;
	open_buttons(&buttons);
	for (int i = 0; i < 5; i++) {
		keyboard = plug_in(KEY_F2);
		assert_true(keyboard >= 0);
		assert_int_equal(wait_for(buttons, &event, 500), DIO_AGAIN);
		press(keyboard, KEY_F2, 1);
		press(keyboard, KEY_F2, 0);
		assert_int_equal(wait_for(buttons, &event, 5000), DIO_OK);
		assert_int_equal(event.button, 1);
		close(keyboard);
	}
	dio_buttons_close(buttons);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(keys_are_presses),
		cmocka_unit_test(key_of_a_keyboard_pulled_out_comes_up),
		cmocka_unit_test(keyboard_plugged_in_later_is_heard),
	};

	if (!device_tests_may_run("uinput"))
		return DEVICE_SKIPPED;
	if (access("/dev/uinput", W_OK) != 0) {
		printf("skipped: /dev/uinput cannot be written (modprobe uinput, root)\n");
		return DEVICE_SKIPPED;
	}
	return cmocka_run_group_tests(tests, NULL, NULL);
}
