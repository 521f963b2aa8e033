#include "forward/packed.h"

#include <stdlib.h>

#include "base/error.h"
#include "base/memory.h"
#include "kernels/kernels.h"

/* Take room for W[out][in] and, when there is memory behind the arena, fill it. */
static struct dvsm_matrix place(struct dvsm_arena *arena, const float *weights, size_t out,
				size_t in)
{
	size_t floats = 0;

	if (!dvsm_pack_size(out, in, &floats))
		arena->overflow = true;

	float *panels = dvsm_arena_take(arena, floats, sizeof(float));

	if (panels)
		dvsm_pack_panels(weights, out, in, panels);
	return (struct dvsm_matrix){panels, out, in};
}

static struct dvsm_packed_half place_half(struct dvsm_arena *arena,
					  const struct dvsm_half_weights *weights, size_t dim,
					  size_t hidden)
{
	return (struct dvsm_packed_half){
		.query = place(arena, weights->qkv, dim, dim),
		.key_value = place(arena, weights->qkv + dim * dim, 2 * dim, dim),
		.out = place(arena, weights->out, dim, dim),
		.up = place(arena, weights->up, hidden, dim),
		.down = place(arena, weights->down, dim, hidden),
	};
}

static void place_all(struct dvsm_arena *arena, const struct dvsm_model *model,
		      struct dvsm_packed *packed)
{
	const struct dvsm_model_config *config = &model->config;
	const struct dvsm_weights *weights = &model->weights;
	const size_t dim = config->dim, hidden = dim * config->mlp_ratio;
	const size_t area = (size_t)config->patch_px * config->patch_px;

	packed->patch_ray = place(arena, weights->patch_ray, dim, 6 * area);
	packed->patch_rgb = place(arena, weights->patch_rgb, dim, 3 * area);
	packed->to_rgb = place(arena, weights->to_rgb, 3 * area, dim);
	packed->blocks = dvsm_arena_take(arena, config->layers, sizeof(packed->blocks[0]));
	for (uint32_t i = 0; i < config->layers; i++) {
		const struct dvsm_block_weights *block = &weights->blocks[i];
		struct dvsm_packed_block made;

		made.intra = place_half(arena, &block->intra, dim, hidden);
		made.cross = place_half(arena, &block->cross, dim, hidden);
		if (packed->blocks)
			packed->blocks[i] = made;
	}
}

enum dvsm_status dvsm_packed_init(struct dvsm_packed *packed, const struct dvsm_model *model,
				  struct dvsm_error *error)
{
	struct dvsm_packed made = {0};
	struct dvsm_arena arena = {0};

	place_all(&arena, model, &made);
	if (!arena.overflow)
		made.memory = dvsm_aligned_alloc(arena.used);
	if (!made.memory)
		return dvsm_fail(error, DVSM_NO_MEM,
				 "no memory for %.1f MB of packed weights: use a smaller model",
				 (double)arena.used / 1e6);
	made.bytes = arena.used;
	arena = (struct dvsm_arena){.base = made.memory};
	place_all(&arena, model, &made);
	*packed = made;
	return DVSM_OK;
}

void dvsm_packed_deinit(struct dvsm_packed *packed)
{
	free(packed->memory);
	*packed = (struct dvsm_packed){0};
}
