#include "dio/board.h"

#include <errno.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* OpenCV's predefined dictionaries: the index is OpenCV's number. */
static const struct {
	const char *name;
	uint32_t markers;
} dictionaries[] = {
	{"DICT_4X4_50", 50},        {"DICT_4X4_100", 100},         {"DICT_4X4_250", 250},
	{"DICT_4X4_1000", 1000},    {"DICT_5X5_50", 50},           {"DICT_5X5_100", 100},
	{"DICT_5X5_250", 250},      {"DICT_5X5_1000", 1000},       {"DICT_6X6_50", 50},
	{"DICT_6X6_100", 100},      {"DICT_6X6_250", 250},         {"DICT_6X6_1000", 1000},
	{"DICT_7X7_50", 50},        {"DICT_7X7_100", 100},         {"DICT_7X7_250", 250},
	{"DICT_7X7_1000", 1000},    {"DICT_ARUCO_ORIGINAL", 1024}, {"DICT_APRILTAG_16h5", 30},
	{"DICT_APRILTAG_25h9", 35}, {"DICT_APRILTAG_36h10", 2320}, {"DICT_APRILTAG_36h11", 587},
};

#define DICTIONARY_COUNT (sizeof(dictionaries) / sizeof(dictionaries[0]))

enum { CHARUCO_PARTS = 5, CHESSBOARD_PARTS = 3, MAX_PARTS = 6, MAX_SPEC = 128 };

static const char usage[] = "write charuco:COLSxROWS:SQUARE_M:MARKER_M:DICTIONARY[:legacy] or "
			    "chessboard:COLSxROWS:SQUARE_M";

/* Cuts `text` at its colons; more parts than `capacity` answer capacity + 1. */
static uint32_t split(char *text, char **parts, uint32_t capacity)
{
	uint32_t count = 0;
	for (char *part = text; part; count++) {
		char *colon = strchr(part, ':');
		if (colon)
			*colon = '\0';
		if (count == capacity)
			return capacity + 1;
		parts[count] = part;
		part = colon ? colon + 1 : NULL;
	}
	return count;
}

static bool parse_count(const char *text, char **end, uint32_t *value)
{
	if (*text < '0' || *text > '9')
		return false;
	errno = 0;
	unsigned long number = strtoul(text, end, 10);
	if (errno || number > 1000)
		return false;
	*value = (uint32_t)number;
	return true;
}

static bool parse_size(const char *text, uint32_t *cols, uint32_t *rows)
{
	char *end = NULL;
	if (!parse_count(text, &end, cols) || (*end != 'x' && *end != 'X'))
		return false;
	return parse_count(end + 1, &end, rows) && *end == '\0';
}

static bool parse_length(const char *text, double *metres)
{
	char *end = NULL;
	*metres = strtod(text, &end);
	return end != text && *end == '\0' && isfinite(*metres) && *metres >= 1e-4 && *metres <= 10;
}

static enum dio_status parse_dictionary(const char *spec, const char *name, struct dio_board *board,
					struct dio_error *error)
{
	for (size_t i = 0; i < DICTIONARY_COUNT; i++) {
		if (strcmp(name, dictionaries[i].name) != 0)
			continue;
		uint32_t needed = board->cols * board->rows / 2 + 1;
		if (needed > dictionaries[i].markers)
			return dio_fail(
				error, DIO_BAD_ARG,
				"board '%s': %ux%u squares need %u markers, %s has %u: take a "
				"larger dictionary",
				spec, board->cols, board->rows, needed, name,
				dictionaries[i].markers);
		board->dictionary = (int)i;
		snprintf(board->dictionary_name, sizeof(board->dictionary_name), "%s", name);
		return DIO_OK;
	}
	return dio_fail(error, DIO_BAD_ARG,
			"board '%s': '%s' is no dictionary of OpenCV: write one like DICT_6X6_250",
			spec, name);
}

