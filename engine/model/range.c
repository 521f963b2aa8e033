#include "model/range.h"

#include <float.h>
#include <math.h>

#include "base/error.h"
#include "model/names.h"

/*
 * Norms bound everything. A LayerNorm gives a vector of length sqrt(D) times its largest weight g,
 * whatever came in; so the sum of its magnitudes is at most D g, and a row of a matrix with weights
 * up to w makes at most D g w of it. Attention mixes values with weights that add up to one, and
 * GELU makes nothing larger: the same bounds hold behind them. The residual stream is the sum of
 * all that the blocks add to it.
 */

/* Farthest coordinate of a ray: |o x d| of a camera 1e9 rig sizes away on each axis; |d| is 1. */
#define LARGEST_RAY 1.8e9

/* Colours of -1..2, as 2 rgb - 1. */
#define LARGEST_COLOUR 3.0

/* Every score must beat the float kernels' lowest one, and differences must stay finite. */
#define LARGEST_SCORE 1e29

/* A LayerNorm takes the mean off, which may double a number, and adds dim squares; half of that
 * again is left for rounding. */
static double largest_number(const struct dvsm_model_config *config)
{
	return 0.25 * sqrt((double)FLT_MAX / config->dim);
}

struct range {
	const struct dvsm_safetensors *file;
	const struct dvsm_model_config *config;
	struct dvsm_error *error;
	enum dvsm_status status; /* of the first tensor that passes the bound */
	double limit;            /* squares of numbers up to it add up to a float */
	double residual;         /* bound of the stream's numbers so far */
};

/* The model's walk required every tensor. */
static double largest(const struct range *range, const char *name)
{
	const struct dvsm_tensor *tensor = dvsm_safetensors_find(range->file, name);
	return tensor ? tensor->largest : 0;
}

static void keep_below(struct range *range, double reached, double limit, const char *name)
{
	if (range->status != DVSM_OK || reached <= limit)
		return;
	range->status = dvsm_fail(range->error, DVSM_BAD_FILE,
				  "%s: tensor %s: numbers of up to %.3g can leave the range of "
				  "float32 (%.3g): scale the weights down",
				  dvsm_name_tail(range->file->source.name), name,
				  largest(range, name), reached);
}

/* Attention and the MLP behind it: what they make on the way, and what they add to the stream. */
static void walk_half(struct range *range, uint32_t layer, const char *half)
{
	const double dim = range->config->dim, head_dim = dim / range->config->heads;
	const double hidden_dim = dim * range->config->mlp_ratio;
#define NAME(rest) dvsm_name_half(layer, half, rest).text
	double value = dim * largest(range, NAME("_norm")) * largest(range, NAME(".qkv"));
	double query = sqrt(head_dim) * largest(range, NAME(".q_norm"));
	double key = sqrt(head_dim) * largest(range, NAME(".k_norm"));
	keep_below(range, value, range->limit, NAME(".qkv"));
	keep_below(range, query, range->limit, NAME(".q_norm"));
	keep_below(range, key, range->limit, NAME(".k_norm"));
	keep_below(range, query * key / sqrt(head_dim), LARGEST_SCORE, NAME(".k_norm"));
	range->residual += dim * value * largest(range, NAME(".out"));
	keep_below(range, range->residual, range->limit, NAME(".out"));

	double hidden = dim * largest(range, NAME("_mlp_norm")) * largest(range, NAME("_mlp.up"));
	keep_below(range, hidden, range->limit, NAME("_mlp.up"));
	range->residual += hidden_dim * hidden * largest(range, NAME("_mlp.down"));
	keep_below(range, range->residual, range->limit, NAME("_mlp.down"));
#undef NAME
}

enum dvsm_status dvsm_range_check(const struct dvsm_safetensors *file,
				  const struct dvsm_model_config *config, struct dvsm_error *error)
{
	const double dim = config->dim, area = (double)config->patch_px * config->patch_px;
	struct range range = {
		.file = file,
		.config = config,
		.error = error,
		.limit = largest_number(config),
	};
	double ray = 6 * area * LARGEST_RAY * largest(&range, "patch_ray.weight");
	double colour = 3 * area * LARGEST_COLOUR * largest(&range, "patch_rgb.weight");
	keep_below(&range, ray, range.limit, "patch_ray.weight");
	keep_below(&range, ray + colour, range.limit, "patch_rgb.weight");
	range.residual = sqrt(dim) * largest(&range, "embed_norm.weight");
	keep_below(&range, range.residual, range.limit, "embed_norm.weight");
	for (uint32_t i = 0; i < config->layers; i++) {
		walk_half(&range, i, "intra");
		walk_half(&range, i, "cross");
	}
	keep_below(&range,
		   dim * largest(&range, "final_norm.weight") * largest(&range, "to_rgb.weight"),
		   range.limit, "to_rgb.weight");
	return range.status;
}

bool dvsm_range_holds_cache(const struct dvsm_model *model, double largest_key,
			    double largest_value)
{
	const struct dvsm_model_config *config = &model->config;
	const double limit = largest_number(config);
	const uint32_t head_dim = config->dim / config->heads;
	float query = 0;
	for (uint32_t i = 0; i < config->layers; i++) {
		const float *q_norm = model->weights.blocks[i].cross.q_norm;
		for (uint32_t d = 0; d < head_dim; d++)
			query = fmaxf(query, fabsf(q_norm[d]));
	}
	/* Both as vectors are sqrt(head_dim) times longer; a score divides by that once. */
	double score = sqrt(head_dim) * query * largest_key;
	return largest_key <= limit && largest_value <= limit && score <= LARGEST_SCORE;
}
