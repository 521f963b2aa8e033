/* A reconstructed scene: what it holds, and its file (safetensors). */
#ifndef DVSM_SCENE_H
#define DVSM_SCENE_H

#include <stddef.h>
#include <stdint.h>

#include "dvsm/camera.h"
#include "dvsm/engine.h"
#include "dvsm/status.h"

#ifdef __cplusplus
extern "C" {
#endif

/** Release a scene; NULL is fine. */
DVSM_API void dvsm_scene_destroy(struct dvsm_scene *scene);

/** Number of context views and their cameras (world frame, as given), owned by the scene. */
DVSM_API uint32_t dvsm_scene_get_view_count(const struct dvsm_scene *scene);
DVSM_API const struct dvsm_camera *dvsm_scene_get_cameras(const struct dvsm_scene *scene);

/** Tokens of all views together (keys per head and layer), and the stage patch they were cut with.
 */
DVSM_API uint64_t dvsm_scene_get_token_count(const struct dvsm_scene *scene);
DVSM_API uint32_t dvsm_scene_get_patch_px(const struct dvsm_scene *scene);

/** Bytes of the KV-cache: L x 2 x (V N) x D x bytes of a number. */
DVSM_API size_t dvsm_scene_get_cache_bytes(const struct dvsm_scene *scene);

/** The precision it was reconstructed in, which is the one it is rendered in. */
DVSM_API enum dvsm_precision dvsm_scene_get_precision(const struct dvsm_scene *scene);

/** SHA-256 (hex) of the model that made it. */
DVSM_API const char *dvsm_scene_get_model_sha256(const struct dvsm_scene *scene);

/**
 * SHA-256 of the KV-cache, keys first, and in fixed point its scales: `hex` receives 64 lower-case
 * hex digits and a terminator. In fixed point the same pictures and poses give the same hash on
 * every machine.
 */
DVSM_API void dvsm_scene_hash_cache(const struct dvsm_scene *scene, char hex[65]);

/** SHA-256 of any bytes, in the same form. */
DVSM_API void dvsm_hash_bytes(const void *bytes, size_t size, char hex[65]);

/**
 * Keys and values of one block's cross-view layer, copied out for tests and tools.
 *
 * layer   0..L-1
 * keys, values   [heads][tokens][D/heads] float, caller's memory
 *
 * DVSM_UNSUPPORTED  a fixed-point scene: its keys are without their mean and weight
 */
DVSM_API enum dvsm_status dvsm_scene_copy_cache(const struct dvsm_scene *scene, uint32_t layer,
						float *keys, float *values);

/**
 * Write a scene beside `path`, sync it, and rename it into place: a crash leaves the old file or
 * the new one, never a part. The file carries a SHA-256 of its tensors. A bf16 scene of AMX lies in
 * another order than its file and takes as much memory again for the while.
 */
DVSM_API enum dvsm_status dvsm_scene_save(const struct dvsm_scene *scene, const char *path,
					  struct dvsm_error *error);

/**
 * Open a scene file for rendering with `model`.
 *
 * DVSM_BAD_FILE  malformed, checksum wrong, non-finite number
 * DVSM_MISMATCH  made with another model; the text names both hashes
 */
DVSM_API enum dvsm_status dvsm_scene_open(const char *path, const struct dvsm_model *model,
					  struct dvsm_scene **scene, struct dvsm_error *error);

/** What a scene file says of itself, read and checked without the model. */
struct dvsm_scene_info {
	uint32_t views, layers, heads, dim, patch_px;
	uint64_t tokens;
	size_t cache_bytes;
	enum dvsm_precision precision;
	char model_sha256[65];
};
DVSM_API enum dvsm_status dvsm_scene_probe(const char *path, struct dvsm_scene_info *info,
					   struct dvsm_error *error);

#ifdef __cplusplus
}
#endif
#endif
