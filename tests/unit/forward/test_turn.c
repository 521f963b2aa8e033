/* What the fixed-point path does to weights and activations before they are rounded. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "fixed/fine.h"
#include "fixed/turn.h"
#include "kernels/fixed.h"
#include "support/random.h"

enum { MOST = 1024, SEED = 20261129 };

static const size_t counts[] = {1, 2, 3, 4, 9, 36, 64, 128, 256, 384, 768, MOST};

static void turning_twice_gives_back_and_keeps_lengths(void **state)
{
	struct support_random random = {SEED};

	(void)state;
	for (size_t c = 0; c < sizeof(counts) / sizeof(counts[0]); c++) {
		double x[MOST], y[MOST], before = 0, after = 0;

		for (size_t i = 0; i < counts[c]; i++) {
			x[i] = y[i] = support_random_unit(&random);
			before += x[i] * x[i];
		}
		dvsm_fixed_turn(y, counts[c], 1);
		for (size_t i = 0; i < counts[c]; i++)
			after += y[i] * y[i];
		assert_true(fabs(after - before) < 1e-12 * before);
		dvsm_fixed_turn(y, counts[c], 1);
		for (size_t i = 0; i < counts[c]; i++)
			assert_true(fabs(y[i] - x[i]) < 1e-13);
	}
}

static void equal_numbers_stay_and_an_outlier_is_spread(void **state)
{
	double x[256];

	(void)state;
	for (size_t i = 0; i < 256; i++)
		x[i] = 3;
	dvsm_fixed_turn(x, 256, 1);
	for (size_t i = 0; i < 256; i++)
		assert_true(x[i] == 3);
	memset(x, 0, sizeof(x));
	x[77] = 16;
	dvsm_fixed_turn(x, 256, 1);
	for (size_t i = 0; i < 256; i++)
		assert_true(fabs(x[i]) == 1);
}

static void vectors_and_integers_turn_alike(void **state)
{
	struct support_random random = {SEED};

	(void)state;
	for (size_t c = 0; c < sizeof(counts) / sizeof(counts[0]); c++) {
		double x[MOST], wide[3 * MOST];
		int32_t numbers[MOST];

		for (size_t i = 0; i < counts[c]; i++) {
			numbers[i] = (int32_t)(support_random_unit(&random) * (1 << 15));
			x[i] = wide[3 * i + 1] = numbers[i];
			wide[3 * i] = wide[3 * i + 2] = 1;
		}
		dvsm_fixed_turn(x, counts[c], 1);
		dvsm_fixed_turn(wide, counts[c], 3);
		dvsm_fixed_turn_integers(numbers, counts[c]);
		for (size_t i = 0; i < counts[c]; i++) {
			assert_true(x[i] == wide[3 * i + 1]);
			assert_true(wide[3 * i] == 1 && wide[3 * i + 2] == 1);
			assert_true(ldexp(x[i], dvsm_fixed_turn_stages(counts[c])) == numbers[i]);
		}
	}
}

/* A row to its planes; returns up. */
static int split(const int16_t *x, size_t count, size_t plane, int8_t *planes)
{
	struct dvsm_fixed_scale scale;
	const struct dvsm_fixed_split job = {.x = x,
					     .x_stride = count,
					     .rows = 1,
					     .dim = count,
					     .planes = planes,
					     .plane = plane,
					     .a_scale = &scale};

	dvsm_fixed_kernels_scalar.split(&job);
	assert_int_equal(scale.mantissa, 1 << 14);
	return 8 - 14 - scale.exponent;
}

/* Both planes together against the numbers, of any size; every step of 16 bits is one of 256. */
static void planes_hold_twelve_bits(void **state)
{
	struct support_random random = {SEED};
	int16_t x[100];
	int8_t planes[2 * 128];

	(void)state;
	for (int size = 1; size <= 32767; size += size / 3 + 1) {
		for (size_t i = 0; i < 100; i++)
			x[i] = (int16_t)floor(support_random_unit(&random) * (float)size);
		x[37] = (int16_t)size;
		x[38] = (int16_t)-size;
		memset(planes, 0x55, sizeof(planes));

		int up = split(x, 100, 128, planes);

		for (size_t i = 0; i < 128; i++) {
			int number = i < 100 ? x[i] * (1 << up) : 0;
			int planar = planes[i] * 256 + planes[128 + i] * 16;

			assert_true(abs(number - planar) <= 8);
			assert_true(planes[i] >= -128 && planes[128 + i] <= 16);
		}
	}
}

