#include "recording_index.h"

#include <cJSON.h>
#include <errno.h>
#include <inttypes.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "dio/atomic_file.h"
#include "dio/file.h"

#define FORMAT_NAME     "diorama-recording"
#define FORMAT_VERSION  1
#define INDEX_BYTES_MAX ((size_t)256 << 20)

void dio_recording_index_deinit(struct dio_recording_index *index)
{
	free(index->entries);
	*index = (struct dio_recording_index){0};
}

enum dio_status dio_recording_index_append(struct dio_recording_index *index,
					   const struct dio_recording_entry *entry,
					   struct dio_error *error)
{
	if (index->count == index->capacity) {
		size_t capacity = index->capacity ? index->capacity * 2 : 256;
		struct dio_recording_entry *grown =
			reallocarray(index->entries, capacity, sizeof(*grown));

		if (!grown)
			return dio_fail(error, DIO_NO_MEM, "recording: no memory for %zu frames",
					capacity);
		index->entries = grown;
		index->capacity = capacity;
	}
	index->entries[index->count++] = *entry;
	return DIO_OK;
}

/* 64-bit numbers go as decimal text: a JSON number is a double and ends at 2^53. */
static bool add_u64(cJSON *object, const char *key, uint64_t value)
{
	char text[24];

	snprintf(text, sizeof(text), "%" PRIu64, value);
	return cJSON_AddStringToObject(object, key, text) != NULL;
}

static bool get_u64(const cJSON *object, const char *key, int base, uint64_t *value)
{
	const char *text = cJSON_GetStringValue(cJSON_GetObjectItemCaseSensitive(object, key));
	char *end;

	if (!text || text[0] == '-' || text[0] == ' ' || text[0] == '\0')
		return false;
	errno = 0;
	*value = strtoull(text, &end, base);
	return *end == '\0' && errno == 0;
}

/* How the camera took a frame: numbers, left out where it did not say. */
static const struct {
	const char *key;
	size_t offset;
	bool is_real;
} METADATA[] = {
	{"exposure_us", offsetof(struct dio_frame_metadata, exposure_us), false},
	{"gain", offsetof(struct dio_frame_metadata, gain), true},
	{"white_balance_k", offsetof(struct dio_frame_metadata, white_balance_k), false},
	{"red_gain", offsetof(struct dio_frame_metadata, red_gain), true},
	{"blue_gain", offsetof(struct dio_frame_metadata, blue_gain), true},
	{"locked", offsetof(struct dio_frame_metadata, locked), false},
};
#define METADATA_COUNT (sizeof(METADATA) / sizeof(METADATA[0]))

static bool add_metadata(cJSON *object, const struct dio_frame_metadata *metadata)
{
	for (size_t i = 0; i < METADATA_COUNT; i++) {
		const char *at = (const char *)metadata + METADATA[i].offset;
		uint32_t whole;
		float real;
		double value;

		memcpy(&whole, at, sizeof(whole));
		memcpy(&real, at, sizeof(real));
		value = METADATA[i].is_real ? (double)real : (double)whole;
		if (value != 0 && isfinite(value) &&
		    !cJSON_AddNumberToObject(object, METADATA[i].key, value))
			return false;
	}
	return true;
}

/* What cannot be a value of that kind is taken as not said: a frame is not lost for it. */
static void get_metadata(const cJSON *object, struct dio_frame_metadata *metadata)
{
	for (size_t i = 0; i < METADATA_COUNT; i++) {
		const cJSON *item = cJSON_GetObjectItemCaseSensitive(object, METADATA[i].key);
		char *at = (char *)metadata + METADATA[i].offset;
		uint32_t whole;
		float real;

		if (!cJSON_IsNumber(item) || !(item->valuedouble >= 0) ||
		    item->valuedouble > (double)UINT32_MAX)
			continue;
		whole = (uint32_t)item->valuedouble;
		real = (float)item->valuedouble;
		memcpy(at, METADATA[i].is_real ? (const void *)&real : (const void *)&whole, 4);
	}
}

static cJSON *entry_to_json(const struct dio_recording_entry *entry)
{
	cJSON *object = cJSON_CreateObject();
	char crc[16];

	snprintf(crc, sizeof(crc), "%08" PRIx32, entry->crc32);
	if (object && cJSON_AddStringToObject(object, "file", entry->file) &&
	    add_u64(object, "timestamp_ns", entry->timestamp_ns) &&
	    add_u64(object, "sequence", entry->sequence) &&
	    add_u64(object, "size_bytes", entry->size_bytes) &&
	    cJSON_AddStringToObject(object, "crc32", crc) && add_metadata(object, &entry->metadata))
		return object;
	cJSON_Delete(object);
	return NULL;
}

