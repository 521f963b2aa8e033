/* Following the daemons' properties. */
#ifndef DIO_DIORAMA_CTL_WATCH_H
#define DIO_DIORAMA_CTL_WATCH_H

#include "bus/bus.h"

/**
 * Print every change of a property of either daemon as a line "DAEMON PROPERTY VALUE" (or as one
 * JSON object a line) until the process is interrupted.
 *
 * until   NULL, or "PROPERTY=VALUE": print nothing and return once a daemon says so
 *
 * DIO_AGAIN    the time is over; the text says what the value is instead
 * DIO_BAD_ARG  `until` has no '='
 */
enum dio_status ctl_watch(struct dio_bus *bus, const char *until, double timeout_s, bool json,
			  struct dio_error *error);

#endif
