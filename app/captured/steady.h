/* Whether a picture has come to rest: the camera's automatic exposure and white balance are done.
 */
#ifndef DIO_CAPTURED_STEADY_H
#define DIO_CAPTURED_STEADY_H

#include <stdbool.h>
#include <stdint.h>

#include "dio/frame.h"

/** Samples looked back on, and the least time between two of them. */
#define DIO_STEADY_SAMPLES   8u
#define DIO_STEADY_PERIOD_NS 50000000ull

/** Caller's memory; zero-initialise, release with dio_steady_deinit(). Thread-bound. */
struct dio_steady {
	struct dio_picture picture; /* reused */
	struct {
		double level, red, blue;
	} samples[DIO_STEADY_SAMPLES];
	uint32_t count; /* samples taken */
	uint64_t last_ns;
};

void dio_steady_reset(struct dio_steady *steady);
void dio_steady_deinit(struct dio_steady *steady);

/**
 * Look at a frame, unless one was looked at less than a period ago.
 *
 * true: over the last samples neither brightness nor colour has drifted; hand shake, which sways
 * about the same value, is told from drift by comparing the halves
 */
bool dio_steady_look(struct dio_steady *steady, const struct dio_frame *frame);

#endif
