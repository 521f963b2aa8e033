#include "ctl_watch.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "ctl_values.h"
#include "dio/clock.h"

#define PIECE_MS 100 /* a wait with a deadline looks up so often */

struct watch {
	bool json, waits, met;
	char *property, *value; /* waited for */
	char last[256];         /* what that property is */
};

static const struct dio_bus_object *const OBJECTS[] = {&DIO_BUS_CAPTURE, &DIO_BUS_VIEW};

static void print_change(const struct watch *watch, const char *daemon, const cJSON *item,
			 const char *text)
{
	cJSON *line;
	char *printed;

	if (!watch->json) {
		printf("%s %s %s\n", daemon, item->string, text);
		return;
	}
	line = cJSON_CreateObject();
	cJSON_AddStringToObject(line, "daemon", daemon);
	cJSON_AddItemToObject(line, item->string, cJSON_Duplicate(item, 1));
	printed = cJSON_PrintUnformatted(line);
	puts(printed ? printed : "");
	cJSON_free(printed);
	cJSON_Delete(line);
}

/* News of a daemon: an a{sv} follows in the message. */
static void take_news(struct watch *watch, const char *daemon, sd_bus_message *message)
{
	cJSON *values = cJSON_CreateObject();
	const cJSON *item;

	if (!values || !ctl_read_properties(message, values)) {
		cJSON_Delete(values);
		return;
	}
	cJSON_ArrayForEach(item, values)
	{
		char *text = ctl_value_text(item);

		if (!watch->waits && text) {
			print_change(watch, daemon, item, text);
		} else if (text && strcmp(item->string, watch->property) == 0) {
			snprintf(watch->last, sizeof watch->last, "%s", text);
			watch->met = strcmp(text, watch->value) == 0;
		}
		cJSON_free(text);
		if (watch->met)
			break;
	}
	cJSON_Delete(values);
	fflush(stdout);
}

static int on_changed(sd_bus_message *message, void *context, sd_bus_error *error)
{
	const char *interface;

	(void)error;
	if (sd_bus_message_read_basic(message, 's', &interface) <= 0)
		return 0;
	for (size_t i = 0; i < 2; i++)
		if (strcmp(interface, OBJECTS[i]->name) == 0)
			take_news(context, OBJECTS[i]->daemon, message);
	return 0;
}

/* A daemon came or went. */
static int on_owner(sd_bus_message *message, void *context, sd_bus_error *error)
{
	const struct watch *watch = context;
	const char *name, *before, *after;

	(void)error;
	if (watch->waits || sd_bus_message_read(message, "sss", &name, &before, &after) < 0)
		return 0;
	for (size_t i = 0; i < 2; i++)
		if (strcmp(name, OBJECTS[i]->name) == 0)
			printf("%s %s\n", OBJECTS[i]->daemon, *after ? "is running" : "is gone");
	fflush(stdout);
	return 0;
}

static enum dio_status subscribe(struct watch *watch, struct dio_bus *bus, struct dio_error *error)
{
	sd_bus *connection = dio_bus_get_connection(bus);
	int result = sd_bus_match_signal(connection, NULL, "org.freedesktop.DBus",
					 "/org/freedesktop/DBus", "org.freedesktop.DBus",
					 "NameOwnerChanged", on_owner, watch);

	for (size_t i = 0; result >= 0 && i < 2; i++)
		result = sd_bus_match_signal(connection, NULL, OBJECTS[i]->name, OBJECTS[i]->path,
					     "org.freedesktop.DBus.Properties", "PropertiesChanged",
					     on_changed, watch);
	if (result < 0)
		return dio_fail(error, DIO_IO, "bus: cannot listen: %s", strerror(-result));
	return DIO_OK;
}

/* What is so at the start. None of the daemons running is a failure. */
static enum dio_status take_stock(struct watch *watch, struct dio_bus *bus, struct dio_error *error)
{
	enum dio_status status = DIO_NOT_FOUND;

	for (size_t i = 0; i < 2; i++) {
		sd_bus_message *reply = NULL;

		if (dio_bus_get_properties(bus, OBJECTS[i], &reply, error) != DIO_OK)
			continue;
		status = DIO_OK;
		if (!watch->met)
			take_news(watch, OBJECTS[i]->daemon, reply);
		sd_bus_message_unref(reply);
	}
	return status;
}

static enum dio_status follow(struct watch *watch, struct dio_bus *bus, uint64_t deadline_ns,
			      struct dio_error *error)
{
	enum dio_status status = DIO_OK;

	while (status == DIO_OK && !watch->met) {
		struct pollfd fd;
		int timeout_ms;

		status = dio_bus_process(bus, error);
		if (status != DIO_OK || watch->met)
			break;
		if (watch->waits && dio_clock_ns() >= deadline_ns)
			return dio_fail(error, DIO_AGAIN, "waited for %s=%s in vain: it is %s",
					watch->property, watch->value,
					*watch->last ? watch->last : "not stated");
		dio_bus_prepare(bus, &fd, &timeout_ms);
		if (watch->waits && (timeout_ms < 0 || timeout_ms > PIECE_MS))
			timeout_ms = PIECE_MS;
		poll(&fd, 1, timeout_ms);
	}
	return status;
}

enum dio_status ctl_watch(struct dio_bus *bus, const char *until, double timeout_s, bool json,
			  struct dio_error *error)
{
	struct watch watch = {.json = json, .waits = until != NULL};
	const char *equals = until ? strchr(until, '=') : NULL;
	enum dio_status status;

	if (until && !equals)
		return dio_fail(error, DIO_BAD_ARG, "%s: PROPERTY=VALUE is wanted", until);
	if (until) {
		watch.property = strndup(until, (size_t)(equals - until));
		watch.value = strdup(equals + 1);
	}
	status = until && (!watch.property || !watch.value)
			 ? dio_fail(error, DIO_NO_MEM, "no memory to wait")
			 : subscribe(&watch, bus, error);
	if (status == DIO_OK)
		status = take_stock(&watch, bus, error);
	if (status == DIO_OK)
		status = follow(&watch, bus, dio_clock_ns() + (uint64_t)(timeout_s * 1e9), error);
	free(watch.property);
	free(watch.value);
	return status;
}
