/* Keys of input devices (evdev), which may come and go. */
#ifndef DIO_GPIO_KEYBOARD_H
#define DIO_GPIO_KEYBOARD_H

#include <stdbool.h>
#include <stdint.h>

#include "dio/status.h"

/** Opaque, thread-bound. */
struct dio_keyboard;

/** A key went down or up; CLOCK_MONOTONIC as the kernel stamped it. */
typedef void dio_keyboard_fn(void *context, uint32_t key, bool pressed, uint64_t time_ns);

/**
 * Watch for keys.
 *
 * where  "auto": every device that has one of the keys; or a device's path
 * keys   codes of linux/input-event-codes.h, copied
 *
 * DIO_BAD_ARG  `where` is neither; DIO_IO, DIO_NO_MEM
 */
enum dio_status dio_keyboard_open(const char *where, const uint32_t *keys, uint32_t count,
				  struct dio_keyboard **keyboard, struct dio_error *error);
/** NULL is fine. */
void dio_keyboard_close(struct dio_keyboard *keyboard);

/** Readable when dio_keyboard_drain() has work. */
int dio_keyboard_get_fd(const struct dio_keyboard *keyboard);

/** Report what happened; a key of a device that went away comes up. Never blocks. */
void dio_keyboard_drain(struct dio_keyboard *keyboard, dio_keyboard_fn *report, void *context);

#endif
