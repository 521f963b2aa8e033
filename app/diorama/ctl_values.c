#include "ctl_values.h"

#include <math.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* Arrays within arrays deeper than this are nothing that we send. */
#define DEPTH_MAX 4

static cJSON *read_value(sd_bus_message *message, int depth);

static cJSON *read_number(sd_bus_message *message, char type)
{
	union {
		uint8_t y;
		int16_t n;
		uint16_t q;
		int32_t i;
		uint32_t u;
		int64_t x;
		uint64_t t;
		double d;
	} value;

	if (sd_bus_message_read_basic(message, type, &value) <= 0)
		return NULL;
	switch (type) {
	case 'y':
		return cJSON_CreateNumber(value.y);
	case 'n':
		return cJSON_CreateNumber(value.n);
	case 'q':
		return cJSON_CreateNumber(value.q);
	case 'i':
		return cJSON_CreateNumber(value.i);
	case 'u':
		return cJSON_CreateNumber(value.u);
	case 'x':
		return cJSON_CreateNumber((double)value.x);
	case 't':
		return cJSON_CreateNumber((double)value.t);
	default:
		return cJSON_CreateNumber(value.d);
	}
}

static cJSON *read_basic(sd_bus_message *message, char type)
{
	const char *text;
	int flag;

	if (type == 'b')
		return sd_bus_message_read_basic(message, type, &flag) > 0 ? cJSON_CreateBool(flag)
									   : NULL;
	if (!strchr("sog", type))
		return read_number(message, type);
	return sd_bus_message_read_basic(message, type, &text) > 0 ? cJSON_CreateString(text)
								   : NULL;
}

/* a{s?} as an object, other arrays and structs as a list. */
static cJSON *read_container(sd_bus_message *message, char type, const char *contents, int depth)
{
	bool is_map = type == 'a' && strncmp(contents, "{s", 2) == 0;
	cJSON *made = is_map ? cJSON_CreateObject() : cJSON_CreateArray();
	bool good = made && sd_bus_message_enter_container(message, type, contents) > 0;
	const char *key;

	while (good && sd_bus_message_at_end(message, 0) == 0) {
		cJSON *item;

		if (!is_map) {
			item = read_value(message, depth + 1);
			good = item && cJSON_AddItemToArray(made, item);
			continue;
		}
		good = sd_bus_message_enter_container(message, 'e', NULL) > 0 &&
		       sd_bus_message_read_basic(message, 's', &key) > 0 &&
		       (item = read_value(message, depth + 1)) != NULL &&
		       cJSON_AddItemToObject(made, key, item) &&
		       sd_bus_message_exit_container(message) > 0;
	}
	if (good && sd_bus_message_exit_container(message) > 0)
		return made;
	cJSON_Delete(made);
	return NULL;
}

static cJSON *read_value(sd_bus_message *message, int depth)
{
	const char *contents;
	cJSON *value = NULL;
	char type;

	if (depth > DEPTH_MAX || sd_bus_message_peek_type(message, &type, &contents) <= 0)
		return NULL;
	if (type == 'v') {
		if (sd_bus_message_enter_container(message, 'v', contents) <= 0)
			return NULL;
		value = read_value(message, depth);
		sd_bus_message_exit_container(message);
		return value;
	}
	if (type == 'a' || type == 'r')
		return read_container(message, type, contents, depth);
	return read_basic(message, type);
}

bool ctl_read_properties(sd_bus_message *message, cJSON *object)
{
	cJSON *read = read_value(message, 0);

	if (!cJSON_IsObject(read)) {
		cJSON_Delete(read);
		return false;
	}
	while (read->child) {
		cJSON *item = cJSON_DetachItemViaPointer(read, read->child);

		cJSON_DeleteItemFromObjectCaseSensitive(object, item->string);
		if (!cJSON_AddItemToObject(object, item->string, item)) {
			cJSON_Delete(item);
			break;
		}
	}
	cJSON_Delete(read);
	return true;
}

cJSON *ctl_read_arguments(sd_bus_message *message)
{
	cJSON *list = cJSON_CreateArray();

	while (list && sd_bus_message_at_end(message, 1) == 0) {
		cJSON *item = read_value(message, 0);

		if (item && cJSON_AddItemToArray(list, item))
			continue;
		cJSON_Delete(list);
		return NULL;
	}
	return list;
}

char *ctl_value_text(const cJSON *value)
{
	char *text;

	char number[32];
	const char *from = number;

	if (cJSON_IsNumber(value))
		snprintf(number, sizeof number, "%.10g", round(value->valuedouble * 1e4) / 1e4);
	else if (cJSON_IsString(value))
		from = value->valuestring;
	else
		return cJSON_PrintUnformatted(value);
	text = cJSON_malloc(strlen(from) + 1);
	if (text)
		memcpy(text, from, strlen(from) + 1);
	return text;
}
