#include "support/random.h"

#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <time.h>

struct support_random support_random_seeded(const char *test_name)
{
	const char *given = getenv("DIO_TEST_SEED");
	struct timespec now;
	uint64_t seed;

	clock_gettime(CLOCK_REALTIME, &now);
	seed = given ? strtoull(given, NULL, 0)
		     : (uint64_t)now.tv_sec * 1000000000u + (uint64_t)now.tv_nsec;
	printf("%s: DIO_TEST_SEED=%" PRIu64 "\n", test_name, seed);
	return (struct support_random){seed};
}

uint64_t support_random_next(struct support_random *random)
{
	uint64_t z = random->state += 0x9e3779b97f4a7c15u;

	z = (z ^ z >> 30) * 0xbf58476d1ce4e5b9u;
	z = (z ^ z >> 27) * 0x94d049bb133111ebu;
	return z ^ z >> 31;
}

size_t support_random_below(struct support_random *random, size_t limit)
{
	return (size_t)(support_random_next(random) % limit);
}

float support_random_unit(struct support_random *random)
{
	return (float)((double)(support_random_next(random) >> 11) * 0x1p-52 - 1.0);
}

void support_random_fill(struct support_random *random, float *out, size_t count, float scale)
{
	for (size_t i = 0; i < count; i++)
		out[i] = scale * support_random_unit(random);
}
