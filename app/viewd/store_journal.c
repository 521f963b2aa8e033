#include "viewd/store_journal.h"

#include <cjson/cJSON.h>
#include <errno.h>
#include <fcntl.h>
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>
#include <zlib.h>

#include "core/json_out.h"
#include "core/text.h"
#include "dio/atomic_file.h"

#define JOURNAL_BYTES_MAX ((size_t)64 << 20)
#define CHECK_LETTERS     9 /* eight of the CRC-32 and a space */

/* "CRC JSON\n"; release with free(). */
static char *make_line(cJSON *object)
{
	char *text = object ? cJSON_PrintUnformatted(object) : NULL, *line = NULL;

	if (text && asprintf(&line, "%08lx %s\n", crc32(0, (const Bytef *)text, (uInt)strlen(text)),
			     text) < 0)
		line = NULL;
	cJSON_free(text);
	cJSON_Delete(object);
	return line;
}

static char *camera_line(const struct dio_camera_model *camera)
{
	cJSON *root = cJSON_CreateObject();
	const double focal[4] = {camera->fx, camera->fy, camera->cx, camera->cy};

	cJSON_AddNumberToObject(root, "width", camera->width);
	cJSON_AddNumberToObject(root, "height", camera->height);
	cJSON_AddItemToObject(root, "fx_fy_cx_cy", dio_json_numbers(focal, 4));
	cJSON_AddItemToObject(root, "dist", dio_json_numbers(camera->dist, 5));
	return make_line(root);
}

static char *entry_line(const struct dio_journal_entry *entry)
{
	cJSON *root = cJSON_CreateObject();
	char number[24];

	cJSON_AddStringToObject(root, "file", entry->file);
	snprintf(number, sizeof number, "%08" PRIx32, entry->crc32);
	cJSON_AddStringToObject(root, "crc32", number);
	/* As text: a JSON number is a double and ends at 2^53. */
	snprintf(number, sizeof number, "%" PRIu64, entry->size_bytes);
	cJSON_AddStringToObject(root, "size_bytes", number);
	snprintf(number, sizeof number, "%" PRIu64, entry->timestamp_ns);
	cJSON_AddStringToObject(root, "timestamp_ns", number);
	cJSON_AddItemToObject(root, "world_from_camera",
			      dio_json_numbers(entry->pose.world_from_camera, 16));
	return make_line(root);
}

static bool get_number(const cJSON *object, const char *key, double *value)
{
	const cJSON *item = cJSON_GetObjectItemCaseSensitive(object, key);

	if (!cJSON_IsNumber(item))
		return false;
	*value = item->valuedouble;
	return true;
}

static bool get_numbers(const cJSON *object, const char *key, double *values, int count)
{
	const cJSON *list = cJSON_GetObjectItemCaseSensitive(object, key), *item;
	int i = 0;

	if (!cJSON_IsArray(list) || cJSON_GetArraySize(list) != count)
		return false;
	cJSON_ArrayForEach(item, list)
	{
		if (!cJSON_IsNumber(item))
			return false;
		values[i++] = item->valuedouble;
	}
	return true;
}

static bool get_u64(const cJSON *object, const char *key, int base, uint64_t *value)
{
	const char *text = cJSON_GetStringValue(cJSON_GetObjectItemCaseSensitive(object, key));
	char *end;

	if (!text || !*text || strspn(text, "0123456789abcdef") != strlen(text))
		return false;
	errno = 0;
	*value = strtoull(text, &end, base);
	return *end == '\0' && errno == 0;
}

static bool camera_from_json(const cJSON *root, struct dio_camera_model *camera)
{
	double width, height, focal[4];

	if (!get_number(root, "width", &width) || !get_number(root, "height", &height) ||
	    !(width >= 1 && width <= 16384 && height >= 1 && height <= 16384) ||
	    !get_numbers(root, "fx_fy_cx_cy", focal, 4) ||
	    !get_numbers(root, "dist", camera->dist, 5))
		return false;
	camera->width = (uint32_t)width;
	camera->height = (uint32_t)height;
	camera->fx = focal[0];
	camera->fy = focal[1];
	camera->cx = focal[2];
	camera->cy = focal[3];
	return true;
}

/* Only the names that the store gives: no way out of the folder. */
static bool is_view_name(const char *name)
{
	size_t digits;

	if (strncmp(name, "images/", 7) != 0)
		return false;
	digits = strspn(name + 7, "0123456789");
	return digits > 0 && digits < 10 && strcmp(name + 7 + digits, ".png") == 0;
}

static bool entry_from_json(const cJSON *root, struct dio_journal_entry *entry)
{
	const char *file = cJSON_GetStringValue(cJSON_GetObjectItemCaseSensitive(root, "file"));
	uint64_t crc;

	*entry = (struct dio_journal_entry){0};
	if (!file || !is_view_name(file) || !get_u64(root, "crc32", 16, &crc) || crc > UINT32_MAX ||
	    !get_u64(root, "size_bytes", 10, &entry->size_bytes) ||
	    !get_u64(root, "timestamp_ns", 10, &entry->timestamp_ns) ||
	    !get_numbers(root, "world_from_camera", entry->pose.world_from_camera, 16))
		return false;
	snprintf(entry->file, sizeof entry->file, "%s", file);
	entry->crc32 = (uint32_t)crc;
	return true;
}

