#include "dio/display.h"

#include <ctype.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

#include "backend.h"
#include "dio/file.h"

#define SIDE_MAX 16384
#define HZ_MAX   1000.0

static enum dio_status fail_mode(const char *text, struct dio_error *error)
{
	return dio_fail(error, DIO_BAD_ARG,
			"display: mode '%s' cannot be read; say 1920x1080 or 1920x1080@60", text);
}

/* A side of 1 to SIDE_MAX; where it ends, or NULL. */
static const char *parse_side(const char *text, uint32_t *side)
{
	char *end;
	unsigned long value;

	if (!isdigit((unsigned char)*text))
		return NULL;
	value = strtoul(text, &end, 10);
	*side = (uint32_t)value;
	return value >= 1 && value <= SIDE_MAX ? end : NULL;
}

enum dio_status dio_display_mode_parse(const char *text, struct dio_display_mode *mode,
				       struct dio_error *error)
{
	struct dio_display_mode parsed = {0};
	const char *at = text;
	char *end;

	if (text && text[0]) {
		at = parse_side(at, &parsed.width);
		if (!at || *at != 'x')
			return fail_mode(text, error);
		at = parse_side(at + 1, &parsed.height);
		if (!at || (*at && *at != '@'))
			return fail_mode(text, error);
		if (*at == '@') {
			parsed.refresh_hz = strtod(at + 1, &end);
			if (end == at + 1 || *end || !(parsed.refresh_hz >= 1) ||
			    parsed.refresh_hz > HZ_MAX)
				return fail_mode(text, error);
		}
	}
	*mode = parsed;
	return DIO_OK;
}

enum output { OUTPUT_KMS, OUTPUT_WINDOW, OUTPUT_FILE, OUTPUT_NONE };

/* What kind of display, and what follows the colon. */
static enum dio_status parse_spec(const char *spec, enum output *output, const char **rest,
				  struct dio_error *error)
{
	static const char *const names[] = {"kms", "window", "file", "none"};
	const char *colon = spec ? strchr(spec, ':') : NULL;
	const size_t length = colon ? (size_t)(colon - spec) : spec ? strlen(spec) : 0;
	unsigned found = 0;

	while (found < 4 &&
	       (length != strlen(names[found]) || strncmp(names[found], spec, length) != 0))
		found++;
	*output = (enum output)found;
	*rest = colon ? colon + 1 : "";
	if (found == 4)
		return dio_fail(error, DIO_BAD_ARG,
				"display '%s': say kms, kms:/dev/dri/card0, window, "
				"file:PATH.mp4 or none",
				spec ? spec : "");
	if (*output == OUTPUT_FILE && !**rest)
		return dio_fail(error, DIO_BAD_ARG, "display '%s': the file's name is missing",
				spec);
	if (colon && (*output == OUTPUT_WINDOW || *output == OUTPUT_NONE))
		return dio_fail(error, DIO_BAD_ARG, "display '%s': %s takes nothing after it", spec,
				names[found]);
	return DIO_OK;
}

static enum dio_status check_options(const struct dio_display_options *options,
				     struct dio_display_mode *mode, struct dio_error *error)
{
	if (!(options->frames_per_second >= 0 && options->frames_per_second <= HZ_MAX))
		return dio_fail(error, DIO_BAD_ARG,
				"display: %g frames a second are wished; 0 to 1000 can be",
				options->frames_per_second);
	return dio_display_mode_parse(options->mode, mode, error);
}

enum dio_status dio_display_open(const char *spec, const struct dio_display_options *options,
				 struct dio_display **display, struct dio_error *error)
{
	const struct dio_display_options none = {0};
	struct dio_display_mode mode;
	enum output output = OUTPUT_NONE;
	const char *rest = "";
	enum dio_status status = parse_spec(spec, &output, &rest, error);

	if (!options)
		options = &none;
	if (status == DIO_OK)
		status = check_options(options, &mode, error);
	if (status != DIO_OK)
		return status;
	switch (output) {
	case OUTPUT_KMS:
		return dio_display_open_kms(rest, &mode, options, display, error);
	case OUTPUT_WINDOW:
		return dio_display_open_window(&mode, options, display, error);
	case OUTPUT_FILE:
		return dio_display_open_paced(rest, &mode, options, display, error);
	case OUTPUT_NONE:
		break;
	}
	return dio_display_open_paced(NULL, &mode, options, display, error);
}

static bool exists(const char *pattern)
{
	char path[128];

	return dio_file_match(pattern, 0, path, sizeof path);
}

static enum dio_status check_card(const char *card, const char *connector, struct dio_error *error)
{
	const char *name = strrchr(card, '/');
	char pattern[128];

	if (card[0] && !exists(card))
		return dio_fail(error, DIO_NOT_FOUND,
				"display %s: no such device; ls /dev/dri lists them", card);
	if (!card[0] && !exists("/dev/dri/card*"))
		return dio_fail(error, DIO_NOT_FOUND,
				"display: this machine has no graphics card (/dev/dri/card*)");
	if (connector && connector[0]) {
		snprintf(pattern, sizeof(pattern), "/sys/class/drm/%s-%.64s",
			 card[0] && name ? name + 1 : "card*", connector);
		if (!exists(pattern))
			return dio_fail(error, DIO_NOT_FOUND,
					"display: no connector is called %s; ls /sys/class/drm "
					"lists them",
					connector);
	}
	return DIO_OK;
}

static enum dio_status check_folder(const char *path, struct dio_error *error)
{
	const char *slash = strrchr(path, '/');
	char folder[512];
	struct stat st;

	snprintf(folder, sizeof(folder), "%.*s", slash && slash > path ? (int)(slash - path) : 1,
		 slash ? path : ".");
	if (stat(folder, &st) != 0 || !S_ISDIR(st.st_mode))
		return dio_fail(error, DIO_NOT_FOUND, "display file:%s: there is no folder %s",
				path, folder);
	return DIO_OK;
}

enum dio_status dio_display_check(const char *spec, const struct dio_display_options *options,
				  bool look, struct dio_error *error)
{
	struct dio_display_mode mode;
	enum output output = OUTPUT_NONE;
	const char *rest = "";
	enum dio_status status = parse_spec(spec, &output, &rest, error);

	if (status == DIO_OK && options)
		status = check_options(options, &mode, error);
	if (status != DIO_OK || !look)
		return status;
	if (output == OUTPUT_KMS)
		return check_card(rest, options ? options->connector : NULL, error);
	return output == OUTPUT_FILE ? check_folder(rest, error) : DIO_OK;
}
