#include <ctype.h>
#include <libevdev/libevdev.h>
#include <stdio.h>
#include <string.h>

#include "dio/gpio.h"

uint32_t dio_key_from_name(const char *name)
{
	char upper[64];
	size_t length;
	int code;

	snprintf(upper, sizeof(upper), "%s%s", strncasecmp(name, "KEY_", 4) == 0 ? "" : "KEY_",
		 name);
	length = strlen(upper);
	for (size_t i = 0; i < length; i++)
		upper[i] = (char)toupper((unsigned char)upper[i]);
	code = libevdev_event_code_from_name(EV_KEY, upper);
	return code > 0 ? (uint32_t)code : 0;
}
