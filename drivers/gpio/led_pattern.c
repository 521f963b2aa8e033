#include "led_pattern.h"

#include <stddef.h>

#define NS_PER_MS 1000000u
#define STEPS_MAX 4

/* How long each step lasts, lit first, over and over; none: always `lit`. */
static const struct {
	const char *name;
	bool lit;
	uint32_t steps_ms[STEPS_MAX];
} PATTERNS[DIO_LED_PATTERN_COUNT] = {
	[DIO_LED_OFF] = {"off", false, {0}},
	[DIO_LED_ON] = {"on", true, {0}},
	[DIO_LED_SLOW] = {"slow", true, {500, 500}},
	[DIO_LED_FAST] = {"fast", true, {125, 125}},
	[DIO_LED_FLASH] = {"flash", true, {50, 950}},
	[DIO_LED_TWICE] = {"twice", true, {50, 150, 50, 750}},
};

static const char *const STATES[DIO_LED_STATE_COUNT] = {
	[DIO_LED_STATE_IDLE] = "idle",       [DIO_LED_STATE_CALIBRATE] = "calibrate",
	[DIO_LED_STATE_CAPTURE] = "capture", [DIO_LED_STATE_RECONSTRUCT] = "reconstruct",
	[DIO_LED_STATE_VIEW] = "view",       [DIO_LED_STATE_ERROR] = "error",
};

const char *dio_led_pattern_name(enum dio_led_pattern pattern)
{
	return (unsigned)pattern < DIO_LED_PATTERN_COUNT ? PATTERNS[pattern].name : NULL;
}

const char *dio_led_state_name(enum dio_led_state state)
{
	return (unsigned)state < DIO_LED_STATE_COUNT ? STATES[state] : NULL;
}

bool dio_led_pattern_at(enum dio_led_pattern pattern, uint64_t elapsed_ns, uint64_t *next_ns)
{
	const uint32_t *steps_ms = PATTERNS[pattern].steps_ms;
	uint64_t period_ns = 0, end_ns;

	for (size_t i = 0; i < STEPS_MAX; i++)
		period_ns += (uint64_t)steps_ms[i] * NS_PER_MS;
	*next_ns = UINT64_MAX;
	if (period_ns == 0)
		return PATTERNS[pattern].lit;
	end_ns = elapsed_ns / period_ns * period_ns;
	for (size_t i = 0; i < STEPS_MAX; i++) {
		end_ns += (uint64_t)steps_ms[i] * NS_PER_MS;
		if (elapsed_ns < end_ns) {
			*next_ns = end_ns;
			return i % 2 == 0;
		}
	}
	return false;
}
