#include "forward/fixed_stages.h"

#include "fixed/block.h"
#include "fixed/picture.h"
#include "forward/engine.h"

static void embed_views(const struct dvsm_fixed_run *run, const struct dvsm_scene *scene,
			const struct dvsm_view *views)
{
	const size_t dim = run->config->dim;

	for (uint32_t v = 0; v < scene->views; v++)
		dvsm_fixed_picture_embed(run, &views[v].camera, &scene->normalisation,
					 scene->patch_px, views[v].rgb,
					 run->work.x + scene->first_token[v] * dim);
}

static struct dvsm_group group_from(const struct dvsm_scene *scene, uint32_t first)
{
	return dvsm_group_from(scene->first_token, scene->views, first, DVSM_FIXED_GROUPING);
}

/* work.a = the norm of the group's rows, as the matrix takes it. */
static void norm_group(const struct dvsm_fixed_run *run, const struct dvsm_group *group,
		       const struct dvsm_fixed_gain *gain, const struct dvsm_fixed_matrix *input)
{
	dvsm_fixed_step_norm(run, dvsm_fixed_group_x(run, group), dvsm_fixed_group_rows(group),
			     gain, input);
}

/*
 * One block. Keys and values of all views wait in 16 bits until their range is known; then they are
 * packed, and every view attends across. Behind the last block's nothing is needed any more.
 */
static void run_block(const struct dvsm_fixed_run *run, struct dvsm_scene *scene, uint32_t layer)
{
	const struct dvsm_fixed_block *block = &run->model->blocks[layer];
	const struct dvsm_fixed_layers cache = {
		.one = dvsm_fixed_cache_layer(&scene->fixed, layer),
	};
	struct dvsm_group group;

	for (uint32_t v = 0; v < scene->views; v += group.views) {
		group = group_from(scene, v);
		norm_group(run, &group, &block->intra.norm, &block->intra.key_value);
		dvsm_fixed_block_intra(run, layer, &group, &block->cross.key_value);
		dvsm_fixed_block_cross_keys(run, layer, &group);
	}
	dvsm_fixed_step_pack(run, &block->cross, run->work.kv, &cache);
	if (run->trace)
		dvsm_trace_packed(run->trace, 2 * (size_t)layer + 1, 0, run->work.kv, scene->tokens,
				  run->work.channels, block->cross.value_fraction);
	if (layer + 1 == scene->layers)
		return;
	for (uint32_t v = 0; v < scene->views; v += group.views) {
		group = group_from(scene, v);
		norm_group(run, &group, &block->cross.norm, &block->cross.query);
		dvsm_fixed_block_cross(run, layer, &group, &cache.one, NULL);
	}
}

enum dvsm_status dvsm_fixed_reconstruct(const struct dvsm_fixed_run *run, struct dvsm_scene *scene,
					const struct dvsm_view *views, dvsm_progress_fn *progress,
					void *progress_context, struct dvsm_error *error)
{
	enum dvsm_status status = DVSM_OK;

	embed_views(run, scene, views);
	for (uint32_t layer = 0; status == DVSM_OK && layer < scene->layers; layer++) {
		run_block(run, scene, layer);
		status = dvsm_engine_report(progress, progress_context, layer + 1, scene->layers,
					    error);
	}
	return status;
}

void dvsm_fixed_render(const struct dvsm_fixed_run *run, const struct dvsm_scene *scene,
		       const struct dvsm_group *group, const struct dvsm_camera *cameras,
		       uint32_t patch_px, const struct dvsm_picture_out *out)
{
	const struct dvsm_model_config *config = run->config;
	const struct dvsm_fixed_half *first = &run->model->blocks[0].intra;

	for (uint32_t v = 0; v < group->views; v++)
		dvsm_fixed_picture_embed(run, &cameras[v], &scene->normalisation, patch_px, NULL,
					 run->work.x + group->first_token[v] * config->dim);
	norm_group(run, group, &first->norm, &first->key_value);
	for (uint32_t layer = 0; layer < config->layers; layer++) {
		struct dvsm_fixed_layer cache = dvsm_fixed_cache_layer(&scene->fixed, layer);
		const struct dvsm_fixed_block *next =
			layer + 1 < config->layers ? &run->model->blocks[layer + 1] : NULL;

		dvsm_fixed_block_intra(run, layer, group, &run->model->blocks[layer].cross.query);
		dvsm_fixed_block_cross(run, layer, group, &cache, next ? &next->intra : NULL);
	}
	for (uint32_t v = 0; v < group->views; v++)
		dvsm_fixed_picture_write(run, &cameras[v], patch_px,
					 run->work.x + group->first_token[v] * config->dim,
					 &out[v]);
}
