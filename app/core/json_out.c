#include "core/json_out.h"

#include <math.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "dio/atomic_file.h"

void dio_json_add_number(cJSON *object, const char *key, double value, int digits)
{
	char text[64];

	if (!isfinite(value)) {
		cJSON_AddNullToObject(object, key);
		return;
	}
	snprintf(text, sizeof text, "%.*f", digits, value);
	cJSON_AddNumberToObject(object, key, strtod(text, NULL));
}

void dio_json_add_text(cJSON *object, const char *key, const char *text)
{
	cJSON_AddStringToObject(object, key, text ? text : "");
}

cJSON *dio_json_number(double value)
{
	char text[32];
	int digits = 15;

	if (!isfinite(value))
		return cJSON_CreateNull();
	do {
		snprintf(text, sizeof text, "%.*g", digits, value);
	} while (strtod(text, NULL) != value && ++digits <= 17);
	return cJSON_CreateRaw(text);
}

cJSON *dio_json_numbers(const double *values, uint32_t count)
{
	cJSON *list = cJSON_CreateArray();

	for (uint32_t i = 0; i < count; i++)
		cJSON_AddItemToArray(list, dio_json_number(values[i]));
	return list;
}

cJSON *dio_json_camera(const struct dio_camera_model *camera)
{
	cJSON *object = cJSON_CreateObject();

	cJSON_AddNumberToObject(object, "width", camera->width);
	cJSON_AddNumberToObject(object, "height", camera->height);
	cJSON_AddItemToObject(object, "fx", dio_json_number(camera->fx));
	cJSON_AddItemToObject(object, "fy", dio_json_number(camera->fy));
	cJSON_AddItemToObject(object, "cx", dio_json_number(camera->cx));
	cJSON_AddItemToObject(object, "cy", dio_json_number(camera->cy));
	cJSON_AddItemToObject(object, "dist", dio_json_numbers(camera->dist, 5));
	return object;
}

enum dio_status dio_json_print(cJSON *root, struct dio_error *error)
{
	char *text = root ? cJSON_Print(root) : NULL;
	bool written = text && puts(text) != EOF;

	cJSON_Delete(root);
	if (!text)
		return dio_fail(error, DIO_NO_MEM, "no memory for the JSON text");
	cJSON_free(text);
	return written ? DIO_OK : dio_fail(error, DIO_IO, "standard output: cannot be written");
}

enum dio_status dio_json_write(const cJSON *root, const char *path, struct dio_error *error)
{
	char *text = root ? cJSON_Print(root) : NULL;
	enum dio_status status;
	size_t length;

	if (!text)
		return dio_fail(error, DIO_NO_MEM, "%s: no memory for the JSON text", path);
	/* The terminating zero's place serves as the last line's end. */
	length = strlen(text);
	text[length] = '\n';
	status = dio_atomic_file_write(path, text, length + 1, error);
	cJSON_free(text);
	return status;
}
