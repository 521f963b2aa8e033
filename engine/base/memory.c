#include "base/memory.h"

#include <stdlib.h>

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

void *dvsm_aligned_alloc(size_t size)
{
	size_t rounded;
	if (!dvsm_size_align(size ? size : 1, &rounded))
		return NULL;
	return aligned_alloc(DVSM_ALIGN, rounded);
}
