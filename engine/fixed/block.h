/* A block of the transformer in fixed point: forward/block.h's pieces. Private to the engine. */
#ifndef DVSM_FIXED_BLOCK_H
#define DVSM_FIXED_BLOCK_H

#include "fixed/run.h"

/**
 * Attention within one view, and the MLP behind it. work.a holds the norm of x before attention,
 * and afterwards that of the cross half.
 *
 * x      [tokens][D] the view's residual stream
 * kv     [tokens][2D], written over
 * input  matrix of the cross half that work.a is to fit afterwards
 */
void dvsm_fixed_block_intra(const struct dvsm_fixed_run *run, uint32_t layer, int32_t *x,
			    size_t tokens, int16_t *kv, const struct dvsm_fixed_matrix *input);

/** Cross-view keys and values of the view whose norm work.a holds, normalised and in 16 bits, to
 * kv[tokens][2D]. */
void dvsm_fixed_block_cross_keys(const struct dvsm_fixed_run *run, uint32_t layer, size_t tokens,
				 int16_t *kv);

/**
 * Attention to a layer of context tokens, and the MLP behind it. work.a holds the norm of x.
 *
 * next   what work.a is to hold the norm of x for afterwards, or NULL
 */
void dvsm_fixed_block_cross(const struct dvsm_fixed_run *run, uint32_t layer, int32_t *x,
			    size_t tokens, const struct dvsm_fixed_layer *cache,
			    const struct dvsm_fixed_half *next);

#endif
