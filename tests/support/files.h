/* Whole files for tests. Every failure prints one line and returns NULL. */
#ifndef TESTS_SUPPORT_FILES_H
#define TESTS_SUPPORT_FILES_H

#include <stddef.h>
#include <stdint.h>

/** A file's bytes with a 0 behind them; release with free(). */
unsigned char *support_read_file(const char *path, size_t *size);

/** A PNG as [height][width][3] floats in [0,1]; release with free(). */
float *support_read_png(const char *path, uint32_t *width, uint32_t *height);

/** DIO_SHARED_DIR/name in `path`, or NULL with a printed reason when the shared data is absent. */
const char *support_shared_path(const char *name, char *path, size_t size);

#endif
