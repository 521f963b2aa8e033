/* The option table: values land in their targets, wrong ones are refused. */
#include "unit/app/fixture.h"

#include <stdio.h>
#include <string.h>

#include "core/options.h"
#include "core/session.h"

struct values {
	bool flag;
	const char *text;
	uint32_t count, patch, tier;
	double real;
	enum dvsm_precision precision;
	enum dio_deblock deblock;
};

static enum dio_options_result parse(struct values *values, int argc, const char **argv,
				     char ***arguments, uint32_t *count)
{
	const struct dio_option options[] = {
		{"flag", DIO_OPTION_FLAG, NULL, "a flag", &values->flag, 0, 0, false},
		{"text", DIO_OPTION_TEXT, "FILE", "a text", &values->text, 0, 0, true},
		{"count", DIO_OPTION_COUNT, "N", "a count", &values->count, 1, 10, false},
		{"real", DIO_OPTION_REAL, "X", "a real", &values->real, -1, 1, false},
		{"patch", DIO_OPTION_PATCH, "P", "a patch", &values->patch, 0, 0, false},
		{"tier", DIO_OPTION_TIER, "T", "a tier", &values->tier, 0, 0, false},
		{"precision", DIO_OPTION_ARITHMETIC, "P", "arithmetic", &values->precision, 0, 0,
		 false},
		{"deblock", DIO_OPTION_DEBLOCK, "WHEN", "deblocking", &values->deblock, 0, 0,
		 false},
	};
	const struct dio_usage usage = {
		.command = "try",
		.summary = "for tests",
		.arguments = "IN",
		.min_arguments = 1,
		.max_arguments = 2,
		.options = options,
		.option_count = sizeof options / sizeof *options,
	};

	return dio_options_parse(&usage, argc, (char **)(uintptr_t)argv, arguments, count);
}

#define PARSE(...)                                                                                 \
	parse(&values, (int)(sizeof(const char *[]){"try", __VA_ARGS__} / sizeof(char *)),         \
	      (const char *[]){"try", __VA_ARGS__, NULL}, &arguments, &count)

static void values_land_in_their_targets(void **state)
{
	struct values values = {.patch = 9};
	char **arguments;
	uint32_t count;

	(void)state;
	assert_int_equal(PARSE("in.json", "--text", "t", "--count=7", "--flag", "--real", "-0.5",
			       "--patch", "auto", "--tier", "scalar", "--precision", "fixed",
			       "--deblock", "off", "more"),
			 DIO_OPTIONS_RUN);
	assert_true(values.flag);
	assert_string_equal(values.text, "t");
	assert_int_equal(values.count, 7);
	assert_float_equal(values.real, -0.5, 0);
	assert_int_equal(values.patch, 0);
	assert_int_equal(values.tier, DVSM_CPU_SCALAR);
	assert_int_equal(values.precision, DVSM_PRECISION_FIXED);
	assert_int_equal(values.deblock, DIO_DEBLOCK_OFF);
	assert_int_equal(count, 2);
	assert_string_equal(arguments[0], "in.json");
	assert_string_equal(arguments[1], "more");
}

static void absent_options_keep_their_default(void **state)
{
	struct values values = {.count = 3, .real = 0.25};
	char **arguments;
	uint32_t count;

	(void)state;
	assert_int_equal(PARSE("--text", "t", "--", "--flag"), DIO_OPTIONS_RUN);
	assert_int_equal(values.count, 3);
	assert_float_equal(values.real, 0.25, 0);
	assert_false(values.flag);
	assert_string_equal(arguments[0], "--flag");
}

static void wrong_values_are_refused(void **state)
{
	struct values values = {0};
	char **arguments;
	uint32_t count;

	(void)state;
	assert_int_equal(PARSE("x", "--text", "t", "--count", "11"), DIO_OPTIONS_WRONG);
	assert_int_equal(PARSE("x", "--text", "t", "--count", "0"), DIO_OPTIONS_WRONG);
	assert_int_equal(PARSE("x", "--text", "t", "--count", "2.5"), DIO_OPTIONS_WRONG);
	assert_int_equal(PARSE("x", "--text", "t", "--count", "3x"), DIO_OPTIONS_WRONG);
	assert_int_equal(PARSE("x", "--text", "t", "--count", ""), DIO_OPTIONS_WRONG);
	assert_int_equal(PARSE("x", "--text", "t", "--real", "nan"), DIO_OPTIONS_WRONG);
	assert_int_equal(PARSE("x", "--text", "t", "--real", "1.01"), DIO_OPTIONS_WRONG);
	assert_int_equal(PARSE("x", "--text", "t", "--patch", "257"), DIO_OPTIONS_WRONG);
	assert_int_equal(PARSE("x", "--text", "t", "--patch", "0"), DIO_OPTIONS_WRONG);
	assert_int_equal(PARSE("x", "--text", "t", "--tier", "sse9"), DIO_OPTIONS_WRONG);
	assert_int_equal(PARSE("x", "--text", "t", "--precision", "f16"), DIO_OPTIONS_WRONG);
	assert_int_equal(PARSE("x", "--text", "t", "--deblock", "yes"), DIO_OPTIONS_WRONG);
	assert_int_equal(PARSE("x", "--text", ""), DIO_OPTIONS_WRONG);
	assert_int_equal(PARSE("x", "--flag=1", "--text", "t"), DIO_OPTIONS_WRONG);
	assert_int_equal(PARSE("x", "--nothing", "--text", "t"), DIO_OPTIONS_WRONG);
	assert_int_equal(PARSE("x", "--text"), DIO_OPTIONS_WRONG);
	assert_int_equal(PARSE("x"), DIO_OPTIONS_WRONG);
	assert_int_equal(PARSE("--text", "t"), DIO_OPTIONS_WRONG);
	assert_int_equal(PARSE("a", "b", "c", "--text", "t"), DIO_OPTIONS_WRONG);
}

static void a_tier_that_the_cpu_lacks_is_refused(void **state)
{
	struct values values = {0};
	char **arguments;
	uint32_t count;

	(void)state;
	/* No CPU has both; the foreign one has to be refused, not run as something else. */
	if (dvsm_cpu_detect() & DVSM_CPU_NEON)
		assert_int_equal(PARSE("x", "--text", "t", "--tier", "avx2"), DIO_OPTIONS_WRONG);
	else
		assert_int_equal(PARSE("x", "--text", "t", "--tier", "neon"), DIO_OPTIONS_WRONG);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(values_land_in_their_targets),
		cmocka_unit_test(absent_options_keep_their_default),
		cmocka_unit_test(wrong_values_are_refused),
		cmocka_unit_test(a_tier_that_the_cpu_lacks_is_refused),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
