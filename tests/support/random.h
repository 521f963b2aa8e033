/* Random numbers with a printed seed: splitmix64 (Steele, Lea, Flood, 2014). */
#ifndef TESTS_SUPPORT_RANDOM_H
#define TESTS_SUPPORT_RANDOM_H

#include <stddef.h>
#include <stdint.h>

struct support_random {
	uint64_t state;
};

/** Seeded from DIO_TEST_SEED, else from the clock; the seed is printed so a failure repeats. */
struct support_random support_random_seeded(const char *test_name);

uint64_t support_random_next(struct support_random *random);

/** 0 .. limit - 1, limit >= 1. */
size_t support_random_below(struct support_random *random, size_t limit);

/** Uniform in [-1, 1). */
float support_random_unit(struct support_random *random);

/** count numbers, uniform in [-scale, scale). */
void support_random_fill(struct support_random *random, float *out, size_t count, float scale);

#endif
