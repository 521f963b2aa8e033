/* The reading side of scene.json: from text to frames, every fault with its frame. */
#include <cjson/cJSON.h>
#include <math.h>
#include <stdarg.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "core/path.h"
#include "core/scene_file.h"
#include "core/text.h"

/* Where in the file something is being read, for messages. */
struct place {
	const char *path;
	const cJSON *frame; /* NULL outside frames */
	uint32_t index;
	struct dio_error *error;
};

__attribute__((format(printf, 2, 3))) static enum dio_status refuse(const struct place *at,
								    const char *format, ...)
{
	const cJSON *file;
	char fault[256];
	va_list arguments;

	va_start(arguments, format);
	vsnprintf(fault, sizeof fault, format, arguments);
	va_end(arguments);
	if (!at->frame)
		return dio_fail(at->error, DIO_BAD_FILE, "%s: %s", at->path, fault);
	file = cJSON_GetObjectItemCaseSensitive(at->frame, "file");
	return dio_fail(at->error, DIO_BAD_FILE, "%s: frame %u (%.120s): %s", at->path, at->index,
			cJSON_IsString(file) ? file->valuestring : "no file", fault);
}

static enum dio_status read_number(const struct place *at, const cJSON *object, const char *key,
				   double *value)
{
	const cJSON *item = cJSON_GetObjectItemCaseSensitive(object, key);

	if (!item)
		return refuse(at, "camera has no \"%s\"", key);
	if (!cJSON_IsNumber(item))
		return refuse(at, "camera \"%s\" is not a number", key);
	if (!isfinite(item->valuedouble))
		return refuse(at, "camera \"%s\" is not finite", key);
	*value = item->valuedouble;
	return DIO_OK;
}

static enum dio_status read_size(const struct place *at, const cJSON *object, const char *key,
				 uint32_t *value)
{
	double number = 0;
	enum dio_status status = read_number(at, object, key, &number);

	if (status != DIO_OK)
		return status;
	if (number < 1 || number > 16384 || number != floor(number))
		return refuse(at, "camera \"%s\" is %g, not a whole number of 1 to 16384 pixels",
			      key, number);
	*value = (uint32_t)number;
	return DIO_OK;
}

/* Exactly `count` finite numbers; `count` receives how many there were when it is a pointer. */
static enum dio_status read_numbers(const struct place *at, const cJSON *array, const char *key,
				    double *values, int count)
{
	const cJSON *item;
	int i = 0;

	if (!cJSON_IsArray(array) || cJSON_GetArraySize(array) != count)
		return refuse(at, "\"%s\" is not a list of %d numbers", key, count);
	cJSON_ArrayForEach(item, array)
	{
		if (!cJSON_IsNumber(item))
			return refuse(at, "\"%s\"[%d] is not a number", key, i);
		if (!isfinite(item->valuedouble))
			return refuse(at, "\"%s\"[%d] is not finite", key, i);
		values[i++] = item->valuedouble;
	}
	return DIO_OK;
}

static enum dio_status read_camera(const struct place *at, const cJSON *object,
				   struct dio_camera_model *camera)
{
	const struct {
		const char *key;
		double *value;
	} numbers[] = {
		{"fx", &camera->fx}, {"fy", &camera->fy}, {"cx", &camera->cx}, {"cy", &camera->cy}};
	const cJSON *dist = cJSON_GetObjectItemCaseSensitive(object, "dist");
	enum dio_status status;
	int terms;

	*camera = (struct dio_camera_model){0};
	if (!cJSON_IsObject(object))
		return refuse(at, "\"camera\" is not an object");
	if ((status = read_size(at, object, "width", &camera->width)) != DIO_OK ||
	    (status = read_size(at, object, "height", &camera->height)) != DIO_OK)
		return status;
	for (size_t i = 0; i < sizeof numbers / sizeof *numbers; i++) {
		status = read_number(at, object, numbers[i].key, numbers[i].value);
		if (status != DIO_OK)
			return status;
	}
	if (camera->fx <= 0 || camera->fy <= 0)
		return refuse(at, "camera focal length %s is %g; it has to be above zero",
			      camera->fx <= 0 ? "fx" : "fy",
			      camera->fx <= 0 ? camera->fx : camera->fy);
	if (!dist)
		return DIO_OK;
	/* Four terms (k1 k2 p1 p2) and none at all are common; k3 is 0 then. */
	terms = cJSON_GetArraySize(dist);
	return read_numbers(at, dist, "dist", camera->dist, terms == 0 || terms == 4 ? terms : 5);
}

