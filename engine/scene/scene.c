#include "dvsm/scene.h"

#include <stdlib.h>
#include <string.h>

#include "base/error.h"
#include "base/memory.h"
#include "files/sha256.h"
#include "geometry/rays.h"
#include "scene/scene_file.h"
#include "scene/scene_internal.h"

static enum dvsm_status fail_size(const char *what, struct dvsm_error *error)
{
	return dvsm_fail(error, DVSM_NO_MEM,
			 "no memory for %s: take fewer or smaller views, or a larger patch", what);
}

/* Bytes from the keys to the values: both halves start aligned. */
static bool half_cache_bytes(const struct dvsm_model_config *config, enum dvsm_precision precision,
			     size_t tokens, size_t *bytes)
{
	uint32_t dim = config->dim, layers = config->layers;
	if (precision == DVSM_PRECISION_FIXED)
		return dvsm_fixed_cache_bytes(config, tokens, bytes);
	return dvsm_size_mul(tokens, dim, bytes) && dvsm_size_mul(*bytes, layers, bytes) &&
	       dvsm_size_mul(*bytes, dvsm_cache_number_bytes(precision), bytes) &&
	       dvsm_size_align(*bytes, bytes);
}

enum dvsm_status dvsm_scene_measure(const struct dvsm_model_config *config,
				    enum dvsm_precision precision,
				    const struct dvsm_camera *cameras, uint32_t views,
				    uint32_t patch_px, size_t *tokens, size_t *cache_bytes,
				    struct dvsm_error *error)
{
	size_t total = 0, half = 0, fine = 0, bytes = 0;
	for (uint32_t i = 0; i < views; i++) {
		if (!dvsm_size_add(total, dvsm_camera_tokens(&cameras[i], patch_px), &total))
			return fail_size("so many tokens", error);
	}
	if (!half_cache_bytes(config, precision, total, &half) || !dvsm_size_mul(half, 2, &bytes) ||
	    (precision == DVSM_PRECISION_FIXED &&
	     (!dvsm_fixed_cache_fine_bytes(config, total, &fine) ||
	      !dvsm_size_add(bytes, fine, &bytes))))
		return fail_size("the KV-cache", error);
	if (tokens)
		*tokens = total;
	*cache_bytes = bytes;
	return DVSM_OK;
}

static struct dvsm_model_config config_of(const struct dvsm_scene *scene)
{
	return (struct dvsm_model_config){
		.dim = scene->dim,
		.heads = scene->heads,
		.layers = scene->layers,
	};
}

static void allocate_cache(struct dvsm_scene *scene)
{
	struct dvsm_model_config config = config_of(scene);
	if (scene->precision != DVSM_PRECISION_FIXED) {
		scene->keys = dvsm_aligned_alloc(scene->cache_bytes);
	} else if (dvsm_fixed_cache_init(&config, scene->tokens, &scene->fixed)) {
		scene->keys = scene->fixed.keys;
	}
	if (scene->keys)
		scene->values = (unsigned char *)scene->keys + scene->cache_bytes / 2;
}

static bool allocate_parts(struct dvsm_scene *scene, bool with_cache)
{
	scene->cameras = calloc(scene->views, sizeof(*scene->cameras));
	scene->first_token = calloc((size_t)scene->views + 1, sizeof(*scene->first_token));
	if (with_cache)
		allocate_cache(scene);
	return scene->cameras && scene->first_token && (scene->keys || !with_cache);
}

enum dvsm_status dvsm_scene_make(const struct dvsm_scene *sizes, bool with_cache,
				 struct dvsm_scene **scene, struct dvsm_error *error)
{
	struct dvsm_model_config config = config_of(sizes);
	size_t half;
	if (!half_cache_bytes(&config, sizes->precision, sizes->tokens, &half) ||
	    half > SIZE_MAX / 2)
		return fail_size("the KV-cache", error);

	struct dvsm_scene *made = calloc(1, sizeof(*made));
	if (!made)
		return fail_size("a scene", error);
	*made = *sizes;
	made->cache_bytes = 2 * half;
	if (!allocate_parts(made, with_cache)) {
		dvsm_scene_destroy(made);
		return fail_size("the KV-cache", error);
	}
	*scene = made;
	return DVSM_OK;
}

void dvsm_scene_place_cameras(struct dvsm_scene *scene)
{
	for (uint32_t i = 0; i < scene->views; i++)
		scene->first_token[i + 1] = scene->first_token[i] +
					    dvsm_camera_tokens(&scene->cameras[i], scene->patch_px);
	scene->normalisation = dvsm_normalisation_compute(scene->cameras, scene->views);
}

enum dvsm_status dvsm_scene_allocate(const struct dvsm_model_config *config,
				     const char model_sha256[65], enum dvsm_precision precision,
				     const struct dvsm_camera *cameras, uint32_t views,
				     uint32_t patch_px, struct dvsm_scene **scene,
				     struct dvsm_error *error)
{
	struct dvsm_scene sizes = {
		.dim = config->dim,
		.heads = config->heads,
		.layers = config->layers,
		.precision = precision,
		.views = views,
		.patch_px = patch_px,
	};
	enum dvsm_status status = dvsm_scene_measure(config, precision, cameras, views, patch_px,
						     &sizes.tokens, &sizes.cache_bytes, error);
	if (status != DVSM_OK)
		return status;
	memcpy(sizes.model_sha256, model_sha256, sizeof(sizes.model_sha256));

	struct dvsm_scene *made = NULL;
	status = dvsm_scene_make(&sizes, true, &made, error);
	if (status != DVSM_OK)
		return status;
	memcpy(made->cameras, cameras, views * sizeof(*cameras));
	dvsm_scene_place_cameras(made);
	*scene = made;
	return DVSM_OK;
}

