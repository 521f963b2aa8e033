#include "core/npy.h"

#include <endian.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "dio/file.h"

#define PREFIX_BYTES 10 /* magic, version, length of the dictionary */
#define MAX_BYTES    ((size_t)4 << 30)

/* What stands behind `'key':` in the dictionary; NULL when the key is missing. */
static const char *find(const char *dictionary, const char *key)
{
	const char *at = strstr(dictionary, key);

	if (!at)
		return NULL;
	at += strlen(key);
	return at + strspn(at, " ");
}

/* "(2, 3, )": false when it is no list of up to DIO_NPY_RANK_MAX sizes that multiply to a count. */
static bool read_shape(const char *text, struct dio_npy_array *array, size_t *count)
{
	*count = 1;
	if (!text || *text++ != '(')
		return false;
	while (*text != ')') {
		char *end;
		unsigned long long size = strtoull(text, &end, 10);

		if (end == text || array->rank == DIO_NPY_RANK_MAX ||
		    (size != 0 && *count > MAX_BYTES / size))
			return false;
		array->shape[array->rank++] = (size_t)size;
		*count *= (size_t)size;
		text = end + strspn(end, ", ");
	}
	return true;
}

static void convert(const uint8_t *data, size_t count, bool wide, double *values)
{
	_Static_assert(__BYTE_ORDER == __LITTLE_ENDIAN, "numbers are read as they lie");
	for (size_t i = 0; i < count; i++) {
		float narrow;

		if (wide) {
			memcpy(&values[i], data + i * sizeof *values, sizeof *values);
		} else {
			memcpy(&narrow, data + i * sizeof narrow, sizeof narrow);
			values[i] = narrow;
		}
	}
}

static enum dio_status parse(const char *path, uint8_t *bytes, size_t size,
			     struct dio_npy_array *array, struct dio_error *error)
{
	const char *dictionary = (const char *)bytes + PREFIX_BYTES, *type, *order;
	size_t data_at, count, width;

	if (size < PREFIX_BYTES || memcmp(bytes, "\x93NUMPY\x01", 7) != 0)
		return dio_fail(error, DIO_BAD_FILE, "%s: is no NumPy array of format 1", path);
	data_at = PREFIX_BYTES + bytes[8] + 256u * bytes[9];
	if (data_at > size || data_at == PREFIX_BYTES)
		return dio_fail(error, DIO_BAD_FILE, "%s: ends inside its header", path);
	bytes[data_at - 1] = '\0'; /* the header's line end */
	type = find(dictionary, "'descr':");
	order = find(dictionary, "'fortran_order':");
	if (!type || (strncmp(type, "'<f4'", 5) != 0 && strncmp(type, "'<f8'", 5) != 0) || !order ||
	    strncmp(order, "False", 5) != 0)
		return dio_fail(error, DIO_BAD_FILE,
				"%s: is not float32 or float64 in C order: save it as such", path);
	width = type[3] == '8' ? sizeof(double) : sizeof(float);
	if (!read_shape(find(dictionary, "'shape':"), array, &count) ||
	    count != (size - data_at) / width || (size - data_at) % width != 0)
		return dio_fail(error, DIO_BAD_FILE,
				"%s: holds another number of bytes than its shape asks for", path);
	array->values = malloc((count ? count : 1) * sizeof *array->values);
	if (!array->values)
		return dio_fail(error, DIO_NO_MEM, "%s: no memory for %zu numbers", path, count);
	convert(bytes + data_at, count, width == sizeof(double), array->values);
	return DIO_OK;
}

enum dio_status dio_npy_read(const char *path, struct dio_npy_array *array, struct dio_error *error)
{
	struct dio_npy_array made = {0};
	uint8_t *bytes = NULL;
	size_t size = 0;
	enum dio_status status = dio_file_read(path, MAX_BYTES, &bytes, &size, error);

	if (status != DIO_OK)
		return status;
	status = parse(path, bytes, size, &made, error);
	free(bytes);
	if (status == DIO_OK)
		*array = made;
	return status;
}

void dio_npy_array_deinit(struct dio_npy_array *array)
{
	free(array->values);
	*array = (struct dio_npy_array){0};
}