static enum dio_status read_role(const struct place *at, enum dio_scene_role *role)
{
	const cJSON *item = cJSON_GetObjectItemCaseSensitive(at->frame, "role");

	*role = DIO_ROLE_CONTEXT;
	if (!item)
		return DIO_OK;
	if (!cJSON_IsString(item))
		return refuse(at, "\"role\" is not a text");
	if (strcmp(item->valuestring, "target") == 0)
		*role = DIO_ROLE_TARGET;
	else if (strcmp(item->valuestring, "context") != 0)
		return refuse(at, "role \"%.40s\" is neither \"context\" nor \"target\"",
			      item->valuestring);
	return DIO_OK;
}

static enum dio_status read_file_name(const struct place *at, const char **file)
{
	const cJSON *item = cJSON_GetObjectItemCaseSensitive(at->frame, "file");

	*file = NULL;
	if (!item || cJSON_IsNull(item))
		return DIO_OK;
	if (!cJSON_IsString(item) || *item->valuestring == '\0')
		return refuse(at, "\"file\" is not the name of a picture");
	*file = item->valuestring;
	return DIO_OK;
}

/* `common` is the scene's camera, NULL when it has none. */
static enum dio_status read_frame(const struct place *at, const struct dio_camera_model *common,
				  struct dio_scene_file *scene)
{
	const cJSON *own, *matrix;
	struct dio_camera_model camera;
	enum dio_scene_role role;
	struct dio_pose pose;
	enum dio_status status;
	const char *file;

	if (!cJSON_IsObject(at->frame))
		return refuse(at, "is not an object");
	if ((status = read_file_name(at, &file)) != DIO_OK ||
	    (status = read_role(at, &role)) != DIO_OK)
		return status;

	own = cJSON_GetObjectItemCaseSensitive(at->frame, "camera");
	if (own) {
		status = read_camera(at, own, &camera);
		if (status != DIO_OK)
			return status;
	} else if (common) {
		camera = *common;
	} else {
		return refuse(at, "no \"camera\", neither here nor for the scene");
	}

	matrix = cJSON_GetObjectItemCaseSensitive(at->frame, "world_from_camera");
	if (!matrix)
		return refuse(at, "has no \"world_from_camera\"");
	status = read_numbers(at, matrix, "world_from_camera", pose.world_from_camera, 16);
	if (status != DIO_OK)
		return status;
	return dio_scene_file_append(scene, file, role, &camera, &pose, at->error);
}

static enum dio_status read_name(const struct place *at, const cJSON *root,
				 struct dio_scene_file *scene)
{
	const cJSON *item = cJSON_GetObjectItemCaseSensitive(root, "name");

	if (item && !cJSON_IsString(item))
		return refuse(at, "\"name\" is not a text");
	scene->name = strdup(item ? item->valuestring : "scene");
	scene->folder = dio_path_folder(at->path);
	return scene->name && scene->folder
		       ? DIO_OK
		       : dio_fail(at->error, DIO_NO_MEM, "%s: no memory", at->path);
}

static enum dio_status read_root(const struct place *where, const cJSON *root,
				 struct dio_scene_file *scene)
{
	const cJSON *frames = cJSON_GetObjectItemCaseSensitive(root, "frames");
	const cJSON *shared = cJSON_GetObjectItemCaseSensitive(root, "camera");
	struct dio_camera_model common;
	struct place at = *where;
	enum dio_status status;

