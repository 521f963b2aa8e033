#include "bus/bus.h"

#include <errno.h>
#include <stdlib.h>
#include <string.h>

#include "bus/bus_private.h"
#include "dio/clock.h"

#define NS_PER_US 1000u

const struct dio_bus_object DIO_BUS_CAPTURE = {"diorama-captured", "org.diorama.Capture1",
					       "/org/diorama/Capture1"};
const struct dio_bus_object DIO_BUS_VIEW = {"diorama-viewd", "org.diorama.View1",
					    "/org/diorama/View1"};

/* D-Bus error names of our statuses. */
static const char *const ERROR_NAMES[] = {
	[DIO_OK] = NULL,
	[DIO_AGAIN] = "org.diorama.Error.Again",
	[DIO_END] = "org.diorama.Error.End",
	[DIO_NO_SIGNAL] = "org.diorama.Error.NoSignal",
	[DIO_BAD_ARG] = "org.diorama.Error.BadArgument",
	[DIO_BAD_FILE] = "org.diorama.Error.BadFile",
	[DIO_NOT_FOUND] = "org.diorama.Error.NotFound",
	[DIO_BUSY] = "org.diorama.Error.Busy",
	[DIO_GONE] = "org.diorama.Error.Gone",
	[DIO_IO] = "org.diorama.Error.InputOutput",
	[DIO_NO_SPACE] = "org.diorama.Error.NoSpace",
	[DIO_NO_MEM] = "org.diorama.Error.NoMemory",
	[DIO_UNSUPPORTED] = "org.diorama.Error.Unsupported",
	[DIO_REFUSED] = "org.diorama.Error.Refused",
};

enum dio_status dio_bus_status_from_name(const char *name)
{
	for (size_t i = 1; name && i < sizeof ERROR_NAMES / sizeof *ERROR_NAMES; i++)
		if (strcmp(name, ERROR_NAMES[i]) == 0)
			return (enum dio_status)i;
	return DIO_IO;
}

int dio_bus_set_error(sd_bus_error *to, enum dio_status status, const struct dio_error *from)
{
	return sd_bus_error_set(to, ERROR_NAMES[status == DIO_OK ? DIO_IO : status],
				from && *from->text ? from->text : dio_status_text(status));
}

static int connect_address(const char *address, sd_bus **connection)
{
	sd_bus *made;
	int result = sd_bus_new(&made);

	if (result < 0)
		return result;
	result = sd_bus_set_address(made, address);
	if (result >= 0)
		result = sd_bus_set_bus_client(made, 1);
	/* Whoever can reach a private bus or a user's own is trusted, as sd_bus_open_user() does.
	 */
	if (result >= 0)
		result = sd_bus_set_trusted(made, 1);
	if (result >= 0)
		result = sd_bus_start(made);
	if (result < 0) {
		sd_bus_unref(made);
		return result;
	}
	*connection = made;
	return 0;
}

enum dio_status dio_bus_open(const char *address, struct dio_bus **bus, struct dio_error *error)
{
	const char *wanted = address ? address : getenv("DIORAMA_BUS");
	struct dio_bus *made = calloc(1, sizeof *made);
	int result;

	if (!made)
		return dio_fail(error, DIO_NO_MEM, "no memory for a bus connection");
	if (!wanted || !*wanted)
		wanted = "system";
	made->is_system = strcmp(wanted, "system") == 0;
	if (made->is_system)
		result = sd_bus_open_system(&made->connection);
	else if (strcmp(wanted, "user") == 0)
		result = sd_bus_open_user(&made->connection);
	else
		result = connect_address(wanted, &made->connection);
	if (result < 0) {
		free(made);
		return dio_fail(error, DIO_NOT_FOUND,
				"bus %s: cannot connect: %s: is a D-Bus daemon running there?",
				wanted, strerror(-result));
	}
	/* A bus that goes away is an answer of dio_bus_process(), not the end of the process. */
	sd_bus_set_exit_on_disconnect(made->connection, 0);
	*bus = made;
	return DIO_OK;
}

