#include "files/json.h"

#include <locale.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#define MAX_DEPTH  32
#define MAX_VALUES (1u << 20)

struct parser {
	struct dvsm_json *json;
	struct dvsm_json_fault *fault;
	char *begin, *at, *end; /* *end is a terminator of ours */
	locale_t c_locale; /* numbers have a point whatever the caller's locale; made on need */
	uint32_t open[MAX_DEPTH];
	uint32_t last_child[MAX_DEPTH];
	int depth;
};

static bool fail(struct parser *p, const char *what)
{
	p->fault->what = what;
	p->fault->byte = (size_t)(p->at - p->begin);
	return false;
}

static bool fail_memory(struct parser *p)
{
	p->fault->no_memory = true;
	return fail(p, "out of memory");
}

static void skip_space(struct parser *p)
{
	while (*p->at == ' ' || *p->at == '\t' || *p->at == '\n' || *p->at == '\r')
		p->at++;
}

/* Length of the well-formed UTF-8 sequence at `s` (RFC 3629), 0 when there is none. */
static int utf8_length(const char *text)
{
	const unsigned char *s = (const unsigned char *)text;
	int length;
	unsigned char low = 0x80, high = 0xbf; /* range of the second byte */
	if (s[0] < 0x80)
		return 1;
	if (s[0] >= 0xc2 && s[0] <= 0xdf)
		length = 2;
	else if (s[0] >= 0xe0 && s[0] <= 0xef)
		length = 3;
	else if (s[0] >= 0xf0 && s[0] <= 0xf4)
		length = 4;
	else
		return 0;
	if (s[0] == 0xe0)
		low = 0xa0; /* overlong */
	else if (s[0] == 0xed)
		high = 0x9f; /* surrogates */
	else if (s[0] == 0xf0)
		low = 0x90; /* overlong */
	else if (s[0] == 0xf4)
		high = 0x8f; /* beyond U+10FFFF */
	if (s[1] < low || s[1] > high)
		return 0;
	for (int i = 2; i < length; i++) {
		if ((s[i] & 0xc0) != 0x80)
			return 0;
	}
	return length;
}

static char *utf8_put(char *out, uint32_t code)
{
	if (code < 0x80) {
		*out++ = (char)code;
	} else if (code < 0x800) {
		*out++ = (char)(0xc0 | code >> 6);
		*out++ = (char)(0x80 | (code & 0x3f));
	} else if (code < 0x10000) {
		*out++ = (char)(0xe0 | code >> 12);
		*out++ = (char)(0x80 | (code >> 6 & 0x3f));
		*out++ = (char)(0x80 | (code & 0x3f));
	} else {
		*out++ = (char)(0xf0 | code >> 18);
		*out++ = (char)(0x80 | (code >> 12 & 0x3f));
		*out++ = (char)(0x80 | (code >> 6 & 0x3f));
		*out++ = (char)(0x80 | (code & 0x3f));
	}
	return out;
}

/* Four hex digits after "\u"; the terminator stops a short one. */
static bool take_hex4(struct parser *p, uint32_t *code)
{
	*code = 0;
	for (int i = 0; i < 4; i++, p->at++) {
		char c = *p->at;
		uint32_t digit;
		if (c >= '0' && c <= '9')
			digit = (uint32_t)(c - '0');
		else if (c >= 'a' && c <= 'f')
			digit = (uint32_t)(c - 'a' + 10);
		else if (c >= 'A' && c <= 'F')
			digit = (uint32_t)(c - 'A' + 10);
		else
			return fail(p, "\\u without four hex digits");
		*code = *code << 4 | digit;
	}
	return true;
}

/* After "\u": one code point, from a surrogate pair where need be. */
static bool take_code_point(struct parser *p, uint32_t *code)
{
	if (!take_hex4(p, code))
		return false;
	if (*code >= 0xdc00 && *code <= 0xdfff)
		return fail(p, "a lone surrogate");
	if (*code >= 0xd800 && *code <= 0xdbff) {
		uint32_t low;
		if (p->at[0] != '\\' || p->at[1] != 'u')
			return fail(p, "a lone surrogate");
		p->at += 2;
		if (!take_hex4(p, &low))
			return false;
		if (low < 0xdc00 || low > 0xdfff)
			return fail(p, "a lone surrogate");
		*code = 0x10000 + ((*code - 0xd800) << 10) + (low - 0xdc00);
	}
	if (*code == 0)
		return fail(p, "\\u0000 in a string");
	return true;
}

/* After the backslash: append what the escape stands for at *out. */
static bool take_escape(struct parser *p, char **out)
{
	static const char names[] = "\"\\/bfnrt", meanings[] = "\"\\/\b\f\n\r\t";
	if (*p->at == 'u') {
		uint32_t code;
		p->at++;
		if (!take_code_point(p, &code))
			return false;
		*out = utf8_put(*out, code);
		return true;
	}
	const char *name = *p->at ? strchr(names, *p->at) : NULL;
	if (!name)
		return fail(p, "an unknown escape");
	*(*out)++ = meanings[name - names];
	p->at++;
	return true;
}

