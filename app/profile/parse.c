#include <ini.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "dio/file.h"
#include "profile/keys.h"
#include "profile/profile.h"

#define FILE_MAX_BYTES (256u << 10)
/* What inih splits: its lines hold 199 characters. */
#define LINE_MAX_BYTES 198

#define BYTE_ORDER_MARK "\xEF\xBB\xBF"

/* A button's own times and debounce, when its section names none. */
#define LONG_MS     800
#define DOUBLE_MS   300
#define DEBOUNCE_US 5000

struct parser {
	struct dio_profile *profile;
	struct dio_profile_report *report;
	const char *at;         /* the rest of the file */
	uint32_t line;          /* of the line inih is at */
	char section[80];       /* "button capture" */
	char kind[32];          /* "button" of [button NAME], else the section itself */
	bool section_began;     /* any, well formed or not */
	bool section_is_usable; /* known, and there is room for what it describes */
	uint32_t button, led;   /* the one the section is about */
};

static bool same_text(const char *a, const char *b)
{
	return strcmp(a, b) == 0;
}

static bool is_button(const struct parser *parser)
{
	return same_text(parser->kind, "button");
}

static void add_button(struct parser *parser, const char *name)
{
	struct dio_profile *profile = parser->profile;
	struct dio_button_options *button = &profile->buttons[profile->button_count];

	if (profile->button_count == DIO_BUTTONS_MAX) {
		dio_profile_report_fault(parser->report, parser->line,
					 "[%s]: one button too many; %d can be", parser->section,
					 DIO_BUTTONS_MAX);
		return;
	}
	*button = (struct dio_button_options){
		.debounce_us = DEBOUNCE_US, .long_ms = LONG_MS, .double_ms = DOUBLE_MS};
	snprintf(button->name, sizeof(button->name), "%s", name);
	parser->button = profile->button_count++;
	parser->section_is_usable = true;
}

static void add_led(struct parser *parser, const char *name)
{
	struct dio_profile *profile = parser->profile;
	struct dio_led_options *led = &profile->leds[profile->led_count];

	if (profile->led_count == DIO_LEDS_MAX) {
		dio_profile_report_fault(parser->report, parser->line,
					 "[%s]: one LED too many; %d can be", parser->section,
					 DIO_LEDS_MAX);
		return;
	}
	*led = (struct dio_led_options){.patterns = {
						[DIO_LED_STATE_IDLE] = DIO_LED_FLASH,
						[DIO_LED_STATE_CALIBRATE] = DIO_LED_SLOW,
						[DIO_LED_STATE_CAPTURE] = DIO_LED_TWICE,
						[DIO_LED_STATE_RECONSTRUCT] = DIO_LED_SLOW,
						[DIO_LED_STATE_VIEW] = DIO_LED_ON,
						[DIO_LED_STATE_ERROR] = DIO_LED_FAST,
					}};
	snprintf(led->name, sizeof(led->name), "%s", name);
	parser->led = profile->led_count++;
	parser->section_is_usable = true;
}

/* "[button NAME]" and "[led NAME]": each describes one more. */
static void begin_device(struct parser *parser, const char *name)
{
	if (name[0] == '\0')
		dio_profile_report_fault(parser->report, parser->line,
					 "[%s]: a name is missing; write [%s NAME]",
					 parser->section, parser->kind);
	else if (strlen(name) >= sizeof(parser->profile->buttons[0].name))
		dio_profile_report_fault(parser->report, parser->line,
					 "[%s]: the name is too long; at most 31 characters can be",
					 parser->section);
	else if (is_button(parser))
		add_button(parser, name);
	else
		add_led(parser, name);
}

/* "button  capture" is of kind "button" and called "button capture". */
static const char *split_section(struct parser *parser, const char *text, size_t length)
{
	size_t kind = strcspn(text, " \t]"), own = kind + strspn(text + kind, " \t");

	while (length > own && strchr(" \t", text[length - 1]))
		length--;
	if (own >= length)
		own = length;
	snprintf(parser->kind, sizeof(parser->kind), "%.*s", (int)(kind < own ? kind : own), text);
	snprintf(parser->section, sizeof(parser->section), "%.31s%s%.*s", parser->kind,
		 own < length ? " " : "", (int)(length - own), text + own);
	return own < length ? parser->section + strlen(parser->kind) + 1 : "";
}

static void begin_section(struct parser *parser, const char *text, size_t length)
{
	const char *own = split_section(parser, text, length);
	const bool device = is_button(parser) || same_text(parser->kind, "led");
	uint32_t before = dio_profile_report_line(parser->report, parser->section, NULL);
	char list[256];

	if (before) {
		dio_profile_report_fault(parser->report, parser->line,
					 "[%s] stands in line %u already: join the two",
					 parser->section, before);
		return;
	}
	dio_profile_report_place(parser->report, parser->section, "", parser->line);
	if (device) {
		begin_device(parser, own);
	} else if (!own[0] && dio_profile_section_is_known(parser->section)) {
		parser->section_is_usable = true;
	} else {
		dio_profile_keys_list(NULL, list, sizeof(list));
		dio_profile_report_fault(parser->report, parser->line,
					 "[%s]: no such section; there are %s", parser->section,
					 list);
	}
}

