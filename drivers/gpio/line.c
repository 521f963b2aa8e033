#include "dio/gpio.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define OFFSET_DIGITS_MAX 6

/* Where ":17" begins, or NULL: a name. */
static const char *find_offset(const char *text)
{
	const char *colon = strrchr(text, ':');
	size_t digits = colon ? strlen(colon + 1) : 0;

	if (!colon || colon == text || digits == 0 || strspn(colon + 1, "0123456789") != digits)
		return NULL;
	return colon;
}

enum dio_status dio_gpio_line_parse(const char *text, struct dio_gpio_line *line,
				    struct dio_error *error)
{
	const char *colon = find_offset(text);
	const size_t length = colon ? (size_t)(colon - text) : strlen(text);
	struct dio_gpio_line parsed = {0};

	if (length == 0)
		return dio_fail(error, DIO_BAD_ARG,
				"line: empty; say a name (GPIO17) or a chip and an offset "
				"(gpiochip0:17)");
	if (length >= DIO_GPIO_NAME_MAX)
		return dio_fail(error, DIO_BAD_ARG,
				"line '%s': %zu characters; names have at most %d", text, length,
				DIO_GPIO_NAME_MAX - 1);
	if (colon && strlen(colon + 1) > OFFSET_DIGITS_MAX)
		return dio_fail(error, DIO_BAD_ARG, "line '%s': no chip has so many lines", text);
	snprintf(colon ? parsed.chip : parsed.name, DIO_GPIO_NAME_MAX, "%.*s", (int)length, text);
	if (colon)
		parsed.offset = (uint32_t)strtoul(colon + 1, NULL, 10);
	*line = parsed;
	return DIO_OK;
}
