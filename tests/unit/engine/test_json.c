#include "files/json.h"

#include <locale.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "check.h"

/* Parse a copy of exactly this size, so that a sanitizer sees a read beyond the end. */
static bool parse(const char *text, size_t size, struct dvsm_json *json,
		  struct dvsm_json_fault *fault)
{
	char *copy = malloc(size ? size : 1);
	assert_non_null(copy);
	memcpy(copy, text, size);
	bool ok = dvsm_json_init(json, copy, size, fault);
	free(copy);
	return ok;
}

static void assert_refused(const char *text, const char *what)
{
	struct dvsm_json json;
	struct dvsm_json_fault fault;
	if (parse(text, strlen(text), &json, &fault))
		fail_msg("taken: %s", text);
	if (!strstr(fault.what, what))
		fail_msg("%s: \"%s\" does not say \"%s\"", text, fault.what, what);
	assert_null(json.values);
	assert_true(fault.byte <= strlen(text));
}

static void a_document_reads_back_as_written(void **state)
{
	(void)state;
	static const char text[] = " {\"a\": [1, -2.5e2, true, false, null, {}, []],\n"
				   "\t\"b\" : {\"c\":\"d\"}, \"big\": 18446744073709551615,"
				   "\"bigger\": 18446744073709551616, \"zero\": 0, \"neg\": -1 } ";
	struct dvsm_json json;
	struct dvsm_json_fault fault;
	assert_true(parse(text, strlen(text), &json, &fault));
	const struct dvsm_json_value *root = &json.values[0];
	const struct dvsm_json_value *a = dvsm_json_find(&json, root, "a");
	assert_int_equal(root->children, 6);
	assert_int_equal(a->children, 7);

	const struct dvsm_json_value *item = dvsm_json_first(&json, a);
	assert_true(item->is_count && item->count == 1);
	item = dvsm_json_next(&json, item);
	assert_true(item->type == DVSM_JSON_NUMBER && !item->is_count && item->number == -250);
	static const enum dvsm_json_type rest[] = {DVSM_JSON_BOOL, DVSM_JSON_BOOL, DVSM_JSON_NULL,
						   DVSM_JSON_OBJECT, DVSM_JSON_ARRAY};
	for (int i = 0; i < 5; i++) {
		item = dvsm_json_next(&json, item);
		assert_int_equal(item->type, rest[i]);
		assert_int_equal(item->boolean, i == 0);
	}
	assert_null(dvsm_json_next(&json, item));

	const struct dvsm_json_value *b = dvsm_json_find(&json, root, "b");
	assert_string_equal(dvsm_json_find(&json, b, "c")->text, "d");
	assert_true(dvsm_json_find(&json, root, "big")->count == UINT64_MAX);
	assert_false(dvsm_json_find(&json, root, "bigger")->is_count);
	assert_true(dvsm_json_find(&json, root, "zero")->is_count);
	assert_false(dvsm_json_find(&json, root, "neg")->is_count);
	assert_null(dvsm_json_find(&json, root, "missing"));
	assert_null(dvsm_json_find(&json, a, "b"));
	dvsm_json_deinit(&json);
}

static void strings_are_unescaped_to_utf8(void **state)
{
	(void)state;
	static const char text[] = "[\"\\\"\\\\\\/\\b\\f\\n\\r\\t\", \"\\u0041\\u00e9\\u20ac\", "
				   "\"\\ud83d\\ude00\", \"\xc3\xa9\xe2\x82\xac\xf0\x9f\x98\x80\"]";
	struct dvsm_json json;
	struct dvsm_json_fault fault;
	assert_true(parse(text, strlen(text), &json, &fault));
	const struct dvsm_json_value *item = dvsm_json_first(&json, &json.values[0]);
	assert_string_equal(item->text, "\"\\/\b\f\n\r\t");
	item = dvsm_json_next(&json, item);
	assert_string_equal(item->text, "A\xc3\xa9\xe2\x82\xac");
	item = dvsm_json_next(&json, item);
	assert_string_equal(item->text, "\xf0\x9f\x98\x80");
	item = dvsm_json_next(&json, item);
	assert_string_equal(item->text, "\xc3\xa9\xe2\x82\xac\xf0\x9f\x98\x80");
	dvsm_json_deinit(&json);
}

