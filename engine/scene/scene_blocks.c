#include <stdlib.h>
#include <string.h>

#include "base/error.h"
#include "base/memory.h"
#include "kernels/kernels.h"
#include "scene/scene_internal.h"

typedef void lay_head_fn(enum dvsm_block_order order, const dvsm_bf16 *from, size_t keys,
			 size_t head_dim, dvsm_bf16 *to);

static enum dvsm_status fail(struct dvsm_error *error)
{
	return dvsm_fail(error, DVSM_NO_MEM, "no memory for another order of the KV-cache");
}

enum dvsm_status dvsm_scene_reorder(const struct dvsm_scene *scene, void **keys, void **values,
				    struct dvsm_error *error)
{
	lay_head_fn *const turn = scene->in_blocks ? dvsm_unlay_head : dvsm_lay_head;
	const size_t head_dim = scene->dim / scene->heads, half = scene->cache_bytes / 2;
	unsigned char *made = dvsm_aligned_alloc(scene->cache_bytes);

	if (!made)
		return fail(error);
	for (uint32_t layer = 0; layer < scene->layers; layer++) {
		for (uint32_t head = 0; head < scene->heads; head++) {
			unsigned char *to = made + dvsm_scene_head_at(scene, layer, head);

			turn(DVSM_BLOCK_OF_KEYS, dvsm_scene_keys(scene, layer, head), scene->tokens,
			     head_dim, (dvsm_bf16 *)(void *)to);
			turn(DVSM_BLOCK_OF_VALUES, dvsm_scene_values(scene, layer, head),
			     scene->tokens, head_dim, (dvsm_bf16 *)(void *)(to + half));
		}
	}
	*keys = made;
	*values = made + half;
	return DVSM_OK;
}

enum dvsm_status dvsm_scene_lay(struct dvsm_scene *scene, struct dvsm_error *error)
{
	const size_t head_dim = scene->dim / scene->heads;
	const struct dvsm_kernels *best = dvsm_kernels_choose(scene->precision, DVSM_CPU_ALL);
	dvsm_bf16 *rows;
	size_t bytes = scene->tokens * head_dim * sizeof(*rows);

	if (!dvsm_kernels_want_blocks(best, head_dim))
		return DVSM_OK;
	rows = malloc(bytes);
	if (!rows)
		return fail(error);
	for (uint32_t layer = 0; layer < scene->layers; layer++) {
		for (uint32_t head = 0; head < scene->heads; head++) {
			void *keys = dvsm_scene_keys(scene, layer, head);
			void *values = dvsm_scene_values(scene, layer, head);

			memcpy(rows, keys, bytes);
			dvsm_lay_head(DVSM_BLOCK_OF_KEYS, rows, scene->tokens, head_dim, keys);
			memcpy(rows, values, bytes);
			dvsm_lay_head(DVSM_BLOCK_OF_VALUES, rows, scene->tokens, head_dim, values);
		}
	}
	free(rows);
	scene->in_blocks = true;
	return DVSM_OK;
}
