/*
 * A block of the transformer (MODEL.md section 4), in the pieces both stages use. Private.
 *
 * Tokens of a view are cut into tiles; one thread takes a tile through as much of the layer as
 * needs nothing of another's, so that its rows stay in that thread's cache and threads meet only
 * where keys are shared.
 */
#ifndef DVSM_FORWARD_BLOCK_H
#define DVSM_FORWARD_BLOCK_H

#include "forward/steps.h"

/**
 * Attention within each view, the MLP behind it, and the views' cross-view keys and values into
 * `cache`, where tokens lie as in the residual stream.
 */
void dvsm_block_intra(const struct dvsm_run *run, uint32_t layer, const struct dvsm_group *group,
		      const struct dvsm_heads *cache);

/** Attention to all of `cache`, and the MLP behind it. */
void dvsm_block_cross(const struct dvsm_run *run, uint32_t layer, const struct dvsm_group *group,
		      const struct dvsm_heads *cache);

/** Both for a target, whose keys no other view wants. */
void dvsm_block_render(const struct dvsm_run *run, uint32_t layer, const struct dvsm_group *group,
		       const struct dvsm_heads *cache);

#endif
