/*
 * A small strict JSON reader (RFC 8259) for file headers. Private to the engine.
 *
 * Stricter than the standard where a file has no reason to differ: valid UTF-8 only, no duplicate
 * keys, no \u0000, nesting at most 32 deep, at most a million values. Never recurses.
 */
#ifndef DVSM_FILES_JSON_H
#define DVSM_FILES_JSON_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

enum dvsm_json_type {
	DVSM_JSON_NULL,
	DVSM_JSON_BOOL,
	DVSM_JSON_NUMBER,
	DVSM_JSON_STRING,
	DVSM_JSON_ARRAY,
	DVSM_JSON_OBJECT,
};

/** No such value: the end of a list of children. */
#define DVSM_JSON_NONE UINT32_MAX

struct dvsm_json_value {
	enum dvsm_json_type type;
	bool boolean;
	bool is_count;     /* a number written as digits alone that fits `count` */
	const char *key;   /* in an object: the member's key; owned by the document */
	const char *text;  /* a string's text, UTF-8; owned by the document */
	double number;     /* a number's value; finite */
	uint64_t count;    /* the exact value when is_count */
	uint32_t first;    /* array, object: index of the first child or DVSM_JSON_NONE */
	uint32_t next;     /* index of the next sibling or DVSM_JSON_NONE */
	uint32_t children; /* array, object: how many */
};

/** A parsed document; values[0] is the root. */
struct dvsm_json {
	struct dvsm_json_value *values;
	uint32_t value_count;
	uint32_t capacity;
	char *text; /* private copy, in which strings are unescaped and terminated in place */
};

/** What was wrong: one phrase and the byte it was found at. */
struct dvsm_json_fault {
	const char *what; /* a constant; "out of memory" when memory was the fault */
	size_t byte;
	bool no_memory;
};

/**
 * Parse `size` bytes of text, which need no terminator. False with `fault` filled when the text is
 * not JSON; the document is then empty. Release with dvsm_json_deinit().
 */
bool dvsm_json_init(struct dvsm_json *json, const char *text, size_t size,
		    struct dvsm_json_fault *fault);
void dvsm_json_deinit(struct dvsm_json *json);

/** Member `key` of an object, or NULL when it is missing or `object` is no object. */
const struct dvsm_json_value *dvsm_json_find(const struct dvsm_json *json,
					     const struct dvsm_json_value *object, const char *key);

/** First child of an array or object, next sibling; NULL at the end. */
const struct dvsm_json_value *dvsm_json_first(const struct dvsm_json *json,
					      const struct dvsm_json_value *parent);
const struct dvsm_json_value *dvsm_json_next(const struct dvsm_json *json,
					     const struct dvsm_json_value *value);

#endif
