#include "core/npy.h"

#include <endian.h>
#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "dio/atomic_file.h"

#define HEADER_BYTES 128 /* a multiple of 64, as the format asks */
#define PREFIX_BYTES 10  /* magic, version, length of the dictionary */

static const char MAGIC[8] = {'\x93', 'N', 'U', 'M', 'P', 'Y', 1, 0};

struct dio_npy {
	struct dio_atomic_file *file;
	char *path; /* for messages */
	size_t picture_bytes;
	uint32_t count, written;
};

/* Format 1.0: "\x93NUMPY", version, little-endian length, a Python dictionary padded by spaces. */
static void make_header(char header[HEADER_BYTES], uint32_t count, uint32_t height, uint32_t width)
{
	int dictionary_bytes = HEADER_BYTES - PREFIX_BYTES, used;

	memset(header, ' ', HEADER_BYTES);
	memcpy(header, MAGIC, sizeof MAGIC);
	header[8] = (char)(dictionary_bytes & 0xff);
	header[9] = (char)(dictionary_bytes >> 8);
	used = snprintf(header + PREFIX_BYTES, (size_t)dictionary_bytes,
			"{'descr': '<f4', 'fortran_order': False, 'shape': (%u, %u, %u, 3), }",
			count, height, width);
	header[PREFIX_BYTES + used] = ' ';
	header[HEADER_BYTES - 1] = '\n';
}

enum dio_status dio_npy_open(const char *path, uint32_t count, uint32_t height, uint32_t width,
			     struct dio_npy **npy, struct dio_error *error)
{
	struct dio_npy *made = calloc(1, sizeof *made);
	char header[HEADER_BYTES];
	enum dio_status status;

	if (!made)
		return dio_fail(error, DIO_NO_MEM, "%s: no memory to write it", path);
	made->path = strdup(path);
	if (!made->path)
		status = dio_fail(error, DIO_NO_MEM, "%s: no memory to write it", path);
	else
		status = dio_atomic_file_open(path, &made->file, error);
	if (status != DIO_OK) {
		free(made->path);
		free(made);
		return status;
	}
	make_header(header, count, height, width);
	/* A failed write stays on the stream and is told by the commit. */
	fwrite(header, 1, sizeof header, dio_atomic_file_stream(made->file));
	made->count = count;
	made->picture_bytes = (size_t)height * width * 3 * sizeof(float);
	*npy = made;
	return DIO_OK;
}

enum dio_status dio_npy_append(struct dio_npy *npy, const float *rgb, struct dio_error *error)
{
	_Static_assert(__BYTE_ORDER == __LITTLE_ENDIAN, "numbers are written as they lie");
	if (npy->written == npy->count)
		return dio_fail(error, DIO_BAD_ARG, "%s: more pictures than announced", npy->path);
	if (fwrite(rgb, 1, npy->picture_bytes, dio_atomic_file_stream(npy->file)) !=
	    npy->picture_bytes) {
		int code = errno;

		return dio_fail(error, dio_status_from_errno(code), "%s: cannot be written: %s",
				npy->path, strerror(code));
	}
	npy->written++;
	return DIO_OK;
}

enum dio_status dio_npy_close(struct dio_npy *npy, struct dio_error *error)
{
	enum dio_status status;

	if (!npy)
		return DIO_OK;
	if (npy->written == npy->count) {
		status = dio_atomic_file_commit(npy->file, error);
	} else {
		status = dio_fail(error, DIO_BAD_ARG, "%s: %u of %u pictures came", npy->path,
				  npy->written, npy->count);
		dio_atomic_file_discard(npy->file);
	}
	free(npy->path);
	free(npy);
	return status;
}
