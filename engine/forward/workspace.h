/* The memory that one run of the transformer works in. Private to the engine. */
#ifndef DVSM_FORWARD_WORKSPACE_H
#define DVSM_FORWARD_WORKSPACE_H

#include "base/arena.h"
#include "dvsm/model.h"
#include "geometry/group.h"

struct dvsm_kernels;

/** Of the float precisions; dvsm_group_rows() rounds likewise. */
#define DVSM_GROUPING ((struct dvsm_grouping){32, 2048})

/** Rows that the tokens of a view take in a group of DVSM_GROUPING: whole steps of 32. */
static inline size_t dvsm_group_rows(size_t tokens)
{
	return (tokens + 31) / 32 * 32;
}

/** D = dim, h = heads, N = view_tokens, G = group_rows. */
struct dvsm_workspace {
	float *x;     /* [tokens][D] residual stream */
	void *normed; /* left side [G][D]: input of a product, then attention's output */
	float *wide;  /* [G][wide_width] patches; q, k, v; MLP hidden (left side); output patches */
	size_t wide_width;
	void *patches;          /* left side [N][6 q q]: `wide` itself where numbers are floats */
	void *keys;             /* numbers [G][D]: [h][tokens][D/h] of each view */
	void *values;           /* the same */
	unsigned char *scratch; /* [threads][scratch_stride] */
	size_t scratch_stride;
};

/** Walk the workspace: measures or places, as the arena says. */
struct dvsm_workspace dvsm_workspace_place(struct dvsm_arena *arena,
					   const struct dvsm_model_config *config,
					   const struct dvsm_job_size *size,
					   const struct dvsm_kernels *kernels);

#endif
