/* NumPy array files: float32 pictures streamed out, float arrays read. */
#ifndef DIO_APP_NPY_H
#define DIO_APP_NPY_H

#include <stddef.h>
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

#define DIO_NPY_RANK_MAX 8

/** An array in memory, row-major, as doubles. Release with dio_npy_array_deinit(). */
struct dio_npy_array {
	uint32_t rank;
	size_t shape[DIO_NPY_RANK_MAX];
	double *values;
};

/**
 * Read an array of little-endian float32 or float64 in C order.
 *
 * DIO_BAD_FILE  another type or order, or sizes that disagree
 */
enum dio_status dio_npy_read(const char *path, struct dio_npy_array *array,
			     struct dio_error *error);
void dio_npy_array_deinit(struct dio_npy_array *array);

#endif
