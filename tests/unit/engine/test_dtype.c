#include "files/dtype.h"

#include <math.h>
#include <string.h>

#include "check.h"

/* Every half there is, against the definition of IEEE 754 binary16. */
static void every_half_becomes_the_float_it_stands_for(void **state)
{
	(void)state;
	for (uint32_t image = 0; image < 0x10000; image++) {
		uint16_t half = (uint16_t)image;
		int exponent = half >> 10 & 31, fraction = half & 1023;
		bool is_finite = exponent != 31;
		assert_int_equal(dvsm_dtype_find_non_finite(DVSM_DTYPE_F16, &half, 1), is_finite);
		if (!is_finite)
			continue;
		double magnitude =
			exponent ? ldexp(1024 + fraction, exponent - 25) : ldexp(fraction, -24);
		float out;
		dvsm_dtype_expand(DVSM_DTYPE_F16, &half, 1, &out);
		assert_true((double)out == (half & 0x8000 ? -magnitude : magnitude));
		assert_int_equal(signbit(out) != 0, half >> 15);
	}
}

static void every_bfloat_becomes_the_float_with_its_bits_on_top(void **state)
{
	(void)state;
	for (uint32_t image = 0; image < 0x10000; image++) {
		uint16_t bfloat = (uint16_t)image;
		uint32_t back;
		float out;
		dvsm_dtype_expand(DVSM_DTYPE_BF16, &bfloat, 1, &out);
		memcpy(&back, &out, sizeof(back));
		assert_int_equal(back, image << 16);
		assert_int_equal(dvsm_dtype_find_non_finite(DVSM_DTYPE_BF16, &bfloat, 1),
				 isfinite(out) ? 1 : 0);
	}
}

static void the_first_non_finite_number_is_found(void **state)
{
	(void)state;
	float floats[5] = {1, -3e38f, 1e-45f, 0, 2};
	double doubles[3] = {1e308, 0, -1};
	assert_int_equal(dvsm_dtype_find_non_finite(DVSM_DTYPE_F32, floats, 5), 5);
	assert_int_equal(dvsm_dtype_find_non_finite(DVSM_DTYPE_F64, doubles, 3), 3);
	floats[3] = -INFINITY;
	floats[4] = NAN;
	doubles[2] = NAN;
	assert_int_equal(dvsm_dtype_find_non_finite(DVSM_DTYPE_F32, floats, 5), 3);
	assert_int_equal(dvsm_dtype_find_non_finite(DVSM_DTYPE_F64, doubles, 3), 2);
	assert_int_equal(dvsm_dtype_find_non_finite(DVSM_DTYPE_I32, floats, 5), 5);
}

static void the_largest_magnitude_is_found_in_every_weight_type(void **state)
{
	(void)state;
	const float floats[] = {1, -3e38f, 1e-45f, 0, 2};
	const uint16_t halves[] = {0x3c00, 0xfbff, 0x0001, 0x7800}; /* 1, -65504, 2^-24, 32768 */
	const uint16_t bfloats[] = {0x3f80, 0x0001, 0xc000};        /* 1, 2^-133, -2 */
	assert_true(dvsm_dtype_find_largest(DVSM_DTYPE_F32, floats, 5) == 3e38f);
	assert_true(dvsm_dtype_find_largest(DVSM_DTYPE_F32, floats + 2, 2) == 1e-45f);
	assert_true(dvsm_dtype_find_largest(DVSM_DTYPE_F16, halves, 4) == 65504);
	assert_true(dvsm_dtype_find_largest(DVSM_DTYPE_F16, halves + 2, 1) == 0x1p-24f);
	assert_true(dvsm_dtype_find_largest(DVSM_DTYPE_BF16, bfloats, 3) == 2);
	assert_true(dvsm_dtype_find_largest(DVSM_DTYPE_F32, floats, 0) == 0);
}

static void names_and_types_match_both_ways(void **state)
{
	(void)state;
	for (int i = DVSM_DTYPE_BOOL; i <= DVSM_DTYPE_U64; i++) {
		enum dvsm_dtype dtype;
		assert_true(dvsm_dtype_parse(dvsm_dtype_name((enum dvsm_dtype)i), &dtype));
		assert_int_equal(dtype, i);
	}
	enum dvsm_dtype dtype;
	assert_false(dvsm_dtype_parse("f32", &dtype));
	assert_false(dvsm_dtype_parse("", &dtype));
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(every_half_becomes_the_float_it_stands_for),
		cmocka_unit_test(every_bfloat_becomes_the_float_with_its_bits_on_top),
		cmocka_unit_test(the_first_non_finite_number_is_found),
		cmocka_unit_test(the_largest_magnitude_is_found_in_every_weight_type),
		cmocka_unit_test(names_and_types_match_both_ways),
	};
	return cmocka_run_group_tests(tests, NULL, NULL);
}
