/* One block of memory, handed out in order. Private to the engine. */
#ifndef DVSM_BASE_ARENA_H
#define DVSM_BASE_ARENA_H

#include <stdbool.h>
#include <stddef.h>

/**
 * The same walk measures and places: with base NULL every take returns NULL and only `used` grows;
 * with a block of that size behind `base` the same takes return its parts.
 */
struct dvsm_arena {
	unsigned char *base; /* NULL to measure; DVSM_ALIGN-aligned */
	size_t used;
	bool overflow; /* a size did not fit; sticks */
};

/** The next count * size bytes on a DVSM_ALIGN boundary; NULL when measuring or after overflow. */
void *dvsm_arena_take(struct dvsm_arena *arena, size_t count, size_t size);

/** count x width floats. */
float *dvsm_arena_take_floats(struct dvsm_arena *arena, size_t count, size_t width);

#endif
