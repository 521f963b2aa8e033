/* What an LED does over time. */
#ifndef DIO_GPIO_LED_PATTERN_H
#define DIO_GPIO_LED_PATTERN_H

#include <stdbool.h>
#include <stdint.h>

#include "dio/gpio.h"

/**
 * Is the LED lit `elapsed_ns` after its pattern began?
 *
 * next_ns  receives how long after the beginning that changes; UINT64_MAX: never
 */
bool dio_led_pattern_at(enum dio_led_pattern pattern, uint64_t elapsed_ns, uint64_t *next_ns);

#endif
