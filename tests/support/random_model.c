#include "support/random_model.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/memory.h"
#include "model/model.h"

/* Tensors in one block, as the model file's reader lays them: measured first, then filled. */
struct maker {
	struct support_random *random;
	float *block; /* NULL while measuring */
	size_t used;  /* floats */
	uint64_t weights;
};

static const float *matrix(struct maker *maker, size_t out, size_t in)
{
	size_t count = out * in;
	float *at = maker->block ? maker->block + maker->used : NULL;

	if (at)
		support_random_fill(maker->random, at, count, sqrtf(3.0f / (float)in));
	maker->used += (count + 15) / 16 * 16;
	maker->weights += count;
	return at;
}

static const float *norm(struct maker *maker, size_t dim)
{
	float *at = maker->block ? maker->block + maker->used : NULL;

	for (size_t i = 0; at && i < dim; i++)
		at[i] = 1.0f + 0.2f * support_random_unit(maker->random);
	maker->used += (dim + 15) / 16 * 16;
	maker->weights += dim;
	return at;
}

static void make_half(struct maker *maker, const struct dvsm_model_config *config,
		      struct dvsm_half_weights *half)
{
	size_t dim = config->dim, head_dim = dim / config->heads, hidden = config->mlp_ratio * dim;

	half->norm = norm(maker, dim);
	half->qkv = matrix(maker, 3 * dim, dim);
	half->q_norm = norm(maker, head_dim);
	half->k_norm = norm(maker, head_dim);
	half->out = matrix(maker, dim, dim);
	half->mlp_norm = norm(maker, dim);
	half->up = matrix(maker, hidden, dim);
	half->down = matrix(maker, dim, hidden);
}

static void make_all(struct maker *maker, struct dvsm_model *model)
{
	const struct dvsm_model_config *config = &model->config;
	struct dvsm_weights *weights = &model->weights;
	size_t dim = config->dim, area = (size_t)config->patch_px * config->patch_px;

	weights->patch_ray = matrix(maker, dim, 6 * area);
	weights->patch_rgb = matrix(maker, dim, 3 * area);
	weights->embed_norm = norm(maker, dim);
	for (uint32_t i = 0; i < config->layers; i++) {
		make_half(maker, config, &weights->blocks[i].intra);
		make_half(maker, config, &weights->blocks[i].cross);
	}
	weights->final_norm = norm(maker, dim);
	weights->to_rgb = matrix(maker, 3 * area, dim);
}

struct dvsm_model *support_random_model(const struct dvsm_model_config *config,
					struct support_random *random)
{
	struct dvsm_model *model = calloc(1, sizeof(*model));
	struct maker maker = {.random = random};

	if (!model)
		return NULL;
	model->config = *config;
	memset(model->sha256, '0', 64);
	model->weights.blocks = calloc(config->layers, sizeof(model->weights.blocks[0]));
	if (model->weights.blocks) {
		make_all(&maker, model);
		model->block = dvsm_aligned_alloc(maker.used * sizeof(float));
	}
	if (!model->block) {
		dvsm_model_close(model);
		return NULL;
	}
	model->weight_bytes = maker.used * sizeof(float);
	maker = (struct maker){.random = random, .block = model->block};
	make_all(&maker, model);
	model->weight_count = maker.weights;
	return model;
}

struct dvsm_camera support_ring_camera(uint32_t width, uint32_t height, uint32_t index,
				       uint32_t count)
{
	double angle = 2 * M_PI * index / count, s = sin(angle), c = cos(angle);

	/* At (2 s, 0, -2 c), z axis to the origin, y axis down. */
	return (struct dvsm_camera){
		.width = width,
		.height = height,
		.fx = width,
		.fy = width,
		.cx = 0.5 * width - 0.5,
		.cy = 0.5 * height - 0.5,
		.world_from_camera = {c, 0, -s, 2 * s, 0, 1, 0, 0, s, 0, c, -2 * c, 0, 0, 0, 1},
	};
}
