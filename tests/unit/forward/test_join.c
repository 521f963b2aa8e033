/* Rows of a fixed-point picture from its patches, against fractions of integers taken at their
 * word. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>
#include <stdio.h>
#include <stdlib.h>

#include "fixed/resample.h"
#include "support/random.h"

#define MOST (1 << 24) /* what a colour may be in size */

/* The share of source sample i in target sample `at`, in units of 1 / whole_of(). */
static int64_t share_of(int64_t i, int64_t at, int64_t source, int64_t target)
{
	if (source == target)
		return i == at;
	if (source > target) {
		int64_t from = i * target > at * source ? i * target : at * source;
		int64_t to =
			(i + 1) * target < (at + 1) * source ? (i + 1) * target : (at + 1) * source;

		return to > from ? to - from : 0;
	}

	/* Between the centres of `first` and of the one behind it, at the edges the edge's alone.
	 */
	int64_t position = (2 * at + 1) * source - target, share = 0;
	int64_t first = position < 0 ? -1 : position / (2 * target);
	int64_t rest = position - first * 2 * target;

	for (int64_t k = 0; k < 2; k++) {
		int64_t tap = first + k < 0 ? 0 : first + k >= source ? source - 1 : first + k;

		if (tap == i)
			share += k ? rest : 2 * target - rest;
	}
	return share;
}

static int64_t whole_of(int64_t source, int64_t target)
{
	return source == target ? 1 : source > target ? source : 2 * target;
}

static int32_t plain_colour(const struct dvsm_patch_plan *plan, const int32_t *patches, uint32_t x,
			    uint32_t y, uint32_t c)
{
	const uint32_t q = plan->patch_px;
	const uint32_t map_width = plan->grid.columns * q, map_height = plan->grid.rows * q;
	const __int128 whole =
		(__int128)whole_of(map_width, plan->width) * whole_of(map_height, plan->height);
	__int128 sum = 0, twice, quotient;

	for (uint32_t j = 0; j < map_height; j++) {
		int64_t down = share_of(j, y, map_height, plan->height);

		for (uint32_t i = 0; down && i < map_width; i++) {
			size_t token = (size_t)(j / q) * plan->grid.columns + i / q;

			sum += (__int128)down * share_of(i, x, map_width, plan->width) *
			       patches[((token * q + j % q) * q + i % q) * 3 + c];
		}
	}
	twice = 2 * sum + whole;
	quotient = twice / (2 * whole);
	return (int32_t)(twice < 0 && quotient * 2 * whole != twice ? quotient - 1 : quotient);
}

/* Colours of every size, among them the largest there are and halves of what they are divided by.
 */
static int32_t draw_colour(struct support_random *random)
{
	int32_t size =
		(int32_t)support_random_below(random, MOST + 1) >> support_random_below(random, 25);

	if (support_random_below(random, 8) == 0)
		size = MOST;
	return support_random_below(random, 2) ? size : -size;
}

static void check_shape(uint32_t width, uint32_t height, uint32_t q, uint32_t p,
			struct support_random *random)
{
	const struct dvsm_patch_plan plan = dvsm_patch_plan_make(width, height, q, p);
	const size_t numbers = dvsm_token_grid_count(plan.grid) * q * q * 3;
	int32_t *patches = malloc(numbers * sizeof(*patches));
	void *scratch = malloc(2 * plan.scratch_bytes);

	assert_true(patches && scratch);
	for (size_t i = 0; i < numbers; i++)
		patches[i] = draw_colour(random);
	for (uint32_t y = 0; y < height; y++) {
		const int32_t *row = dvsm_fixed_join_row(&plan, patches, y, scratch);

		for (uint32_t x = 0; x < width; x++)
			for (uint32_t c = 0; c < 3; c++)
				if (row[3 * x + c] != plain_colour(&plan, patches, x, y, c))
					fail_msg("%ux%u, patches of %u for %u: pixel %u, %u is %d",
						 width, height, q, p, x, y, row[3 * x + c]);
	}
	free(patches);
	free(scratch);
}

static void rows_are_the_fractions_rounded_once(void **state)
{
	static const uint32_t shapes[][4] = {
		{16, 16, 4, 4},                                  /* as large as the map */
		{32, 32, 8, 16},                                 /* twice as large */
		{37, 23, 4, 8},  {50, 31, 3, 11}, {9, 40, 1, 4}, /* larger by odd factors */
		{20, 12, 8, 4},  {17, 11, 8, 3},  {7, 5, 16, 5}, /* smaller */
		{24, 33, 8, 8},  {33, 24, 8, 8},                 /* one axis each */
		{1, 1, 8, 8},    {3, 1, 8, 16},   {100, 2, 2, 64},
	};
	struct support_random random = support_random_seeded("join");

	(void)state;
	for (size_t i = 0; i < sizeof(shapes) / sizeof(*shapes); i++)
		check_shape(shapes[i][0], shapes[i][1], shapes[i][2], shapes[i][3], &random);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(rows_are_the_fractions_rounded_once),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
