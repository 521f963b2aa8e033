/* Memory that notices: a page behind it that no one may touch, a pattern in front of it. */
#ifndef TESTS_SUPPORT_GUARDED_H
#define TESTS_SUPPORT_GUARDED_H

#include <stdbool.h>
#include <stddef.h>

struct support_guarded {
	float *data; /* `count` floats that end at a page no one may read or write */
	size_t count;
	unsigned char *map;
	size_t map_bytes;
};

/** NULL data when memory runs out. Release with support_guarded_free(). */
struct support_guarded support_guarded_make(size_t count);

/** The pattern in front of the data is as it was. */
bool support_guarded_intact(const struct support_guarded *guarded);

void support_guarded_free(struct support_guarded *guarded);

#endif