/* A string, unescaped in place: what it stands for is never longer than how it is written. */
static bool take_string(struct parser *p, const char **text)
{
	char *out = ++p->at;
	*text = out;
	while (*p->at != '"') {
		if (p->at == p->end)
			return fail(p, "a string without an end");
		if ((unsigned char)*p->at < ' ')
			return fail(p, "a control character in a string");
		if (*p->at == '\\') {
			p->at++;
			if (!take_escape(p, &out))
				return false;
			continue;
		}
		int length = utf8_length(p->at);
		if (length == 0)
			return fail(p, "bytes that are not UTF-8");
		memmove(out, p->at, (size_t)length);
		out += length;
		p->at += length;
	}
	p->at++;
	*out = '\0';
	return true;
}

static bool is_digit(char c)
{
	return c >= '0' && c <= '9';
}

static bool skip_digits(struct parser *p)
{
	if (!is_digit(*p->at))
		return fail(p, "a number without digits");
	while (is_digit(*p->at))
		p->at++;
	return true;
}

/* Exact value of a run of digits; false when it does not fit. */
static bool count_of(const char *digits, const char *end, uint64_t *count)
{
	uint64_t value = 0;
	for (; digits < end; digits++) {
		if (__builtin_mul_overflow(value, 10, &value) ||
		    __builtin_add_overflow(value, (uint64_t)(*digits - '0'), &value))
			return false;
	}
	*count = value;
	return true;
}

static bool take_number(struct parser *p, struct dvsm_json_value *value)
{
	const char *start = p->at;
	bool whole = *start != '-';
	if (!whole)
		p->at++;
	if (p->at[0] == '0' && is_digit(p->at[1]))
		return fail(p, "a number with a leading zero");
	if (!skip_digits(p))
		return false;
	if (*p->at == '.') {
		whole = false;
		p->at++;
		if (!skip_digits(p))
			return false;
	}
	if (*p->at == 'e' || *p->at == 'E') {
		whole = false;
		p->at++;
		if (*p->at == '+' || *p->at == '-')
			p->at++;
		if (!skip_digits(p))
			return false;
	}

	if (!p->c_locale)
		p->c_locale = newlocale(LC_ALL_MASK, "C", (locale_t)0);
	if (!p->c_locale)
		return fail_memory(p);
	value->type = DVSM_JSON_NUMBER;
	value->number = strtod_l(start, NULL, p->c_locale);
	value->is_count = whole && count_of(start, p->at, &value->count);
	if (!isfinite(value->number))
		return fail(p, "a number beyond the range of a double");
	return true;
}

static bool take_word(struct parser *p, const char *word)
{
	size_t length = strlen(word);
	if ((size_t)(p->end - p->at) < length || memcmp(p->at, word, length) != 0)
		return fail(p, "something that is no JSON value");
	p->at += length;
	return true;
}

static bool grow(struct parser *p)
{
	struct dvsm_json *json = p->json;
	if (json->value_count < json->capacity)
		return true;
	if (json->value_count >= MAX_VALUES)
		return fail(p, "more than a million values");
	uint32_t capacity = json->capacity ? 2 * json->capacity : 64;
	void *values = realloc(json->values, capacity * sizeof(*json->values));
	if (!values)
		return fail_memory(p);
	json->values = values;
	json->capacity = capacity;
	return true;
}

/* A new value, linked behind the last child of the innermost open container. */
static bool append_value(struct parser *p, const char *key, uint32_t *index)
{
	if (!grow(p))
		return false;
	struct dvsm_json_value *values = p->json->values;
	*index = p->json->value_count++;
	values[*index] = (struct dvsm_json_value){
		.key = key,
		.first = DVSM_JSON_NONE,
		.next = DVSM_JSON_NONE,
	};
	if (p->depth > 0) {
		int inner = p->depth - 1;
		if (p->last_child[inner] == DVSM_JSON_NONE)
			values[p->open[inner]].first = *index;
		else
			values[p->last_child[inner]].next = *index;
		p->last_child[inner] = *index;
		values[p->open[inner]].children++;
	}
	return true;
}

static bool open_container(struct parser *p, uint32_t index, enum dvsm_json_type type)
{
	if (p->depth == MAX_DEPTH)
		return fail(p, "nesting more than 32 deep");
	p->at++;
	p->json->values[index].type = type;
	p->open[p->depth] = index;
	p->last_child[p->depth] = DVSM_JSON_NONE;
	p->depth++;
	return true;
}

