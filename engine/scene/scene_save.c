#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/error.h"
#include "files/safetensors.h"
#include "scene/scene_file.h"
#include "scene/scene_internal.h"

static void pack_camera(const struct dvsm_camera *camera, double numbers[DVSM_SCENE_CAMERA_NUMBERS])
{
	const double head[6] = {camera->width, camera->height, camera->fx,
				camera->fy,    camera->cx,     camera->cy};
	memcpy(numbers, head, sizeof(head));
	memcpy(numbers + 6, camera->world_from_camera, sizeof(camera->world_from_camera));
}

static void pack_normalisation(const struct dvsm_normalisation *n,
			       double numbers[DVSM_SCENE_NORMALISATION_NUMBERS])
{
	memcpy(numbers, n->axes, sizeof(n->axes));
	memcpy(numbers + 9, n->origin, sizeof(n->origin));
	numbers[12] = n->scale;
}

static void checksum(const char *config, const char *model_sha256,
		     const struct dvsm_tensor_out *tensors, size_t count, char hex[DVSM_SHA256_HEX])
{
	struct dvsm_sha256 hash;
	dvsm_sha256_init(&hash);
	dvsm_sha256_update(&hash, config, strlen(config));
	dvsm_sha256_update(&hash, model_sha256, strlen(model_sha256));
	for (size_t i = 0; i < count; i++)
		dvsm_sha256_update(&hash, tensors[i].bytes, tensors[i].size);
	dvsm_sha256_finish(&hash, hex);
}

/* The tensors of a file, in its order. */
struct tensors_out {
	struct dvsm_tensor_out list[7];
	size_t count;
};

static void add(struct tensors_out *tensors, const char *name, enum dvsm_dtype dtype,
		const uint64_t *shape, uint32_t rank, const void *bytes)
{
	struct dvsm_tensor_out *to = &tensors->list[tensors->count++];
	*to = (struct dvsm_tensor_out){.name = name, .dtype = dtype, .rank = rank, .bytes = bytes};
	to->size = dvsm_dtype_bytes(dtype);
	for (uint32_t i = 0; i < rank; i++) {
		to->shape[i] = shape[i];
		to->size *= (size_t)shape[i];
	}
}

static void add_cache(const struct dvsm_scene *scene, struct tensors_out *tensors)
{
	const enum dvsm_dtype dtype = dvsm_scene_dtype(scene->precision);
	const uint64_t layers = scene->layers, dim = scene->dim;
	uint64_t shape[4] = {layers, scene->heads, scene->tokens, dim / scene->heads};
	if (scene->precision == DVSM_PRECISION_FIXED) {
		const struct dvsm_fixed_cache *fixed = &scene->fixed;
		const uint64_t scales[3] = {layers, dim, 2};
		add(tensors, "k_scale", DVSM_DTYPE_I16, scales, 3, fixed->k_scale);
		add(tensors, "v_scale", DVSM_DTYPE_I16, scales, 3, fixed->v_scale);
		add(tensors, "v_mean", DVSM_DTYPE_I16, scales, 2, fixed->v_mean);
		shape[2] = fixed->padded;
		shape[3] = dvsm_fixed_pad(scene->dim / scene->heads, DVSM_FIXED_HEAD);
	}
	add(tensors, "keys", dtype, shape, 4, scene->keys);
	add(tensors, scene->precision == DVSM_PRECISION_FIXED ? "turned_values" : "values", dtype,
	    shape, 4, scene->values);
}

static enum dvsm_status write_scene(const struct dvsm_scene *scene, const double *cameras,
				    const char *path, struct dvsm_error *error)
{
	double normalisation[DVSM_SCENE_NORMALISATION_NUMBERS];
	pack_normalisation(&scene->normalisation, normalisation);
	const uint64_t cameras_shape[2] = {scene->views, DVSM_SCENE_CAMERA_NUMBERS};
	const uint64_t normalisation_shape[1] = {DVSM_SCENE_NORMALISATION_NUMBERS};
	struct tensors_out tensors = {.count = 0};
	add(&tensors, "cameras", DVSM_DTYPE_F64, cameras_shape, 2, cameras);
	add(&tensors, "normalisation", DVSM_DTYPE_F64, normalisation_shape, 1, normalisation);
	add_cache(scene, &tensors);

	char config[160], sha256[DVSM_SHA256_HEX];
	snprintf(config, sizeof(config),
		 "{\"dim\": %u, \"heads\": %u, \"layers\": %u, \"patch\": %u, \"tokens\": %zu}",
		 scene->dim, scene->heads, scene->layers, scene->patch_px, scene->tokens);
	checksum(config, scene->model_sha256, tensors.list, tensors.count, sha256);
	const struct dvsm_metadata_out metadata[] = {
		{"format", DVSM_SCENE_FORMAT},
		{"version", DVSM_SCENE_VERSION},
		{"config", config},
		{"model_sha256", scene->model_sha256},
		{"sha256", sha256},
	};
	return dvsm_safetensors_write(path, metadata, sizeof(metadata) / sizeof(metadata[0]),
				      tensors.list, tensors.count, error);
}

enum dvsm_status dvsm_scene_save(const struct dvsm_scene *scene, const char *path,
				 struct dvsm_error *error)
{
	if (!scene || !path)
		return dvsm_fail(error, DVSM_BAD_ARG, "no scene, or no file to save it to");
	struct dvsm_scene rows = *scene; /* as it lies in the file */
	enum dvsm_status status = DVSM_OK;
	if (scene->in_blocks)
		status = dvsm_scene_reorder(scene, &rows.keys, &rows.values, error);
	if (status != DVSM_OK)
		return status;
	double *cameras =
		calloc((size_t)scene->views * DVSM_SCENE_CAMERA_NUMBERS, sizeof(*cameras));
	if (!cameras)
		status = dvsm_fail(error, DVSM_NO_MEM, "%s: no memory to write it",
				   dvsm_name_tail(path));
	for (uint32_t i = 0; cameras && i < scene->views; i++)
		pack_camera(&scene->cameras[i], cameras + (size_t)i * DVSM_SCENE_CAMERA_NUMBERS);
	if (status == DVSM_OK)
		status = write_scene(&rows, cameras, path, error);
	free(cameras);
	if (scene->in_blocks)
		free(rows.keys);
	return status;
}
