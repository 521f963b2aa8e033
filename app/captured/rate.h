/* Frames a second over the last second or so, by the times the driver gave. */
#ifndef DIO_CAPTURED_RATE_H
#define DIO_CAPTURED_RATE_H

#include <stdint.h>

#define DIO_RATE_FRAMES 32u

/** Caller's memory; zero-initialise. */
struct dio_rate {
	uint64_t times_ns[DIO_RATE_FRAMES];
	uint32_t count; /* frames seen */
};

void dio_rate_reset(struct dio_rate *rate);
void dio_rate_add(struct dio_rate *rate, uint64_t timestamp_ns);

/** 0 before the second frame, or when the times do not advance. */
double dio_rate_get(const struct dio_rate *rate);

#endif
