#include "support/allocations.h"

#include <stdatomic.h>

static _Atomic size_t made;
static _Atomic long alive;

void *__real_malloc(size_t size);
void *__real_calloc(size_t count, size_t size);
void *__real_realloc(void *block, size_t size);
void *__real_aligned_alloc(size_t alignment, size_t size);
void __real_free(void *block);

void *__wrap_malloc(size_t size);
void *__wrap_calloc(size_t count, size_t size);
void *__wrap_realloc(void *block, size_t size);
void *__wrap_aligned_alloc(size_t alignment, size_t size);
void __wrap_free(void *block);

static void *counted(void *block)
{
	atomic_fetch_add(&made, 1);
	if (block)
		atomic_fetch_add(&alive, 1);
	return block;
}

void *__wrap_malloc(size_t size)
{
	return counted(__real_malloc(size));
}

void *__wrap_calloc(size_t count, size_t size)
{
	return counted(__real_calloc(count, size));
}

void *__wrap_realloc(void *block, size_t size)
{
	void *moved = __real_realloc(block, size);

	atomic_fetch_add(&made, 1);
	if (!block && moved)
		atomic_fetch_add(&alive, 1);
	return moved;
}

void *__wrap_aligned_alloc(size_t alignment, size_t size)
{
	return counted(__real_aligned_alloc(alignment, size));
}

void __wrap_free(void *block)
{
	if (block)
		atomic_fetch_sub(&alive, 1);
	__real_free(block);
}

size_t allocations_made(void)
{
	return made;
}

long allocations_alive(void)
{
	return alive;
}