void dio_bus_close(struct dio_bus *bus)
{
	if (!bus)
		return;
	dio_bus_forget_questions(bus);
	sd_bus_flush_close_unref(bus->connection);
	free(bus);
}

sd_bus *dio_bus_get_connection(const struct dio_bus *bus)
{
	return bus->connection;
}

bool dio_bus_is_system(const struct dio_bus *bus)
{
	return bus->is_system;
}

static enum dio_status take_name(struct dio_bus *bus, const char *name, struct dio_error *error)
{
	int result = sd_bus_request_name(bus->connection, name, 0);

	if (result >= 0)
		return DIO_OK;
	if (result == -EEXIST)
		return dio_fail(error, DIO_BUSY,
				"bus: %s is taken: another %s is running; stop it first", name,
				bus->object->daemon);
	if (result == -EACCES || result == -EPERM)
		return dio_fail(error, DIO_REFUSED,
				"bus: %s is not allowed to this user: install the bus policy of "
				"the package, or run on another bus",
				name);
	return dio_fail(error, DIO_IO, "bus: cannot take the name %s: %s", name, strerror(-result));
}

enum dio_status dio_bus_publish(struct dio_bus *bus, const struct dio_bus_object *object,
				const sd_bus_vtable *vtable, void *context, struct dio_error *error)
{
	int result = sd_bus_add_object_vtable(bus->connection, NULL, object->path, object->name,
					      vtable, context);

	if (result < 0)
		return dio_fail(error, DIO_IO, "bus: cannot publish %s: %s", object->path,
				strerror(-result));
	bus->object = object;
	return take_name(bus, object->name, error);
}

void dio_bus_mark_changed(struct dio_bus *bus, const char *name)
{
	for (unsigned i = 0; i < bus->changed_count; i++)
		if (strcmp(bus->changed[i], name) == 0)
			return;
	if (bus->changed_count == DIO_BUS_CHANGES_MAX)
		dio_bus_flush_changes(bus);
	bus->changed[bus->changed_count++] = name;
	bus->changed[bus->changed_count] = NULL;
}

/* sd-bus wants char ** and writes to neither the list nor the names. */
static char **as_strv(const char **names)
{
	union {
		const char **from;
		char **to;
	} list = {names};

	return list.to;
}

void dio_bus_flush_changes(struct dio_bus *bus)
{
	if (bus->changed_count > 0 && bus->object)
		sd_bus_emit_properties_changed_strv(bus->connection, bus->object->path,
						    bus->object->name, as_strv(bus->changed));
	bus->changed_count = 0;
	bus->changed[0] = NULL;
}

void dio_bus_prepare(const struct dio_bus *bus, struct pollfd *fd, int *timeout_ms)
{
	uint64_t deadline_us = UINT64_MAX, now_us;
	int events = sd_bus_get_events(bus->connection);

	fd->fd = sd_bus_get_fd(bus->connection);
	fd->events = (short)(events < 0 ? 0 : events);
	fd->revents = 0;
	*timeout_ms = -1;
	if (events < 0 || sd_bus_get_timeout(bus->connection, &deadline_us) < 0)
		*timeout_ms = 0;
	if (*timeout_ms == 0 || deadline_us == UINT64_MAX)
		return;
	now_us = dio_clock_ns() / NS_PER_US;
	if (deadline_us <= now_us)
		*timeout_ms = 0;
	else if (deadline_us - now_us < 3600000000u)
		*timeout_ms = (int)((deadline_us - now_us + 999) / 1000);
}

enum dio_status dio_bus_process(struct dio_bus *bus, struct dio_error *error)
{
	int result;

	do {
		result = sd_bus_process(bus->connection, NULL);
	} while (result > 0);
	if (result < 0 || sd_bus_is_open(bus->connection) <= 0)
		return dio_fail(error, DIO_GONE, "bus: the connection is gone: %s",
				strerror(result < 0 ? -result : ENOTCONN));
	return DIO_OK;
}
