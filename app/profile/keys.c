#include "profile/keys.h"

#include <errno.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>

static const char *const FLICKERS[] = {"auto", "off", "50", "60", NULL};
static const char *const PRECISIONS[] = {"float32", "bfloat16", "int8", NULL};
static const char *const DEBLOCKS[] = {"auto", "on", "off", NULL};
static const char *const PULLS[] = {"as-is", "none", "up", "down", NULL};
/* As enum dio_action has them. */
static const char *const ACTIONS[] = {"none", "calibrate", "capture",  "reconstruct", "play",
				      "save", "cancel",    "shutdown", NULL};
/* As enum dio_led_pattern has them. */
static const char *const PATTERNS[] = {"off", "on", "slow", "fast", "flash", "twice", NULL};

#define TARGET(base_, type, member)                                                                \
	.base = (base_), .offset = offsetof(struct type, member),                                  \
	.size = sizeof(((struct type *)0)->member)
#define PROFILE(member)       TARGET(DIO_PROFILE_OF_PROFILE, dio_profile, member)
#define BUTTON(member)        TARGET(DIO_PROFILE_OF_BUTTON, dio_button_options, member)
#define PRESSES(member)       TARGET(DIO_PROFILE_OF_PRESSES, dio_profile_presses, member)
#define LED(member)           TARGET(DIO_PROFILE_OF_LED, dio_led_options, member)
#define WORDS(list)           DIO_PROFILE_WORD, .words = (list)
#define RANGE(kind, from, to) DIO_PROFILE_##kind, .min = (from), .max = (to)