/* Report what inih would pass over or cut; true when the line is for inih. */
static bool check_line(struct parser *parser, const char *line, size_t length)
{
	const char *close;

	if (length == 0 || *line == ';' || *line == '#')
		return false;
	if (length > LINE_MAX_BYTES) {
		dio_profile_report_fault(parser->report, parser->line,
					 "%zu characters in a line; at most %d can be", length,
					 LINE_MAX_BYTES);
		return false;
	}
	if (*line == '[') {
		close = memchr(line, ']', length);
		parser->section_began = true;
		parser->section_is_usable = false;
		if (close)
			begin_section(parser, line + 1, (size_t)(close - line - 1));
		else
			dio_profile_report_fault(parser->report, parser->line,
						 "']' is missing after the section's name");
		return close != NULL;
	}
	if (!memchr(line, '=', length)) {
		dio_profile_report_fault(parser->report, parser->line,
					 "neither [section] nor key = value nor a comment");
		return false;
	}
	return true;
}

/* fgets() over the text, for inih: one line, without what was reported already. Nothing is left
 * indented: inih would take that for more of the value before. */
static char *read_line(char *buffer, int size, void *stream)
{
	struct parser *parser = stream;
	const char *line = parser->at, *end = line + strcspn(line, "\n");

	if (*line == '\0')
		return NULL;
	parser->at = *end ? end + 1 : end;
	parser->line++;
	line += strspn(line, " \t\r");
	while (end > line && strchr(" \t\r", end[-1]))
		end--;
	if (line > end || !check_line(parser, line, (size_t)(end - line)))
		line = end;
	snprintf(buffer, (size_t)size, "%.*s\n", (int)(end - line), line);
	return buffer;
}

static void *get_target(struct parser *parser, const struct dio_profile_key *key)
{
	switch (key->base) {
	case DIO_PROFILE_OF_PROFILE:
		return parser->profile;
	case DIO_PROFILE_OF_BUTTON:
		return &parser->profile->buttons[parser->button];
	case DIO_PROFILE_OF_PRESSES:
		return &parser->profile->presses[parser->button];
	case DIO_PROFILE_OF_LED:
		return &parser->profile->leds[parser->led];
	}
	return NULL;
}

static void set_key(struct parser *parser, const char *name, const char *value)
{
	const struct dio_profile_key *key = dio_profile_key_find(parser->kind, name);
	uint32_t before = dio_profile_report_line(parser->report, parser->section, name);
	struct dio_error error = {""};
	char list[256];

	if (!key) {
		dio_profile_keys_list(parser->kind, list, sizeof(list));
		dio_profile_report_fault(parser->report, parser->line,
					 "%s: no such key in [%s]; there are %s", name,
					 parser->section, list);
		return;
	}
	if (before) {
		dio_profile_report_fault(parser->report, parser->line,
					 "%s stands in line %u already: remove one", name, before);
		return;
	}
	dio_profile_report_place(parser->report, parser->section, name, parser->line);
	if (dio_profile_key_set(key, value, get_target(parser, key), &error) != DIO_OK)
		dio_profile_report_fault(parser->report, parser->line, "%s: %s", name, error.text);
}

/* inih's callback for "name = value". 1: go on. */
static int take(void *user, const char *section, const char *name, const char *value)
{
	struct parser *parser = user;

	(void)section;
	if (!parser->section_began)
		dio_profile_report_fault(parser->report, parser->line,
					 "%s: stands before any [section]", name);
	else if (parser->section_is_usable)
		set_key(parser, name, value);
	return 1;
}

static void name_section(char *text, size_t size, const char *kind, const char *name)
{
	snprintf(text, size, "%s %s", kind, name);
}

/* Is one of the keys given, however badly? */
static bool has_any(const struct dio_profile_report *report, const char *section,
		    const char *const keys[])
{
	for (int i = 0; keys[i]; i++)
		if (dio_profile_report_line(report, section, keys[i]))
			return true;
	return false;
}

/* What a press cannot ask for need not be waited for. */
static void settle_button(struct dio_button_options *button,
			  const struct dio_profile_presses *presses,
			  struct dio_profile_report *report)
{
	static const char *const sources[] = {"line", "key", NULL};
	static const char *const uses[] = {"short", "long", "double", NULL};
	char section[64];
	uint32_t line;

	name_section(section, sizeof(section), "button", button->name);
	line = dio_profile_report_line(report, section, NULL);
	if (!presses->long_press)
		button->long_ms = 0;
	if (!presses->double_press)
		button->double_ms = 0;
	if (!has_any(report, section, sources))
		dio_profile_report_fault(report, line, "[%s]: neither line nor key is given",
					 section);
	if (!has_any(report, section, uses))
		dio_profile_report_fault(
			report, line, "[%s]: does nothing; give it short, long or double", section);
}

static bool same_line(const struct dio_gpio_line *a, const struct dio_gpio_line *b)
{
	if (!a->chip[0] && !a->name[0])
		return false;
	return same_text(a->chip, b->chip) && same_text(a->name, b->name) && a->offset == b->offset;
}

