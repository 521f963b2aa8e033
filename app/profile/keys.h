/* The keys that a profile's sections know, as one table. */
#ifndef DIO_APP_PROFILE_KEYS_H
#define DIO_APP_PROFILE_KEYS_H

#include <stddef.h>

#include "profile/profile.h"

enum dio_profile_kind {
	DIO_PROFILE_TEXT,
	DIO_PROFILE_PATH,  /* absolute, or empty */
	DIO_PROFILE_WORD,  /* one of `words`; the target is an enum */
	DIO_PROFILE_FLAG,  /* yes or no; bool */
	DIO_PROFILE_COUNT, /* uint32_t in [min, max] */
	DIO_PROFILE_REAL,  /* double in [min, max] */
	DIO_PROFILE_LINE,  /* struct dio_gpio_line */
	DIO_PROFILE_KEY,   /* a key's name; uint32_t */
};

/** What a key's offset counts from. */
enum dio_profile_base {
	DIO_PROFILE_OF_PROFILE,
	DIO_PROFILE_OF_BUTTON,  /* struct dio_button_options */
	DIO_PROFILE_OF_PRESSES, /* struct dio_profile_presses */
	DIO_PROFILE_OF_LED,     /* struct dio_led_options */
};

struct dio_profile_key {
	const char *section; /* "button" and "led" stand for [button NAME] and [led NAME] */
	const char *name;
	enum dio_profile_kind kind;
	enum dio_profile_base base;
	size_t offset, size; /* of the target */
	double min, max;
	const char *const *words; /* NULL ends it */
};

/** NULL when no section of that name has such a key. */
const struct dio_profile_key *dio_profile_key_find(const char *section, const char *name);
bool dio_profile_section_is_known(const char *section);

/** "key, key and key" of a section, or of the sections themselves with NULL. */
void dio_profile_keys_list(const char *section, char *text, size_t size);

/**
 * Read a value into its place.
 *
 * target  start of the struct that the key's offset counts from
 *
 * DIO_BAD_ARG  the text says what is wrong with the value and what would do
 */
enum dio_status dio_profile_key_set(const struct dio_profile_key *key, const char *value,
				    void *target, struct dio_error *error);

#endif
