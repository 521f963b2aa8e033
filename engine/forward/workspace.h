/* The memory that one run of the transformer works in. Private to the engine. */
#ifndef DVSM_FORWARD_WORKSPACE_H
#define DVSM_FORWARD_WORKSPACE_H

#include "dvsm/camera.h"
#include "dvsm/model.h"
#include "forward/arena.h"

struct dvsm_kernels;

/**
 * How views are worked on together: in what they share each takes its tokens rounded up to `unit`
 * rows; a group of more than one view has at most `most` of them.
 */
struct dvsm_grouping {
	size_t unit, most;
};

/** Of the float precisions; dvsm_group_rows() rounds likewise. */
#define DVSM_GROUPING ((struct dvsm_grouping){32, 2048})

/** Views that are worked on together, all of whose tokens the workspace has room for. */
struct dvsm_group {
	const size_t *first_token; /* [views + 1] in the residual stream */
	uint32_t views;
};

/** Of views whose tokens are first_token[view] and on, [views + 1], those from `first` on. */
struct dvsm_group dvsm_group_from(const size_t *first_token, uint32_t views, uint32_t first,
				  struct dvsm_grouping grouping);

/** What a run needs room for. */
struct dvsm_job_size {
	size_t tokens;        /* of all pictures together: the residual stream */
	size_t view_tokens;   /* of the largest picture */
	size_t group_rows;    /* of the largest group */
	size_t group_views;   /* of the group that has most */
	size_t scratch_bytes; /* of each thread */
	uint32_t threads;
};

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

/** Size of a run over pictures of these checked cameras, [count]. */
struct dvsm_job_size dvsm_job_size_of(const struct dvsm_model_config *config,
				      const struct dvsm_camera *cameras, uint32_t count,
				      uint32_t patch_px, uint32_t threads,
				      struct dvsm_grouping grouping);

/** Walk the workspace: measures or places, as the arena says. */
struct dvsm_workspace dvsm_workspace_place(struct dvsm_arena *arena,
					   const struct dvsm_model_config *config,
					   const struct dvsm_job_size *size,
					   const struct dvsm_kernels *kernels);

#endif