static void text_that_is_not_json_is_refused_with_the_fault(void **state)
{
	(void)state;
	static const struct {
		const char *text, *what;
	} cases[] = {
		{"", "early end"},
		{"  ", "early end"},
		{"{", "without a key"},
		{"[", "early end"},
		{"[1", "early end"},
		{"[1,", "early end"},
		{"[1,]", "no JSON value"},
		{"[,1]", "no JSON value"},
		{"[1 2]", "missing comma"},
		{"[1}", "missing comma"},
		{"{\"a\":1]", "missing comma"},
		{"{\"a\":1,}", "without a key"},
		{"{a:1}", "without a key"},
		{"{\"a\" 1}", "without a colon"},
		{"{\"a\":}", "no JSON value"},
		{"{\"a\":1,\"a\":2}", "a key twice"},
		{"{\"a\":1,\"b\":2,\"\\u0061\":3}", "a key twice"},
		{"1 2", "after the end"},
		{"{}{}", "after the end"},
		{"nul", "no JSON value"},
		{"truth", "no JSON value"},
		{"'a'", "no JSON value"},
		{"NaN", "no JSON value"},
		{"Infinity", "no JSON value"},
		{"-", "without digits"},
		{"01", "leading zero"},
		{"-01", "leading zero"},
		{"1.", "without digits"},
		{".5", "no JSON value"},
		{"1e", "without digits"},
		{"1e+", "without digits"},
		{"+1", "no JSON value"},
		{"0x10", "after the end"},
		{"1e999", "beyond the range"},
		{"\"a", "without an end"},
		{"\"a\\", "unknown escape"},
		{"\"\\x41\"", "unknown escape"},
		{"\"\\u12", "four hex digits"},
		{"\"\\u12g4\"", "four hex digits"},
		{"\"\\ud800\"", "lone surrogate"},
		{"\"\\ud800\\u0041\"", "lone surrogate"},
		{"\"\\udc00\"", "lone surrogate"},
		{"\"\\u0000\"", "\\u0000"},
		{"\"a\nb\"", "control character"},
		{"\"\x80\"", "UTF-8"},
		{"\"\xc0\xaf\"", "UTF-8"},
		{"\"\xe0\x80\xaf\"", "UTF-8"},
		{"\"\xed\xa0\x80\"", "UTF-8"},
		{"\"\xf4\x90\x80\x80\"", "UTF-8"},
		{"\"\xf8\x88\x80\x80\x80\"", "UTF-8"},
		{"\"\xe2\x82", "UTF-8"},
		{"\"\xf0", "UTF-8"},
	};
	for (size_t i = 0; i < sizeof(cases) / sizeof(cases[0]); i++)
		assert_refused(cases[i].text, cases[i].what);
}

static void a_null_byte_ends_nothing(void **state)
{
	(void)state;
	static const char *const texts[] = {"{}\0", "[\0]", "\"\0\""};
	static const size_t sizes[] = {3, 3, 3};
	for (int i = 0; i < 3; i++) {
		struct dvsm_json json;
		struct dvsm_json_fault fault;
		assert_false(parse(texts[i], sizes[i], &json, &fault));
	}
}

static void nesting_is_taken_to_its_limit_and_no_deeper(void **state)
{
	(void)state;
	char text[2000];
	for (int depth = 31; depth <= 1000; depth += depth < 33 ? 1 : 967) {
		memset(text, '[', (size_t)depth);
		memset(text + depth, ']', (size_t)depth);
		struct dvsm_json json;
		struct dvsm_json_fault fault;
		bool ok = parse(text, 2 * (size_t)depth, &json, &fault);
		assert_int_equal(ok, depth <= 32);
		dvsm_json_deinit(&json);
	}
}

static void very_many_values_are_refused_without_taking_much_memory(void **state)
{
	(void)state;
	size_t size = (size_t)8 << 20;
	char *text = malloc(size);
	assert_non_null(text);
	for (size_t i = 0; i < size; i++)
		text[i] = i % 2 ? '0' : ',';
	text[0] = '[';
	struct dvsm_json json;
	struct dvsm_json_fault fault;
	assert_false(dvsm_json_init(&json, text, size, &fault));
	assert_non_null(strstr(fault.what, "a million values"));
	free(text);
}

static void numbers_do_not_depend_on_the_locale(void **state)
{
	(void)state;
	/* Where no locale with a decimal comma is installed, this checks the C locale alone. */
	static const char *const names[] = {"de_DE.UTF-8", "fr_FR.UTF-8", "de_DE", "C"};
	size_t i = 0;
	while (!setlocale(LC_ALL, names[i]))
		i++;
	struct dvsm_json json;
	struct dvsm_json_fault fault;
	assert_true(parse("[0.5]", 5, &json, &fault));
	assert_true(dvsm_json_first(&json, &json.values[0])->number == 0.5);
	dvsm_json_deinit(&json);
	setlocale(LC_ALL, "C");
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(a_document_reads_back_as_written),
		cmocka_unit_test(strings_are_unescaped_to_utf8),
		cmocka_unit_test(text_that_is_not_json_is_refused_with_the_fault),
		cmocka_unit_test(a_null_byte_ends_nothing),
		cmocka_unit_test(nesting_is_taken_to_its_limit_and_no_deeper),
		cmocka_unit_test(very_many_values_are_refused_without_taking_much_memory),
		cmocka_unit_test(numbers_do_not_depend_on_the_locale),
	};
	return cmocka_run_group_tests(tests, NULL, NULL);
}
