#include "fixed/layer.h"

#include <stdlib.h>

#include "kernels/fixed_math.h"

/* log2(e): softmax in powers of two. */
static const struct dvsm_fixed_scale LOG2_E = {23637, -14};

#define ONE ((int64_t)1 << 15)

/* By how much balancing may widen a key channel's scale: one of its seven bits. */
#define WIDEST 2

/* What a query's channel is multiplied by; a sign does not matter here. */
static struct dvsm_fixed_scale gain_of(struct dvsm_fixed_scale weight,
				       struct dvsm_fixed_scale scale)
{
	return dvsm_fixed_scale_make((uint64_t)abs(weight.mantissa) * (uint64_t)scale.mantissa,
				     weight.exponent + scale.exponent);
}

struct dvsm_fixed_layer_scales dvsm_fixed_layer_scales_place(struct dvsm_arena *arena,
							     size_t layers, size_t dim)
{
	struct dvsm_fixed_layer_scales scales;

	scales.k_scale = dvsm_arena_take(arena, layers, dim * sizeof(*scales.k_scale));
	scales.v_scale = dvsm_arena_take(arena, layers, dim * sizeof(*scales.v_scale));
	scales.v_mean = dvsm_arena_take(arena, layers, dim * sizeof(*scales.v_mean));
	return scales;
}

/* a / b of two scales as a fraction of 2^15, at most 1; 1 where b is 0. */
static int64_t share(struct dvsm_fixed_scale a, struct dvsm_fixed_scale b)
{
	int64_t quotient;

	if (b.mantissa == 0 || a.exponent > b.exponent)
		return ONE;
	quotient = ((int64_t)a.mantissa << 15) / b.mantissa;
	quotient >>= dvsm_fixed_clamp(b.exponent - a.exponent, 0, 62);
	return quotient < ONE ? quotient : ONE;
}

static bool is_larger(struct dvsm_fixed_scale a, struct dvsm_fixed_scale b)
{
	if (a.mantissa == 0 || b.mantissa == 0)
		return a.mantissa > b.mantissa;
	return a.exponent != b.exponent ? a.exponent > b.exponent : a.mantissa > b.mantissa;
}

/*
 * Widen the key scales of one head where a query's channel would weigh less than the head's
 * heaviest: what the keys lose is noise that differs from key to key, what the query's int8 gains
 * is an error that all keys share.
 */
static void balance_head(const struct dvsm_fixed_scale *weight, size_t width,
			 struct dvsm_fixed_channel *channels, struct dvsm_fixed_scale *k_scale)
{
	struct dvsm_fixed_scale heaviest = {0, 0};

	for (size_t d = 0; d < width; d++) {
		struct dvsm_fixed_scale gain = gain_of(weight[d], k_scale[d]);

		heaviest = is_larger(gain, heaviest) ? gain : heaviest;
	}
	for (size_t d = 0; d < width; d++) {
		struct dvsm_fixed_scale gain = gain_of(weight[d], k_scale[d]);
		int64_t least = channels[d].inverse / WIDEST;
		int64_t inverse = channels[d].inverse * share(gain, heaviest) >> 15;

		if (channels[d].inverse == 0)
			continue;
		channels[d].inverse = (int16_t)(inverse > least ? inverse : least);
		k_scale[d] =
			dvsm_fixed_shift(dvsm_fixed_inverse_scale((uint32_t)channels[d].inverse),
					 -channels[d].shift);
	}
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
	balance_head(half->qk_weight, dim, channels, layer->k_scale);
}

void dvsm_fixed_layer_refine(const struct dvsm_fixed_layer *layer, size_t head, size_t dim)
{
	const size_t bytes = dvsm_fixed_head_bytes(layer->padded, dim, 1);

	dvsm_fixed_fine_keys(layer->keys + head * bytes, layer->padded, dim,
			     dvsm_fixed_head_fine_keys(layer, head, dim));
}

/* Gains of one head: qk_weight times k_scale, brought to the largest one's exponent. */
static int fill_gains(const struct dvsm_fixed_scale *weight, const struct dvsm_fixed_scale *k_scale,
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

struct dvsm_fixed_gain dvsm_fixed_query_gain(const struct dvsm_fixed_model *model,
					     const struct dvsm_fixed_half *half, size_t head,
					     size_t dim, const struct dvsm_fixed_scale *k_scale,
					     int16_t *numbers)
{
	int exponent = fill_gains(half->qk_weight, k_scale, dim, numbers);

	return (struct dvsm_fixed_gain){
		.gain = numbers,
		.scale = dvsm_fixed_shift(LOG2_E, exponent - model->key_fraction),
		.epsilon = half->query_epsilon[head],
	};
}
