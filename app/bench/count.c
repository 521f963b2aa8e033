#include "bench/count.h"

#include <math.h>

double dio_count_tokens(const struct dvsm_camera *camera, uint32_t patch_px)
{
	return fmax(1, floor((double)camera->width / patch_px + 0.5)) *
	       fmax(1, floor((double)camera->height / patch_px + 0.5));
}

/* Products with [projections] D x D matrices, the output's and the MLP's. */
static double count_products(const struct dvsm_model_config *config, double tokens,
			     double projections)
{
	const double dim = config->dim;

	return tokens * 2 * dim * dim * (projections + 1 + 2.0 * config->mlp_ratio);
}

static double count_attention(const struct dvsm_model_config *config, double queries, double keys)
{
	return queries * keys * 4 * config->dim;
}

/* `channels` numbers a pixel of a patch, to or from D. */
static double count_patches(const struct dvsm_model_config *config, double tokens, double channels)
{
	return tokens * 2 * config->dim * channels * config->patch_px * config->patch_px;
}

double dio_count_reconstruct(const struct dvsm_model_config *config, const double *tokens,
			     uint32_t views)
{
	const double dim = config->dim, layers = config->layers;
	double all = 0, intra = 0;

	for (uint32_t i = 0; i < views; i++) {
		all += tokens[i];
		intra += count_attention(config, tokens[i], tokens[i]);
	}
	intra += count_products(config, all, 3);
	/* The last block ends with the keys and values of its cross-view layer. */
	return layers * intra +
	       (layers - 1) * (count_products(config, all, 3) + count_attention(config, all, all)) +
	       all * 2 * dim * dim * 2 + count_patches(config, all, 6 + 3);
}

double dio_count_render(const struct dvsm_model_config *config, double tokens, double keys)
{
	return config->layers *
		       (count_products(config, tokens, 3) +
			count_attention(config, tokens, tokens) +
			count_products(config, tokens, 1) + count_attention(config, tokens, keys)) +
	       count_patches(config, tokens, 6 + 3);
}
