/* The one clock of frames, events and waits. */
#ifndef DIO_CLOCK_H
#define DIO_CLOCK_H

#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/** Nanoseconds of CLOCK_MONOTONIC. */
uint64_t dio_clock_ns(void);

#ifdef __cplusplus
}
#endif
#endif
