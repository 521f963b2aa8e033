#include "geometry/resample.h"

#include <math.h>
#include <stdlib.h>

#include "check.h"
#include "file_fixture.h"

static float *random_floats(size_t count, uint64_t seed)
{
	float *numbers = malloc(count * sizeof(*numbers));
	assert_non_null(numbers);
	for (size_t i = 0; i < count; i++)
		numbers[i] = (float)(0.5 + 0.5 * fixture_random(&seed));
	return numbers;
}

/* Weight of source sample i in target sample `at`, from the rule's words. */
static double plain_weight(uint32_t i, uint32_t at, uint32_t source, uint32_t target)
{
	if (source == target)
		return i == at;
	if (source > target) {
		double ratio = (double)source / target;
		double from = fmax(i, at * ratio), to = fmin(i + 1.0, (at + 1) * ratio);
		return to > from ? (to - from) / ratio : 0;
	}
	double position = (at + 0.5) * source / target - 0.5;
	double whole = floor(position), rest = position - whole, weight = 0;
	for (int k = 0; k < 2; k++) {
		double tap = fmin(fmax(whole + k, 0), source - 1.0);
		if (tap == i)
			weight += k ? rest : 1 - rest;
	}
	return weight;
}

static double plain_sample(const float *rgb, uint32_t sw, uint32_t sh, uint32_t dw, uint32_t dh,
			   uint32_t x, uint32_t y, uint32_t channel)
{
	double sum = 0;
	for (uint32_t j = 0; j < sh; j++) {
		double weight = plain_weight(j, y, sh, dh);
		for (uint32_t i = 0; i < sw && weight > 0; i++)
			sum += weight * plain_weight(i, x, sw, dw) *
			       rgb[((size_t)j * sw + i) * 3 + channel];
	}
	return sum;
}

static size_t patch_index(const struct dvsm_patch_plan *plan, uint32_t x, uint32_t y, uint32_t c)
{
	uint32_t q = plan->patch_px;
	size_t token = (size_t)(y / q) * plan->grid.columns + x / q;
	return ((token * q + y % q) * q + x % q) * 3 + c;
}

/* Exactly as much as stated, so that a sanitizer sees more being used. */
static void *make_scratch(const struct dvsm_patch_plan *plan)
{
	void *scratch = malloc(plan->scratch_bytes);
	assert_non_null(scratch);
	return scratch;
}

static void check_both_ways(uint32_t width, uint32_t height, uint32_t q, uint32_t p)
{
	struct dvsm_patch_plan plan = dvsm_patch_plan_make(width, height, q, p);
	uint32_t w = plan.grid.columns * q, h = plan.grid.rows * q;
	float *picture = random_floats((size_t)width * height * 3, 1);
	float *map = random_floats((size_t)w * h * 3, 2); /* row by row */
	float *patches = calloc((size_t)w * h * 3, sizeof(float));
	float *joined = calloc((size_t)width * height * 3, sizeof(float));
	void *scratch = make_scratch(&plan);
	assert_true(patches && joined);

	dvsm_patch_cut_rows(&plan, picture, 0, plan.grid.rows, patches, scratch);
	for (uint32_t y = 0; y < h; y++)
		for (uint32_t x = 0; x < w; x++)
			for (uint32_t c = 0; c < 3; c++) {
				double expected =
					2 * plain_sample(picture, width, height, w, h, x, y, c) - 1;
				float is = patches[patch_index(&plan, x, y, c)];
				assert_true(fabs(is - expected) <= 1.3e-7);
			}

	for (uint32_t y = 0; y < h; y++)
		for (uint32_t x = 0; x < w; x++)
			for (uint32_t c = 0; c < 3; c++)
				patches[patch_index(&plan, x, y, c)] =
					map[((size_t)y * w + x) * 3 + c];
	dvsm_patch_join_rows(&plan, patches, 0, height, joined, scratch);
	for (uint32_t y = 0; y < height; y++)
		for (uint32_t x = 0; x < width; x++)
			for (uint32_t c = 0; c < 3; c++) {
				double expected = plain_sample(map, w, h, width, height, x, y, c);
				float is = joined[((size_t)y * width + x) * 3 + c];
				assert_true(fabs(is - expected) <= 1.3e-7);
			}
	free(picture);
	free(map);
	free(patches);
	free(joined);
	free(scratch);
}

