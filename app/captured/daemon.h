/* The capture daemon as a whole: its parts, and the loop that serves readers, bus and watchdog. */
#ifndef DIO_CAPTURED_DAEMON_H
#define DIO_CAPTURED_DAEMON_H

#include "captured/settings.h"

/**
 * Run until SIGTERM or SIGINT, which the caller has not blocked. A camera that is missing or
 * broken is no reason to end, nor is a missing bus; a socket that another daemon has is.
 *
 * DIO_OK  ended by a signal, everything closed in good order
 */
enum dio_status dio_captured_run(const struct dio_captured_settings *settings,
				 struct dio_error *error);

#endif
