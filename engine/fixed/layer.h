/*
 * Keys and values of one attention layer in int8, with what turns scores and sums back into
 * numbers. Private to the engine.
 */
#ifndef DVSM_FIXED_LAYER_H
#define DVSM_FIXED_LAYER_H

#include "base/arena.h"
#include "fixed/fine.h"
#include "fixed/model.h"

/**
 * D = dim, h = heads, W = padded head width. Keys stand for (n - their mean over all tokens) of the
 * normalised keys n, whose weight is in the queries' gains; values likewise, their mean beside.
 */
struct dvsm_fixed_layer {
	size_t tokens, padded;            /* the latter a multiple of DVSM_FIXED_KEY_PAD */
	int8_t *keys;                     /* [h] packed keys of padded x W bytes */
	int8_t *fine_keys;                /* [h] what fine queries meet instead, or NULL */
	int8_t *values;                   /* [h] packed values */
	struct dvsm_fixed_scale *k_scale; /* [D] of a key, in units of normalised keys */
	struct dvsm_fixed_scale *v_scale; /* [D] of a value, in units of attention's output */
	int16_t *v_mean;                  /* [D] in units of attention's output */
};

/** Bytes of one head's packed keys, or values. */
static inline size_t dvsm_fixed_head_bytes(size_t padded, size_t dim, size_t heads)
{
	return padded * dvsm_fixed_pad(dim / heads, DVSM_FIXED_HEAD);
}

/** One head's fine keys. */
static inline int8_t *dvsm_fixed_head_fine_keys(const struct dvsm_fixed_layer *layer, size_t head,
						size_t dim)
{
	return layer->fine_keys + head * layer->padded * dvsm_fixed_fine_width(dim);
}

/** The small arrays of some layers, one behind the other. */
struct dvsm_fixed_layer_scales {
	struct dvsm_fixed_scale *k_scale, *v_scale;
	int16_t *v_mean;
};

/** Place (or measure) those of `layers` layers. */
struct dvsm_fixed_layer_scales dvsm_fixed_layer_scales_place(struct dvsm_arena *arena,
							     size_t layers, size_t dim);

/**
 * From the ranges of one head's keys and values to how they are packed.
 *
 * half, layer  their arrays begin at the head's
 * dim          of a head
 * ranges       [2][dim]: keys, values
 * channels     receives [2][dim]
 */
void dvsm_fixed_layer_scale(const struct dvsm_fixed_half *half, size_t dim,
			    const struct dvsm_fixed_range *ranges, struct dvsm_fixed_layer *layer,
			    struct dvsm_fixed_channel *channels);

/** Make the fine keys of a head of a layer that has them; dim of a head. */
void dvsm_fixed_layer_refine(const struct dvsm_fixed_layer *layer, size_t head, size_t dim);

/**
 * The gain that one head's queries need for its keys.
 *
 * dim      of a head
 * k_scale  [dim] of the head's keys
 * numbers  receives [dim], which the gain borrows
 */
struct dvsm_fixed_gain dvsm_fixed_query_gain(const struct dvsm_fixed_model *model,
					     const struct dvsm_fixed_half *half, size_t head,
					     size_t dim, const struct dvsm_fixed_scale *k_scale,
					     int16_t *numbers);

#endif
