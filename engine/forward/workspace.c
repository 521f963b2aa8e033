#include "forward/workspace.h"

#include "geometry/resample.h"
#include "kernels/kernels.h"

static size_t larger(size_t a, size_t b)
{
	return a > b ? a : b;
}

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

struct dvsm_job_size dvsm_job_size_of(const struct dvsm_model_config *config,
				      const struct dvsm_camera *cameras, uint32_t count,
				      uint32_t patch_px, uint32_t threads,
				      struct dvsm_grouping grouping)
{
	const size_t head_dim = config->dim / config->heads;
	struct dvsm_job_size size = {
		.scratch_bytes = dvsm_attention_scratch(head_dim) +
				 DVSM_ATTENTION_MOST_QUERIES * head_dim * sizeof(float),
		.threads = threads,
	};
	struct filling group = {0, 0};

	/* At most 65536 views of 16384^2 tokens: the sum stays below 2^44. */
	for (uint32_t i = 0; i < count; i++) {
		struct dvsm_patch_plan plan = dvsm_patch_plan_make(
			cameras[i].width, cameras[i].height, config->patch_px, patch_px);
		size_t tokens = dvsm_token_grid_count(plan.grid);

		size.tokens += tokens;
		size.view_tokens = larger(size.view_tokens, tokens);
		if (!take_in(&group, tokens, grouping)) {
			group = (struct filling){0, 0};
			take_in(&group, tokens, grouping);
		}
		size.group_rows = larger(size.group_rows, group.rows);
		size.group_views = larger(size.group_views, group.views);
		/* Rows of a picture: one being mixed, one that becomes bytes. */
		size_t rows = plan.scratch_bytes + 3 * (size_t)cameras[i].width * sizeof(float);

		size.scratch_bytes = larger(size.scratch_bytes, rows);
	}
	return size;
}

/* A left side; rows up to whole strips, so that no product can overflow that did not before. */
static void *take_left(struct dvsm_arena *arena, const struct dvsm_kernels *kernels, size_t rows,
		       size_t stride)
{
	size_t strips = (rows + DVSM_TILE_ROWS - 1) / DVSM_TILE_ROWS;

	if (!kernels->tiled)
		return dvsm_arena_take(arena, rows, stride * kernels->number_bytes);
	return dvsm_arena_take(arena, strips,
			       dvsm_left_size(kernels, DVSM_TILE_ROWS, stride) *
				       kernels->number_bytes);
}

struct dvsm_workspace dvsm_workspace_place(struct dvsm_arena *arena,
					   const struct dvsm_model_config *config,
					   const struct dvsm_job_size *size,
					   const struct dvsm_kernels *kernels)
{
	const size_t number_bytes = kernels->number_bytes;
	const size_t dim = config->dim, n = size->view_tokens, g = size->group_rows;
	const size_t area = (size_t)config->patch_px * config->patch_px;
	struct dvsm_workspace w = {0};

	/* Patches, attention inputs and MLP hidden numbers are never needed together. */
	w.wide_width = dvsm_group_rows(larger(larger(3, config->mlp_ratio) * dim, 6 * area));
	w.scratch_stride = (size->scratch_bytes + 63) / 64 * 64;
	w.x = dvsm_arena_take_floats(arena, size->tokens, dim);
	w.normed = take_left(arena, kernels, g, dim);
	w.wide = dvsm_arena_take_floats(arena, g, w.wide_width);
	w.patches = w.wide;
	if (number_bytes != sizeof(float))
		w.patches = take_left(arena, kernels, n, 6 * area);
	w.keys = dvsm_arena_take(arena, g, dim * number_bytes);
	w.values = dvsm_arena_take(arena, g, dim * number_bytes);
	w.scratch = dvsm_arena_take(arena, size->threads, w.scratch_stride);
	return w;
}
