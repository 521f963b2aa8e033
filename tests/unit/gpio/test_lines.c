#include "check.h"

#include <errno.h>
#include <linux/input-event-codes.h>
#include <string.h>

#include "fake_gpio.h"

static void name_or_chip_and_offset_is_read(void **state)
{
	static const struct {
		const char *text, *chip, *name;
		uint32_t offset;
	} cases[] = {
		{"GPIO17", "", "GPIO17", 0},
		{"gpiochip0:17", "gpiochip0", "", 17},
		{"/dev/gpiochip4:0", "/dev/gpiochip4", "", 0},
		{"pinctrl-rp1:999999", "pinctrl-rp1", "", 999999},
		{"MCP2221:A:3", "MCP2221:A", "", 3},
		{"a:b", "", "a:b", 0},
		{":5", "", ":5", 0},
		{"x:", "", "x:", 0},
	};
	struct dio_error error = {""};

	(void)state;
	for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
		struct dio_gpio_line line = {.name = "before", .offset = 1};

		assert_ok(dio_gpio_line_parse(cases[i].text, &line, &error), error);
		assert_string_equal(line.chip, cases[i].chip);
		assert_string_equal(line.name, cases[i].name);
		assert_int_equal(line.offset, cases[i].offset);
	}
}

static void line_that_cannot_be_is_refused(void **state)
{
	struct dio_gpio_line line = {.name = "before"};
	struct dio_error error = {""};
	char longest[DIO_GPIO_NAME_MAX + 1];

	(void)state;
	memset(longest, 'x', sizeof(longest) - 1);
	longest[sizeof(longest) - 1] = '\0';
	assert_fails(dio_gpio_line_parse("", &line, &error), DIO_BAD_ARG, error, "empty");
	assert_fails(dio_gpio_line_parse(longest, &line, &error), DIO_BAD_ARG, error,
		     "64 characters");
	assert_fails(dio_gpio_line_parse("gpiochip0:1234567", &line, &error), DIO_BAD_ARG, error,
		     "so many lines");
	assert_string_equal(line.name, "before");
}

static enum dio_status check(struct fake_gpio *fake, const char *text, struct dio_error *error)
{
	struct dio_gpio_line line;

	if (dio_gpio_line_parse(text, &line, error) != DIO_OK)
		return DIO_BAD_ARG;
	return dio_gpio_line_check_on(&fake->system, &line, error);
}

static void line_is_found_by_name_path_file_name_or_label(void **state)
{
	static const char *const found[] = {"B5", "/dev/gpiochip1:5", "gpiochip1:5", "second:5"};
	struct dio_error error = {""};
	struct fake_gpio fake;

	(void)state;
	fake_gpio_init(&fake);
	for (size_t i = 0; i < sizeof found / sizeof *found; i++)
		assert_ok(check(&fake, found[i], &error), error);
	assert_int_equal(fake_gpio_in_use(&fake), 0);
}

static void line_that_is_missing_is_told_with_what_was_looked_at(void **state)
{
	struct dio_error error = {""};
	struct fake_gpio fake;

	(void)state;
	fake_gpio_init(&fake);
	assert_fails(check(&fake, "C1", &error), DIO_NOT_FOUND, error, "none of 2 GPIO chips");
	assert_fails(check(&fake, "third:1", &error), DIO_NOT_FOUND, error, "third:1");
	assert_fails(check(&fake, "first:8", &error), DIO_NOT_FOUND, error, "lines 0 to 7");
	fake.chips[1].open_errno = EACCES;
	assert_ok(check(&fake, "A1", &error), error);
	assert_fails(check(&fake, "B1", &error), DIO_IO, error, "group gpio");
	fake.chip_count = 0;
	assert_fails(check(&fake, "A1", &error), DIO_NOT_FOUND, error, "no GPIO chip");
	assert_int_equal(fake_gpio_in_use(&fake), 0);
}

static void keys_have_the_kernels_names(void **state)
{
	(void)state;
	assert_int_equal(dio_key_from_name("f1"), KEY_F1);
	assert_int_equal(dio_key_from_name("KEY_SPACE"), KEY_SPACE);
	assert_int_equal(dio_key_from_name("Key_Enter"), KEY_ENTER);
	assert_int_equal(dio_key_from_name("7"), KEY_7);
	assert_int_equal(dio_key_from_name(""), 0);
	assert_int_equal(dio_key_from_name("no such key"), 0);
	assert_int_equal(dio_key_from_name("key_key_a"), 0);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(name_or_chip_and_offset_is_read),
		cmocka_unit_test(line_that_cannot_be_is_refused),
		cmocka_unit_test(line_is_found_by_name_path_file_name_or_label),
		cmocka_unit_test(line_that_is_missing_is_told_with_what_was_looked_at),
		cmocka_unit_test(keys_have_the_kernels_names),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