static enum dio_status parse_charuco(const char *spec, char **parts, uint32_t count,
				     struct dio_board *board, struct dio_error *error)
{
	if (count < CHARUCO_PARTS || count > MAX_PARTS)
		return dio_fail(error, DIO_BAD_ARG, "board '%s': %s", spec, usage);
	if (!parse_length(parts[3], &board->marker_m) || board->marker_m >= board->square_m)
		return dio_fail(
			error, DIO_BAD_ARG,
			"board '%s': marker length '%s' must be metres, smaller than the square",
			spec, parts[3]);
	board->layout = DIO_LAYOUT_AUTO;
	if (count == MAX_PARTS) {
		if (strcmp(parts[5], "legacy") == 0)
			board->layout = DIO_LAYOUT_LEGACY;
		else if (strcmp(parts[5], "modern") == 0)
			board->layout = DIO_LAYOUT_MODERN;
		else
			return dio_fail(
				error, DIO_BAD_ARG,
				"board '%s': layout '%s' must be legacy or modern, or left out "
				"to try both",
				spec, parts[5]);
	}
	return parse_dictionary(spec, parts[4], board, error);
}

enum dio_status dio_board_parse(const char *spec, struct dio_board *board, struct dio_error *error)
{
	if (!spec || !board)
		return dio_fail(error, DIO_BAD_ARG, "board: no specification: %s", usage);
	char text[MAX_SPEC];
	if (strlen(spec) >= sizeof(text))
		return dio_fail(error, DIO_BAD_ARG, "board '%.40s...': too long: %s", spec, usage);
	memcpy(text, spec, strlen(spec) + 1);

	char *parts[MAX_PARTS] = {NULL};
	uint32_t count = split(text, parts, MAX_PARTS);
	struct dio_board parsed = {.dictionary = -1, .layout = DIO_LAYOUT_MODERN};
	if (strcmp(parts[0], "charuco") == 0)
		parsed.kind = DIO_BOARD_CHARUCO;
	else if (strcmp(parts[0], "chessboard") == 0)
		parsed.kind = DIO_BOARD_CHESSBOARD;
	else
		return dio_fail(error, DIO_BAD_ARG, "board '%s': no kind called '%s': %s", spec,
				parts[0], usage);
	if (count < CHESSBOARD_PARTS)
		return dio_fail(error, DIO_BAD_ARG, "board '%s': %s", spec, usage);
	if (!parse_size(parts[1], &parsed.cols, &parsed.rows) || parsed.cols < 3 ||
	    parsed.rows < 3 || parsed.cols > 100 || parsed.rows > 100)
		return dio_fail(error, DIO_BAD_ARG,
				"board '%s': size '%s' must be COLSxROWS, 3x3 to 100x100", spec,
				parts[1]);
	if (!parse_length(parts[2], &parsed.square_m))
		return dio_fail(error, DIO_BAD_ARG,
				"board '%s': square length '%s' must be metres, 0.0001 to 10", spec,
				parts[2]);

	if (parsed.kind == DIO_BOARD_CHARUCO) {
		enum dio_status status = parse_charuco(spec, parts, count, &parsed, error);
		if (status != DIO_OK)
			return status;
	} else if (count != CHESSBOARD_PARTS) {
		return dio_fail(error, DIO_BAD_ARG, "board '%s': '%s' is too much: %s", spec,
				parts[CHESSBOARD_PARTS], usage);
	}
	*board = parsed;
	return DIO_OK;
}

void dio_board_format(const struct dio_board *board, char *spec, uint32_t spec_size)
{
	if (board->kind == DIO_BOARD_CHESSBOARD) {
		snprintf(spec, spec_size, "chessboard:%ux%u:%.10g", board->cols, board->rows,
			 board->square_m);
		return;
	}
	static const char *const suffix[] = {
		[DIO_LAYOUT_AUTO] = "",
		[DIO_LAYOUT_MODERN] = ":modern",
		[DIO_LAYOUT_LEGACY] = ":legacy",
	};
	snprintf(spec, spec_size, "charuco:%ux%u:%.10g:%.10g:%s%s", board->cols, board->rows,
		 board->square_m, board->marker_m, board->dictionary_name, suffix[board->layout]);
}
