#include "support/guarded.h"

#include <string.h>
#include <sys/mman.h>
#include <unistd.h>

#define PATTERN 0xa5

static size_t front_bytes(const struct support_guarded *guarded)
{
	const unsigned char *data = (const unsigned char *)guarded->data;

	return (size_t)(data - guarded->map);
}

struct support_guarded support_guarded_make(size_t count)
{
	size_t page = (size_t)sysconf(_SC_PAGESIZE), bytes = count * sizeof(float);
	size_t body = (bytes + page - 1) / page * page + page;
	struct support_guarded made = {.count = count, .map_bytes = body + page};
	void *map = mmap(NULL, made.map_bytes, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS,
			 -1, 0);

	if (map == MAP_FAILED)
		return (struct support_guarded){0};
	made.map = map;
	memset(made.map, PATTERN, body);
	mprotect(made.map + body, page, PROT_NONE);
	made.data = (void *)(made.map + body - bytes);
	return made;
}

bool support_guarded_intact(const struct support_guarded *guarded)
{
	for (size_t i = 0; i < front_bytes(guarded); i++) {
		if (guarded->map[i] != PATTERN)
			return false;
	}
	return true;
}

void support_guarded_free(struct support_guarded *guarded)
{
	if (guarded->map)
		munmap(guarded->map, guarded->map_bytes);
	*guarded = (struct support_guarded){0};
}
