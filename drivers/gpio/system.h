/* What the buttons and LEDs need of libgpiod, as a table: one file fills it for 1.6, one for 2.x,
 * and tests put a scripted chip behind it. */
#ifndef DIO_GPIO_SYSTEM_H
#define DIO_GPIO_SYSTEM_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "dio/gpio.h"

/** How a line is wanted. */
struct dio_gpio_request {
	uint32_t offset;
	bool output; /* else an input whose edges are reported, both */
	bool active_low;
	enum dio_gpio_pull pull;
	uint32_t debounce_us;
};

/** Levels are logical: `active` is high, or low where the line is active low. */
struct dio_gpio_edge {
	bool active;
	uint64_t timestamp_ns; /* CLOCK_MONOTONIC */
};

/** Functions that return int give -1 and set errno; `context` is handed through. */
struct dio_gpio_system {
	void *context;
	bool debounces; /* request.debounce_us is honoured; otherwise edges come as they are */
	/** Path of chip number `index` in a steady order; false past the last. */
	bool (*list)(void *context, uint32_t index, char *path, size_t path_size);
	int (*open)(void *context, const char *path, void **chip);
	void (*close)(void *context, void *chip);
	void (*get_label)(void *context, void *chip, char *label, size_t label_size);
	uint32_t (*get_line_count)(void *context, void *chip);
	/** Offset of the line with that name, or -1. */
	int (*find)(void *context, void *chip, const char *name);
	/** Who holds the line; "" when nobody says. */
	void (*get_consumer)(void *context, void *chip, uint32_t offset, char *name,
			     size_t name_size);
	int (*request)(void *context, void *chip, const struct dio_gpio_request *request,
		       void **line);
	void (*release)(void *context, void *line);
	int (*get_fd)(void *context, void *line);
	/** The next edge: 1, none is waiting: 0. Never blocks. */
	int (*read)(void *context, void *line, struct dio_gpio_edge *edge);
	/** 1: active, 0: not. */
	int (*get)(void *context, void *line);
	int (*set)(void *context, void *line, bool active);
	uint64_t (*now_ns)(void *context); /* CLOCK_MONOTONIC */
};

/** The kernel, through the libgpiod of this build. */
extern const struct dio_gpio_system dio_gpio_kernel;

/** A line that is held, and the chip it is on. */
struct dio_gpio_hold {
	void *chip, *line;
};

/**
 * Find a line and take it.
 *
 * owner    "button capture", for messages
 * request  offset is filled in
 */
enum dio_status dio_gpio_hold(const struct dio_gpio_system *system, const char *owner,
			      const struct dio_gpio_line *line, struct dio_gpio_request *request,
			      struct dio_gpio_hold *hold, struct dio_error *error);
/** Accepts one that holds nothing. */
void dio_gpio_let_go(const struct dio_gpio_system *system, struct dio_gpio_hold *hold);

/** As in dio/gpio.h, over a system of the caller's choice, which must outlive the object. */
enum dio_status dio_gpio_line_check_on(const struct dio_gpio_system *system,
				       const struct dio_gpio_line *line, struct dio_error *error);
enum dio_status dio_buttons_open_on(const struct dio_gpio_system *system,
				    const struct dio_buttons_options *options,
				    struct dio_buttons **buttons, struct dio_error *error);
enum dio_status dio_leds_open_on(const struct dio_gpio_system *system,
				 const struct dio_led_options *leds, uint32_t count,
				 struct dio_leds **opened, struct dio_error *error);

#endif
