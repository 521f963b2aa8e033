#include "fake_gpio.h"

#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/eventfd.h>
#include <unistd.h>

static int fail(int errno_value)
{
	errno = errno_value;
	return -1;
}

static bool fake_list(void *context, uint32_t index, char *path, size_t path_size)
{
	struct fake_gpio *fake = context;

	if (index >= fake->chip_count)
		return false;
	snprintf(path, path_size, "%s", fake->chips[index].path);
	return true;
}

static int fake_open(void *context, const char *path, void **chip)
{
	struct fake_gpio *fake = context;

	for (uint32_t i = 0; i < fake->chip_count; i++) {
		if (strcmp(fake->chips[i].path, path) != 0)
			continue;
		if (fake->chips[i].open_errno)
			return fail(fake->chips[i].open_errno);
		fake->chips[i].opened++;
		*chip = &fake->chips[i];
		return 0;
	}
	return fail(ENOENT);
}

static void fake_close(void *context, void *chip)
{
	(void)context;
	((struct fake_chip *)chip)->opened--;
}

static void fake_get_label(void *context, void *chip, char *label, size_t label_size)
{
	(void)context;
	snprintf(label, label_size, "%s", ((struct fake_chip *)chip)->label);
}

static uint32_t fake_get_line_count(void *context, void *chip)
{
	(void)context;
	(void)chip;
	return FAKE_LINES;
}

static int fake_find(void *context, void *opaque, const char *name)
{
	struct fake_chip *chip = opaque;

	(void)context;
	for (int i = 0; i < FAKE_LINES; i++)
		if (strcmp(chip->lines[i].name, name) == 0)
			return i;
	return -1;
}

static void fake_get_consumer(void *context, void *chip, uint32_t offset, char *name,
			      size_t name_size)
{
	const char *consumer = ((struct fake_chip *)chip)->lines[offset].consumer;

	(void)context;
	snprintf(name, name_size, "%s", consumer ? consumer : "");
}

static int fake_request(void *context, void *chip, const struct dio_gpio_request *request,
			void **taken)
{
	struct fake_line *line = &((struct fake_chip *)chip)->lines[request->offset];

	if (line->held || line->consumer)
		return fail(EBUSY);
	if (line->request_errno)
		return fail(line->request_errno);
	line->held = true;
	line->request = *request;
	line->edge_count = 0;
	line->fake = context;
	line->fd = eventfd(0, EFD_NONBLOCK | EFD_CLOEXEC);
	if (!request->output && request->pull == DIO_GPIO_PULL_UP)
		line->level = true;
	if (request->output)
		line->level = request->active_low;
	*taken = line;
	return 0;
}

static void fake_release(void *context, void *opaque)
{
	struct fake_line *line = opaque;

	(void)context;
	line->held = false;
	close(line->fd);
}

static int fake_get_fd(void *context, void *line)
{
	(void)context;
	return ((struct fake_line *)line)->fd;
}

static int fake_read(void *context, void *opaque, struct dio_gpio_edge *edge)
{
	struct fake_line *line = opaque;
	uint64_t count;

	if (((struct fake_gpio *)context)->gone)
		return fail(ENODEV);
	if (line->edge_count == 0)
		return 0;
	*edge = line->edges[0];
	memmove(line->edges, line->edges + 1, --line->edge_count * sizeof(*edge));
	if (line->edge_count == 0 && read(line->fd, &count, sizeof(count)) < 0)
		return -1;
	return 1;
}

static int fake_get(void *context, void *opaque)
{
	struct fake_line *line = opaque;

	if (((struct fake_gpio *)context)->gone)
		return fail(ENODEV);
	return line->level != line->request.active_low;
}

static int fake_set(void *context, void *opaque, bool active)
{
	struct fake_line *line = opaque;

	if (((struct fake_gpio *)context)->gone)
		return fail(ENODEV);
	line->level = active != line->request.active_low;
	line->sets++;
	return 0;
}

static uint64_t fake_now_ns(void *context)
{
	return ((struct fake_gpio *)context)->now_ns;
}

void fake_gpio_init(struct fake_gpio *fake)
{
	static const char *const names[FAKE_CHIPS][FAKE_LINES] = {
		{"A0", "A1", "A2", "A3", "A4", "A5", "A6", "A7"},
		{"B0", "B1", "B2", "B3", "B4", "B5", "B6", "B7"},
	};

	*fake = (struct fake_gpio){
		.chip_count = FAKE_CHIPS,
		.chips = {{.path = "/dev/gpiochip0", .label = "first"},
			  {.path = "/dev/gpiochip1", .label = "second"}},
		.system = {.list = fake_list,
			   .open = fake_open,
			   .close = fake_close,
			   .get_label = fake_get_label,
			   .get_line_count = fake_get_line_count,
			   .find = fake_find,
			   .get_consumer = fake_get_consumer,
			   .request = fake_request,
			   .release = fake_release,
			   .get_fd = fake_get_fd,
			   .read = fake_read,
			   .get = fake_get,
			   .set = fake_set,
			   .now_ns = fake_now_ns},
	};
	fake->system.context = fake;
	for (int i = 0; i < FAKE_CHIPS; i++)
		for (int k = 0; k < FAKE_LINES; k++)
			fake->chips[i].lines[k].name = names[i][k];
	/* Not from zero: the clock has run long before. */
	fake_gpio_at(fake, 1000);
}

void fake_gpio_at(struct fake_gpio *fake, double ms)
{
	fake->now_ns = (uint64_t)(ms * 1e6);
}

struct fake_line *fake_gpio_line(struct fake_gpio *fake, const char *name)
{
	for (int i = 0; i < FAKE_CHIPS; i++)
		for (int k = 0; k < FAKE_LINES; k++)
			if (strcmp(fake->chips[i].lines[k].name, name) == 0)
				return &fake->chips[i].lines[k];
	abort();
}

void fake_gpio_drive(struct fake_gpio *fake, const char *name, bool high)
{
	struct fake_line *line = fake_gpio_line(fake, name);
	const uint64_t one = 1;

	if (line->level == high)
		return;
	line->level = high;
	if (!line->held || line->request.output || line->edge_count == FAKE_EDGES)
		return;
	line->edges[line->edge_count++] = (struct dio_gpio_edge){
		.active = high != line->request.active_low, .timestamp_ns = fake->now_ns};
	if (write(line->fd, &one, sizeof(one)) < 0)
		abort();
}

uint32_t fake_gpio_in_use(const struct fake_gpio *fake)
{
	uint32_t count = 0;

	for (int i = 0; i < FAKE_CHIPS; i++) {
		count += fake->chips[i].opened;
		for (int k = 0; k < FAKE_LINES; k++)
			count += fake->chips[i].lines[k].held;
	}
	return count;
}
