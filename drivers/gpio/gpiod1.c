/* libgpiod 1.6: the kernel's first GPIO interface, which cannot debounce. */
#include <errno.h>
#include <gpiod.h>
#include <stdio.h>
#include <string.h>

#include "chips.h"
#include "system.h"

#define CONSUMER "diorama"

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
	(void)context;
	snprintf(label, label_size, "%s", gpiod_chip_label(chip));
}

static uint32_t get_line_count(void *context, void *chip)
{
	(void)context;
	return gpiod_chip_num_lines(chip);
}

static int find(void *context, void *chip, const char *name)
{
	struct gpiod_line *line = gpiod_chip_find_line(chip, name);

	(void)context;
	return line ? (int)gpiod_line_offset(line) : -1;
}

static void get_consumer(void *context, void *chip, uint32_t offset, char *name, size_t name_size)
{
	struct gpiod_line *line = gpiod_chip_get_line(chip, offset);
	const char *consumer = line ? gpiod_line_consumer(line) : NULL;

	(void)context;
	snprintf(name, name_size, "%s", consumer ? consumer : "");
}

static int get_flags(const struct dio_gpio_request *request)
{
	int flags = request->active_low ? GPIOD_LINE_REQUEST_FLAG_ACTIVE_LOW : 0;

	switch (request->pull) {
	case DIO_GPIO_PULL_AS_IS:
		break;
	case DIO_GPIO_PULL_NONE:
		flags |= GPIOD_LINE_REQUEST_FLAG_BIAS_DISABLE;
		break;
	case DIO_GPIO_PULL_UP:
		flags |= GPIOD_LINE_REQUEST_FLAG_BIAS_PULL_UP;
		break;
	case DIO_GPIO_PULL_DOWN:
		flags |= GPIOD_LINE_REQUEST_FLAG_BIAS_PULL_DOWN;
		break;
	}
	return flags;
}

static int request_line(void *context, void *chip, const struct dio_gpio_request *request,
			void **line)
{
	const struct gpiod_line_request_config config = {
		.consumer = CONSUMER,
		.request_type = request->output ? GPIOD_LINE_REQUEST_DIRECTION_OUTPUT
						: GPIOD_LINE_REQUEST_EVENT_BOTH_EDGES,
		.flags = get_flags(request),
	};
	struct gpiod_line *found = gpiod_chip_get_line(chip, request->offset);

	(void)context;
	if (!found || gpiod_line_request(found, &config, 0) < 0)
		return -1;
	*line = found;
	return 0;
}

static void release(void *context, void *line)
{
	(void)context;
	gpiod_line_release(line);
}

static int get_fd(void *context, void *line)
{
	(void)context;
	return gpiod_line_event_get_fd(line);
}

static int read_edge(void *context, void *line, struct dio_gpio_edge *edge)
{
	const struct timespec at_once = {0};
	struct gpiod_line_event event;
	int waiting = gpiod_line_event_wait(line, &at_once);

	(void)context;
	if (waiting <= 0)
		return waiting < 0 && errno == EINTR ? 0 : waiting;
	if (gpiod_line_event_read(line, &event) < 0)
		return -1;
	edge->active = event.event_type == GPIOD_LINE_EVENT_RISING_EDGE;
	edge->timestamp_ns = (uint64_t)event.ts.tv_sec * 1000000000u + (uint64_t)event.ts.tv_nsec;
	return 1;
}

static int get(void *context, void *line)
{
	(void)context;
	return gpiod_line_get_value(line);
}

static int set(void *context, void *line, bool active)
{
	(void)context;
	return gpiod_line_set_value(line, active);
}

const struct dio_gpio_system dio_gpio_kernel = {
	.debounces = false,
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
