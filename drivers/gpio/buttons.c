#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/epoll.h>
#include <sys/timerfd.h>
#include <unistd.h>

#include "keyboard.h"
#include "press.h"
#include "system.h"

#define NS_PER_US  1000u
#define NS_PER_MS  1000000u
#define EVENTS_MAX 64
#define NS_PER_S   1000000000u

/* A line and a key do the same and are recognised apart. */
struct button {
	struct dio_button_options options;
	struct dio_gpio_hold hold;
	struct dio_press_state line, key;
};

struct dio_buttons {
	const struct dio_gpio_system *system;
	uint32_t count;
	struct button buttons[DIO_BUTTONS_MAX];
	struct dio_keyboard *keyboard;
	int epoll, timer;
	struct dio_button_event events[EVENTS_MAX]; /* told next: first */
	uint32_t first, event_count;
};

static bool has_line(const struct dio_button_options *options)
{
	return options->line.chip[0] || options->line.name[0];
}

static struct dio_press_times get_times(const struct dio_button_options *options, bool debounce)
{
	return (struct dio_press_times){
		.debounce_ns = debounce ? (uint64_t)options->debounce_us * NS_PER_US : 0,
		.long_ns = (uint64_t)options->long_ms * NS_PER_MS,
		.double_ns = (uint64_t)options->double_ms * NS_PER_MS,
	};
}

static enum dio_status watch(const struct dio_buttons *buttons, int fd, struct dio_error *error)
{
	struct epoll_event event = {.events = EPOLLIN};

	if (fd < 0 || epoll_ctl(buttons->epoll, EPOLL_CTL_ADD, fd, &event) < 0)
		return dio_fail(error, dio_status_from_errno(errno),
				"buttons: cannot be waited for: %s", strerror(errno));
	return DIO_OK;
}

static enum dio_status take_line(struct dio_buttons *buttons, struct button *button,
				 struct dio_error *error)
{
	const struct dio_gpio_system *system = buttons->system;
	const struct dio_press_times times = get_times(&button->options, !system->debounces);
	struct dio_gpio_request request = {
		.active_low = button->options.active_low,
		.pull = button->options.pull,
		.debounce_us = button->options.debounce_us,
	};
	char owner[48];
	enum dio_status status;

	snprintf(owner, sizeof(owner), "button %s", button->options.name);
	status =
		dio_gpio_hold(system, owner, &button->options.line, &request, &button->hold, error);
	if (status != DIO_OK)
		return status;
	dio_press_init(&button->line, &times, system->get(system->context, button->hold.line) == 1);
	return watch(buttons, system->get_fd(system->context, button->hold.line), error);
}

static enum dio_status add_button(struct dio_buttons *buttons,
				  const struct dio_button_options *options, struct dio_error *error)
{
	struct button *button = &buttons->buttons[buttons->count++];
	const struct dio_press_times times = get_times(options, false);

	button->options = *options;
	dio_press_init(&button->key, &times, false);
	return has_line(options) ? take_line(buttons, button, error) : DIO_OK;
}

static enum dio_status open_keyboard(struct dio_buttons *buttons, const char *where,
				     struct dio_error *error)
{
	uint32_t keys[DIO_BUTTONS_MAX], count = 0;
	enum dio_status status;

	for (uint32_t i = 0; i < buttons->count; i++)
		if (buttons->buttons[i].options.key)
			keys[count++] = buttons->buttons[i].options.key;
	if (!where || !where[0] || count == 0)
		return DIO_OK;
	status = dio_keyboard_open(where, keys, count, &buttons->keyboard, error);
	return status == DIO_OK ? watch(buttons, dio_keyboard_get_fd(buttons->keyboard), error)
				: status;
}

static enum dio_status set_up(struct dio_buttons *buttons,
			      const struct dio_buttons_options *options, struct dio_error *error)
{
	enum dio_status status;

	buttons->epoll = epoll_create1(EPOLL_CLOEXEC);
	buttons->timer = timerfd_create(CLOCK_MONOTONIC, TFD_NONBLOCK | TFD_CLOEXEC);
	status = watch(buttons, buttons->timer, error);
	for (uint32_t i = 0; i < options->count && status == DIO_OK; i++)
		status = add_button(buttons, &options->buttons[i], error);
	return status == DIO_OK ? open_keyboard(buttons, options->keyboard, error) : status;
}

enum dio_status dio_buttons_open_on(const struct dio_gpio_system *system,
				    const struct dio_buttons_options *options,
				    struct dio_buttons **buttons, struct dio_error *error)
{
	struct dio_buttons *made;
	enum dio_status status;

	if (options->count > DIO_BUTTONS_MAX)
		return dio_fail(error, DIO_BAD_ARG, "buttons: %u; at most %d can be",
				options->count, DIO_BUTTONS_MAX);
	made = calloc(1, sizeof(*made));
	if (!made)
		return dio_fail(error, DIO_NO_MEM, "buttons: out of memory");
	made->system = system;
	status = set_up(made, options, error);
	if (status != DIO_OK) {
		dio_buttons_close(made);
		return status;
	}
	*buttons = made;
	return DIO_OK;
}

enum dio_status dio_buttons_open(const struct dio_buttons_options *options,
				 struct dio_buttons **buttons, struct dio_error *error)
{
	return dio_buttons_open_on(&dio_gpio_kernel, options, buttons, error);
}

