/* From a button's edges to presses: debounce, short, long and double, on timestamps alone. */
#ifndef DIO_GPIO_PRESS_H
#define DIO_GPIO_PRESS_H

#include <stdbool.h>
#include <stdint.h>

#include "dio/gpio.h"

#define DIO_PRESS_NEVER UINT64_MAX

struct dio_press_times {
	uint64_t debounce_ns; /* a level counts when nothing changed for so long; 0: at once */
	uint64_t long_ns;     /* 0: no long press */
	uint64_t double_ns;   /* from the first release to the second press; 0: no double press */
};

enum dio_press_phase {
	DIO_PRESS_UP,     /* nothing going on */
	DIO_PRESS_DOWN,   /* held, may become long */
	DIO_PRESS_SPENT,  /* held, told already: waits for the release */
	DIO_PRESS_SECOND, /* released, may become double */
};

/** The state of one button. Its owner's memory; thread-bound. */
struct dio_press_state {
	struct dio_press_times times;
	enum dio_press_phase phase;
	bool raw, level;      /* as last seen; as settled */
	uint64_t raw_ns;      /* of the last edge */
	uint64_t first_ns;    /* of the first edge of a burst */
	uint64_t down_ns;     /* when the (first) press began */
	uint64_t released_ns; /* when it ended */
};

/**
 * pressed  the level now: a button held from before is no press, it counts from its next one
 */
void dio_press_init(struct dio_press_state *state, const struct dio_press_times *times,
		    bool pressed);

/**
 * An edge. Everything before it must have been taken: call dio_press_next() until it says false
 * with `until_ns` = time_ns first. A time before the last edge's counts as that edge's.
 */
void dio_press_edge(struct dio_press_state *state, bool pressed, uint64_t time_ns);

/**
 * The next press that is certain at `until_ns`.
 *
 * press, began_ns  receive what it was and when the (first) press began
 */
bool dio_press_next(struct dio_press_state *state, uint64_t until_ns, enum dio_press *press,
		    uint64_t *began_ns);

/** When to call dio_press_next() again without an edge; DIO_PRESS_NEVER. */
uint64_t dio_press_deadline(const struct dio_press_state *state);

#endif
