/* One block of memory, measured and placed by the same walk. */
#pragma once

#include <stddef.h>
#include <stdlib.h>
#include <sys/mman.h>

struct arena {
	char *base; /* NULL: measure only */
	size_t used;
};

static inline void *take(struct arena *arena, size_t count, size_t size)
{
	size_t at = arena->used;
	arena->used = (at + count * size + 127) & ~(size_t)63;
	return arena->base ? arena->base + at : NULL;
}

/* In huge pages where there are some: tiles touch more small ones than the processor keeps track
 * of. */
static inline char *allocate(size_t bytes)
{
	const size_t huge = (size_t)2 << 20;
	bytes = (bytes + huge - 1) & ~(huge - 1);
	char *memory = aligned_alloc(huge, bytes);
	if (memory) {
		(void)madvise(memory, bytes, MADV_HUGEPAGE);
	}
	return memory;
}
