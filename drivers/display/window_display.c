/* The window of dio/window.h as a display. */
#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/timerfd.h>
#include <unistd.h>

#include "backend.h"
#include "dio/clock.h"
#include "dio/window.h"

/* SDL has no descriptor to wait on: its events are asked for so often. */
#define LOOK_NS 8000000

struct window_display {
	struct dio_display base;
	struct dio_window *window;
	bool was_closed;
};

static enum dio_status window_show(struct dio_display *base, const struct dio_picture *picture,
				   uint64_t tag, struct dio_error *error)
{
	struct window_display *display = (struct window_display *)base;
	enum dio_status status = dio_window_show(display->window, picture, error);
	const struct dio_display_event event = {
		.kind = DIO_DISPLAY_FLIPPED, .time_ns = dio_clock_ns(), .tag = tag};
	const struct itimerspec at_once = {.it_interval = {.tv_nsec = LOOK_NS},
					   .it_value = {.tv_nsec = 1}};

	if (status != DIO_OK)
		return status;
	base->counters.shown++;
	dio_display_push(base, &event);
	/* The event is there now, so the descriptor must say so. */
	timerfd_settime(base->fd, 0, &at_once, NULL);
	return DIO_OK;
}

static enum dio_status window_dispatch(struct dio_display *base, struct dio_error *error)
{
	struct window_display *display = (struct window_display *)base;
	struct dio_display_event event = {.time_ns = dio_clock_ns()};
	struct dio_window_input input;
	uint64_t ticks;

	(void)error;
	if (read(base->fd, &ticks, sizeof(ticks)) != sizeof(ticks))
		return DIO_OK;
	dio_window_poll(display->window, 0, &input);
	for (uint32_t i = 0; i < input.key_count; i++) {
		event.kind = DIO_DISPLAY_KEY;
		event.key = input.keys[i].key;
		event.pressed = input.keys[i].pressed;
		dio_display_push(base, &event);
	}
	if (input.quit && !display->was_closed) {
		display->was_closed = true;
		event = (struct dio_display_event){.kind = DIO_DISPLAY_QUIT,
						   .time_ns = event.time_ns};
		dio_display_push(base, &event);
	}
	return DIO_OK;
}

static enum dio_status window_close(struct dio_display *base, struct dio_error *error)
{
	struct window_display *display = (struct window_display *)base;

	(void)error;
	dio_window_close(display->window);
	if (base->fd >= 0)
		close(base->fd);
	free(display);
	return DIO_OK;
}

static const struct dio_display_ops WINDOW = {
	.show = window_show,
	.dispatch = window_dispatch,
	.close = window_close,
};

static enum dio_status set_up(struct window_display *display, const char *title,
			      struct dio_error *error)
{
	const struct itimerspec often = {.it_interval = {.tv_nsec = LOOK_NS},
					 .it_value = {.tv_nsec = LOOK_NS}};

	display->base.fd = timerfd_create(CLOCK_MONOTONIC, TFD_NONBLOCK | TFD_CLOEXEC);
	if (display->base.fd < 0 || timerfd_settime(display->base.fd, 0, &often, NULL) < 0)
		return dio_fail(error, DIO_IO, "window: no timer: %s", strerror(errno));
	return dio_window_open(title && title[0] ? title : "Diorama", display->base.info.width,
			       display->base.info.height, &display->window, error);
}

enum dio_status dio_display_open_window(const struct dio_display_mode *mode,
					const struct dio_display_options *options,
					struct dio_display **display, struct dio_error *error)
{
	struct window_display *made = calloc(1, sizeof(*made));
	enum dio_status status;

	if (!made)
		return dio_fail(error, DIO_NO_MEM, "window: out of memory");
	made->base.ops = &WINDOW;
	made->base.info.state = DIO_DISPLAY_ON;
	made->base.info.width = mode->width ? mode->width : DIO_DISPLAY_WIDTH;
	made->base.info.height = mode->height ? mode->height : DIO_DISPLAY_HEIGHT;
	snprintf(made->base.info.name, sizeof(made->base.info.name), "window");
	status = set_up(made, options->title, error);
	if (status != DIO_OK) {
		window_close(&made->base, NULL);
		return status;
	}
	*display = &made->base;
	return DIO_OK;
}
