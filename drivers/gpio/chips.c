#include "chips.h"

#include <glob.h>
#include <stdio.h>
#include <time.h>

bool dio_gpio_list_chips(void *context, uint32_t index, char *path, size_t path_size)
{
	glob_t found;
	bool there;

	(void)context;
	if (glob("/dev/gpiochip*", 0, NULL, &found) != 0)
		return false;
	there = index < found.gl_pathc;
	if (there)
		snprintf(path, path_size, "%s", found.gl_pathv[index]);
	globfree(&found);
	return there;
}

uint64_t dio_gpio_now_ns(void *context)
{
	struct timespec now;

	(void)context;
	clock_gettime(CLOCK_MONOTONIC, &now);
	return (uint64_t)now.tv_sec * 1000000000u + (uint64_t)now.tv_nsec;
}
