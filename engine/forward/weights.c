#include "forward/weights.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/error.h"
#include "base/memory.h"
#include "forward/arena.h"

/* Room for a matrix's pairs and, where there is memory, the pairs. */
static void place_matrix(struct dvsm_arena *arena, struct dvsm_matrix *matrix)
{
	size_t numbers = 0;

	if (!dvsm_bf16_pack_size(matrix->out, matrix->in, &numbers))
		arena->overflow = true;

	dvsm_bf16 *pairs = dvsm_arena_take(arena, numbers, sizeof(*pairs));

	if (pairs)
		dvsm_bf16_pack(matrix->panels, matrix->out, matrix->in, pairs);
	matrix->pairs = pairs;
}

static void place_half(struct dvsm_arena *arena, struct dvsm_half_weights *half)
{
	place_matrix(arena, &half->query);
	place_matrix(arena, &half->key_value);
	place_matrix(arena, &half->out);
	place_matrix(arena, &half->up);
	place_matrix(arena, &half->down);
}

/* Walk all matrices: measures or places, as the arena says. */
static void place(struct dvsm_arena *arena, uint32_t layers, struct dvsm_weights *w)
{
	place_matrix(arena, &w->patch_ray);
	place_matrix(arena, &w->patch_rgb);
	for (uint32_t i = 0; i < layers; i++) {
		place_half(arena, &w->blocks[i].intra);
		place_half(arena, &w->blocks[i].cross);
	}
	place_matrix(arena, &w->to_rgb);
}

/*
 * By Cauchy and Schwarz a score is no larger than the largest product of the gains of QK-norm times
 * sqrt(D / h); a little more where numbers are rounded.
 */
static float score_bound(const struct dvsm_half_weights *half, size_t head_dim)
{
	float largest = 0;

	for (size_t d = 0; d < head_dim; d++)
		largest = fmaxf(largest, fabsf(half->q_norm[d] * half->k_norm[d]));
	return 1.02f * (float)M_LOG2E * sqrtf((float)head_dim) * largest;
}

static void bound_scores(const struct dvsm_model_config *config, struct dvsm_weights *w)
{
	for (uint32_t i = 0; i < config->layers; i++) {
		struct dvsm_block_weights *block = &w->blocks[i];

		block->intra.score_bound = score_bound(&block->intra, config->dim / config->heads);
		block->cross.score_bound = score_bound(&block->cross, config->dim / config->heads);
	}
}

static bool copy_weights(const struct dvsm_model *model, struct dvsm_weights *w)
{
	size_t layers = model->config.layers;

	*w = model->weights;
	w->blocks = calloc(layers, sizeof(*w->blocks));
	if (w->blocks)
		memcpy(w->blocks, model->weights.blocks, layers * sizeof(*w->blocks));
	return w->blocks != NULL;
}

enum dvsm_status dvsm_engine_weights_init(const struct dvsm_model *model,
					  enum dvsm_precision precision,
					  struct dvsm_engine_weights *weights,
					  struct dvsm_error *error)
{
	struct dvsm_arena arena = {0};

	memset(weights, 0, sizeof(*weights));
	if (!copy_weights(model, &weights->w))
		return dvsm_fail(error, DVSM_NO_MEM, "no memory for an engine");
	bound_scores(&model->config, &weights->w);
	if (precision != DVSM_PRECISION_BF16)
		return DVSM_OK;
	place(&arena, model->config.layers, &weights->w);
	if (!arena.overflow)
		weights->block = arena.base = dvsm_aligned_alloc(arena.used);
	if (!weights->block) {
		dvsm_engine_weights_deinit(weights);
		return dvsm_fail(error, DVSM_NO_MEM,
				 "no memory for %.1f MB of weights in bf16: use f32, which needs "
				 "no copy of them",
				 (double)arena.used / 1e6);
	}
	weights->bytes = arena.used;
	arena.used = 0;
	place(&arena, model->config.layers, &weights->w);
	return DVSM_OK;
}

void dvsm_engine_weights_deinit(struct dvsm_engine_weights *weights)
{
	free(weights->w.blocks);
	free(weights->block);
	memset(weights, 0, sizeof(*weights));
}