static void both_ways_agree_with_the_plain_rule(void **state)
{
	(void)state;
	check_both_ways(16, 16, 4, 4); /* equal */
	check_both_ways(48, 32, 4, 8); /* half */
	check_both_ways(16, 8, 4, 2);  /* double */
	check_both_ways(51, 37, 8, 8); /* a little smaller and larger */
	check_both_ways(19, 23, 4, 7); /* odd ratios */
	check_both_ways(7, 40, 8, 16); /* one axis each way */
	check_both_ways(1, 1, 8, 8);
	check_both_ways(3, 2, 1, 16); /* to a single pixel */
	check_both_ways(1, 29, 3, 5);
}

static void equal_sizes_are_copied_bit_by_bit(void **state)
{
	(void)state;
	struct dvsm_patch_plan plan = dvsm_patch_plan_make(24, 16, 8, 8);
	float *picture = random_floats(24 * 16 * 3, 3), patches[24 * 16 * 3], back[24 * 16 * 3];
	void *scratch = make_scratch(&plan);
	dvsm_patch_cut_rows(&plan, picture, 0, plan.grid.rows, patches, scratch);
	for (uint32_t y = 0; y < 16; y++)
		for (uint32_t x = 0; x < 24; x++)
			for (uint32_t c = 0; c < 3; c++)
				assert_true(patches[patch_index(&plan, x, y, c)] ==
					    (float)(2.0 * picture[(y * 24 + x) * 3 + c] - 1));
	dvsm_patch_join_rows(&plan, patches, 0, 16, back, scratch);
	for (uint32_t i = 0; i < 24 * 16 * 3; i++)
		assert_true(back[i] == (float)(2.0 * picture[i] - 1));
	free(picture);
	free(scratch);
}

static void a_constant_picture_stays_constant(void **state)
{
	(void)state;
	struct dvsm_patch_plan plan = dvsm_patch_plan_make(101, 77, 8, 9);
	size_t pixels = (size_t)plan.grid.columns * plan.grid.rows * 64;
	float *picture = malloc(101 * 77 * 3 * sizeof(float));
	float *patches = malloc(pixels * 3 * sizeof(float));
	void *scratch = make_scratch(&plan);
	assert_true(picture && patches);
	for (size_t i = 0; i < 101 * 77 * 3; i++)
		picture[i] = 0.75f;
	dvsm_patch_cut_rows(&plan, picture, 0, plan.grid.rows, patches, scratch);
	for (size_t i = 0; i < pixels * 3; i++)
		assert_true(patches[i] == 0.5f);
	dvsm_patch_join_rows(&plan, patches, 0, 77, picture, scratch);
	for (size_t i = 0; i < 101 * 77 * 3; i++)
		assert_true(picture[i] == 0.5f);
	free(picture);
	free(patches);
	free(scratch);
}

static void any_share_of_the_rows_gives_the_same_bits(void **state)
{
	(void)state;
	struct dvsm_patch_plan plan = dvsm_patch_plan_make(50, 41, 4, 6);
	size_t picture_floats = 50 * 41 * 3;
	size_t map_floats = dvsm_token_grid_count(plan.grid) * 16 * 3;
	float *picture = random_floats(picture_floats, 5);
	float *whole = calloc(map_floats + picture_floats, sizeof(float));
	float *shared = calloc(map_floats + picture_floats, sizeof(float));
	void *scratch = make_scratch(&plan);
	assert_true(whole && shared);

	dvsm_patch_cut_rows(&plan, picture, 0, plan.grid.rows, whole, scratch);
	for (uint32_t row = plan.grid.rows; row-- > 0;)
		dvsm_patch_cut_rows(&plan, picture, row, 1, shared, scratch);
	dvsm_patch_join_rows(&plan, whole, 0, 41, whole + map_floats, scratch);
	for (uint32_t row = 0; row < 41; row += 4)
		dvsm_patch_join_rows(&plan, whole, row, row + 4 > 41 ? 41 - row : 4,
				     shared + map_floats, scratch);
	assert_memory_equal(whole, shared, (map_floats + picture_floats) * sizeof(float));
	free(picture);
	free(whole);
	free(shared);
	free(scratch);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(both_ways_agree_with_the_plain_rule),
		cmocka_unit_test(equal_sizes_are_copied_bit_by_bit),
		cmocka_unit_test(a_constant_picture_stays_constant),
		cmocka_unit_test(any_share_of_the_rows_gives_the_same_bits),
	};
	return cmocka_run_group_tests(tests, NULL, NULL);
}