static const struct dio_profile_key KEYS[] = {
	{"board", "name", DIO_PROFILE_TEXT, PROFILE(name)},

	{"camera", "source", DIO_PROFILE_TEXT, PROFILE(camera.source)},
	{"camera", "width", RANGE(COUNT, 0, 16384), PROFILE(camera.width)},
	{"camera", "height", RANGE(COUNT, 0, 16384), PROFILE(camera.height)},
	{"camera", "frames_per_second", RANGE(REAL, 0, 1000), PROFILE(camera.frames_per_second)},
	{"camera", "calibration", DIO_PROFILE_PATH, PROFILE(camera.calibration)},
	{"camera", "lock", DIO_PROFILE_FLAG, PROFILE(camera.lock)},
	{"camera", "settle_ms", RANGE(COUNT, 0, 60000), PROFILE(camera.settle_ms)},
	{"camera", "exposure_us", RANGE(COUNT, 0, 10000000), PROFILE(camera.exposure_us)},
	{"camera", "gain", RANGE(REAL, 0, 1000), PROFILE(camera.gain)},
	{"camera", "anti_flicker", WORDS(FLICKERS), PROFILE(camera.flicker)},

	{"capture", "board", DIO_PROFILE_TEXT, PROFILE(capture.board)},
	{"capture", "ring_slots", RANGE(COUNT, 3, 64), PROFILE(capture.ring_slots)},
	{"capture", "stalled_ms", RANGE(COUNT, 100, 60000), PROFILE(capture.stalled_ms)},
	{"capture", "views_min", RANGE(COUNT, 1, 1024), PROFILE(capture.views_min)},
	{"capture", "views_max", RANGE(COUNT, 1, 1024), PROFILE(capture.views_max)},
	{"capture", "new_view_deg", RANGE(REAL, 0, 90), PROFILE(capture.new_view_deg)},
	{"capture", "reserve_mib", RANGE(COUNT, 0, 1048576), PROFILE(capture.reserve_mib)},

	{"display", "output", DIO_PROFILE_TEXT, PROFILE(display.output)},
	{"display", "connector", DIO_PROFILE_TEXT, PROFILE(display.connector)},
	{"display", "mode", DIO_PROFILE_TEXT, PROFILE(display.mode)},
	{"display", "frames_per_second", RANGE(REAL, 0, 1000), PROFILE(display.frames_per_second)},
	{"display", "smooth", DIO_PROFILE_FLAG, PROFILE(display.smooth)},
	{"display", "overlay", DIO_PROFILE_FLAG, PROFILE(display.overlay)},

	{"engine", "model", DIO_PROFILE_PATH, PROFILE(engine.model)},
	{"engine", "precision", WORDS(PRECISIONS), PROFILE(engine.precision)},
	{"engine", "threads", RANGE(COUNT, 0, 256), PROFILE(engine.threads)},
	{"engine", "render_width", RANGE(COUNT, 16, 4096), PROFILE(engine.render_width)},
	{"engine", "render_height", RANGE(COUNT, 16, 4096), PROFILE(engine.render_height)},
	{"engine", "patch_recon", RANGE(COUNT, 0, 256), PROFILE(engine.patch_recon)},
	{"engine", "patch_render", RANGE(COUNT, 0, 256), PROFILE(engine.patch_render)},
	{"engine", "deblock", WORDS(DEBLOCKS), PROFILE(engine.deblock)},

	{"buttons", "keyboard", DIO_PROFILE_TEXT, PROFILE(keyboard)},

	{"button", "line", DIO_PROFILE_LINE, BUTTON(line)},
	{"button", "pull", WORDS(PULLS), BUTTON(pull)},
	{"button", "active_low", DIO_PROFILE_FLAG, BUTTON(active_low)},
	{"button", "debounce_us", RANGE(COUNT, 0, 1000000), BUTTON(debounce_us)},
	{"button", "key", DIO_PROFILE_KEY, BUTTON(key)},
	{"button", "long_ms", RANGE(COUNT, 100, 60000), BUTTON(long_ms)},
	{"button", "double_ms", RANGE(COUNT, 50, 5000), BUTTON(double_ms)},
	{"button", "short", WORDS(ACTIONS), PRESSES(short_press)},
	{"button", "long", WORDS(ACTIONS), PRESSES(long_press)},
	{"button", "double", WORDS(ACTIONS), PRESSES(double_press)},

	{"led", "line", DIO_PROFILE_LINE, LED(line)},
	{"led", "active_low", DIO_PROFILE_FLAG, LED(active_low)},
	{"led", "idle", WORDS(PATTERNS), LED(patterns[DIO_LED_STATE_IDLE])},
	{"led", "calibrate", WORDS(PATTERNS), LED(patterns[DIO_LED_STATE_CALIBRATE])},
	{"led", "capture", WORDS(PATTERNS), LED(patterns[DIO_LED_STATE_CAPTURE])},
	{"led", "reconstruct", WORDS(PATTERNS), LED(patterns[DIO_LED_STATE_RECONSTRUCT])},
	{"led", "view", WORDS(PATTERNS), LED(patterns[DIO_LED_STATE_VIEW])},
	{"led", "error", WORDS(PATTERNS), LED(patterns[DIO_LED_STATE_ERROR])},

	{"paths", "state", DIO_PROFILE_PATH, PROFILE(paths.state)},
	{"paths", "runtime", DIO_PROFILE_PATH, PROFILE(paths.runtime)},

	{"web", "enabled", DIO_PROFILE_FLAG, PROFILE(web.enabled)},
	{"web", "address", DIO_PROFILE_TEXT, PROFILE(web.address)},
	{"web", "port", RANGE(COUNT, 1, 65535), PROFILE(web.port)},
	{"web", "token_file", DIO_PROFILE_PATH, PROFILE(web.token_file)},
};

const char *dio_action_name(enum dio_action action)
{
	return (unsigned)action < sizeof ACTIONS / sizeof *ACTIONS - 1 ? ACTIONS[action] : NULL;
}

#define KEY_COUNT (sizeof KEYS / sizeof *KEYS)

const struct dio_profile_key *dio_profile_key_find(const char *section, const char *name)
{
	for (size_t i = 0; i < KEY_COUNT; i++)
		if (strcmp(KEYS[i].section, section) == 0 && strcmp(KEYS[i].name, name) == 0)
			return &KEYS[i];
	return NULL;
}

bool dio_profile_section_is_known(const char *section)
{
	for (size_t i = 0; i < KEY_COUNT; i++)
		if (strcmp(KEYS[i].section, section) == 0)
			return true;
	return false;
}

static void append(char *text, size_t size, const char *word)
{
	size_t used = strlen(text);

	snprintf(text + used, size - used, "%s%s", used ? ", " : "", word);
}

