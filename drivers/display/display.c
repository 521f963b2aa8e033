#include "dio/display.h"

#include <poll.h>

#include "backend.h"
#include "dio/clock.h"

enum dio_status dio_display_close(struct dio_display *display, struct dio_error *error)
{
	return display ? display->ops->close(display, error) : DIO_OK;
}

int dio_display_get_fd(const struct dio_display *display)
{
	return display->fd;
}

enum dio_status dio_display_show(struct dio_display *display, const struct dio_picture *picture,
				 uint64_t tag, struct dio_error *error)
{
	if (!picture->rgb || !picture->width || !picture->height)
		return dio_fail(error, DIO_BAD_ARG, "display %s: no picture to show",
				display->info.name);
	if (display->info.state != DIO_DISPLAY_ON)
		return DIO_NO_SIGNAL;
	return display->ops->show(display, picture, tag, error);
}

void dio_display_push(struct dio_display *display, const struct dio_display_event *event)
{
	if (display->event_count == DIO_DISPLAY_EVENTS_MAX) {
		display->first = (display->first + 1) % DIO_DISPLAY_EVENTS_MAX;
		display->event_count--;
	}
	display->events[(display->first + display->event_count++) % DIO_DISPLAY_EVENTS_MAX] =
		*event;
}

void dio_display_push_changed(struct dio_display *display, uint64_t time_ns)
{
	const struct dio_display_event event = {.kind = DIO_DISPLAY_CHANGED, .time_ns = time_ns};

	dio_display_push(display, &event);
}

static bool pop(struct dio_display *display, struct dio_display_event *event)
{
	if (display->event_count == 0)
		return false;
	*event = display->events[display->first];
	display->first = (display->first + 1) % DIO_DISPLAY_EVENTS_MAX;
	display->event_count--;
	return true;
}

enum dio_status dio_display_poll(struct dio_display *display, int64_t timeout_ns,
				 struct dio_display_event *event, struct dio_error *error)
{
	const uint64_t begin_ns = dio_clock_ns();
	struct pollfd waiting = {.fd = display->fd, .events = POLLIN};

	for (;;) {
		int64_t left_ns = timeout_ns;
		enum dio_status status;

		if (pop(display, event))
			return DIO_OK;
		status = display->ops->dispatch(display, error);
		if (pop(display, event))
			return DIO_OK;
		if (status != DIO_OK)
			return status;
		left_ns -= (int64_t)(dio_clock_ns() - begin_ns);
		if (left_ns <= 0)
			return DIO_AGAIN;
		if (left_ns > INT32_MAX * (int64_t)1000000)
			left_ns = INT32_MAX * (int64_t)1000000;
		/* Woken early or by a signal, it looks again. */
		poll(&waiting, 1, (int)((left_ns + 999999) / 1000000));
	}
}

void dio_display_get_info(const struct dio_display *display, struct dio_display_info *info)
{
	*info = display->info;
}

void dio_display_get_counters(const struct dio_display *display,
			      struct dio_display_counters *counters)
{
	*counters = display->counters;
}