static bool take_value(struct parser *p, const char *key)
{
	uint32_t index;
	if (!append_value(p, key, &index))
		return false;
	struct dvsm_json_value *value = &p->json->values[index];
	switch (*p->at) {
	case '{':
		return open_container(p, index, DVSM_JSON_OBJECT);
	case '[':
		return open_container(p, index, DVSM_JSON_ARRAY);
	case '"':
		value->type = DVSM_JSON_STRING;
		return take_string(p, &value->text);
	case 't':
		value->type = DVSM_JSON_BOOL;
		value->boolean = true;
		return take_word(p, "true");
	case 'f':
		value->type = DVSM_JSON_BOOL;
		return take_word(p, "false");
	case 'n':
		return take_word(p, "null");
	case '-':
	case '0':
	case '1':
	case '2':
	case '3':
	case '4':
	case '5':
	case '6':
	case '7':
	case '8':
	case '9':
		return take_number(p, value);
	default:
		return fail(p,
			    p->at == p->end ? "an early end" : "something that is no JSON value");
	}
}

static int compare_keys(const void *a, const void *b)
{
	const char *const *left = a, *const *right = b;
	return strcmp(*left, *right);
}

/* Sorting keeps a file with very many keys from costing their square. */
static bool check_duplicates(struct parser *p, const struct dvsm_json_value *object)
{
	if (object->children < 2)
		return true;
	const char **keys = malloc(object->children * sizeof(*keys));
	if (!keys)
		return fail_memory(p);
	size_t count = 0;
	for (uint32_t i = object->first; i != DVSM_JSON_NONE; i = p->json->values[i].next)
		keys[count++] = p->json->values[i].key;
	qsort(keys, count, sizeof(*keys), compare_keys);
	bool unique = true;
	for (size_t i = 1; i < count && unique; i++)
		unique = strcmp(keys[i - 1], keys[i]) != 0;
	free(keys);
	return unique || fail(p, "a key twice in one object");
}

static bool take_key(struct parser *p, const char **key)
{
	if (*p->at != '"')
		return fail(p, "a member without a key");
	if (!take_string(p, key))
		return false;
	skip_space(p);
	if (*p->at != ':')
		return fail(p, "a key without a colon");
	p->at++;
	skip_space(p);
	return true;
}

/* One step inside the innermost open container: its end, or its next child. */
static bool step(struct parser *p)
{
	int inner = p->depth - 1;
	const struct dvsm_json_value *container = &p->json->values[p->open[inner]];
	bool is_object = container->type == DVSM_JSON_OBJECT;
	bool is_first = p->last_child[inner] == DVSM_JSON_NONE;

	if (*p->at == (is_object ? '}' : ']')) {
		p->at++;
		p->depth--;
		return !is_object || check_duplicates(p, container);
	}
	if (!is_first) {
		if (*p->at != ',')
			return fail(p, p->at == p->end ? "an early end" : "a missing comma");
		p->at++;
		skip_space(p);
	}
	const char *key = NULL;
	if (is_object && !take_key(p, &key))
		return false;
	return take_value(p, key);
}

static bool parse(struct parser *p)
{
	skip_space(p);
	if (!take_value(p, NULL))
		return false;
	for (skip_space(p); p->depth > 0; skip_space(p)) {
		if (!step(p))
			return false;
	}
	return p->at == p->end || fail(p, "something after the end");
}

bool dvsm_json_init(struct dvsm_json *json, const char *text, size_t size,
		    struct dvsm_json_fault *fault)
{
	*json = (struct dvsm_json){0};
	*fault = (struct dvsm_json_fault){0};
	struct parser p = {.json = json, .fault = fault};

	/* Terminators to spare: the longest look ahead is a four-byte UTF-8 sequence. */
	json->text = size < SIZE_MAX - 4 ? malloc(size + 4) : NULL;
	if (!json->text)
		return fail_memory(&p);
	if (size)
		memcpy(json->text, text, size);
	memset(json->text + size, 0, 4);
	p.begin = p.at = json->text;
	p.end = json->text + size;

	bool ok = parse(&p);
	if (p.c_locale)
		freelocale(p.c_locale);
	if (!ok)
		dvsm_json_deinit(json);
	return ok;
}

void dvsm_json_deinit(struct dvsm_json *json)
{
	free(json->values);
	free(json->text);
	*json = (struct dvsm_json){0};
}

const struct dvsm_json_value *dvsm_json_find(const struct dvsm_json *json,
					     const struct dvsm_json_value *object, const char *key)
{
	if (object->type != DVSM_JSON_OBJECT)
		return NULL;
	const struct dvsm_json_value *member = dvsm_json_first(json, object);
	while (member && strcmp(member->key, key) != 0)
		member = dvsm_json_next(json, member);
	return member;
}

const struct dvsm_json_value *dvsm_json_first(const struct dvsm_json *json,
					      const struct dvsm_json_value *parent)
{
	return parent->first == DVSM_JSON_NONE ? NULL : &json->values[parent->first];
}

const struct dvsm_json_value *dvsm_json_next(const struct dvsm_json *json,
					     const struct dvsm_json_value *value)
{
	return value->next == DVSM_JSON_NONE ? NULL : &json->values[value->next];
}
