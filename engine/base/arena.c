#include "base/arena.h"

#include "base/memory.h"

void *dvsm_arena_take(struct dvsm_arena *arena, size_t count, size_t size)
{
	size_t bytes, end, at = arena->used;

	if (arena->overflow || !dvsm_size_mul(count, size, &bytes) ||
	    !dvsm_size_align(bytes, &bytes) || !dvsm_size_add(at, bytes, &end)) {
		arena->overflow = true;
		return NULL;
	}
	arena->used = end;
	return arena->base ? arena->base + at : NULL;
}

float *dvsm_arena_take_floats(struct dvsm_arena *arena, size_t count, size_t width)
{
	size_t floats;

	if (!dvsm_size_mul(count, width, &floats)) {
		arena->overflow = true;
		return NULL;
	}
	return dvsm_arena_take(arena, floats, sizeof(float));
}
