/* A D-Bus daemon of the test's own, on a socket in a temporary folder. */
#ifndef TESTS_SUPPORT_PRIVATE_BUS_H
#define TESTS_SUPPORT_PRIVATE_BUS_H

#include <stdbool.h>
#include <sys/types.h>

struct support_private_bus {
	pid_t daemon;
	char folder[256];
	char address[512];
};

/**
 * Start dbus-daemon and wait until it listens. Everybody may connect, own names and call. The
 * environment variables DIORAMA_BUS and DBUS_SYSTEM_BUS_ADDRESS then hold its address.
 *
 * false: it cannot be started (not installed?); a line says so
 */
bool support_private_bus_start(struct support_private_bus *bus);
void support_private_bus_stop(struct support_private_bus *bus);

#endif
