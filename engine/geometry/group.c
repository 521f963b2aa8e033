#include "geometry/group.h"

#include <stdbool.h>

#include "base/memory.h"
#include "geometry/resample.h"

/* A group that is being filled. */
struct filling {
	size_t rows;
	uint32_t views;
};

/* Take another view in; false, with the group as it was, when it is full. */
static bool take_in(struct filling *group, size_t tokens, struct dvsm_grouping grouping)
{
	size_t rows = (tokens + grouping.unit - 1) / grouping.unit * grouping.unit;

	if (group->views > 0 && group->rows + rows > grouping.most)
		return false;
	group->rows += rows;
	group->views++;
	return true;
}

struct dvsm_group dvsm_group_from(const size_t *first_token, uint32_t views, uint32_t first,
				  struct dvsm_grouping grouping)
{
	struct filling group = {0, 0};

	for (uint32_t v = first; v < views; v++)
		if (!take_in(&group, first_token[v + 1] - first_token[v], grouping))
			break;
	return (struct dvsm_group){first_token + first, group.views};
}

struct dvsm_job_size dvsm_job_size_of(const struct dvsm_camera *cameras, uint32_t count,
				      uint32_t model_patch_px, uint32_t patch_px, uint32_t threads,
				      struct dvsm_grouping grouping)
{
	struct dvsm_job_size size = {.threads = threads};
	struct filling group = {0, 0};

	/* At most 65536 views of 16384^2 tokens: the sum stays below 2^44. */
	for (uint32_t i = 0; i < count; i++) {
		struct dvsm_patch_plan plan = dvsm_patch_plan_make(
			cameras[i].width, cameras[i].height, model_patch_px, patch_px);
		size_t tokens = dvsm_token_grid_count(plan.grid);

		size.tokens += tokens;
		size.view_tokens = dvsm_size_larger(size.view_tokens, tokens);
		if (!take_in(&group, tokens, grouping)) {
			group = (struct filling){0, 0};
			take_in(&group, tokens, grouping);
		}
		size.group_rows = dvsm_size_larger(size.group_rows, group.rows);
		size.group_views = dvsm_size_larger(size.group_views, group.views);
		/* Rows of a picture: one being mixed, one that becomes bytes. */
		size_t rows = plan.scratch_bytes + 3 * (size_t)cameras[i].width * sizeof(float);

		size.row_bytes = dvsm_size_larger(size.row_bytes, rows);
	}
	return size;
}
