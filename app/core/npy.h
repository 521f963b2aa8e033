/* NumPy array files: float32 pictures, streamed. */
#ifndef DIO_APP_NPY_H
#define DIO_APP_NPY_H

#include <stdint.h>

#include "dio/status.h"

/** Opaque, thread-bound. */
struct dio_npy;

/** Start [count][height][width][3] little-endian float32 beside `path`. */
enum dio_status dio_npy_open(const char *path, uint32_t count, uint32_t height, uint32_t width,
			     struct dio_npy **npy, struct dio_error *error);
enum dio_status dio_npy_append(struct dio_npy *npy, const float *rgb, struct dio_error *error);

/**
 * Sync and rename when all pictures came, else remove what was written. NULL is fine.
 *
 * DIO_BAD_ARG  fewer pictures than announced
 */
enum dio_status dio_npy_close(struct dio_npy *npy, struct dio_error *error);

#endif
