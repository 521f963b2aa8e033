#include "fixed/layer.h"

#include "kernels/fixed_math.h"

/* log2(e): softmax in powers of two. */
static const struct dvsm_fixed_scale LOG2_E = {23637, -14};

void dvsm_fixed_layer_place(struct dvsm_arena *arena, size_t dim, struct dvsm_fixed_layer *layer)
{
	layer->k_scale = dvsm_arena_take(arena, dim, sizeof(*layer->k_scale));
	layer->v_scale = dvsm_arena_take(arena, dim, sizeof(*layer->v_scale));
	layer->v_mean = dvsm_arena_take(arena, dim, sizeof(*layer->v_mean));
}

void dvsm_fixed_layer_scale(const struct dvsm_fixed_half *half, size_t dim,
			    const struct dvsm_fixed_range *ranges, struct dvsm_fixed_layer *layer,
			    struct dvsm_fixed_channel *channels)
{
	const int64_t tokens = (int64_t)layer->tokens;

	for (size_t d = 0; d < dim; d++) {
		int down = half->value_fraction[d] - half->mixed_fraction;
		struct dvsm_fixed_scale scale;

		channels[d] = dvsm_fixed_channel_make(&ranges[d], tokens, &layer->k_scale[d]);
		channels[dim + d] = dvsm_fixed_channel_make(&ranges[dim + d], tokens, &scale);
		layer->v_scale[d] = dvsm_fixed_shift(scale, -down);
		layer->v_mean[d] =
			(int16_t)dvsm_fixed_round(channels[dim + d].mean, down < 62 ? down : 62);
	}
}

/* Gains of one head: qk_weight times k_scale, brought to the largest one's exponent. */
static int fill_head(const struct dvsm_fixed_scale *weight, const struct dvsm_fixed_scale *k_scale,
		     size_t width, int16_t *numbers)
{
	int top = INT16_MIN;

	for (size_t d = 0; d < width; d++) {
		int exponent = weight[d].exponent + k_scale[d].exponent + 15;

		if (weight[d].mantissa && k_scale[d].mantissa && exponent > top)
			top = exponent;
	}
	/* Two mantissas of 15 bits make 28 or 29 bits, which become 15. */
	for (size_t d = 0; d < width; d++) {
		int64_t product = (int64_t)weight[d].mantissa * k_scale[d].mantissa;
		int shift = top - weight[d].exponent - k_scale[d].exponent;

		numbers[d] =
			product ? (int16_t)dvsm_fixed_round(product, dvsm_fixed_clamp(shift, 0, 62))
				: 0;
	}
	return top == INT16_MIN ? 0 : top;
}

void dvsm_fixed_slots_fill(const struct dvsm_fixed_model *model, const struct dvsm_fixed_half *half,
			   size_t dim, size_t heads, const struct dvsm_fixed_scale *k_scale,
			   struct dvsm_fixed_slots *slots)
{
	const size_t width = dim / heads;

	for (size_t h = 0; h < heads; h++) {
		int16_t *numbers = slots->numbers + h * width;
		int exponent = fill_head(half->qk_weight, k_scale + h * width, width, numbers);

		slots->gains[h] = (struct dvsm_fixed_gain){
			.gain = numbers,
			.scale = dvsm_fixed_shift(LOG2_E, exponent - model->key_fraction),
			.epsilon = half->query_epsilon[h],
		};
	}
}
