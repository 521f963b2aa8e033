/*
 * What the checks of the fixed-point kernels share: how shapes and numbers are drawn, memory that
 * ends where the contract says (support/guarded.h), and the walk over the tiers. The seed is
 * printed; DIO_TEST_SEED repeats a run.
 */
#ifndef TESTS_KERNELS_FIXED_CHECKS_H
#define TESTS_KERNELS_FIXED_CHECKS_H

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>
#include <stdio.h>
#include <string.h>

#include "kernels/fixed_math.h"
#include "model_tiers.h"
#include "support/guarded.h"
#include "support/random.h"

#define COUNT(array) (sizeof(array) / sizeof((array)[0]))

static struct support_random rng;
static struct dvsm_fixed_kernels tiers[16];
static size_t tier_count;

static const size_t edges[] = {0,  1,  2,  3,  4,  5,  7,  8,  9,  12, 15, 16,
			       17, 31, 32, 33, 47, 48, 49, 63, 64, 65, 96, 97};

static inline size_t edge(size_t low)
{
	size_t value;

	do {
		value = edges[support_random_below(&rng, COUNT(edges))];
	} while (value < low);
	return value;
}

static inline int between(int low, int high)
{
	return low + (int)support_random_below(&rng, (size_t)(high - low + 1));
}

/* ---- memory of one check ---- */

static struct support_guarded blocks[24];
static size_t block_count;

/* `bytes` bytes of noise that end at a forbidden page. */
static inline void *take(size_t bytes)
{
	struct support_guarded *block = &blocks[block_count++];
	size_t words = (bytes + 3) / 4;

	assert_true(block_count <= COUNT(blocks));
	*block = support_guarded_make(words);
	assert_non_null(block->data);

	unsigned char *start = (unsigned char *)block->data + (words * 4 - bytes);

	for (size_t i = 0; i < bytes; i++)
		start[i] = (unsigned char)support_random_next(&rng);
	return start;
}

/* Two outputs of equal content: what lies between rows must stay, so all of it is compared. */
struct outputs {
	void *want, *got;
	size_t bytes;
};

static inline struct outputs take_outputs(size_t bytes)
{
	struct outputs made = {take(bytes), take(bytes), bytes};

	if (bytes)
		memcpy(made.got, made.want, bytes);
	return made;
}

static inline void compare(const struct outputs *outputs, const char *tier, const char *what)
{
	const unsigned char *want = outputs->want, *got = outputs->got;

	for (size_t i = 0; i < outputs->bytes; i++) {
		if (got[i] != want[i])
			fail_msg("%s, %s: byte %zu of %zu is %d, the specification says %d", tier,
				 what, i, outputs->bytes, got[i], want[i]);
	}
}

static inline void release(void)
{
	while (block_count > 0) {
		assert_true(support_guarded_intact(&blocks[--block_count]));
		support_guarded_free(&blocks[block_count]);
	}
}

/* ---- numbers ---- */

enum kind { EVEN, STEEP, EXTREME, ZERO };

static inline enum kind draw_kind(void)
{
	int at = between(0, 9);

	return at < 5 ? EVEN : at < 7 ? STEEP : at < 9 ? EXTREME : ZERO;
}

/* Up to `bits` bits and a sign: any size alike, mostly small ones, the largest alone, or none. */
static inline int32_t draw(int bits, enum kind kind)
{
	int64_t limit = ((int64_t)1 << bits) - 1;
	int64_t value = (int64_t)(support_random_next(&rng) % (uint64_t)(2 * limit + 1)) - limit;

	switch (kind) {
	case EVEN:
		return (int32_t)value;
	case STEEP:
		return (int32_t)(value / ((int64_t)1 << between(0, bits)));
	case EXTREME:
		return (int32_t)(value < 0 ? -limit : limit);
	case ZERO:
		break;
	}
	return 0;
}

/* Rows that differ in size as tokens do, here and there with the number that has no opposite. */
static inline int16_t *take_s16(size_t rows, size_t stride, size_t width)
{
	size_t count = rows ? (rows - 1) * stride + width : 0;
	int16_t *made = take(count * sizeof(*made));

	for (size_t i = 0; i < rows; i++) {
		enum kind kind = draw_kind();
		int bits = between(1, 15);

		for (size_t d = 0; d < width; d++)
			made[i * stride + d] = (int16_t)draw(bits, kind);
		if (width && between(0, 9) == 0)
			made[i * stride + support_random_below(&rng, width)] = INT16_MIN;
	}
	return made;
}

static inline struct dvsm_fixed_scale draw_scale(int low, int high)
{
	return (struct dvsm_fixed_scale){(int16_t)between(1 << 14, (1 << 15) - 1),
					 (int16_t)between(low, high)};
}

/* ---- tiers ---- */

#if defined(__x86_64__)
/* What a tier over a model has of its own, the scalar set for the rest. */
static inline struct dvsm_fixed_kernels modelled(const struct dvsm_fixed_kernels *tier,
						 const char *name)
{
	struct dvsm_fixed_kernels model = dvsm_fixed_kernels_scalar;

	model.cpu = tier->cpu;
	model.name = name;
	model.gemm = tier->gemm;
	model.attention = tier->attention;
	if (tier->attention_queries)
		model.attention_queries = tier->attention_queries;
	return model;
}
#endif

/* Each tier alone over the scalar set, so that what it lacks is not tested by another; `program`
 * goes with the seed that is printed. */
static inline int find_tiers(const char *program)
{
	rng = support_random_seeded(program);
	for (uint32_t cpu = DVSM_CPU_SCALAR; cpu; cpu <<= 1) {
		struct dvsm_fixed_kernels tier = dvsm_fixed_kernels_choose(cpu);

		if (tier.cpu == cpu)
			tiers[tier_count++] = tier;
	}
#if defined(__x86_64__)
	if (dvsm_cpu_detect() & DVSM_CPU_VNNI) {
		tiers[tier_count++] = modelled(&amx_model_fixed_kernels, "amx, modelled");
		tiers[tier_count++] = modelled(&avxvnni_model_fixed_kernels, "avxvnni, modelled");
	}
#endif
	for (size_t t = 0; t < tier_count; t++)
		printf("tier %s\n", tiers[t].name);
	return 0;
}

static inline void walk(void (*check)(const struct dvsm_fixed_kernels *tier), int rounds)
{
	for (size_t t = 0; t < tier_count; t++) {
		for (int round = 0; round < rounds; round++) {
			check(&tiers[t]);
			release();
		}
	}
}

#define EXACT(kernel, rounds)                                                                      \
	static void kernel##_is_exact_in_every_tier(void **state)                                  \
	{                                                                                          \
		(void)state;                                                                       \
		walk(check_##kernel, rounds);                                                      \
	}

#endif
