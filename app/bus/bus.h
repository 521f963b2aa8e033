/* D-Bus over sd-bus: connect, publish an object, say what changed, call the other side. */
#ifndef DIO_BUS_BUS_H
#define DIO_BUS_BUS_H

#include <poll.h>
#include <stdbool.h>
#include <stdint.h>
#include <systemd/sd-bus.h>

#include "dio/status.h"

/** Opaque, thread-bound: one connection. */
struct dio_bus;

/** What a daemon offers: its name on the bus is its interface's name too. */
struct dio_bus_object {
	const char *daemon; /* the program behind it, for messages: "diorama-viewd" */
	const char *name;   /* "org.diorama.View1" */
	const char *path;   /* "/org/diorama/View1" */
};

extern const struct dio_bus_object DIO_BUS_CAPTURE; /* org.diorama.Capture1 */
extern const struct dio_bus_object DIO_BUS_VIEW;    /* org.diorama.View1 */

/**
 * Connect to a bus.
 *
 * address   "system", "user", a D-Bus address ("unix:path=/run/x"), or NULL: what the environment
 *           variable DIORAMA_BUS says, else the system's
 * bus       release with dio_bus_close()
 *
 * DIO_NOT_FOUND  no bus answers there
 */
enum dio_status dio_bus_open(const char *address, struct dio_bus **bus, struct dio_error *error);
/** What is under way is sent first. NULL is fine. */
void dio_bus_close(struct dio_bus *bus);

/** The sd-bus connection, owned by the bus: to attach it to an sd-event, or to add matches. */
sd_bus *dio_bus_get_connection(const struct dio_bus *bus);

/** Is it the system's? */
bool dio_bus_is_system(const struct dio_bus *bus);

/**
 * Publish an object and take its name. A daemon publishes one object a connection.
 *
 * vtable    methods and properties of interface object->name; static. Properties that change carry
 *           SD_BUS_VTABLE_PROPERTY_EMITS_CHANGE; methods SD_BUS_VTABLE_UNPRIVILEGED, and ask
 *           dio_bus_authorise() themselves
 * context   handed to their handlers
 *
 * DIO_BUSY     another process has the name
 * DIO_REFUSED  the bus's policy forbids it
 */
enum dio_status dio_bus_publish(struct dio_bus *bus, const struct dio_bus_object *object,
				const sd_bus_vtable *vtable, void *context,
				struct dio_error *error);

/**
 * Note that a property changed; `name` is a constant string. Notes are gathered, each name once,
 * and dio_bus_flush_changes() sends all of them as one signal.
 */
void dio_bus_mark_changed(struct dio_bus *bus, const char *name);
void dio_bus_flush_changes(struct dio_bus *bus);

/**
 * For a poll loop: what to wait for. A loop on sd-event attaches the connection instead.
 *
 * fd         receives descriptor and events
 * timeout_ms receives the longest wait, -1 for none; 0: call dio_bus_process() at once
 */
void dio_bus_prepare(const struct dio_bus *bus, struct pollfd *fd, int *timeout_ms);

/**
 * Handle what came and send what waits, without blocking.
 *
 * DIO_GONE  the bus went away: close, and open again later
 */
enum dio_status dio_bus_process(struct dio_bus *bus, struct dio_error *error);

/**
 * May the sender of a method call do this? Root, the daemon's own user, and everybody on a bus
 * other than the system's may; of others polkit is asked, and the answer calls `handler` again
 * with the same message.
 *
 *	int granted = dio_bus_authorise(bus, message, ACTION, on_capture, context, error);
 *	if (granted <= 0)
 *		return granted < 0 ? granted : 1;
 *
 * action   "org.diorama.view.control"
 *
 * > 0 yes; 0 asked: return 1 to sd-bus and wait; < 0 no, `error` is set
 */
int dio_bus_authorise(struct dio_bus *bus, sd_bus_message *message, const char *action,
		      sd_bus_message_handler_t handler, void *context, sd_bus_error *error);

/**
 * Set a D-Bus error for a failure: org.diorama.Error.NoSpace and so on, with our line as its text.
 * Returns the negative number that a handler returns.
 */
int dio_bus_set_error(sd_bus_error *to, enum dio_status status, const struct dio_error *from);

/**
 * Call a method of a daemon; the arguments follow as in sd_bus_message_append().
 *
 * timeout_ms   longest wait for the answer; 0: sd-bus's 25 s
 * reply        NULL, or receives the answer; release with sd_bus_message_unref()
 *
 * DIO_NOT_FOUND  the daemon is not running; the text says how to start it
 * DIO_REFUSED    not permitted
 * else the status and the line that the daemon gave
 */
enum dio_status dio_bus_call(struct dio_bus *bus, const struct dio_bus_object *object,
			     const char *method, uint32_t timeout_ms, sd_bus_message **reply,
			     struct dio_error *error, const char *types, ...);

/** All properties of a daemon's object: a reply that holds a{sv}. Statuses as dio_bus_call(). */
enum dio_status dio_bus_get_properties(struct dio_bus *bus, const struct dio_bus_object *object,
				       sd_bus_message **reply, struct dio_error *error);

#endif
