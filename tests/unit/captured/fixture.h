/* What the capture daemon's tests share: a bus of their own, the daemon as a process, a reader. */
#ifndef TESTS_CAPTURED_FIXTURE_H
#define TESTS_CAPTURED_FIXTURE_H

#include <setjmp.h>
#include <stdarg.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <sys/types.h>

#include <cmocka.h>

#include "bus/bus.h"
#include "ring/ring_client.h"
#include "scripted_camera.h"

#define SECOND_NS 1000000000ll

struct daemon {
	char folder[64]; /* of its own: socket, bus, recordings */
	struct script *script;
	pid_t bus_daemon, pid; /* 0: not running */
	struct dio_bus *bus;   /* NULL: none */
	struct dio_ring_client *reader;
	struct dio_ring_frame frame;
	struct dio_error error;
	int notify; /* the socket that it tells systemd's things, or -1 */
};

/** cmocka set-up and tear-down of one test: *state is a struct daemon with a bus, nothing started.
 * Where dbus-daemon is not installed `bus` stays NULL. */
int daemon_setup(void **state);
int daemon_teardown(void **state);

/** Start build/bin/captured_scripted with further arguments; NULL ends them. */
void daemon_start(struct daemon *daemon, ...);

/** Send a signal and wait for the end; returns the wait status. */
int daemon_end(struct daemon *daemon, int signal_number);

/** FOLDER/NAME, good until eight more were asked for. */
const char *daemon_path(const struct daemon *daemon, const char *name);

void script_set(struct daemon *daemon, enum script_mode mode);

/** Connect the reader. */
void daemon_read(struct daemon *daemon, enum dio_ring_order order);
/** Read until the state is reached; fails the test after `limit_ns`. Returns how long it took. */
int64_t daemon_await_state(struct daemon *daemon, enum dio_capture_state state, int64_t limit_ns);
/** The next frame; fails the test after five seconds. */
void daemon_await_frame(struct daemon *daemon);

/** Skip the test, and say so, where there is no bus. Waits until the daemon is on it. */
void daemon_need_bus(struct daemon *daemon);
/** A text property; release with free(). */
char *daemon_get_text(struct daemon *daemon, const char *property);
uint64_t daemon_get_number(struct daemon *daemon, const char *property);
/** Ask until the text property has the value; fails the test after five seconds. */
void daemon_await_text(struct daemon *daemon, const char *property, const char *value);
/** Ask until the number is `least` or more; likewise. */
void daemon_await_number(struct daemon *daemon, const char *property, uint64_t least);

/** Be systemd for the daemons started from now on. Who asks for this reads: a socket that is full
 * stops the daemon, as it would with systemd. */
void daemon_open_notify(struct daemon *daemon);
/** The next line that the daemon tells systemd ("READY=1"); false: none in time. */
bool daemon_next_notice(struct daemon *daemon, char *text, size_t size, int timeout_ms);

/** Entries of /proc/PID/NAME: "fd", "task". */
unsigned daemon_count(const struct daemon *daemon, const char *name);

/** Count until there are so many; fails the test after five seconds. */
void daemon_await_count(const struct daemon *daemon, const char *name, unsigned count);

int64_t monotonic_ns(void);

#endif