void dvsm_scene_destroy(struct dvsm_scene *scene)
{
	if (!scene)
		return;
	free(scene->cameras);
	free(scene->first_token);
	if (scene->precision == DVSM_PRECISION_FIXED)
		dvsm_fixed_cache_deinit(&scene->fixed);
	else
		free(scene->keys);
	free(scene);
}

uint32_t dvsm_scene_get_view_count(const struct dvsm_scene *scene)
{
	return scene->views;
}

const struct dvsm_camera *dvsm_scene_get_cameras(const struct dvsm_scene *scene)
{
	return scene->cameras;
}

uint64_t dvsm_scene_get_token_count(const struct dvsm_scene *scene)
{
	return scene->tokens;
}

uint32_t dvsm_scene_get_patch_px(const struct dvsm_scene *scene)
{
	return scene->patch_px;
}

size_t dvsm_scene_get_cache_bytes(const struct dvsm_scene *scene)
{
	return scene->cache_bytes;
}

enum dvsm_precision dvsm_scene_get_precision(const struct dvsm_scene *scene)
{
	return scene->precision;
}

const char *dvsm_scene_get_model_sha256(const struct dvsm_scene *scene)
{
	return scene->model_sha256;
}

/* Bytes of the keys, or of the values, in rows. */
static void hash_heads(const struct dvsm_scene *scene, enum dvsm_block_order order,
		       const dvsm_bf16 *numbers, struct dvsm_sha256 *hash)
{
	const size_t head_dim = scene->dim / scene->heads, heads = scene->layers * scene->heads;
	for (size_t head = 0; head < heads; head++, numbers += scene->tokens * head_dim) {
		for (size_t at = 0; at < scene->tokens * head_dim; at += DVSM_BLOCK_KEYS) {
			dvsm_bf16 part[DVSM_BLOCK_KEYS];
			for (size_t i = 0; i < DVSM_BLOCK_KEYS; i++)
				part[i] = numbers[dvsm_block_place(order, at / head_dim,
								   at % head_dim + i, scene->tokens,
								   head_dim)];
			dvsm_sha256_update(hash, part, sizeof(part));
		}
	}
}

void dvsm_scene_hash_cache(const struct dvsm_scene *scene, char hex[65])
{
	const struct dvsm_fixed_cache *fixed = &scene->fixed;
	const size_t numbers = (size_t)scene->layers * scene->dim;
	struct dvsm_sha256 hash;
	dvsm_sha256_init(&hash);
	if (scene->precision == DVSM_PRECISION_FIXED) {
		dvsm_sha256_update(&hash, scene->keys, scene->cache_bytes);
		dvsm_sha256_update(&hash, fixed->k_scale, numbers * sizeof(*fixed->k_scale));
		dvsm_sha256_update(&hash, fixed->v_scale, numbers * sizeof(*fixed->v_scale));
		dvsm_sha256_update(&hash, fixed->v_mean, numbers * sizeof(*fixed->v_mean));
	} else if (scene->in_blocks) {
		hash_heads(scene, DVSM_BLOCK_OF_KEYS, scene->keys, &hash);
		hash_heads(scene, DVSM_BLOCK_OF_VALUES, scene->values, &hash);
	} else {
		size_t bytes = numbers * scene->tokens * dvsm_cache_number_bytes(scene->precision);
		dvsm_sha256_update(&hash, scene->keys, bytes);
		dvsm_sha256_update(&hash, scene->values, bytes);
	}
	dvsm_sha256_finish(&hash, hex);
}

void dvsm_hash_bytes(const void *bytes, size_t size, char hex[65])
{
	struct dvsm_sha256 hash;
	dvsm_sha256_init(&hash);
	dvsm_sha256_update(&hash, bytes, size);
	dvsm_sha256_finish(&hash, hex);
}

/* The keys of a layer, or its values, in blocks. */
static void expand_heads(const struct dvsm_scene *scene, enum dvsm_block_order order,
			 const dvsm_bf16 *numbers, float *floats)
{
	const size_t head_dim = scene->dim / scene->heads, count = scene->tokens * head_dim;
	for (uint32_t head = 0; head < scene->heads; head++, numbers += count, floats += count) {
		for (size_t i = 0; i < count; i++)
			floats[i] = dvsm_bf16_widen(numbers[dvsm_block_place(
				order, i / head_dim, i % head_dim, scene->tokens, head_dim)]);
	}
}

enum dvsm_status dvsm_scene_copy_cache(const struct dvsm_scene *scene, uint32_t layer, float *keys,
				       float *values)
{
	if (!scene || layer >= scene->layers || !keys || !values)
		return DVSM_BAD_ARG;
	if (scene->precision == DVSM_PRECISION_FIXED)
		return DVSM_UNSUPPORTED;
	if (scene->in_blocks) {
		expand_heads(scene, DVSM_BLOCK_OF_KEYS, dvsm_scene_keys(scene, layer, 0), keys);
		expand_heads(scene, DVSM_BLOCK_OF_VALUES, dvsm_scene_values(scene, layer, 0),
			     values);
		return DVSM_OK;
	}
	size_t count = scene->tokens * scene->dim;
	enum dvsm_dtype dtype = dvsm_scene_dtype(scene->precision);
	dvsm_dtype_expand(dtype, dvsm_scene_keys(scene, layer, 0), count, keys);
	dvsm_dtype_expand(dtype, dvsm_scene_values(scene, layer, 0), count, values);
	return DVSM_OK;
}
