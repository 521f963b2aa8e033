/* Finding files, and reading a whole one. */
#ifndef DIO_FILE_H
#define DIO_FILE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "dio/status.h"

#ifdef __cplusplus
extern "C" {
#endif

/**
 * Read a regular file into memory of its own, with a zero byte after the end for text parsers.
 *
 * max_bytes  longer files are refused before anything is allocated
 * bytes      receives the memory; release with free()
 *
 * DIO_NOT_FOUND; DIO_BAD_FILE  not a regular file, or too long; DIO_IO; DIO_NO_MEM
 */
enum dio_status dio_file_read(const char *path, size_t max_bytes, uint8_t **bytes, size_t *size,
			      struct dio_error *error);

/** Path number `index`, in alphabetical order, of those that match; false behind the last one. */
bool dio_file_match(const char *pattern, uint32_t index, char *path, size_t path_size);

#ifdef __cplusplus
}
#endif
#endif
