#include "sim_spec.h"

#include <errno.h>
#include <inttypes.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static enum dio_status fail_value(const char *key, const char *value, const char *wanted,
				  struct dio_error *error)
{
	return dio_fail(error, DIO_BAD_ARG, "camera sim: %s=%s: %s is needed", key, value, wanted);
}

static enum dio_status read_real(const char *key, const char *value, double min, double max,
				 double *to, struct dio_error *error)
{
	char wanted[64], *end;
	double number;

	snprintf(wanted, sizeof(wanted), "a number from %g to %g", min, max);
	number = strtod(value, &end);
	if (end == value || *end || !(number >= min && number <= max))
		return fail_value(key, value, wanted, error);
	*to = number;
	return DIO_OK;
}

static enum dio_status read_whole(const char *key, const char *value, uint64_t min, uint64_t max,
				  uint64_t *to, struct dio_error *error)
{
	char wanted[80], *end;
	unsigned long long number;

	snprintf(wanted, sizeof(wanted), "a whole number from %" PRIu64 " to %" PRIu64, min, max);
	errno = 0;
	number = strtoull(value, &end, 10);
	if (value[0] < '0' || value[0] > '9' || *end || errno || number < min || number > max)
		return fail_value(key, value, wanted, error);
	*to = number;
	return DIO_OK;
}

static enum dio_status read_float(const char *key, const char *value, double min, double max,
				  float *to, struct dio_error *error)
{
	double number = 0;
	enum dio_status status = read_real(key, value, min, max, &number, error);

	if (status == DIO_OK)
		*to = (float)number;
	return status;
}

static enum dio_status read_u32(const char *key, const char *value, uint32_t min, uint32_t max,
				uint32_t *to, struct dio_error *error)
{
	uint64_t number = 0;
	enum dio_status status = read_whole(key, value, min, max, &number, error);

	if (status == DIO_OK)
		*to = (uint32_t)number;
	return status;
}

static enum dio_status read_flag(const char *key, const char *value, bool *to,
				 struct dio_error *error)
{
	uint32_t number = 0;
	enum dio_status status = read_u32(key, value, 0, 1, &number, error);

	if (status == DIO_OK)
		*to = number == 1;
	return status;
}

static enum dio_status read_style(const char *value, uint32_t *to, struct dio_error *error)
{
	if (strcmp(value, "walk") == 0)
		*to = 0;
	else if (strcmp(value, "dance") == 0)
		*to = 1;
	else
		return fail_value("style", value, "walk or dance", error);
	return DIO_OK;
}

static enum dio_status read_board(const char *value, struct dio_sim_board *to,
				  struct dio_error *error)
{
	static const char wanted[] =
		"none or charuco:COLSxROWS:SQUARE_M:MARKER_M:DICT_6X6_250[:legacy] (3..40 squares "
		"a "
		"side, at most 250 markers, marker smaller than square, square at most 1 m)";
	struct dio_sim_board board = {0};
	int end = 0;

	if (strcmp(value, "none") == 0) {
		*to = board;
		return DIO_OK;
	}
	if (sscanf(value, "charuco:%2ux%2u:%lf:%lf:DICT_6X6_250%n", &board.cols, &board.rows,
		   &board.square_m, &board.marker_m, &end) != 4 ||
	    end == 0)
		return fail_value("board", value, wanted, error);
	board.legacy = strcmp(value + end, ":legacy") == 0;
	if ((value[end] && !board.legacy) || board.cols < 3 || board.rows < 3 || board.cols > 40 ||
	    board.rows > 40 || board.cols * board.rows / 2 > 250 ||
	    !(board.square_m > 0 && board.square_m <= 1) ||
	    !(board.marker_m > 0 && board.marker_m < board.square_m))
		return fail_value("board", value, wanted, error);
	*to = board;
	return DIO_OK;
}

