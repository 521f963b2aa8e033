/* The KV-cache of a scene in fixed point. Private to the engine. */
#ifndef DVSM_FIXED_CACHE_H
#define DVSM_FIXED_CACHE_H

#include "dvsm/status.h"
#include "fixed/layer.h"

/** D = dim, h = heads, W = padded head width, L = layers; all 64-byte aligned. */
struct dvsm_fixed_cache {
	size_t layer_count, tokens, padded, dim, heads;
	int8_t *keys, *values; /* [L][h][padded x W] packed */
	int8_t *fine_keys;     /* [h][padded x fine width], made of the first layer's keys */
	size_t fine_bytes;
	struct dvsm_fixed_scale *k_scale, *v_scale; /* [L][D] */
	int16_t *v_mean;                            /* [L][D] */
	void *memory;                               /* everything; owned */
};

/** Bytes of the keys, or of the values; false when that does not fit. */
bool dvsm_fixed_cache_bytes(const struct dvsm_model_config *config, size_t tokens, size_t *bytes);

/** Bytes of the fine keys; false when that does not fit. */
bool dvsm_fixed_cache_fine_bytes(const struct dvsm_model_config *config, size_t tokens,
				 size_t *bytes);

/** Make the fine keys again, when keys were read from elsewhere. */
void dvsm_fixed_cache_refine(const struct dvsm_fixed_cache *cache);

/** Make room; the content is undefined. False when there is no memory. */
bool dvsm_fixed_cache_init(const struct dvsm_model_config *config, size_t tokens,
			   struct dvsm_fixed_cache *cache);
void dvsm_fixed_cache_deinit(struct dvsm_fixed_cache *cache);

/** One layer, to fill or to attend to. */
struct dvsm_fixed_layer dvsm_fixed_cache_layer(const struct dvsm_fixed_cache *cache,
					       uint32_t layer);

#endif
