#include <errno.h>
#include <stdarg.h>
#include <stdbool.h>
#include <string.h>

#include "bus/bus.h"
#include "bus/bus_private.h"

static bool is_one_of(const sd_bus_error *fault, const char *const *names)
{
	for (; *names; names++)
		if (sd_bus_error_has_name(fault, *names))
			return true;
	return false;
}

/* The line a person can act on. */
static enum dio_status explain(const struct dio_bus_object *object, const char *method, int result,
			       const sd_bus_error *fault, struct dio_error *error)
{
	static const char *const ABSENT[] = {SD_BUS_ERROR_SERVICE_UNKNOWN,
					     SD_BUS_ERROR_NAME_HAS_NO_OWNER, NULL};
	static const char *const DENIED[] = {SD_BUS_ERROR_ACCESS_DENIED,
					     SD_BUS_ERROR_INTERACTIVE_AUTHORIZATION_REQUIRED, NULL};
	static const char *const SILENT[] = {SD_BUS_ERROR_NO_REPLY, SD_BUS_ERROR_TIMEOUT, NULL};

	if (is_one_of(fault, ABSENT))
		return dio_fail(error, DIO_NOT_FOUND,
				"%s is not running: start it with systemctl start %s",
				object->daemon, object->daemon);
	if (is_one_of(fault, DENIED))
		return dio_fail(error, DIO_REFUSED,
				"%s: %s: not permitted: be root, or let polkit "
				"allow it",
				object->daemon, method);
	if (is_one_of(fault, SILENT) || result == -ETIMEDOUT)
		return dio_fail(error, DIO_AGAIN, "%s: %s: no answer in time: is it busy or gone?",
				object->daemon, method);
	return dio_fail(error, dio_bus_status_from_name(fault->name), "%s: %s", object->daemon,
			fault->message ? fault->message : strerror(-result));
}

static enum dio_status send_call(struct dio_bus *bus, const struct dio_bus_object *object,
				 sd_bus_message *call, uint32_t timeout_ms, sd_bus_message **reply,
				 struct dio_error *error)
{
	sd_bus_error fault = SD_BUS_ERROR_NULL;
	sd_bus_message *answer = NULL;
	int result =
		sd_bus_call(bus->connection, call, (uint64_t)timeout_ms * 1000, &fault, &answer);
	enum dio_status status = DIO_OK;

	if (result < 0)
		status = explain(object, sd_bus_message_get_member(call), result, &fault, error);
	else if (reply)
		*reply = sd_bus_message_ref(answer);
	sd_bus_message_unref(answer);
	sd_bus_error_free(&fault);
	return status;
}

enum dio_status dio_bus_call(struct dio_bus *bus, const struct dio_bus_object *object,
			     const char *method, uint32_t timeout_ms, sd_bus_message **reply,
			     struct dio_error *error, const char *types, ...)
{
	sd_bus_message *call = NULL;
	enum dio_status status;
	va_list arguments;
	int result = sd_bus_message_new_method_call(bus->connection, &call, object->name,
						    object->path, object->name, method);

	if (result >= 0)
		result = sd_bus_message_set_allow_interactive_authorization(call, 1);
	if (result >= 0 && types && *types) {
		va_start(arguments, types);
		result = sd_bus_message_appendv(call, types, arguments);
		va_end(arguments);
	}
	if (result < 0)
		status = dio_fail(error, DIO_IO, "bus: cannot call %s: %s", method,
				  strerror(-result));
	else
		status = send_call(bus, object, call, timeout_ms, reply, error);
	sd_bus_message_unref(call);
	return status;
}

enum dio_status dio_bus_get_properties(struct dio_bus *bus, const struct dio_bus_object *object,
				       sd_bus_message **reply, struct dio_error *error)
{
	sd_bus_message *call = NULL;
	enum dio_status status;
	int result =
		sd_bus_message_new_method_call(bus->connection, &call, object->name, object->path,
					       "org.freedesktop.DBus.Properties", "GetAll");

	if (result >= 0)
		result = sd_bus_message_append(call, "s", object->name);
	if (result < 0)
		status = dio_fail(error, DIO_IO, "bus: cannot ask %s: %s", object->daemon,
				  strerror(-result));
	else
		status = send_call(bus, object, call, 0, reply, error);
	sd_bus_message_unref(call);
	return status;
}
