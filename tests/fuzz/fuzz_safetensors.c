/*
 * Model and scene files of any bytes: opened or refused with one line, never a crash.
 *
 * The mutator repairs what would hide everything behind it: the length of the header after a
 * change of the header, and a scene's checksum.
 */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "dvsm/dvsm.h"
#include "files/safetensors.h"
#include "model/model.h"
#include "scene/scene_internal.h"
#include "weights/open.h"

/* libFuzzer's interface has no header in C. */
int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);
size_t LLVMFuzzerCustomMutator(uint8_t *data, size_t size, size_t max_size, unsigned seed);
size_t LLVMFuzzerMutate(uint8_t *data, size_t size, size_t max_size);

#define PREFIX_BYTES 8

static void require(int truth, const char *what)
{
	if (!truth) {
		fprintf(stderr, "fuzz_safetensors: %s\n", what);
		abort();
	}
}

/* A refusal has its status and one line of text; both outputs stay as they were. */
static void check_refusal(enum dvsm_status status, const void *output,
			  const struct dvsm_error *error)
{
	require(output == NULL, "an output was touched by a failure");
	require(status == DVSM_BAD_FILE || status == DVSM_UNSUPPORTED || status == DVSM_NO_MEM,
		"a status that no file should give");
	require(strncmp(error->text, "input: ", 7) == 0, "a text that does not name the file");
	require(strchr(error->text, '\n') == NULL, "a text of more than one line");
}

static void try_model(const uint8_t *data, size_t size)
{
	struct dvsm_model *model = NULL;
	struct dvsm_error error = {""};
	enum dvsm_status status = dvsm_model_open_bytes(data, size, "input", &model, &error);
	if (status != DVSM_OK) {
		check_refusal(status, model, &error);
		return;
	}
	const struct dvsm_model_config *config = dvsm_model_get_config(model);
	const struct dvsm_matrix *last = &model->weights.to_rgb;
	size_t count = 0;
	require(last->in == config->dim && dvsm_pack_size(last->out, last->in, &count),
		"a matrix of another shape");
	for (size_t i = 0; i < count; i++)
		require(isfinite(last->panels[i]), "a weight that is not finite");
	dvsm_model_close(model);
	for (int p = DVSM_PRECISION_F32; p <= DVSM_PRECISION_FIXED; p++) {
		status = dvsm_model_open_bytes_for(data, size, "input", (enum dvsm_precision)p,
						   &model, &error);
		require(status == DVSM_OK || status == DVSM_UNSUPPORTED || status == DVSM_NO_MEM,
			"a model that opens for all precisions, and not for one");
		if (status == DVSM_OK)
			dvsm_model_close(model);
	}
}

static void try_scene(const uint8_t *data, size_t size)
{
	struct dvsm_scene *scene = NULL;
	struct dvsm_error error = {""};
	enum dvsm_status status = dvsm_scene_open_bytes(data, size, "input", NULL, &scene, &error);
	if (status != DVSM_OK) {
		check_refusal(status, scene, &error);
		return;
	}
	size_t floats = scene->tokens * scene->dim;
	float *cache = malloc(2 * floats * sizeof(*cache));
	require(cache != NULL, "no memory");
	for (uint32_t layer = 0; layer < scene->layers; layer++)
		require(dvsm_scene_copy_cache(scene, layer, cache, cache + floats) == DVSM_OK,
			"a layer that cannot be copied");
	free(cache);
	dvsm_scene_destroy(scene);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
	try_model(data, size);
	try_scene(data, size);
	return 0;
}

static size_t header_length(const uint8_t *data, size_t size)
{
	uint64_t length;
	memcpy(&length, data, sizeof(length));
	return length <= size - PREFIX_BYTES ? (size_t)length : size - PREFIX_BYTES;
}

/* Change the header alone: the tensors move along behind it and the length is set anew. */
static size_t mutate_header(uint8_t *data, size_t size, size_t max_size)
{
	size_t length = header_length(data, size), tail = size - PREFIX_BYTES - length;
	uint8_t *kept = malloc(tail ? tail : 1);
	require(kept != NULL, "no memory");
	memcpy(kept, data + PREFIX_BYTES + length, tail);
	uint64_t changed =
		LLVMFuzzerMutate(data + PREFIX_BYTES, length, max_size - PREFIX_BYTES - tail);
	memcpy(data, &changed, sizeof(changed));
	memcpy(data + PREFIX_BYTES + changed, kept, tail);
	free(kept);
	return PREFIX_BYTES + (size_t)changed + tail;
}

static int checksum_of(const uint8_t *data, size_t size, char hex[DVSM_SHA256_HEX])
{
	struct dvsm_safetensors file;
	if (dvsm_safetensors_open_bytes(data, size, "input", &file, NULL) != DVSM_OK)
		return 0;
	const char *config = dvsm_safetensors_get_metadata(&file, "config");
	const char *model = dvsm_safetensors_get_metadata(&file, "model_sha256");
	struct dvsm_sha256 hash;
	dvsm_sha256_init(&hash);
	int ok = config && model;
	if (ok) {
		dvsm_sha256_update(&hash, config, strlen(config));
		dvsm_sha256_update(&hash, model, strlen(model));
		ok = dvsm_safetensors_load(&file, &hash, NULL, NULL) == DVSM_OK;
		dvsm_sha256_finish(&hash, hex);
	}
	dvsm_safetensors_close(&file);
	return ok;
}

static void repair_checksum(uint8_t *data, size_t size)
{
	static const char key[] = "\"sha256\":\"";
	char hex[DVSM_SHA256_HEX];
	uint8_t *at = memmem(data, size, key, strlen(key));
	if (!at || !checksum_of(data, size, hex))
		return;
	at += strlen(key);
	if ((size_t)(data + size - at) >= strlen(hex))
		memcpy(at, hex, strlen(hex));
}

size_t LLVMFuzzerCustomMutator(uint8_t *data, size_t size, size_t max_size, unsigned seed)
{
	if (seed % 3 != 0 && size > PREFIX_BYTES && header_length(data, size) > 0)
		size = mutate_header(data, size, max_size);
	else
		size = LLVMFuzzerMutate(data, size, max_size);
	if (seed % 16 != 0 && size > PREFIX_BYTES)
		repair_checksum(data, size);
	return size;
}
