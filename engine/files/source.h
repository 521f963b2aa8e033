/* Bytes in order, from a file or from memory. Private to the engine. */
#ifndef DVSM_FILES_SOURCE_H
#define DVSM_FILES_SOURCE_H

#include <stdbool.h>
#include <stddef.h>
#include <time.h>

#include "dvsm/status.h"

/*
 * A file is read, never mapped: a file that shrinks while it is mapped kills the process, while a
 * read that comes up short is an error like any other.
 */
struct dvsm_source {
	const char *name;           /* for error texts; borrowed */
	int fd;                     /* -1: from memory */
	const unsigned char *bytes; /* from memory; borrowed */
	size_t size;                /* of the whole */
	size_t position;            /* next byte to read */
	struct timespec modified;   /* of a file, when it was opened */
};

/** Open a regular file; `path` is borrowed until close. DVSM_IO when it cannot be. */
enum dvsm_status dvsm_source_open(const char *path, struct dvsm_source *source,
				  struct dvsm_error *error);

/** Read from memory; `bytes` and `name` are borrowed until close. */
void dvsm_source_open_bytes(const void *bytes, size_t size, const char *name,
			    struct dvsm_source *source);

void dvsm_source_close(struct dvsm_source *source);

/** The next `size` bytes, no fewer. DVSM_IO when the file ends early or cannot be read. */
enum dvsm_status dvsm_source_read(struct dvsm_source *source, void *out, size_t size,
				  struct dvsm_error *error);

/** Read on from byte `position`, at most the size. DVSM_IO when the file does not allow it. */
enum dvsm_status dvsm_source_seek(struct dvsm_source *source, size_t position,
				  struct dvsm_error *error);

/** Whether nobody has written to the file since it was opened. */
bool dvsm_source_is_unchanged(const struct dvsm_source *source);

#endif
