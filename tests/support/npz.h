/* NumPy archives (.npz): a zip of .npy members, stored or deflated. */
#ifndef TESTS_SUPPORT_NPZ_H
#define TESTS_SUPPORT_NPZ_H

#include <stddef.h>

/** One array as doubles, whatever its type was (f4, f8, i4, i8, u1), C order. */
struct support_array {
	double *data;
	size_t shape[8];
	size_t dims; /* 0 for a scalar */
	size_t count;
};

/**
 * Read the array `name` of an archive; 0, or -1 with a printed line.
 * Release with support_array_free().
 */
int support_npz_read(const char *path, const char *name, struct support_array *array);

void support_array_free(struct support_array *array);

#endif