/* A name within the recording's frames, whoever wrote the index: no way out of the folder. */
static bool is_frame_name(const char *name)
{
	static const char letters[] =
		"abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789._-";
	const char *rest = name + strlen("frames/");

	return strncmp(name, "frames/", strlen("frames/")) == 0 && rest[0] != '\0' &&
	       rest[0] != '.' && rest[strspn(rest, letters)] == '\0';
}

static bool entry_from_json(const cJSON *object, struct dio_recording_entry *entry)
{
	const char *file = cJSON_GetStringValue(cJSON_GetObjectItemCaseSensitive(object, "file"));
	uint64_t crc;

	memset(entry, 0, sizeof(*entry));
	if (!file || strlen(file) >= sizeof(entry->file) || !is_frame_name(file) ||
	    !get_u64(object, "timestamp_ns", 10, &entry->timestamp_ns) ||
	    !get_u64(object, "sequence", 10, &entry->sequence) ||
	    !get_u64(object, "size_bytes", 10, &entry->size_bytes) ||
	    !get_u64(object, "crc32", 16, &crc) || crc > UINT32_MAX)
		return false;
	memcpy(entry->file, file, strlen(file));
	entry->crc32 = (uint32_t)crc;
	get_metadata(object, &entry->metadata);
	return true;
}

static cJSON *camera_to_json(const struct dio_camera_info *camera)
{
	cJSON *object = cJSON_CreateObject();

	if (object && cJSON_AddStringToObject(object, "name", camera->name) &&
	    cJSON_AddStringToObject(object, "pixel_format",
				    dio_pixel_format_name(camera->format)) &&
	    cJSON_AddNumberToObject(object, "width", camera->width) &&
	    cJSON_AddNumberToObject(object, "height", camera->height) &&
	    cJSON_AddNumberToObject(object, "frames_per_second", camera->frames_per_second))
		return object;
	cJSON_Delete(object);
	return NULL;
}

static bool get_number(const cJSON *object, const char *key, double max, double *value)
{
	const cJSON *item = cJSON_GetObjectItemCaseSensitive(object, key);

	if (!cJSON_IsNumber(item) || !(item->valuedouble >= 0 && item->valuedouble <= max))
		return false;
	*value = item->valuedouble;
	return true;
}

static bool camera_from_json(const cJSON *object, struct dio_camera_info *camera)
{
	const char *name = cJSON_GetStringValue(cJSON_GetObjectItemCaseSensitive(object, "name"));
	const char *format =
		cJSON_GetStringValue(cJSON_GetObjectItemCaseSensitive(object, "pixel_format"));
	double width, height, rate;

	if (!name || !format || !get_number(object, "width", 16384, &width) ||
	    !get_number(object, "height", 16384, &height) ||
	    !get_number(object, "frames_per_second", 1e6, &rate))
		return false;
	snprintf(camera->name, sizeof(camera->name), "%s", name);
	camera->width = (uint32_t)width;
	camera->height = (uint32_t)height;
	camera->frames_per_second = rate;
	for (int f = DIO_PIXEL_RGB24; f <= DIO_PIXEL_MJPEG; f++) {
		camera->format = (enum dio_pixel_format)f;
		if (strcmp(format, dio_pixel_format_name(camera->format)) == 0)
			return true;
	}
	return false;
}

char *dio_recording_entry_line(const struct dio_recording_entry *entry)
{
	cJSON *object = entry_to_json(entry);
	char *text = object ? cJSON_PrintUnformatted(object) : NULL;
	char *line = NULL;

	if (text && asprintf(&line, "%s\n", text) < 0)
		line = NULL;
	cJSON_free(text);
	cJSON_Delete(object);
	return line;
}

static cJSON *index_to_json(const struct dio_recording_index *index)
{
	cJSON *root = cJSON_CreateObject();
	cJSON *frames;

	if (!root || !cJSON_AddStringToObject(root, "format", FORMAT_NAME) ||
	    !cJSON_AddNumberToObject(root, "version", FORMAT_VERSION) ||
	    !cJSON_AddItemToObject(root, "camera", camera_to_json(&index->camera)))
		goto fail;
	frames = cJSON_AddArrayToObject(root, "frames");
	for (size_t i = 0; frames && i < index->count; i++) {
		if (!cJSON_AddItemToArray(frames, entry_to_json(&index->entries[i])))
			goto fail;
	}
	if (frames)
		return root;
fail:
	cJSON_Delete(root);
	return NULL;
}

