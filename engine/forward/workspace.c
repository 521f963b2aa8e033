#include "forward/workspace.h"

#include "base/memory.h"
#include "kernels/kernels.h"

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
	const size_t head_dim = dim / config->heads;
	const size_t attention = dvsm_attention_scratch(head_dim) +
				 DVSM_ATTENTION_MOST_QUERIES * head_dim * sizeof(float);
	struct dvsm_workspace w = {0};

	/* Patches, attention inputs and MLP hidden numbers are never needed together. */
	w.wide_width = dvsm_group_rows(
		dvsm_size_larger(dvsm_size_larger(3, config->mlp_ratio) * dim, 6 * area));
	w.scratch_stride = (dvsm_size_larger(attention, size->row_bytes) + 63) / 64 * 64;
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