static enum dio_status read_pair(const char *key, const char *value, struct dio_sim_spec *spec,
				 struct dio_error *error)
{
	if (strcmp(key, "seed") == 0)
		return read_whole(key, value, 0, UINT64_MAX, &spec->scene.seed, error);
	if (strcmp(key, "width") == 0)
		return read_u32(key, value, 16, 4096, &spec->width, error);
	if (strcmp(key, "height") == 0)
		return read_u32(key, value, 16, 4096, &spec->height, error);
	if (strcmp(key, "fps") == 0)
		return read_real(key, value, 0.01, 1000, &spec->fps, error);
	if (strcmp(key, "frames") == 0)
		return read_whole(key, value, 0, UINT32_MAX, &spec->frames, error);
	if (strcmp(key, "style") == 0)
		return read_style(value, &spec->style, error);
	if (strcmp(key, "board") == 0)
		return read_board(value, &spec->scene.board, error);
	if (strcmp(key, "clear") == 0)
		return read_flag(key, value, &spec->scene.clear_board, error);
	if (strcmp(key, "fov") == 0)
		return read_real(key, value, 20, 120, &spec->fov_deg, error);
	if (strcmp(key, "distortion") == 0)
		return read_real(key, value, -1, 1, &spec->distortion, error);
	if (strcmp(key, "noise") == 0)
		return read_float(key, value, 0, 0.5, &spec->sensor.noise, error);
	if (strcmp(key, "exposure") == 0)
		return read_float(key, value, -4, 4, &spec->sensor.exposure_stops, error);
	if (strcmp(key, "blur") == 0)
		return read_float(key, value, 0, 8, &spec->sensor.blur_px, error);
	if (strcmp(key, "vignetting") == 0)
		return read_float(key, value, 0, 1, &spec->sensor.vignetting, error);
	if (strcmp(key, "samples") == 0)
		return read_u32(key, value, 1, 8, &spec->samples, error);
	return dio_fail(
		error, DIO_BAD_ARG,
		"camera sim: unknown word '%s'; there are seed, width, height, fps, frames, style, "
		"board, clear, fov, distortion, noise, exposure, blur, vignetting, samples",
		key);
}

static enum dio_status read_scene(const char *name, struct dio_sim_spec *spec,
				  struct dio_error *error)
{
	static const struct dio_sim_board table_board = {
		.cols = 10, .rows = 7, .square_m = 0.0285, .marker_m = 0.0171};

	if (strcmp(name, "table") == 0) {
		spec->scene.kind = DIO_SIM_TABLE;
		spec->scene.board = table_board;
	} else if (strcmp(name, "room") == 0) {
		spec->scene.kind = DIO_SIM_ROOM;
	} else if (strcmp(name, "turntable") == 0) {
		spec->scene.kind = DIO_SIM_TURNTABLE;
	} else if (strcmp(name, "street") == 0) {
		spec->scene.kind = DIO_SIM_STREET;
	} else {
		return dio_fail(error, DIO_BAD_ARG,
				"camera sim: unknown scene '%s'; there are table, room, turntable "
				"and street",
				name);
	}
	return DIO_OK;
}

/* Cuts `words` up in place. */
static enum dio_status parse(char *words, struct dio_sim_spec *spec, struct dio_error *error)
{
	char *pairs = words, *rest, *pair;
	enum dio_status status;

	strsep(&pairs, "?");
	status = read_scene(words, spec, error);
	rest = pairs;
	while (status == DIO_OK && (pair = strsep(&rest, "&"))) {
		char *value = pair;

		if (!pair[0])
			continue;
		strsep(&value, "=");
		if (!value)
			return dio_fail(error, DIO_BAD_ARG,
					"camera sim: '%s' has no value; write %s=...", pair, pair);
		status = read_pair(pair, value, spec, error);
	}
	return status;
}

enum dio_status dio_sim_spec_parse(const char *words, struct dio_sim_spec *spec,
				   struct dio_error *error)
{
	struct dio_sim_spec read = {
		.scene = {.seed = 1, .clear_board = true},
		.width = 640,
		.height = 480,
		.samples = 2,
		.fps = 30,
		.fov_deg = 60,
		.distortion = 0.25,
		.sensor = {.noise = 0.004f, .blur_px = 0.5f, .vignetting = 0.1f},
	};
	char *copy = strdup(words);
	enum dio_status status;

	if (!copy)
		return dio_fail(error, DIO_NO_MEM, "camera sim: out of memory");
	status = parse(copy, &read, error);
	free(copy);
	if (status == DIO_OK)
		*spec = read;
	return status;
}
