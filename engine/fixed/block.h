/* A block of the transformer in fixed point: forward/block.h's pieces. Private to the engine. */
#ifndef DVSM_FIXED_BLOCK_H
#define DVSM_FIXED_BLOCK_H

#include "fixed/run.h"

/**
 * Attention within one view, and the MLP behind it.
 *
 * x    [tokens][D] the view's residual stream
 * kv   [tokens][2D], written over
 */
void dvsm_fixed_block_intra(const struct dvsm_fixed_run *run, uint32_t layer, int32_t *x,
			    size_t tokens, int16_t *kv);

/** Cross-view keys and values of one view, normalised and in 16 bits, to kv[tokens][2D]. */
void dvsm_fixed_block_cross_keys(const struct dvsm_fixed_run *run, uint32_t layer, const int32_t *x,
				 size_t tokens, int16_t *kv);

/** Attention to a layer of context tokens, and the MLP behind it. */
void dvsm_fixed_block_cross(const struct dvsm_fixed_run *run, uint32_t layer, int32_t *x,
			    size_t tokens, const struct dvsm_fixed_layer *cache);

#endif
