/* Files that are whole or not there: written beside, synced, renamed. */
#ifndef DIO_ATOMIC_FILE_H
#define DIO_ATOMIC_FILE_H

#include <stddef.h>
#include <stdio.h>

#include "dio/status.h"

#ifdef __cplusplus
extern "C" {
#endif

/** Opaque, thread-bound: one file being written. */
struct dio_atomic_file;

/**
 * Begin to write `path`. Until the commit a file of that name stays as it is; what is written goes
 * to "PATH.PID-N.part" in the same folder. A symbolic link is followed. A path that is a device or
 * a pipe (/dev/stdout) is written straight.
 *
 * DIO_NOT_FOUND  the folder is missing; DIO_IO  not permitted, or `path` is a folder
 */
enum dio_status dio_atomic_file_open(const char *path, struct dio_atomic_file **file,
				     struct dio_error *error);

/** Where to write; borrowed, closed by commit and discard. */
FILE *dio_atomic_file_stream(struct dio_atomic_file *file);

/** The name being written to, for a library that wants to open it itself; borrowed. */
const char *dio_atomic_file_part_path(const struct dio_atomic_file *file);

/**
 * Flush, sync, rename, sync the folder, release. On failure the part is removed, a former file of
 * that name is unharmed, and `file` is released all the same.
 *
 * DIO_NO_SPACE  the disk is full; DIO_IO  the system refused
 */
enum dio_status dio_atomic_file_commit(struct dio_atomic_file *file, struct dio_error *error);

/** Give up: remove the part, release. NULL is fine. */
void dio_atomic_file_discard(struct dio_atomic_file *file);

/** All of the above for bytes that are at hand. */
enum dio_status dio_atomic_file_write(const char *path, const void *bytes, size_t size,
				      struct dio_error *error);

#ifdef __cplusplus
}
#endif
#endif
