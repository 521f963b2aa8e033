#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/timerfd.h>
#include <unistd.h>

#include "led_pattern.h"
#include "system.h"

struct led {
	struct dio_led_options options;
	struct dio_gpio_hold hold;
	bool lit;
};

struct dio_leds {
	const struct dio_gpio_system *system;
	uint32_t count;
	struct led leds[DIO_LEDS_MAX];
	int timer;
	enum dio_led_state state;
	bool has_state;
	uint64_t since_ns; /* the state began */
};

static enum dio_status light(struct dio_leds *leds, struct led *led, bool lit,
			     struct dio_error *error)
{
	if (led->lit == lit)
		return DIO_OK;
	if (leds->system->set(leds->system->context, led->hold.line, lit) < 0)
		return dio_fail(error, errno == ENODEV ? DIO_GONE : dio_status_from_errno(errno),
				"led %s: cannot be switched: %s", led->options.name,
				strerror(errno));
	led->lit = lit;
	return DIO_OK;
}

static enum dio_status take(struct dio_leds *leds, const struct dio_led_options *options,
			    struct dio_error *error)
{
	struct dio_gpio_request request = {.output = true, .active_low = options->active_low};
	struct led *led = &leds->leds[leds->count];
	char owner[48];
	enum dio_status status;

	for (int i = 0; i < DIO_LED_STATE_COUNT; i++)
		if ((unsigned)options->patterns[i] >= DIO_LED_PATTERN_COUNT)
			return dio_fail(error, DIO_BAD_ARG, "led %s: pattern %d does not exist",
					options->name, (int)options->patterns[i]);
	snprintf(owner, sizeof(owner), "led %s", options->name);
	status = dio_gpio_hold(leds->system, owner, &options->line, &request, &led->hold, error);
	if (status != DIO_OK)
		return status;
	led->options = *options;
	leds->count++;
	return DIO_OK;
}

enum dio_status dio_leds_open_on(const struct dio_gpio_system *system,
				 const struct dio_led_options *leds, uint32_t count,
				 struct dio_leds **opened, struct dio_error *error)
{
	struct dio_leds *made;
	enum dio_status status = DIO_OK;

	if (count > DIO_LEDS_MAX)
		return dio_fail(error, DIO_BAD_ARG, "leds: %u; at most %d can be", count,
				DIO_LEDS_MAX);
	made = calloc(1, sizeof(*made));
	if (!made)
		return dio_fail(error, DIO_NO_MEM, "leds: out of memory");
	made->system = system;
	made->timer = timerfd_create(CLOCK_MONOTONIC, TFD_NONBLOCK | TFD_CLOEXEC);
	if (made->timer < 0)
		status = dio_fail(error, dio_status_from_errno(errno), "leds: no timer: %s",
				  strerror(errno));
	for (uint32_t i = 0; i < count && status == DIO_OK; i++)
		status = take(made, &leds[i], error);
	if (status != DIO_OK) {
		dio_leds_close(made);
		return status;
	}
	*opened = made;
	return DIO_OK;
}

enum dio_status dio_leds_open(const struct dio_led_options *leds, uint32_t count,
			      struct dio_leds **opened, struct dio_error *error)
{
	return dio_leds_open_on(&dio_gpio_kernel, leds, count, opened, error);
}

void dio_leds_close(struct dio_leds *leds)
{
	if (!leds)
		return;
	for (uint32_t i = 0; i < leds->count; i++) {
		light(leds, &leds->leds[i], false, NULL);
		dio_gpio_let_go(leds->system, &leds->leds[i].hold);
	}
	if (leds->timer >= 0)
		close(leds->timer);
	free(leds);
}

static void arm(const struct dio_leds *leds, uint64_t at_ns)
{
	/* A time of zero disarms. */
	const uint64_t wake_ns = at_ns == UINT64_MAX ? 0 : at_ns;
	const struct itimerspec when = {.it_value = {.tv_sec = (time_t)(wake_ns / 1000000000u),
						     .tv_nsec = (long)(wake_ns % 1000000000u)}};

	/* Cannot fail: the timer is open and the time well formed. */
	timerfd_settime(leds->timer, TFD_TIMER_ABSTIME, &when, NULL);
}

enum dio_status dio_leds_update(struct dio_leds *leds, struct dio_error *error)
{
	const uint64_t now_ns = leds->system->now_ns(leds->system->context);
	const uint64_t elapsed_ns = now_ns - leds->since_ns;
	uint64_t next_ns = UINT64_MAX;
	enum dio_status first = DIO_OK;

	if (!leds->has_state)
		return DIO_OK;
	for (uint32_t i = 0; i < leds->count; i++) {
		struct led *led = &leds->leds[i];
		uint64_t changes_ns;
		bool lit = dio_led_pattern_at(led->options.patterns[leds->state], elapsed_ns,
					      &changes_ns);
		enum dio_status status = light(leds, led, lit, first == DIO_OK ? error : NULL);

		if (first == DIO_OK)
			first = status;
		if (changes_ns < next_ns)
			next_ns = changes_ns;
	}
	/* After a failure nothing is due: the caller decides what next. */
	arm(leds, first != DIO_OK || next_ns == UINT64_MAX ? UINT64_MAX : leds->since_ns + next_ns);
	return first;
}

enum dio_status dio_leds_set_state(struct dio_leds *leds, enum dio_led_state state,
				   struct dio_error *error)
{
	if ((unsigned)state >= DIO_LED_STATE_COUNT)
		return dio_fail(error, DIO_BAD_ARG, "leds: state %d does not exist", (int)state);
	if (leds->has_state && leds->state == state)
		return DIO_OK;
	leds->state = state;
	leds->has_state = true;
	leds->since_ns = leds->system->now_ns(leds->system->context);
	return dio_leds_update(leds, error);
}

int dio_leds_get_fd(const struct dio_leds *leds)
{
	return leds->timer;
}
