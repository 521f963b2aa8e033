/* A window (SDL2) that shows pictures and reports what hand and keys do. */
#ifndef DIO_WINDOW_H
#define DIO_WINDOW_H

#include <stdbool.h>
#include <stdint.h>

#include "dio/frame.h"
#include "dio/status.h"

#ifdef __cplusplus
extern "C" {
#endif

struct dio_window;

#define DIO_WINDOW_KEYS_MAX 16

/** A key that went down or up; code of linux/input-event-codes.h. */
struct dio_window_key {
	uint32_t key;
	bool pressed;
};

/** One step of input since the last call. */
struct dio_window_input {
	bool quit;            /* closed, Escape or q */
	bool reset;           /* r */
	bool save;            /* s */
	float drag_x, drag_y; /* left drag, share of the window's width / height */
	float pan_x, pan_y;   /* right drag */
	float wheel;          /* notches, + towards the viewer */
	float key_x, key_y;   /* arrow keys, held or touched: -1, 0, 1; right and up are + */
	float key_zoom;       /* + and - keys */
	uint32_t key_count;   /* keys that moved, in order; more than fit are dropped */
	struct dio_window_key keys[DIO_WINDOW_KEYS_MAX];
};

/** DIO_UNSUPPORTED: no display is present, or the build has no SDL2. */
enum dio_status dio_window_open(const char *title, uint32_t width, uint32_t height,
				struct dio_window **window, struct dio_error *error);
enum dio_status dio_window_show(struct dio_window *window, const struct dio_picture *picture,
				struct dio_error *error);
/** Wait up to timeout_ms for input, gather all of it. */
void dio_window_poll(struct dio_window *window, uint32_t timeout_ms,
		     struct dio_window_input *input);
void dio_window_close(struct dio_window *window);

#ifdef __cplusplus
}
#endif
#endif