	if (!cJSON_IsObject(root))
		return refuse(&at, "is not a JSON object");
	if ((status = read_name(&at, root, scene)) != DIO_OK)
		return status;
	if (shared && (status = read_camera(&at, shared, &common)) != DIO_OK)
		return status;
	if (!cJSON_IsArray(frames))
		return refuse(&at, "has no list \"frames\"");
	cJSON_ArrayForEach(at.frame, frames)
	{
		status = read_frame(&at, shared ? &common : NULL, scene);
		if (status != DIO_OK)
			return status;
		at.index++;
	}
	return dio_scene_file_check(scene, at.path, at.error);
}

static enum dio_status refuse_syntax(const char *text, size_t size, const char *stop,
				     const char *path, bool cut, struct dio_error *error)
{
	const char *end = text + size, *line_start = text;
	unsigned line = 1;

	if (!stop || stop > end)
		stop = end;
	for (const char *at = text; at < stop; at++)
		if (*at == '\n') {
			line++;
			line_start = at + 1;
		}
	/* Python writes NaN and Infinity where JSON has no such words. */
	size_t rest = (size_t)(end - stop);
	bool not_finite = (rest >= 3 && memcmp(stop, "NaN", 3) == 0) ||
			  (rest >= 8 && memcmp(stop, "Infinity", 8) == 0) ||
			  (rest >= 9 && memcmp(stop, "-Infinity", 9) == 0);

	return dio_fail(error, DIO_BAD_FILE, "%s: line %u, column %u: %s", path, line,
			(unsigned)(stop - line_start) + 1,
			not_finite ? "a number that is not finite"
			: cut      ? "the JSON text ends too early: is the file whole?"
				   : "not JSON from here on");
}

enum dio_status dio_scene_file_parse(const char *text, size_t size, const char *path,
				     struct dio_scene_file *scene, struct dio_error *error)
{
	const struct place at = {.path = path, .error = error};
	struct dio_scene_file made = {0};
	const char *stop = NULL, *end = text + size;
	cJSON *root = cJSON_ParseWithLengthOpts(text, size, &stop, 0);
	enum dio_status status;

	/* cJSON stops at the last character when the text ends too early. */
	if (!root)
		return refuse_syntax(
			text, size, stop, path,
			!stop || stop == end || (stop + 1 == end && !strchr("]}", *stop)), error);
	while (stop < end && *stop && strchr(" \t\r\n", *stop))
		stop++;
	if (stop < end)
		status = refuse_syntax(text, size, stop, path, false, error);
	else
		status = read_root(&at, root, &made);
	cJSON_Delete(root);
	if (status == DIO_OK)
		*scene = made;
	else
		dio_scene_file_deinit(&made);
	return status;
}

static enum dio_status check_pictures(const struct dio_scene_file *scene, const char *path,
				      struct dio_error *error)
{
	for (uint32_t i = 0; i < scene->frame_count; i++) {
		char *picture = dio_scene_file_picture_path(scene, i);
		bool there = picture && dio_path_is_file(picture);

		free(picture);
		if (scene->frames[i].file && !there)
			return dio_fail(error, DIO_BAD_FILE,
					"%s: frame %u (%s): the picture is missing", path, i,
					scene->frames[i].file);
	}
	return DIO_OK;
}

enum dio_status dio_scene_file_read(const char *path, struct dio_scene_file *scene,
				    struct dio_error *error)
{
	char *inside = dio_path_is_folder(path) ? dio_path_join(path, "scene.json") : strdup(path);
	struct dio_scene_file made = {0};
	enum dio_status status;
	char *text = NULL;
	size_t size = 0;

	if (!inside)
		return dio_fail(error, DIO_NO_MEM, "%s: no memory", path);
	status = dio_text_read(inside, DIO_SCENE_BYTES_MAX, &text, &size, error);
	if (status == DIO_OK)
		status = dio_scene_file_parse(text, size, inside, &made, error);
	free(text);
	if (status == DIO_OK)
		status = check_pictures(&made, inside, error);
	free(inside);
	if (status == DIO_OK)
		*scene = made;
	else
		dio_scene_file_deinit(&made);
	return status;
}