static void planes_of_a_norm_are_joined(void **state)
{
	int8_t high[64], low[64], planes[128];

	(void)state;
	for (int first = -(1 << 14); first <= 1 << 14; first += 64) {
		for (int i = 0; i < 64; i++) {
			int number = first + i <= 1 << 14 ? first + i : 1 << 14;

			high[i] = (int8_t)((number + 128) >> 8);
			low[i] = (int8_t)(number - high[i] * 256);
		}
		dvsm_fixed_fine_join(high, low, 64, planes);
		for (int i = 0; i < 64; i++)
			assert_true(abs(high[i] * 256 + low[i] - planes[i] * 128 -
					planes[64 + i] * 8) <= 4);
	}
}

/* Where a key's numbers are among packed ones of `width` numbers a key. */
static size_t packed_at(size_t key, size_t d, size_t width)
{
	return key / 16 * 16 * width + d / 4 * 64 + key % 16 * 4 + d % 4;
}

/* 16 q k of an exact query is what both planes make, but for what R(k, 4) leaves: a half for each
 * of up to 8. */
static void fine_queries_meet_keys_in_planes(void **state)
{
	static const size_t dims[] = {9, 16, 32, 64, 80, 128};
	struct support_random random = {SEED};

	(void)state;
	for (size_t c = 0; c < sizeof(dims) / sizeof(dims[0]); c++) {
		const size_t dim = dims[c], padded = DVSM_FIXED_KEY_PAD;
		const size_t width = dvsm_fixed_pad(dim, DVSM_FIXED_HEAD);
		const size_t fine_width = dvsm_fixed_fine_width(dim);
		int8_t *keys = calloc(padded, width), *fine = malloc(padded * fine_width);
		int16_t query[128];

		assert_non_null(keys);
		assert_non_null(fine);
		for (size_t key = 0; key < padded; key++)
			for (size_t d = 0; d < dim; d++)
				keys[packed_at(key, d, width)] =
					(int8_t)(254 * support_random_unit(&random) - 127);
		for (size_t d = 0; d < dim; d++)
			query[d] = (int16_t)(4000 * support_random_unit(&random) - 2000);
		dvsm_fixed_fine_keys(keys, padded, dim, fine);
		for (size_t key = 0; key < padded; key++) {
			int exact = 0, made = 0;

			for (size_t d = 0; d < fine_width / 2; d++) {
				const int high = d < dim ? (query[d] + 8) >> 4 : 0;
				const int low = d < dim ? query[d] - 16 * high : 1;
				const size_t at = packed_at(key, d, fine_width);

				exact += d < dim ? query[d] * keys[packed_at(key, d, width)] : 0;
				made += high * fine[at];
				made += low * fine[packed_at(key, fine_width / 2 + d, fine_width)];
			}
			assert_true(abs(exact - 16 * made) <= 16 * 4 * (int)dim);
		}
		free(keys);
		free(fine);
	}
}

static void nothing_and_the_most_negative_number_are_split(void **state)
{
	const int16_t zeros[4] = {0}, lowest[4] = {INT16_MIN, 0, 0, 0};
	int8_t planes[128];

	(void)state;
	split(zeros, 4, 64, planes);
	for (size_t i = 0; i < 128; i++)
		assert_int_equal(planes[i], 0);
	assert_int_equal(split(lowest, 4, 64, planes), 0);
	assert_int_equal(planes[0], -128);
	assert_int_equal(planes[64], 0);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(turning_twice_gives_back_and_keeps_lengths),
		cmocka_unit_test(equal_numbers_stay_and_an_outlier_is_spread),
		cmocka_unit_test(vectors_and_integers_turn_alike),
		cmocka_unit_test(planes_hold_twelve_bits),
		cmocka_unit_test(planes_of_a_norm_are_joined),
		cmocka_unit_test(fine_queries_meet_keys_in_planes),
		cmocka_unit_test(nothing_and_the_most_negative_number_are_split),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
