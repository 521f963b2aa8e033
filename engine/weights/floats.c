#include "weights/floats.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/arena.h"
#include "base/error.h"
#include "base/memory.h"
#include "fixed/turn.h"
#include "model/reader.h"

/* The walk over all matrices: measures or places, as the arena says. */
struct walk {
	struct dvsm_arena arena;
	const struct dvsm_model *model;
	struct dvsm_reader *reader;
	bool pairs;
	/* Room for the largest matrix of a turned model, or NULL. */
	double *rows;
	float *turned_back, *panels;
};

/* A turned matrix as float32 and bfloat16 want it. */
static void turn_back(struct walk *walk, const struct dvsm_fixed_place *place,
		      const struct dvsm_matrix *matrix, float *panels)
{
	struct dvsm_fixed_place back = *place;

	back.matrix = matrix;
	back.gain = NULL;
	back.turned = false;
	dvsm_fixed_turn_matrix(&back, walk->rows);
	for (size_t i = 0; i < matrix->out * matrix->in; i++)
		walk->turned_back[i] = (float)walk->rows[i];
	dvsm_pack_panels(walk->turned_back, matrix->out, matrix->in, panels);
}

/* Room for a matrix's pairs and, where there is memory, the pairs; nothing else is kept. */
static void place_pairs(struct walk *walk, const struct dvsm_fixed_place *place,
			struct dvsm_matrix *matrix)
{
	size_t numbers = 0;

	if (!dvsm_bf16_pack_size(matrix->out, matrix->in, &numbers))
		walk->arena.overflow = true;

	dvsm_bf16 *pairs = dvsm_arena_take(&walk->arena, numbers, sizeof(*pairs));

	if (pairs) {
		struct dvsm_matrix read = dvsm_reader_read(walk->reader, matrix);

		if (place->turned) {
			turn_back(walk, place, &read, walk->panels);
			read.panels = walk->panels;
		}
		dvsm_bf16_pack(read.panels, matrix->out, matrix->in, pairs);
	}
	matrix->pairs = pairs;
	matrix->panels = NULL;
}

/* The same in float32, unless the model's own panels will do. */
static void place_panels(struct walk *walk, const struct dvsm_fixed_place *place,
			 struct dvsm_matrix *matrix)
{
	size_t floats = 0;

	if (matrix->panels && !place->turned)
		return;
	if (!dvsm_pack_size(matrix->out, matrix->in, &floats))
		walk->arena.overflow = true;

	float *panels = dvsm_arena_take(&walk->arena, floats, sizeof(*panels));

	if (panels) {
		struct dvsm_matrix read = dvsm_reader_read(walk->reader, matrix);

		if (place->turned)
			turn_back(walk, place, &read, panels);
		else
			memcpy(panels, read.panels, floats * sizeof(*panels));
	}
	matrix->panels = panels;
}

static void place_matrix(struct walk *walk, const struct dvsm_fixed_place *place,
			 struct dvsm_matrix *matrix)
{
	if (walk->pairs)
		place_pairs(walk, place, matrix);
	else
		place_panels(walk, place, matrix);
}

static void place_half(struct walk *walk, struct dvsm_half_weights *half)
{
	const struct dvsm_fixed_half_places places = dvsm_fixed_places_of(walk->model, half);

	place_matrix(walk, &places.query, &half->query);
	place_matrix(walk, &places.key_value, &half->key_value);
	place_matrix(walk, &places.out, &half->out);
	place_matrix(walk, &places.up, &half->up);
	place_matrix(walk, &places.down, &half->down);
}

static void place(struct walk *walk, struct dvsm_weights *w)
{
	const struct dvsm_fixed_place plain = {.turned = false};
	const struct dvsm_fixed_place rgb = dvsm_fixed_place_rgb(walk->model);

	place_matrix(walk, &plain, &w->patch_ray);
	place_matrix(walk, &plain, &w->patch_rgb);
	for (uint32_t i = 0; i < walk->model->config.layers; i++) {
		place_half(walk, &w->blocks[i].intra);
		place_half(walk, &w->blocks[i].cross);
	}
	place_matrix(walk, &rgb, &w->to_rgb);
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

/* Measure, make room, place; false when there is no memory. */
static bool place_all(struct walk *walk, struct dvsm_engine_weights *weights)
{
	struct dvsm_weights measured = weights->w;
	size_t layers = walk->model->config.layers;

	measured.blocks = malloc(layers * sizeof(*measured.blocks));
	if (!measured.blocks)
		return false;
	memcpy(measured.blocks, weights->w.blocks, layers * sizeof(*measured.blocks));
	place(walk, &measured);
	free(measured.blocks);
	weights->bytes = walk->arena.used;
	if (!walk->arena.overflow)
		weights->block = dvsm_aligned_alloc(weights->bytes);
	if (!weights->block)
		return false;
	walk->arena = (struct dvsm_arena){.base = weights->block};
	place(walk, &weights->w);
	return true;
}

enum dvsm_status dvsm_engine_weights_init(const struct dvsm_model *model,
					  enum dvsm_precision precision, struct dvsm_reader *reader,
					  struct dvsm_engine_weights *weights,
					  struct dvsm_error *error)
{
	const struct dvsm_model_config *config = &model->config;
	const size_t colours = 3 * (size_t)config->patch_px * config->patch_px;
	const size_t hidden = (size_t)config->dim * (config->mlp_ratio + 2);
	const size_t most = (hidden > colours ? hidden : colours) * config->dim;
	struct walk walk = {
		.model = model, .reader = reader, .pairs = precision == DVSM_PRECISION_BF16};
	bool made = true;

	memset(weights, 0, sizeof(*weights));
	if (!copy_weights(model, &weights->w))
		return dvsm_fail(error, DVSM_NO_MEM, "no memory for an engine");
	bound_scores(&model->config, &weights->w);
	if (model->turned) {
		walk.rows = malloc(most * sizeof(*walk.rows));
		walk.turned_back = malloc(most * sizeof(*walk.turned_back));
		/* The last panel is filled up. */
		walk.panels = malloc((most + DVSM_PANEL * hidden) * sizeof(*walk.panels));
		made = walk.rows && walk.turned_back && walk.panels;
	}
	if (made && (model->turned || walk.pairs))
		made = place_all(&walk, weights);
	free(walk.rows);
	free(walk.turned_back);
	free(walk.panels);
	if (made)
		return DVSM_OK;
	dvsm_engine_weights_deinit(weights);
	return dvsm_fail(error, DVSM_NO_MEM,
			 "no memory for %.1f MB of weights in %s: use f32 and a model that is not "
			 "quantised, which needs no copy of them",
			 (double)walk.arena.used / 1e6, dvsm_precision_name(precision));
}

void dvsm_engine_weights_deinit(struct dvsm_engine_weights *weights)
{
	free(weights->w.blocks);
	free(weights->block);
	memset(weights, 0, sizeof(*weights));
}
