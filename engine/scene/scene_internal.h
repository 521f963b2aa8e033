/* A scene in memory: KV-cache, context cameras, normalisation. Private to the engine. */
#ifndef DVSM_SCENE_SCENE_INTERNAL_H
#define DVSM_SCENE_SCENE_INTERNAL_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "dvsm/model.h"
#include "dvsm/scene.h"
#include "fixed/cache.h"
#include "geometry/pose.h"
#include "kernels/lay.h"
#include "model/model.h"

/**
 * Which model's scenes are a model's own: those with its SHA-256, and in fixed those of the model
 * it was quantised from, because the bits are the same.
 */
static inline const char *dvsm_scene_model_of(const struct dvsm_model *model,
					      enum dvsm_precision precision)
{
	return precision == DVSM_PRECISION_FIXED ? model->source_sha256 : model->sha256;
}

struct dvsm_scene {
	uint32_t dim, heads, layers; /* of the model that made it */
	enum dvsm_precision precision;
	char model_sha256[65];
	uint32_t views;
	uint32_t patch_px;           /* stage patch p1 */
	struct dvsm_camera *cameras; /* [views], world frame, as given; owned */
	size_t *first_token; /* [views + 1], tokens of view v: first_token[v] .. [v + 1] - 1 */
	size_t tokens;       /* of all views together */
	struct dvsm_normalisation normalisation;
	/* The cache, [layers][heads][tokens][dim / heads] each: keys after QK-norm, and values.
	 * Float32 or, in bf16, bfloat16; both lie in one 64-byte aligned allocation that `keys`
	 * begins; cache_bytes covers both. In fixed they are those of `fixed`.
	 */
	void *keys, *values;
	bool in_blocks; /* each head is in blocks (kernels/lay.h); bf16 alone */
	struct dvsm_fixed_cache fixed;
	size_t cache_bytes;
};

/** Bytes of the cache with what is made of it for fine queries. */
static inline size_t dvsm_scene_memory_bytes(const struct dvsm_scene *scene)
{
	return scene->cache_bytes + scene->fixed.fine_bytes;
}

/** Bytes of a number of the cache. */
static inline size_t dvsm_cache_number_bytes(enum dvsm_precision precision)
{
	return precision == DVSM_PRECISION_BF16 ? sizeof(dvsm_bf16) : sizeof(float);
}

/** Bytes from the start of the keys, or of the values, to those of a head of a layer. */
static inline size_t dvsm_scene_head_at(const struct dvsm_scene *scene, uint32_t layer,
					uint32_t head)
{
	return ((size_t)layer * scene->heads + head) * scene->tokens * (scene->dim / scene->heads) *
	       dvsm_cache_number_bytes(scene->precision);
}

/** Keys of one head of one layer: [tokens][dim / heads], or in blocks. */
static inline void *dvsm_scene_keys(const struct dvsm_scene *scene, uint32_t layer, uint32_t head)
{
	return (unsigned char *)scene->keys + dvsm_scene_head_at(scene, layer, head);
}

/** Values of one head of one layer, likewise. */
static inline void *dvsm_scene_values(const struct dvsm_scene *scene, uint32_t layer, uint32_t head)
{
	return (unsigned char *)scene->values + dvsm_scene_head_at(scene, layer, head);
}

/**
 * dvsm_scene_memory_bytes() that a scene would have, and the tokens it would hold.
 *
 * cameras   [views], checked; only the sizes matter
 * tokens    receives the sum over the views, or NULL
 *
 * DVSM_NO_MEM  does not fit the address space
 */
enum dvsm_status dvsm_scene_measure(const struct dvsm_model_config *config,
				    enum dvsm_precision precision,
				    const struct dvsm_camera *cameras, uint32_t views,
				    uint32_t patch_px, size_t *tokens, size_t *cache_bytes,
				    struct dvsm_error *error);

/**
 * Allocate a scene for checked cameras with its normalisation computed; the cache's content is
 * undefined. Release with dvsm_scene_destroy().
 */
enum dvsm_status dvsm_scene_allocate(const struct dvsm_model_config *config,
				     const char model_sha256[65], enum dvsm_precision precision,
				     const struct dvsm_camera *cameras, uint32_t views,
				     uint32_t patch_px, struct dvsm_scene **scene,
				     struct dvsm_error *error);

/**
 * The two steps of dvsm_scene_allocate(), for a reader that learns the cameras later: make room as
 * dim, layers, precision, views and tokens of `sizes` say, then, with `cameras` filled in, place
 * their tokens and compute the normalisation.
 *
 * with_cache   false leaves keys and values NULL
 */
enum dvsm_status dvsm_scene_make(const struct dvsm_scene *sizes, bool with_cache,
				 struct dvsm_scene **scene, struct dvsm_error *error);
void dvsm_scene_place_cameras(struct dvsm_scene *scene);

/**
 * The keys and values of a bf16 scene in the other order: in rows, if it has them in blocks.
 *
 * keys, values   receive what one free(*keys) releases; untouched on failure
 */
enum dvsm_status dvsm_scene_reorder(const struct dvsm_scene *scene, void **keys, void **values,
				    struct dvsm_error *error);

/**
 * A bf16 scene's own keys and values from rows to blocks, if this machine's best kernels want them
 * so. DVSM_NO_MEM leaves them in rows.
 */
enum dvsm_status dvsm_scene_lay(struct dvsm_scene *scene, struct dvsm_error *error);

/**
 * Open a scene from the bytes of its file; `name` stands for the file in error texts. `model` may
 * be NULL: then the file alone is checked. The bytes are borrowed for the call.
 */
enum dvsm_status dvsm_scene_open_bytes(const void *bytes, size_t size, const char *name,
				       const struct dvsm_model *model, struct dvsm_scene **scene,
				       struct dvsm_error *error);

#endif
