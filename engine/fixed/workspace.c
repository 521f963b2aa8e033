#include "fixed/run.h"

#include "base/memory.h"

/* Attention's scratch; two planes of a few rows; the rows of a map or a picture. */
static size_t scratch_bytes(const struct dvsm_model_config *config,
			    const struct dvsm_job_size *size)
{
	struct dvsm_fixed_head_scratch attention =
		dvsm_fixed_head_scratch_place(NULL, config->dim / config->heads);
	size_t planes = 2 * DVSM_FIXED_FEW_ROWS * dvsm_fixed_pad(config->dim, DVSM_FIXED_DEPTH);

	return dvsm_fixed_pad(
		dvsm_size_larger(dvsm_size_larger(attention.bytes, planes), 2 * size->row_bytes),
		64);
}

/* An input of a product, padded: a plane of the rays, or both planes of so many numbers. */
static size_t input_bytes(const struct dvsm_model_config *config, size_t numbers)
{
	size_t rays = 6 * (size_t)config->patch_px * config->patch_px;

	return dvsm_size_larger(dvsm_fixed_pad(rays, DVSM_FIXED_DEPTH),
				2 * dvsm_fixed_pad(numbers, DVSM_FIXED_DEPTH));
}

static void *take(struct dvsm_arena *arena, size_t rows, size_t width, size_t size)
{
	if (size && width > SIZE_MAX / size) {
		arena->overflow = true;
		return NULL;
	}
	return dvsm_arena_take(arena, rows, width * size);
}

struct dvsm_fixed_workspace dvsm_fixed_workspace_place(struct dvsm_arena *arena,
						       const struct dvsm_model_config *config,
						       const struct dvsm_job_size *size)
{
	const size_t dim = config->dim, heads = config->heads;
	const size_t n = size->view_tokens, g = size->group_rows, views = size->group_views;
	const size_t packed = heads * dvsm_fixed_pad(dim / heads, DVSM_FIXED_HEAD);
	const size_t area = (size_t)config->patch_px * config->patch_px;
	struct dvsm_fixed_workspace w = {0};

	w.x = take(arena, size->tokens, dim, sizeof(*w.x));
	/* a_low also holds the hidden numbers, while other tasks still read a. */
	w.a = take(arena, g, input_bytes(config, dim), 1);
	w.a_low = take(arena, g, input_bytes(config, dim * dvsm_size_larger(1, config->mlp_ratio)),
		       1);
	w.a_scale = take(arena, g, 1, sizeof(*w.a_scale));
	w.wide = take(arena, g, dim * dvsm_size_larger(1, config->mlp_ratio), sizeof(*w.wide));
	w.mixed = take(arena, g, dim, sizeof(*w.mixed));
	w.kv = take(arena, size->tokens, 2 * dim, sizeof(*w.kv));
	w.ranges = take(arena, views, 2 * dim, sizeof(*w.ranges));
	w.channels = take(arena, views, 2 * dim, sizeof(*w.channels));
	w.own_keys = take(arena, g, packed, 1);
	w.own_values = take(arena, g, packed, 1);
	w.scales = dvsm_fixed_layer_scales_place(arena, views, dim);
	w.left = take(arena, g / DVSM_FIXED_LEAST_TASK_ROWS + 1, 1, sizeof(*w.left));
	w.patches = take(arena, n, 6 * area, sizeof(*w.patches));
	w.sums = take(arena, n, dvsm_size_larger(3 * area, dim), sizeof(*w.sums));
	w.scratch_stride = scratch_bytes(config, size);
	w.scratch = dvsm_arena_take(arena, size->threads, w.scratch_stride);
	return w;
}