void dio_buttons_close(struct dio_buttons *buttons)
{
	if (!buttons)
		return;
	for (uint32_t i = 0; i < buttons->count; i++)
		dio_gpio_let_go(buttons->system, &buttons->buttons[i].hold);
	dio_keyboard_close(buttons->keyboard);
	if (buttons->timer >= 0)
		close(buttons->timer);
	if (buttons->epoll >= 0)
		close(buttons->epoll);
	free(buttons);
}

int dio_buttons_get_fd(const struct dio_buttons *buttons)
{
	return buttons->epoll;
}

static uint64_t now_ns(const struct dio_buttons *buttons)
{
	return buttons->system->now_ns(buttons->system->context);
}

/* Queue what is certain at that time. No hand fills the queue; what would not fit is dropped. */
static void take_presses(struct dio_buttons *buttons, const struct button *button,
			 struct dio_press_state *state, uint64_t until_ns)
{
	struct dio_button_event event = {.button = (uint32_t)(button - buttons->buttons)};

	while (dio_press_next(state, until_ns, &event.press, &event.timestamp_ns)) {
		if (buttons->event_count == EVENTS_MAX)
			continue;
		buttons->events[(buttons->first + buttons->event_count++) % EVENTS_MAX] = event;
	}
}

static void take_edge(struct dio_buttons *buttons, const struct button *button,
		      struct dio_press_state *state, bool pressed, uint64_t time_ns)
{
	take_presses(buttons, button, state, time_ns);
	dio_press_edge(state, pressed, time_ns);
}

/* The kernel's queue holds 16 edges and drops later ones: a line that bounced more than that is
 * asked how it stands. */
static enum dio_status drain_line(struct dio_buttons *buttons, struct button *button,
				  struct dio_error *error)
{
	const struct dio_gpio_system *system = buttons->system;
	struct dio_gpio_edge edge;
	bool moved = false;
	int result;

	while ((result = system->read(system->context, button->hold.line, &edge)) > 0) {
		take_edge(buttons, button, &button->line, edge.active, edge.timestamp_ns);
		moved = true;
	}
	if (result == 0 && moved) {
		result = system->get(system->context, button->hold.line);
		if (result >= 0 && (result == 1) != button->line.raw)
			take_edge(buttons, button, &button->line, result == 1, now_ns(buttons));
	}
	if (result < 0)
		return dio_fail(error, errno == ENODEV ? DIO_GONE : dio_status_from_errno(errno),
				"button %s: its line cannot be read: %s", button->options.name,
				strerror(errno));
	return DIO_OK;
}

static void take_key(void *context, uint32_t key, bool pressed, uint64_t time_ns)
{
	struct dio_buttons *buttons = context;

	for (uint32_t i = 0; i < buttons->count; i++)
		if (buttons->buttons[i].options.key == key)
			take_edge(buttons, &buttons->buttons[i], &buttons->buttons[i].key, pressed,
				  time_ns);
}

/* Wake when a press becomes certain without anything moving, and at once while some wait. */
static void arm(const struct dio_buttons *buttons)
{
	uint64_t at_ns = DIO_PRESS_NEVER;
	struct itimerspec when = {0};

	for (uint32_t i = 0; i < buttons->count; i++) {
		uint64_t line_ns = dio_press_deadline(&buttons->buttons[i].line);
		uint64_t key_ns = dio_press_deadline(&buttons->buttons[i].key);

		at_ns = line_ns < at_ns ? line_ns : at_ns;
		at_ns = key_ns < at_ns ? key_ns : at_ns;
	}
	if (buttons->event_count)
		at_ns = 1;
	if (at_ns != DIO_PRESS_NEVER) {
		when.it_value.tv_sec = (time_t)(at_ns / NS_PER_S);
		when.it_value.tv_nsec = (long)(at_ns % NS_PER_S);
	}
	/* Cannot fail: the timer is open and the time well formed. */
	timerfd_settime(buttons->timer, TFD_TIMER_ABSTIME, &when, NULL);
}

/* Edges first, all of them: time passes only after what happened in it. */
static enum dio_status gather(struct dio_buttons *buttons, struct dio_error *error)
{
	const uint64_t until_ns = now_ns(buttons);
	enum dio_status status = DIO_OK;

	if (buttons->keyboard)
		dio_keyboard_drain(buttons->keyboard, take_key, buttons);
	for (uint32_t i = 0; i < buttons->count && status == DIO_OK; i++) {
		struct button *button = &buttons->buttons[i];

		if (button->hold.line)
			status = drain_line(buttons, button, error);
		take_presses(buttons, button, &button->line, until_ns);
		take_presses(buttons, button, &button->key, until_ns);
	}
	return status;
}

enum dio_status dio_buttons_read(struct dio_buttons *buttons, struct dio_button_event *event,
				 struct dio_error *error)
{
	enum dio_status status = DIO_OK;

	if (buttons->event_count == 0)
		status = gather(buttons, error);
	if (buttons->event_count) {
		*event = buttons->events[buttons->first];
		buttons->first = (buttons->first + 1) % EVENTS_MAX;
		buttons->event_count--;
		status = DIO_OK;
	} else if (status == DIO_OK) {
		status = DIO_AGAIN;
	}
	arm(buttons);
	return status;
}

void dio_buttons_feed_key(struct dio_buttons *buttons, uint32_t key, bool pressed,
			  uint64_t timestamp_ns)
{
	if (key)
		take_key(buttons, key, pressed, timestamp_ns);
	arm(buttons);
}