enum dio_status dio_recording_index_write(const char *folder,
					  const struct dio_recording_index *index,
					  struct dio_error *error)
{
	cJSON *root = index_to_json(index);
	char *text = root ? cJSON_Print(root) : NULL;
	char *path = NULL;
	enum dio_status status;

	if (text && asprintf(&path, "%s/%s", folder, DIO_RECORDING_INDEX_FILE) < 0)
		path = NULL;
	if (path)
		status = dio_atomic_file_write(path, text, strlen(text), error);
	else
		status = dio_fail(error, DIO_NO_MEM, "%s: no memory for the index", folder);
	free(path);
	cJSON_free(text);
	cJSON_Delete(root);
	return status;
}

static enum dio_status read_json(const char *path, struct dio_recording_index *index,
				 struct dio_error *error)
{
	uint8_t *bytes;
	size_t size;
	const cJSON *item;
	const cJSON *frames;
	cJSON *root;
	enum dio_status status = dio_file_read(path, INDEX_BYTES_MAX, &bytes, &size, error);

	if (status != DIO_OK)
		return status;
	root = cJSON_ParseWithLength((const char *)bytes, size);
	free(bytes);
	item = cJSON_GetObjectItemCaseSensitive(root, "format");
	frames = cJSON_GetObjectItemCaseSensitive(root, "frames");
	if (!cJSON_IsString(item) || strcmp(item->valuestring, FORMAT_NAME) != 0 ||
	    !cJSON_IsArray(frames) ||
	    !camera_from_json(cJSON_GetObjectItemCaseSensitive(root, "camera"), &index->camera)) {
		status = dio_fail(error, DIO_BAD_FILE,
				  "%s: damaged, or not the index of a recording", path);
		goto out;
	}
	item = cJSON_GetObjectItemCaseSensitive(root, "version");
	if (!cJSON_IsNumber(item) || item->valuedouble != FORMAT_VERSION) {
		status = dio_fail(error, DIO_UNSUPPORTED,
				  "%s: not of version %d; it was written by another release", path,
				  FORMAT_VERSION);
		goto out;
	}
	cJSON_ArrayForEach(item, frames)
	{
		struct dio_recording_entry entry;

		if (!entry_from_json(item, &entry)) {
			status = dio_fail(error, DIO_BAD_FILE, "%s: frame %zu is damaged", path,
					  index->count);
			goto out;
		}
		status = dio_recording_index_append(index, &entry, error);
		if (status != DIO_OK)
			goto out;
	}
out:
	cJSON_Delete(root);
	return status;
}

/* Lines up to the first that is not whole: there the recording was cut off. */
static enum dio_status read_journal(const char *path, struct dio_recording_index *index,
				    struct dio_error *error)
{
	uint8_t *bytes;
	size_t size;
	char *line;
	enum dio_status status = dio_file_read(path, INDEX_BYTES_MAX, &bytes, &size, error);

	if (status == DIO_NOT_FOUND)
		return DIO_OK;
	if (status != DIO_OK)
		return status;
	line = (char *)bytes;
	for (char *end; status == DIO_OK && (end = strchr(line, '\n')); line = end + 1) {
		struct dio_recording_entry entry;
		cJSON *object;
		bool whole;

		object = cJSON_ParseWithLength(line, (size_t)(end - line));
		whole = entry_from_json(object, &entry);
		cJSON_Delete(object);
		if (!whole)
			break;
		status = dio_recording_index_append(index, &entry, error);
	}
	free(bytes);
	return status;
}

enum dio_status dio_recording_index_read(const char *folder, struct dio_recording_index *index,
					 struct dio_error *error)
{
	struct dio_recording_index read = {0};
	char *json = NULL, *journal = NULL;
	enum dio_status status = DIO_NO_MEM;

	if (asprintf(&json, "%s/%s", folder, DIO_RECORDING_INDEX_FILE) < 0)
		json = NULL;
	if (asprintf(&journal, "%s/%s", folder, DIO_RECORDING_JOURNAL_FILE) < 0)
		journal = NULL;
	if (!json || !journal) {
		dio_fail(error, status, "%s: out of memory", folder);
		goto out;
	}
	status = read_json(json, &read, error);
	/* A journal beside a list that has frames already was folded in before the power went. */
	if (status == DIO_OK && read.count == 0)
		status = read_journal(journal, &read, error);
	if (status == DIO_OK) {
		*index = read;
		read = (struct dio_recording_index){0};
	}
out:
	dio_recording_index_deinit(&read);
	free(json);
	free(journal);
	return status;
}
