/* A block of the transformer in fixed point: forward/block.h's pieces. Private to the engine. */
#ifndef DVSM_FIXED_BLOCK_H
#define DVSM_FIXED_BLOCK_H

#include "fixed/run.h"

/**
 * Attention within each view of a group, and the MLP behind it. work.a holds the norm of the
 * group's rows of work.x before attention, and afterwards that of the cross half.
 *
 * work.kv  the views' rows are written over
 * input    matrix of the cross half that work.a is to fit afterwards
 */
void dvsm_fixed_block_intra(const struct dvsm_fixed_run *run, uint32_t layer,
			    const struct dvsm_group *group, const struct dvsm_fixed_matrix *input);

/** Cross-view keys and values of the group whose norm work.a holds, normalised and in 16 bits, to
 * the views' rows of work.kv. */
void dvsm_fixed_block_cross_keys(const struct dvsm_fixed_run *run, uint32_t layer,
				 const struct dvsm_group *group);

/**
 * Attention to a layer of context tokens, and the MLP behind it. work.a holds the norm of the
 * group's rows of work.x.
 *
 * next   what work.a is to hold the norm for afterwards, or NULL
 */
void dvsm_fixed_block_cross(const struct dvsm_fixed_run *run, uint32_t layer,
			    const struct dvsm_group *group, const struct dvsm_fixed_layer *cache,
			    const struct dvsm_fixed_half *next);

/** The group's rows of the residual stream, and how many. */
static inline int32_t *dvsm_fixed_group_x(const struct dvsm_fixed_run *run,
					  const struct dvsm_group *group)
{
	return run->work.x + group->first_token[0] * run->config->dim;
}

static inline size_t dvsm_fixed_group_rows(const struct dvsm_group *group)
{
	return group->first_token[group->views] - group->first_token[0];
}

#endif
