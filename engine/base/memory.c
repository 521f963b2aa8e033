#include "base/memory.h"

#include <stdlib.h>
#include <sys/mman.h>

bool dvsm_size_mul(size_t a, size_t b, size_t *out)
{
	size_t product;
	if (__builtin_mul_overflow(a, b, &product))
		return false;
	*out = product;
	return true;
}

bool dvsm_size_add(size_t a, size_t b, size_t *out)
{
	size_t sum;
	if (__builtin_add_overflow(a, b, &sum))
		return false;
	*out = sum;
	return true;
}

bool dvsm_size_align(size_t size, size_t *out)
{
	size_t padded;
	if (!dvsm_size_add(size, DVSM_ALIGN - 1, &padded))
		return false;
	*out = padded & ~(size_t)(DVSM_ALIGN - 1);
	return true;
}

/* Pages that the processor's table of pages holds few of are worth asking for from some on. */
#define LARGE_PAGE ((size_t)2 << 20)
#define LARGE      (2 * LARGE_PAGE)

void *dvsm_aligned_alloc(size_t size)
{
	size_t bytes;
	void *block;

	if (!dvsm_size_align(size ? size : 1, &bytes))
		return NULL;
	if (bytes < LARGE)
		return aligned_alloc(DVSM_ALIGN, bytes);
	if (!dvsm_size_add(bytes, LARGE_PAGE - 1, &bytes))
		return NULL;
	bytes = bytes / LARGE_PAGE * LARGE_PAGE;
	block = aligned_alloc(LARGE_PAGE, bytes);
	/* For speed alone: small pages do as well. */
	if (block)
		(void)madvise(block, bytes, MADV_HUGEPAGE);
	return block;
}
