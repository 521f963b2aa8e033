/* Views that are worked on together, and the size of a run over them. Private to the engine. */
#ifndef DVSM_GEOMETRY_GROUP_H
#define DVSM_GEOMETRY_GROUP_H

#include <stddef.h>
#include <stdint.h>

#include "dvsm/camera.h"

/**
 * How views are worked on together: in what they share each takes its tokens rounded up to `unit`
 * rows; a group of more than one view has at most `most` of them.
 */
struct dvsm_grouping {
	size_t unit, most;
};

/** Views that are worked on together, all of whose tokens the workspace has room for. */
struct dvsm_group {
	const size_t *first_token; /* [views + 1] in the residual stream */
	uint32_t views;
};

/** How many tokens a view of it has. */
static inline size_t dvsm_group_tokens(const struct dvsm_group *group, uint32_t view)
{
	return group->first_token[view + 1] - group->first_token[view];
}

/** Of views whose tokens are first_token[view] and on, [views + 1], those from `first` on. */
struct dvsm_group dvsm_group_from(const size_t *first_token, uint32_t views, uint32_t first,
				  struct dvsm_grouping grouping);

/** What a run needs room for. */
struct dvsm_job_size {
	size_t tokens;      /* of all pictures together: the residual stream */
	size_t view_tokens; /* of the largest picture */
	size_t group_rows;  /* of the largest group */
	size_t group_views; /* of the group that has most */
	size_t row_bytes;   /* of a thread that mixes rows of a picture */
	uint32_t threads;
};

/**
 * Size of a run over pictures of these checked cameras, [count].
 *
 * model_patch_px, patch_px   the model's, and the stage's
 */
struct dvsm_job_size dvsm_job_size_of(const struct dvsm_camera *cameras, uint32_t count,
				      uint32_t model_patch_px, uint32_t patch_px, uint32_t threads,
				      struct dvsm_grouping grouping);

#endif
