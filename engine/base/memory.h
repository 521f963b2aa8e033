/* Checked sizes and aligned memory. */
#ifndef DVSM_BASE_MEMORY_H
#define DVSM_BASE_MEMORY_H

#include <stdbool.h>
#include <stddef.h>

/* Every tensor, cache and workspace block starts on a cache line, which is also a 512-bit vector.
 */
#define DVSM_ALIGN 64u

/** *out = a * b or a + b; false when the result does not fit, *out untouched. */
bool dvsm_size_mul(size_t a, size_t b, size_t *out);
bool dvsm_size_add(size_t a, size_t b, size_t *out);

static inline size_t dvsm_size_larger(size_t a, size_t b)
{
	return a > b ? a : b;
}

/** Round up to DVSM_ALIGN; false on overflow. */
bool dvsm_size_align(size_t size, size_t *out);

/**
 * `size` bytes on a DVSM_ALIGN boundary, or NULL; release with free(). Size 0 gives one line. Some
 * megabytes come on large pages where the system has them.
 */
void *dvsm_aligned_alloc(size_t size);

#endif