/* A line can serve one button or LED. */
static void check_lines_differ(const struct dio_profile *profile, struct dio_profile_report *report)
{
	const uint32_t total = profile->button_count + profile->led_count;
	const struct dio_gpio_line *lines[DIO_BUTTONS_MAX + DIO_LEDS_MAX];
	char sections[DIO_BUTTONS_MAX + DIO_LEDS_MAX][64];

	for (uint32_t i = 0; i < total; i++) {
		const uint32_t led = i - profile->button_count;

		if (i < profile->button_count) {
			lines[i] = &profile->buttons[i].line;
			name_section(sections[i], sizeof(sections[i]), "button",
				     profile->buttons[i].name);
		} else {
			lines[i] = &profile->leds[led].line;
			name_section(sections[i], sizeof(sections[i]), "led",
				     profile->leds[led].name);
		}
		for (uint32_t k = 0; k < i; k++)
			if (same_line(lines[i], lines[k]))
				dio_profile_report_fault(
					report,
					dio_profile_report_line(report, sections[i], "line"),
					"line: [%s] has it already", sections[k]);
	}
}

static void settle(struct dio_profile *profile, struct dio_profile_report *report)
{
	char section[64];

	for (uint32_t i = 0; i < profile->button_count; i++)
		settle_button(&profile->buttons[i], &profile->presses[i], report);
	for (uint32_t i = 0; i < profile->led_count; i++) {
		name_section(section, sizeof(section), "led", profile->leds[i].name);
		if (!dio_profile_report_line(report, section, "line"))
			dio_profile_report_fault(report,
						 dio_profile_report_line(report, section, NULL),
						 "[%s]: line is missing", section);
	}
	check_lines_differ(profile, report);
	if (profile->capture.views_min > profile->capture.views_max)
		dio_profile_report_fault(report,
					 dio_profile_report_line(report, "capture", "views_min"),
					 "views_min: %u is more than views_max, %u",
					 profile->capture.views_min, profile->capture.views_max);
	if (!profile->paths.state[0] || !profile->paths.runtime[0])
		dio_profile_report_fault(report, dio_profile_report_line(report, "paths", NULL),
					 "[paths]: state and runtime cannot be empty");
	if (!profile->camera.source[0])
		dio_profile_report_fault(report,
					 dio_profile_report_line(report, "camera", "source"),
					 "source: empty; say v4l2:/dev/video0 or sim:table?seed=1");
}

static enum dio_status conclude(const char *path, const struct dio_profile_report *report,
				struct dio_error *error)
{
	const struct dio_profile_fault *first = report->faults;
	char more[96] = "";

	if (report->short_of_memory)
		return dio_fail(error, DIO_NO_MEM, "%s: out of memory", path);
	if (report->fault_count == 0)
		return DIO_OK;
	if (report->fault_count > 1)
		snprintf(more, sizeof(more), " (and %zu more: see diorama board check)",
			 report->fault_count - 1);
	return dio_fail(error, DIO_BAD_FILE, "%s:%u: %.300s%s", path, first->line, first->text,
			more);
}

static enum dio_status parse(const char *path, const char *text, struct dio_profile *profile,
			     struct dio_profile_report *report, struct dio_error *error)
{
	struct parser parser = {.profile = profile, .report = report, .at = text};

	if (strncmp(text, BYTE_ORDER_MARK, strlen(BYTE_ORDER_MARK)) == 0)
		parser.at += strlen(BYTE_ORDER_MARK);
	if (ini_parse_stream(read_line, &parser, take, &parser) < 0)
		return dio_fail(error, DIO_NO_MEM, "%s: out of memory", path);
	settle(profile, report);
	dio_profile_report_sort(report);
	return conclude(path, report, error);
}

enum dio_status dio_profile_read(const char *path, struct dio_profile *profile,
				 struct dio_profile_report *report, struct dio_error *error)
{
	struct dio_profile_report own = {0};
	struct dio_profile *parsed = malloc(sizeof(*parsed));
	uint8_t *bytes = NULL;
	size_t size;
	enum dio_status status;

	if (!parsed)
		return dio_fail(error, DIO_NO_MEM, "%s: out of memory", path);
	status = dio_file_read(path, FILE_MAX_BYTES, &bytes, &size, error);
	if (status == DIO_OK && strlen((const char *)bytes) != size)
		status = dio_fail(error, DIO_BAD_FILE, "%s: not a text file: a zero byte in it",
				  path);
	if (status == DIO_OK) {
		dio_profile_init(parsed);
		status = parse(path, (const char *)bytes, parsed, report ? report : &own, error);
	}
	if (status == DIO_OK)
		*profile = *parsed;
	dio_profile_report_deinit(&own);
	free(bytes);
	free(parsed);
	return status;
}

enum dio_status dio_profile_load(const char *path, struct dio_profile *profile,
				 struct dio_error *error)
{
	dio_profile_init(profile);
	if (!path && access(DIO_PROFILE_BOARD, F_OK) == 0)
		path = DIO_PROFILE_BOARD;
	return path ? dio_profile_read(path, profile, NULL, error) : DIO_OK;
}
