/* libgpiod 2: the kernel's second GPIO interface, which debounces. */
#include <errno.h>
#include <gpiod.h>
#include <stdio.h>
#include <stdlib.h>

#include "chips.h"
#include "system.h"

#define CONSUMER "diorama"

/* A request of one line, with room for one event. */
struct line {
	struct gpiod_line_request *request;
	struct gpiod_edge_event_buffer *events;
	uint32_t offset;
};

static int open_chip(void *context, const char *path, void **chip)
{
	(void)context;
	*chip = gpiod_chip_open(path);
	return *chip ? 0 : -1;
}

static void close_chip(void *context, void *chip)
{
	(void)context;
	gpiod_chip_close(chip);
}

static void get_label(void *context, void *chip, char *label, size_t label_size)
{
	struct gpiod_chip_info *info = gpiod_chip_get_info(chip);

	(void)context;
	snprintf(label, label_size, "%s", info ? gpiod_chip_info_get_label(info) : "");
	gpiod_chip_info_free(info);
}

static uint32_t get_line_count(void *context, void *chip)
{
	struct gpiod_chip_info *info = gpiod_chip_get_info(chip);
	uint32_t count = info ? (uint32_t)gpiod_chip_info_get_num_lines(info) : 0;

	(void)context;
	gpiod_chip_info_free(info);
	return count;
}

static int find(void *context, void *chip, const char *name)
{
	(void)context;
	return gpiod_chip_get_line_offset_from_name(chip, name);
}

static void get_consumer(void *context, void *chip, uint32_t offset, char *name, size_t name_size)
{
	struct gpiod_line_info *info = gpiod_chip_get_line_info(chip, offset);
	const char *consumer = info ? gpiod_line_info_get_consumer(info) : NULL;

	(void)context;
	snprintf(name, name_size, "%s", consumer ? consumer : "");
	gpiod_line_info_free(info);
}

static enum gpiod_line_bias get_bias(enum dio_gpio_pull pull)
{
	switch (pull) {
	case DIO_GPIO_PULL_AS_IS:
		break;
	case DIO_GPIO_PULL_NONE:
		return GPIOD_LINE_BIAS_DISABLED;
	case DIO_GPIO_PULL_UP:
		return GPIOD_LINE_BIAS_PULL_UP;
	case DIO_GPIO_PULL_DOWN:
		return GPIOD_LINE_BIAS_PULL_DOWN;
	}
	return GPIOD_LINE_BIAS_AS_IS;
}

static int configure(struct gpiod_line_settings *settings, struct gpiod_line_config *config,
		     const struct dio_gpio_request *request)
{
	const unsigned int offset = request->offset;

	gpiod_line_settings_set_active_low(settings, request->active_low);
	if (gpiod_line_settings_set_bias(settings, get_bias(request->pull)) < 0)
		return -1;
	if (request->output) {
		if (gpiod_line_settings_set_direction(settings, GPIOD_LINE_DIRECTION_OUTPUT) < 0)
			return -1;
	} else {
		if (gpiod_line_settings_set_direction(settings, GPIOD_LINE_DIRECTION_INPUT) < 0 ||
		    gpiod_line_settings_set_edge_detection(settings, GPIOD_LINE_EDGE_BOTH) < 0)
			return -1;
		gpiod_line_settings_set_debounce_period_us(settings, request->debounce_us);
	}
	return gpiod_line_config_add_line_settings(config, &offset, 1, settings);
}

static int take(struct gpiod_chip *chip, const struct dio_gpio_request *request, struct line *line)
{
	struct gpiod_line_settings *settings = gpiod_line_settings_new();
	struct gpiod_line_config *config = gpiod_line_config_new();
	struct gpiod_request_config *about = gpiod_request_config_new();
	int result = -1, cause;

	if (!settings || !config || !about || configure(settings, config, request) < 0)
		goto out;
	gpiod_request_config_set_consumer(about, CONSUMER);
	line->offset = request->offset;
	line->events = gpiod_edge_event_buffer_new(1);
	if (!line->events)
		goto out;
	line->request = gpiod_chip_request_lines(chip, about, config);
	if (line->request)
		result = 0;
out:
	cause = errno;
	gpiod_request_config_free(about);
	gpiod_line_config_free(config);
	gpiod_line_settings_free(settings);
	errno = cause;
	return result;
}

static void release(void *context, void *opaque)
{
	struct line *line = opaque;

	(void)context;
	if (line->request)
		gpiod_line_request_release(line->request);
	gpiod_edge_event_buffer_free(line->events);
	free(line);
}

static int request_line(void *context, void *chip, const struct dio_gpio_request *request,
			void **line)
{
	struct line *made = calloc(1, sizeof(*made));
	int cause;

	if (!made)
		return -1;
	if (take(chip, request, made) < 0) {
		cause = errno;
		release(context, made);
		errno = cause;
		return -1;
	}
	*line = made;
	return 0;
}

static int get_fd(void *context, void *opaque)
{
	struct line *line = opaque;

	(void)context;
	return gpiod_line_request_get_fd(line->request);
}

static int read_edge(void *context, void *opaque, struct dio_gpio_edge *edge)
{
	struct line *line = opaque;
	struct gpiod_edge_event *event;
	int waiting = gpiod_line_request_wait_edge_events(line->request, 0);

	(void)context;
	if (waiting <= 0)
		return waiting < 0 && errno == EINTR ? 0 : waiting;
	if (gpiod_line_request_read_edge_events(line->request, line->events, 1) < 1)
		return -1;
	event = gpiod_edge_event_buffer_get_event(line->events, 0);
	edge->active = gpiod_edge_event_get_event_type(event) == GPIOD_EDGE_EVENT_RISING_EDGE;
	edge->timestamp_ns = gpiod_edge_event_get_timestamp_ns(event);
	return 1;
}

static int get(void *context, void *opaque)
{
	struct line *line = opaque;

	(void)context;
	/* GPIOD_LINE_VALUE_ERROR is -1. */
	return (int)gpiod_line_request_get_value(line->request, line->offset);
}

static int set(void *context, void *opaque, bool active)
{
	struct line *line = opaque;

	(void)context;
	return gpiod_line_request_set_value(line->request, line->offset,
					    active ? GPIOD_LINE_VALUE_ACTIVE
						   : GPIOD_LINE_VALUE_INACTIVE);
}

const struct dio_gpio_system dio_gpio_kernel = {
	.debounces = true,
	.list = dio_gpio_list_chips,
	.open = open_chip,
	.close = close_chip,
	.get_label = get_label,
	.get_line_count = get_line_count,
	.find = find,
	.get_consumer = get_consumer,
	.request = request_line,
	.release = release,
	.get_fd = get_fd,
	.read = read_edge,
	.get = get,
	.set = set,
	.now_ns = dio_gpio_now_ns,
};
