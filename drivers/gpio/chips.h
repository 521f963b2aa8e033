/* What both libgpiod versions share: the chips that are there, the clock. */
#ifndef DIO_GPIO_CHIPS_H
#define DIO_GPIO_CHIPS_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

/** dio_gpio_system.list and .now_ns over /dev. */
bool dio_gpio_list_chips(void *context, uint32_t index, char *path, size_t path_size);
uint64_t dio_gpio_now_ns(void *context);

#endif
