#include "press.h"

void dio_press_init(struct dio_press_state *state, const struct dio_press_times *times,
		    bool pressed)
{
	*state = (struct dio_press_state){
		.times = *times,
		.phase = pressed ? DIO_PRESS_SPENT : DIO_PRESS_UP,
		.raw = pressed,
		.level = pressed,
	};
}

void dio_press_edge(struct dio_press_state *state, bool pressed, uint64_t time_ns)
{
	if (time_ns < state->raw_ns)
		time_ns = state->raw_ns;
	/* The contact moved when the first edge came, however long it bounced. */
	if (state->raw == state->level && pressed != state->level &&
	    time_ns - state->raw_ns >= state->times.debounce_ns)
		state->first_ns = time_ns;
	state->raw = pressed;
	state->raw_ns = time_ns;
}

/* When what was seen last counts; NEVER when it is what counts already. */
static uint64_t settling_ns(const struct dio_press_state *state)
{
	return state->raw == state->level ? DIO_PRESS_NEVER
					  : state->raw_ns + state->times.debounce_ns;
}

/* When the phase ends without the button moving. */
static uint64_t phase_end_ns(const struct dio_press_state *state)
{
	if (state->phase == DIO_PRESS_DOWN && state->times.long_ns)
		return state->down_ns + state->times.long_ns;
	if (state->phase == DIO_PRESS_SECOND)
		return state->released_ns + state->times.double_ns;
	return DIO_PRESS_NEVER;
}

/* A level that is settling began at first_ns: what was due before it goes first, what is due later
 * must wait for it. */
static bool phase_ends_first(const struct dio_press_state *state)
{
	return state->raw == state->level || phase_end_ns(state) <= state->first_ns;
}

/* The settled level changed at first_ns. True when that makes a press certain. */
static bool settle(struct dio_press_state *state, enum dio_press *press)
{
	state->level = state->raw;
	switch (state->phase) {
	case DIO_PRESS_UP:
		state->phase = DIO_PRESS_DOWN;
		state->down_ns = state->first_ns;
		return false;
	case DIO_PRESS_DOWN:
		state->released_ns = state->first_ns;
		state->phase = state->times.double_ns ? DIO_PRESS_SECOND : DIO_PRESS_UP;
		*press = DIO_PRESS_SHORT;
		return state->phase == DIO_PRESS_UP;
	case DIO_PRESS_SPENT:
		state->phase = DIO_PRESS_UP;
		return false;
	case DIO_PRESS_SECOND:
		state->phase = DIO_PRESS_SPENT;
		*press = DIO_PRESS_DOUBLE;
		return true;
	}
	return false;
}

static void end_phase(struct dio_press_state *state, enum dio_press *press)
{
	*press = state->phase == DIO_PRESS_DOWN ? DIO_PRESS_LONG : DIO_PRESS_SHORT;
	state->phase = state->phase == DIO_PRESS_DOWN ? DIO_PRESS_SPENT : DIO_PRESS_UP;
}

bool dio_press_next(struct dio_press_state *state, uint64_t until_ns, enum dio_press *press,
		    uint64_t *began_ns)
{
	for (;;) {
		const uint64_t began = state->down_ns;

		if (phase_ends_first(state) && phase_end_ns(state) <= until_ns) {
			end_phase(state, press);
			*began_ns = began;
			return true;
		}
		if (settling_ns(state) > until_ns)
			return false;
		if (settle(state, press)) {
			*began_ns = began;
			return true;
		}
	}
}

uint64_t dio_press_deadline(const struct dio_press_state *state)
{
	uint64_t settled = settling_ns(state);
	uint64_t phase = phase_ends_first(state) ? phase_end_ns(state) : DIO_PRESS_NEVER;

	return settled < phase ? settled : phase;
}
