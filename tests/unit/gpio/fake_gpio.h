/* GPIO chips with a clock of their own, for the table in system.h. */
#ifndef FAKE_GPIO_H
#define FAKE_GPIO_H

#include "system.h"

#define FAKE_CHIPS 2
#define FAKE_LINES 8
/* As the kernel's queue. */
#define FAKE_EDGES 16

struct fake_line {
	const char *name, *consumer;
	bool held, level; /* physical */
	int request_errno;
	struct dio_gpio_request request;
	struct dio_gpio_edge edges[FAKE_EDGES];
	uint32_t edge_count;
	uint32_t sets; /* how often it was driven */
	int fd;        /* an eventfd while held as input */
	struct fake_gpio *fake;
};

struct fake_chip {
	const char *path, *label;
	int open_errno;
	uint32_t opened;
	struct fake_line lines[FAKE_LINES];
};

struct fake_gpio {
	uint32_t chip_count;
	struct fake_chip chips[FAKE_CHIPS];
	uint64_t now_ns;
	bool gone; /* every access fails with ENODEV */
	struct dio_gpio_system system;
};

/** Two chips, "first" and "second", with lines "A0".. and "B0".. */
void fake_gpio_init(struct fake_gpio *fake);

/** Let time pass until then, in ms. */
void fake_gpio_at(struct fake_gpio *fake, double ms);

/** The world moves an input line, now: an edge when it is another level. */
void fake_gpio_drive(struct fake_gpio *fake, const char *name, bool high);

struct fake_line *fake_gpio_line(struct fake_gpio *fake, const char *name);

/** Chips open and lines held: 0 when all was given back. */
uint32_t fake_gpio_in_use(const struct fake_gpio *fake);

#endif