/* The object of a line whose checksum holds, else NULL. */
static cJSON *parse_line(const char *line, size_t length)
{
	char check[CHECK_LETTERS + 1];

	if (length <= CHECK_LETTERS)
		return NULL;
	snprintf(check, sizeof check, "%08lx ",
		 crc32(0, (const Bytef *)line + CHECK_LETTERS, (uInt)(length - CHECK_LETTERS)));
	if (strncmp(line, check, CHECK_LETTERS) != 0)
		return NULL;
	return cJSON_ParseWithLength(line + CHECK_LETTERS, length - CHECK_LETTERS);
}

enum dio_status dio_journal_add(struct dio_journal *journal, const struct dio_journal_entry *entry,
				struct dio_error *error)
{
	if (journal->count == journal->capacity) {
		uint32_t capacity = journal->capacity ? journal->capacity * 2 : 32;
		struct dio_journal_entry *grown =
			reallocarray(journal->entries, capacity, sizeof *grown);

		if (!grown)
			return dio_fail(error, DIO_NO_MEM, "no memory for %u views", capacity);
		journal->entries = grown;
		journal->capacity = capacity;
	}
	journal->entries[journal->count++] = *entry;
	return DIO_OK;
}

enum dio_status dio_journal_read(const char *path, struct dio_journal *journal,
				 struct dio_error *error)
{
	struct dio_journal read = {0};
	struct dio_journal_entry entry;
	bool has_camera = false;
	char *text, *line;
	size_t size;
	enum dio_status status = dio_text_read(path, JOURNAL_BYTES_MAX, &text, &size, error);

	if (status != DIO_OK)
		return status;
	line = text;
	for (char *end; status == DIO_OK && (end = strchr(line, '\n')); line = end + 1) {
		cJSON *object = parse_line(line, (size_t)(end - line));
		bool whole = has_camera ? entry_from_json(object, &entry)
					: camera_from_json(object, &read.camera);

		cJSON_Delete(object);
		if (!whole)
			break;
		if (has_camera)
			status = dio_journal_add(&read, &entry, error);
		has_camera = true;
	}
	read.torn = line != text + size;
	free(text);
	if (status == DIO_OK && !has_camera)
		status = dio_fail(error, DIO_BAD_FILE, "%s: its first line is not whole", path);
	if (status == DIO_OK)
		*journal = read;
	else
		dio_journal_deinit(&read);
	return status;
}

static bool print_line(FILE *stream, char *line)
{
	bool printed = line && fputs(line, stream) >= 0;

	free(line);
	return printed;
}

enum dio_status dio_journal_write(const char *path, const struct dio_journal *journal,
				  struct dio_error *error)
{
	struct dio_atomic_file *file;
	enum dio_status status = dio_atomic_file_open(path, &file, error);
	bool printed;

	if (status != DIO_OK)
		return status;
	printed = print_line(dio_atomic_file_stream(file), camera_line(&journal->camera));
	for (uint32_t i = 0; printed && i < journal->count; i++)
		printed =
			print_line(dio_atomic_file_stream(file), entry_line(&journal->entries[i]));
	if (printed)
		return dio_atomic_file_commit(file, error);
	status = dio_fail(error, dio_status_from_errno(errno), "%s: cannot write: %s", path,
			  strerror(errno));
	dio_atomic_file_discard(file);
	return status;
}

static bool write_all(int fd, const char *bytes, size_t size)
{
	while (size > 0) {
		ssize_t written = write(fd, bytes, size);

		if (written < 0 && errno == EINTR)
			continue;
		if (written < 0)
			return false;
		bytes += written;
		size -= (size_t)written;
	}
	return true;
}

enum dio_status dio_journal_append(const char *path, const struct dio_journal_entry *entry,
				   struct dio_error *error)
{
	char *line = entry_line(entry);
	int fd = line ? open(path, O_WRONLY | O_APPEND | O_CLOEXEC) : -1, reason;
	enum dio_status status = DIO_OK;
	struct stat before;

	if (!line)
		return dio_fail(error, DIO_NO_MEM, "%s: no memory for a line", path);
	if (fd < 0 || fstat(fd, &before) != 0 || !write_all(fd, line, strlen(line)) ||
	    fsync(fd) != 0) {
		reason = errno;
		status = dio_fail(error, dio_status_from_errno(reason), "%s: cannot append: %s",
				  path, strerror(reason));
		/* Half a line would end the journal for all lines after it. */
		if (fd >= 0 && ftruncate(fd, before.st_size) != 0)
			status = dio_fail(error, DIO_IO, "%s: cannot take back half a line: %s",
					  path, strerror(errno));
	}
	if (fd >= 0)
		close(fd);
	free(line);
	return status;
}

void dio_journal_deinit(struct dio_journal *journal)
{
	free(journal->entries);
	*journal = (struct dio_journal){0};
}
