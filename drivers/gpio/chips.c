#include "chips.h"

#include "dio/clock.h"
#include "dio/file.h"

bool dio_gpio_list_chips(void *context, uint32_t index, char *path, size_t path_size)
{
	(void)context;
	return dio_file_match("/dev/gpiochip*", index, path, path_size);
}

uint64_t dio_gpio_now_ns(void *context)
{
	(void)context;
	return dio_clock_ns();
}
