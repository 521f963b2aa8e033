#include "core/model_choice.h"

#include <cjson/cJSON.h>
#include <dirent.h>
#include <math.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "core/path.h"
#include "core/text.h"

#define CARD_BYTES_MAX (1u << 20)
#define PATCH_MAX_PX   256
#define TOKENS_MAX     1000000

static const char ENDING[] = ".safetensors";

/* NAME.json of NAME.safetensors, NULL when memory is short. */
static char *card_path(const char *model_path)
{
	size_t length = strlen(model_path), ending = strlen(ENDING);
	char *path;

	if (length > ending && strcmp(model_path + length - ending, ENDING) == 0)
		length -= ending;
	return asprintf(&path, "%.*s.json", (int)length, model_path) < 0 ? NULL : path;
}

/* `json` receives NULL when there is none. */
static enum dio_status read_json(const char *model_path, cJSON **json, struct dio_error *error)
{
	char *path = card_path(model_path), *text = NULL;
	enum dio_status status = DIO_OK;
	size_t size;

	*json = NULL;
	if (!path)
		return dio_fail(error, DIO_NO_MEM, "%s: no memory", model_path);
	if (dio_path_is_file(path)) {
		status = dio_text_read(path, CARD_BYTES_MAX, &text, &size, error);
		if (status == DIO_OK)
			*json = cJSON_ParseWithLength(text, size);
		if (status == DIO_OK && !cJSON_IsObject(*json)) {
			cJSON_Delete(*json);
			*json = NULL;
			status = dio_fail(error, DIO_BAD_FILE, "%s: is not a JSON object", path);
		}
	}
	free(text);
	free(path);
	return status;
}

static enum dio_status parse_card(const cJSON *json, const char *model_path,
				  struct dio_model_card *card, struct dio_error *error)
{
	const cJSON *tokens = cJSON_GetObjectItemCaseSensitive(json, "tokens_per_view");
	const cJSON *deblock = cJSON_GetObjectItemCaseSensitive(json, "deblock");

	if (tokens && !(cJSON_IsNumber(tokens) && tokens->valuedouble >= 1 &&
			tokens->valuedouble <= TOKENS_MAX))
		return dio_fail(error, DIO_BAD_FILE,
				"the card of %s: \"tokens_per_view\" is not a number from 1 to %d",
				model_path, TOKENS_MAX);
	if (deblock && !cJSON_IsBool(deblock))
		return dio_fail(error, DIO_BAD_FILE,
				"the card of %s: \"deblock\" is neither true nor false",
				model_path);
	*card = (struct dio_model_card){
		.tokens_per_view = tokens ? (uint32_t)tokens->valuedouble : 0,
		.deblock = cJSON_IsTrue(deblock),
	};
	return DIO_OK;
}

enum dio_status dio_model_read_card(const char *model_path, struct dio_model_card *card,
				    struct dio_error *error)
{
	cJSON *json;
	enum dio_status status = read_json(model_path, &json, error);

	if (status == DIO_OK)
		status = parse_card(json, model_path, card, error);
	cJSON_Delete(json);
	return status;
}

uint32_t dio_model_choose_patch(uint32_t tokens_per_view, uint32_t patch_px, uint32_t width,
				uint32_t height)
{
	double best_off = INFINITY, best_misfit = INFINITY;
	uint32_t best = patch_px;

	if (tokens_per_view == 0)
		return patch_px;
	for (uint32_t p = 1; p <= PATCH_MAX_PX; p++) {
		double columns = fmax(1, floor((double)width / p + 0.5));
		double rows = fmax(1, floor((double)height / p + 0.5));
		double off = fabs(log(columns * rows / tokens_per_view));
		double misfit = fabs((double)width / p - columns) / columns +
				fabs((double)height / p - rows) / rows;

		if (off < best_off || (off == best_off && misfit < best_misfit)) {
			best_off = off;
			best_misfit = misfit;
			best = p;
		}
	}
	return best;
}

static bool is_model_name(const char *name)
{
	size_t length = strlen(name), ending = strlen(ENDING);

	return name[0] != '.' && length > ending && strcmp(name + length - ending, ENDING) == 0;
}

static bool is_default(const char *model_path)
{
	cJSON *json;
	bool yes;

	if (read_json(model_path, &json, NULL) != DIO_OK)
		return false;
	yes = cJSON_IsTrue(cJSON_GetObjectItemCaseSensitive(json, "default"));
	cJSON_Delete(json);
	return yes;
}

/* The model that a folder offers, or NULL. */
static char *find_in_folder(const char *folder)
{
	struct dirent **names;
	int count = scandir(folder, &names, NULL, alphasort);
	char *found = NULL;
	bool settled = false;

	for (int i = 0; i < count; i++) {
		char *path = is_model_name(names[i]->d_name)
				     ? dio_path_join(folder, names[i]->d_name)
				     : NULL;

		if (path && !settled) {
			settled = is_default(path);
			if (settled || !found) {
				free(found);
				found = path;
				path = NULL;
			}
		}
		free(path);
		free(names[i]);
	}
	if (count >= 0)
		free(names);
	return found;
}

enum dio_status dio_model_find_shipped(char **path, struct dio_error *error)
{
	static const char *const PLACES[] = {
		"models",
		"../models",
		"../../models",
		"../../../models",
		"../share/diorama/models",
		"../../share/diorama/models",
	};
	char program[4096];
	ssize_t length = readlink("/proc/self/exe", program, sizeof program - 1);
	char *folder = NULL, *found = NULL;

	if (length > 0) {
		program[length] = '\0';
		folder = dio_path_folder(program);
	}
	for (size_t i = 0; folder && !found && i < sizeof PLACES / sizeof *PLACES; i++) {
		char *place = dio_path_join(folder, PLACES[i]);

		/* Without the dots, as it will be shown. */
		char *plain = place ? realpath(place, NULL) : NULL;

		if (plain)
			found = find_in_folder(plain);
		free(plain);
		free(place);
	}
	free(folder);
	if (!found)
		return dio_fail(error, DIO_NOT_FOUND,
				"no model is shipped beside the program: name one with --model");
	*path = found;
	return DIO_OK;
}
