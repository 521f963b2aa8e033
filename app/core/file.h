/* Files whole or not at all, and the paths between them. */
#ifndef DIO_APP_FILE_H
#define DIO_APP_FILE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdio.h>

#include "dio/status.h"

/**
 * Read a whole file; a zero byte follows the content. Release *data with free().
 *
 * DIO_NOT_FOUND, DIO_IO, DIO_BAD_FILE (larger than max_bytes), DIO_NO_MEM
 */
enum dio_status dio_file_read(const char *path, size_t max_bytes, char **data, size_t *size,
			      struct dio_error *error);

/** Write beside, sync, rename: the old file or the new one, never a part. */
enum dio_status dio_file_write(const char *path, const void *data, size_t size,
			       struct dio_error *error);

/** A file being written beside its place. */
struct dio_file_writer {
	FILE *stream; /* write here */
	char *path, *beside;
};
enum dio_status dio_file_writer_open(struct dio_file_writer *writer, const char *path,
				     struct dio_error *error);
/** Sync and rename when `keep`, else remove. Any earlier write error is reported here. */
enum dio_status dio_file_writer_close(struct dio_file_writer *writer, bool keep,
				      struct dio_error *error);

/** Make a folder and its parents; one that exists is fine. */
enum dio_status dio_folder_make(const char *path, struct dio_error *error);

/** `folder`/`name` (or name alone when it is absolute); release with free(), NULL: no memory. */
char *dio_path_join(const char *folder, const char *name);
/** The folder part of a path, "." when there is none; release with free(). */
char *dio_path_folder(const char *path);
/** The last part of a path, borrowed from it. */
const char *dio_path_name(const char *path);
/** `to` as seen from `folder` ("../images/0.png"), both must exist; release with free(). */
char *dio_path_relative(const char *folder, const char *to);
bool dio_path_is_folder(const char *path);
bool dio_path_is_file(const char *path);

#endif