void dio_profile_keys_list(const char *section, char *text, size_t size)
{
	text[0] = '\0';
	for (size_t i = 0; i < KEY_COUNT; i++) {
		if (section && strcmp(KEYS[i].section, section) == 0)
			append(text, size, KEYS[i].name);
		else if (!section && (i == 0 || strcmp(KEYS[i].section, KEYS[i - 1].section) != 0))
			append(text, size, KEYS[i].section);
	}
}

static enum dio_status set_word(const struct dio_profile_key *key, const char *value, void *to,
				struct dio_error *error)
{
	char list[256] = "";

	for (unsigned i = 0; key->words[i]; i++) {
		if (strcmp(key->words[i], value) == 0) {
			/* An enum of ours has the size of an unsigned int. */
			memcpy(to, &i, sizeof(i));
			return DIO_OK;
		}
		append(list, sizeof(list), key->words[i]);
	}
	return dio_fail(error, DIO_BAD_ARG, "'%s' is none of: %s", value, list);
}

static enum dio_status set_flag(const char *value, bool *to, struct dio_error *error)
{
	bool yes = strcmp(value, "yes") == 0 || strcmp(value, "true") == 0 ||
		   strcmp(value, "on") == 0 || strcmp(value, "1") == 0;

	if (!yes && strcmp(value, "no") != 0 && strcmp(value, "false") != 0 &&
	    strcmp(value, "off") != 0 && strcmp(value, "0") != 0)
		return dio_fail(error, DIO_BAD_ARG, "'%s' is neither yes nor no", value);
	*to = yes;
	return DIO_OK;
}

static enum dio_status set_number(const struct dio_profile_key *key, const char *value, void *to,
				  struct dio_error *error)
{
	const bool whole = key->kind == DIO_PROFILE_COUNT;
	char *end;
	double number;

	errno = 0;
	number = strtod(value, &end);
	if (end == value || *end || errno || !isfinite(number) ||
	    (whole && strspn(value, "0123456789") != strlen(value)))
		return dio_fail(error, DIO_BAD_ARG, "'%s' is not a %snumber", value,
				whole ? "whole " : "");
	if (number < key->min || number > key->max)
		return dio_fail(error, DIO_BAD_ARG, "%s is out of range: %.10g to %.10g can be",
				value, key->min, key->max);
	if (whole)
		*(uint32_t *)to = (uint32_t)number;
	else
		*(double *)to = number;
	return DIO_OK;
}

static enum dio_status set_text(const struct dio_profile_key *key, const char *value, char *to,
				struct dio_error *error)
{
	size_t length = strlen(value);

	if (key->kind == DIO_PROFILE_PATH && length && value[0] != '/')
		return dio_fail(error, DIO_BAD_ARG,
				"'%s' is not a path from the root: begin it with /", value);
	if (length >= key->size)
		return dio_fail(error, DIO_BAD_ARG, "%zu characters; at most %zu can be", length,
				key->size - 1);
	memcpy(to, value, length + 1);
	return DIO_OK;
}

enum dio_status dio_profile_key_set(const struct dio_profile_key *key, const char *value,
				    void *target, struct dio_error *error)
{
	void *to = (char *)target + key->offset;

	switch (key->kind) {
	case DIO_PROFILE_TEXT:
	case DIO_PROFILE_PATH:
		return set_text(key, value, to, error);
	case DIO_PROFILE_WORD:
		return set_word(key, value, to, error);
	case DIO_PROFILE_FLAG:
		return set_flag(value, to, error);
	case DIO_PROFILE_COUNT:
	case DIO_PROFILE_REAL:
		return set_number(key, value, to, error);
	case DIO_PROFILE_LINE:
		return dio_gpio_line_parse(value, to, error);
	case DIO_PROFILE_KEY:
		*(uint32_t *)to = dio_key_from_name(value);
		if (*(uint32_t *)to == 0)
			return dio_fail(error, DIO_BAD_ARG,
					"there is no key '%s'; say space, enter, f1, a and so on",
					value);
		return DIO_OK;
	}
	return dio_fail(error, DIO_BAD_ARG, "cannot be set");
}
