/* Buttons and LEDs on GPIO lines (libgpiod 1.6 or 2), and keys that stand for buttons. */
#ifndef DIO_GPIO_H
#define DIO_GPIO_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "dio/status.h"

#ifdef __cplusplus
extern "C" {
#endif

#define DIO_BUTTONS_MAX   16
#define DIO_LEDS_MAX      16
#define DIO_GPIO_NAME_MAX 64

/** A line: by its name on whichever chip has it, or by chip and offset. */
struct dio_gpio_line {
	char chip[DIO_GPIO_NAME_MAX]; /* "gpiochip0", "/dev/gpiochip0" or the chip's label;
				       * "": look for `name` */
	char name[DIO_GPIO_NAME_MAX]; /* "GPIO17"; "" with a chip */
	uint32_t offset;              /* with a chip */
};

/**
 * Read "GPIO17" (a name) or "gpiochip0:17", "pinctrl-rp1:17" (a chip and an offset).
 *
 * DIO_BAD_ARG  empty, or too long
 */
enum dio_status dio_gpio_line_parse(const char *text, struct dio_gpio_line *line,
				    struct dio_error *error);

/**
 * Is the line there? Nothing is requested or changed.
 *
 * DIO_NOT_FOUND  no such chip, name or offset; DIO_IO  a chip may not be opened
 */
enum dio_status dio_gpio_line_check(const struct dio_gpio_line *line, struct dio_error *error);

enum dio_gpio_pull {
	DIO_GPIO_PULL_AS_IS, /* as firmware or device tree left it */
	DIO_GPIO_PULL_NONE,
	DIO_GPIO_PULL_UP,
	DIO_GPIO_PULL_DOWN,
};

/**
 * One button. A press is short, long or double; which of them can be decides how soon one is
 * known: without `double_ms` a short press is reported at its release, with it only when the time
 * for a second press is over.
 */
struct dio_button_options {
	char name[32];             /* for messages */
	struct dio_gpio_line line; /* chip and name "": no line, a key alone */
	enum dio_gpio_pull pull;
	bool active_low;
	uint32_t debounce_us; /* 0: none */
	uint32_t key;         /* code of linux/input-event-codes.h that does the same; 0: none */
	uint32_t long_ms;     /* held so long is a long press, told while held; 0: never */
	uint32_t double_ms;   /* two presses, less than this between them; 0: never */
};

struct dio_buttons_options {
	const struct dio_button_options *buttons; /* copied */
	uint32_t count;                           /* at most DIO_BUTTONS_MAX */
	/* "": no keyboard; "auto": every input device that has one of the keys; or a path under
	 * /dev/input. Keys come alive and go with their device; a keyboard that is missing is no
	 * error. */
	const char *keyboard;
};

enum dio_press {
	DIO_PRESS_SHORT,
	DIO_PRESS_LONG,
	DIO_PRESS_DOUBLE,
};

struct dio_button_event {
	uint32_t button; /* index into the options */
	enum dio_press press;
	uint64_t timestamp_ns; /* CLOCK_MONOTONIC of the edge that began the (first) press, as the
				* kernel stamped it */
};

/** Opaque, thread-bound. */
struct dio_buttons;

/**
 * Take the lines as inputs. No buttons at all, or buttons without lines, is fine.
 *
 * DIO_NOT_FOUND, DIO_BUSY (the text says who holds the line), DIO_BAD_ARG, DIO_UNSUPPORTED (the
 * line reports no edges)
 */
enum dio_status dio_buttons_open(const struct dio_buttons_options *options,
				 struct dio_buttons **buttons, struct dio_error *error);
/** NULL is fine. */
void dio_buttons_close(struct dio_buttons *buttons);

/** Readable (POLLIN) when dio_buttons_read() has work; stays the same for the object's life. */
int dio_buttons_get_fd(const struct dio_buttons *buttons);

/**
 * Take the next press. Never blocks; call until DIO_AGAIN.
 *
 * DIO_AGAIN  none yet; DIO_GONE  a GPIO chip went away: close, and open again when it is back
 */
enum dio_status dio_buttons_read(struct dio_buttons *buttons, struct dio_button_event *event,
				 struct dio_error *error);

/** A key event from elsewhere (a window): goes through the same recognition. Unknown keys are
 * ignored. */
void dio_buttons_feed_key(struct dio_buttons *buttons, uint32_t key, bool pressed,
			  uint64_t timestamp_ns);

/** Code of "space", "KEY_SPACE", "f1"; 0 when there is no such key. */
uint32_t dio_key_from_name(const char *name);

/** What the appliance is doing, for the LEDs. */
enum dio_led_state {
	DIO_LED_STATE_IDLE,
	DIO_LED_STATE_CALIBRATE,
	DIO_LED_STATE_CAPTURE,
	DIO_LED_STATE_RECONSTRUCT,
	DIO_LED_STATE_VIEW,
	DIO_LED_STATE_ERROR,
	DIO_LED_STATE_COUNT,
};

/** "idle", "calibrate" and so on. */
const char *dio_led_state_name(enum dio_led_state state);

enum dio_led_pattern {
	DIO_LED_OFF,
	DIO_LED_ON,
	DIO_LED_SLOW,  /* half a second on, half a second off */
	DIO_LED_FAST,  /* four times a second */
	DIO_LED_FLASH, /* a short flash every second */
	DIO_LED_TWICE, /* two short flashes every second */
	DIO_LED_PATTERN_COUNT,
};

/** "off", "on", "slow", "fast", "flash", "twice". */
const char *dio_led_pattern_name(enum dio_led_pattern pattern);

struct dio_led_options {
	char name[32];
	struct dio_gpio_line line;
	bool active_low;
	enum dio_led_pattern patterns[DIO_LED_STATE_COUNT];
};

/** Opaque, thread-bound. */
struct dio_leds;

/** Take the lines as outputs, all off. Statuses as dio_buttons_open(). Options are copied. */
enum dio_status dio_leds_open(const struct dio_led_options *leds, uint32_t count,
			      struct dio_leds **opened, struct dio_error *error);
/** Switches them off and releases the lines. NULL is fine. */
void dio_leds_close(struct dio_leds *leds);

/** Show a state. The same state again changes nothing. */
enum dio_status dio_leds_set_state(struct dio_leds *leds, enum dio_led_state state,
				   struct dio_error *error);

/** Readable (POLLIN) when a pattern's next step is due: then call dio_leds_update(). */
int dio_leds_get_fd(const struct dio_leds *leds);
/** DIO_GONE  the chip went away. */
enum dio_status dio_leds_update(struct dio_leds *leds, struct dio_error *error);

#ifdef __cplusplus
}
#endif
#endif
