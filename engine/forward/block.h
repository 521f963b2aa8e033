/* A block of the transformer (MODEL.md section 4), in the pieces both stages use. Private. */
#ifndef DVSM_FORWARD_BLOCK_H
#define DVSM_FORWARD_BLOCK_H

#include "forward/steps.h"

/** Attention within one view, and the MLP behind it: x[tokens][D] is the view's residual stream. */
void dvsm_block_intra(const struct dvsm_run *run, uint32_t layer, float *x, size_t tokens);

/** Cross-view keys and values of one view into heads, whose tokens from `first` on they are. */
void dvsm_block_cross_keys(const struct dvsm_run *run, uint32_t layer, const float *x,
			   size_t tokens, const struct dvsm_heads *heads, size_t first);

/** Attention to all of `heads`, and the MLP behind it. */
void dvsm_block_cross(const struct dvsm_run *run, uint32_t layer, float *x, size_t tokens,
		      const struct dvsm_heads *heads);

#endif
