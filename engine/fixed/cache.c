#include "fixed/cache.h"

#include <stdlib.h>

#include "base/memory.h"
#include "fixed/fine.h"

/* Bytes of the keys of one layer, of this width in all heads. */
static bool layer_bytes(size_t tokens, size_t width, size_t *bytes)
{
	return dvsm_size_add(tokens, DVSM_FIXED_KEY_PAD - 1, bytes) &&
	       dvsm_size_mul(dvsm_fixed_pad(tokens, DVSM_FIXED_KEY_PAD), width, bytes);
}

bool dvsm_fixed_cache_bytes(const struct dvsm_model_config *config, size_t tokens, size_t *bytes)
{
	size_t width = config->heads * dvsm_fixed_pad(config->dim / config->heads, DVSM_FIXED_HEAD);

	return layer_bytes(tokens, width, bytes) && dvsm_size_mul(*bytes, config->layers, bytes);
}

bool dvsm_fixed_cache_fine_bytes(const struct dvsm_model_config *config, size_t tokens,
				 size_t *bytes)
{
	size_t width = config->heads * dvsm_fixed_fine_width(config->dim / config->heads);

	return layer_bytes(tokens, width, bytes);
}

static void place(struct dvsm_arena *arena, struct dvsm_fixed_cache *cache)
{
	const size_t layers = cache->layer_count, numbers = layers * cache->dim;
	const size_t half = layers * cache->heads *
			    dvsm_fixed_head_bytes(cache->padded, cache->dim, cache->heads);

	cache->keys = dvsm_arena_take(arena, half, 1);
	cache->values = dvsm_arena_take(arena, half, 1);
	cache->fine_keys = dvsm_arena_take(arena, cache->fine_bytes, 1);
	cache->k_scale = dvsm_arena_take(arena, numbers, sizeof(*cache->k_scale));
	cache->v_scale = dvsm_arena_take(arena, numbers, sizeof(*cache->v_scale));
	cache->v_mean = dvsm_arena_take(arena, numbers, sizeof(*cache->v_mean));
}

bool dvsm_fixed_cache_init(const struct dvsm_model_config *config, size_t tokens,
			   struct dvsm_fixed_cache *cache)
{
	struct dvsm_fixed_cache made = {
		.layer_count = config->layers,
		.tokens = tokens,
		.padded = dvsm_fixed_pad(tokens, DVSM_FIXED_KEY_PAD),
		.dim = config->dim,
		.heads = config->heads,
	};
	struct dvsm_arena arena = {0};
	size_t bytes;

	if (!dvsm_fixed_cache_bytes(config, tokens, &bytes) ||
	    !dvsm_fixed_cache_fine_bytes(config, tokens, &made.fine_bytes))
		return false;
	place(&arena, &made);
	made.memory = arena.overflow ? NULL : dvsm_aligned_alloc(arena.used);
	if (!made.memory)
		return false;
	arena = (struct dvsm_arena){.base = made.memory};
	place(&arena, &made);
	*cache = made;
	return true;
}

void dvsm_fixed_cache_deinit(struct dvsm_fixed_cache *cache)
{
	free(cache->memory);
	*cache = (struct dvsm_fixed_cache){0};
}

struct dvsm_fixed_layer dvsm_fixed_cache_layer(const struct dvsm_fixed_cache *cache, uint32_t layer)
{
	size_t bytes =
		cache->heads * dvsm_fixed_head_bytes(cache->padded, cache->dim, cache->heads);

	return (struct dvsm_fixed_layer){
		.tokens = cache->tokens,
		.padded = cache->padded,
		.keys = cache->keys + layer * bytes,
		.fine_keys = layer == 0 ? cache->fine_keys : NULL,
		.values = cache->values + layer * bytes,
		.k_scale = cache->k_scale + layer * cache->dim,
		.v_scale = cache->v_scale + layer * cache->dim,
		.v_mean = cache->v_mean + layer * cache->dim,
	};
}

void dvsm_fixed_cache_refine(const struct dvsm_fixed_cache *cache)
{
	const struct dvsm_fixed_layer first = dvsm_fixed_cache_layer(cache, 0);

	for (size_t head = 0; head < cache->heads; head++)
		dvsm_fixed_layer_refine(&first, head, cache->dim / cache->heads);
}
