/*
 * What the checks of the bfloat16 kernels share: the tables that this machine can run, numbers that
 * end where the guard begins, and how a left side lies.
 */
#ifndef TESTS_KERNELS_BF16_CHECKS_H
#define TESTS_KERNELS_BF16_CHECKS_H

#include <stdio.h>

#include "float_checks.h"
#include "model_tiers.h"

#define BF16_STEP 0x1p-7

static const struct dvsm_kernels *tiers[8];
static size_t tier_count;

static const size_t edges[] = {0,  1,  2,  3,  4,  5,  6,  7,  8,  9,  15, 16,  17,
			       31, 32, 33, 47, 48, 49, 63, 64, 65, 96, 97, 128, 129};

static inline size_t edge(size_t below)
{
	return draw_size(edges, COUNT(edges), below);
}

/* Numbers that end where the guard begins. */
struct numbers {
	struct support_guarded memory;
	dvsm_bf16 *at;
	size_t count;
};

static inline struct numbers make_numbers(size_t count, float scale)
{
	struct support_guarded floats = fill(count, scale);
	struct numbers made = {fill((count + 1) / 2, 1.0f), NULL, count};

	made.at = (dvsm_bf16 *)made.memory.data + count % 2;
	for (size_t i = 0; i < count; i++)
		made.at[i] = dvsm_bf16_round(floats.data[i]);
	support_guarded_free(&floats);
	return made;
}

static inline void free_numbers(struct numbers *numbers)
{
	assert_true(support_guarded_intact(&numbers->memory));
	support_guarded_free(&numbers->memory);
}

static inline void free_floats(struct support_guarded *floats)
{
	assert_true(support_guarded_intact(floats));
	support_guarded_free(floats);
}

/* Where number `at` of rows of `stride` lies in a left side of a table. */
static inline size_t left_at(const struct dvsm_kernels *kernels, size_t at, size_t stride)
{
	return dvsm_left_place(kernels, at / stride, at % stride, stride);
}

static inline struct numbers make_left(const struct dvsm_kernels *kernels, size_t rows,
				       size_t stride, size_t last, float scale)
{
	/* Rows end with their last number in memory, unless tiles go on to a whole strip. */
	size_t count = rows ? (rows - 1) * stride + last : 0;

	return make_numbers(kernels->tiled ? dvsm_left_size(kernels, rows, stride) : count, scale);
}

/* ---- tiers ---- */

/* What this machine can run; `program` goes with the seed that is printed. */
static inline int find_tiers(const char *program)
{
	static const struct dvsm_kernels *const all[] = {
		&dvsm_kernels_bf16_scalar,
#if defined(__x86_64__)
		&dvsm_kernels_bf16_sse2,
		&dvsm_kernels_bf16_avx2,
		&dvsm_kernels_bf16_avx512,
		&dvsm_kernels_bf16_avx512bf16,
		&dvsm_kernels_bf16_amx,
#elif defined(__aarch64__)
		&dvsm_kernels_bf16_neon,
		&dvsm_kernels_bf16_neonbf16,
#endif
	};
	uint32_t present = dvsm_cpu_detect();

	rng = support_random_seeded(program);
	for (size_t i = 0; i < COUNT(all); i++) {
		if (present & all[i]->cpu)
			tiers[tier_count++] = all[i];
	}
#if defined(__x86_64__)
	if ((present & DVSM_CPU_AVX512_BF16) && __builtin_cpu_supports("avx512vbmi2"))
		tiers[tier_count++] = &amx_model_bf16_kernels;
#endif
	for (size_t t = 0; t < tier_count; t++)
		printf("tier %s\n", tiers[t]->name);
	return 0;
}

#endif
