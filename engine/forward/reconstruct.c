#include <stdlib.h>

#include "base/error.h"
#include "forward/block.h"
#include "forward/engine.h"
#include "forward/fixed_stages.h"
#include "forward/picture.h"
#include "geometry/pose.h"
#include "scene/scene_internal.h"

/* Tokens of all views, view by view, into the residual stream. */
static void embed_views(const struct dvsm_run *run, const struct dvsm_scene *scene,
			const struct dvsm_view *views)
{
	const size_t dim = run->model->config.dim;

	for (uint32_t v = 0; v < scene->views; v++)
		dvsm_picture_embed(run, &views[v].camera, &scene->normalisation, scene->patch_px,
				   views[v].rgb, run->work.x + scene->first_token[v] * dim);
}

static struct dvsm_group group_from(const struct dvsm_scene *scene, uint32_t first)
{
	return dvsm_group_from(scene->first_token, scene->views, first, DVSM_GROUPING);
}

/*
 * One block. Keys and values of every view go straight to the cache; only when all are there can
 * any view attend across. Behind the last block's keys and values nothing is needed any more.
 */
static void run_block(const struct dvsm_run *run, const struct dvsm_scene *scene, uint32_t layer)
{
	const struct dvsm_heads cache = {
		dvsm_scene_keys(scene, layer, 0),
		dvsm_scene_values(scene, layer, 0),
		scene->tokens,
	};
	struct dvsm_group group;

	for (uint32_t v = 0; v < scene->views; v += group.views) {
		group = group_from(scene, v);
		dvsm_block_intra(run, layer, &group, &cache);
	}
	if (run->trace)
		dvsm_trace_float_heads(run->trace, 2 * (size_t)layer + 1, 0, cache.keys,
				       cache.values, scene->tokens);
	if (layer + 1 == scene->layers)
		return;
	for (uint32_t v = 0; v < scene->views; v += group.views) {
		group = group_from(scene, v);
		dvsm_block_cross(run, layer, &group, &cache);
	}
}

static enum dvsm_status run_stage(const struct dvsm_run *run, const struct dvsm_scene *scene,
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

static struct dvsm_camera *copy_cameras(const struct dvsm_view *views, uint32_t count)
{
	struct dvsm_camera *cameras = calloc(count, sizeof(*cameras));

	for (uint32_t i = 0; cameras && i < count; i++)
		cameras[i] = views[i].camera;
	return cameras;
}

/* Everything that can be refused, before anything is allocated. */
static enum dvsm_status check(const struct dvsm_engine *engine, const struct dvsm_view *views,
			      uint32_t count, uint32_t *patch_px, struct dvsm_scene **scene,
			      struct dvsm_error *error)
{
	if (!engine || !scene)
		return dvsm_fail(error, DVSM_BAD_ARG,
				 "reconstruct: an engine and a place for the scene are needed");
	if (engine->model->config.prior_dim > 0)
		return dvsm_fail(error, DVSM_UNSUPPORTED,
				 "the model has a prior of %u features, which this engine does not "
				 "compute: use a model without one",
				 engine->model->config.prior_dim);

	enum dvsm_status status = dvsm_engine_check_patch(engine, patch_px, error);

	return status == DVSM_OK ? dvsm_views_check(views, count, error) : status;
}

enum dvsm_status dvsm_reconstruct(struct dvsm_engine *engine, const struct dvsm_view *views,
				  uint32_t count, uint32_t patch_px, dvsm_progress_fn *progress,
				  void *progress_context, struct dvsm_scene **scene,
				  struct dvsm_stats *stats, struct dvsm_error *error)
{
	uint64_t start_ns = dvsm_engine_now_ns();
	struct dvsm_scene *made = NULL;
	struct dvsm_camera *cameras = NULL;
	enum dvsm_status status = check(engine, views, count, &patch_px, scene, error);

	if (status != DVSM_OK)
		return status;
	cameras = copy_cameras(views, count);
	if (!cameras)
		return dvsm_fail(error, DVSM_NO_MEM, "no memory for %u cameras", count);
	status = dvsm_scene_allocate(&engine->model->config,
				     dvsm_scene_model_of(engine->model, engine->precision),
				     engine->precision, cameras, count, patch_px, &made, error);
	if (status == DVSM_OK)
		status = dvsm_engine_reserve(engine, cameras, count, patch_px, error);
	if (status == DVSM_OK && engine->fixed) {
		struct dvsm_fixed_run run =
			dvsm_engine_begin_fixed(engine, cameras, count, patch_px);

		status = dvsm_fixed_reconstruct(&run, made, views, progress, progress_context,
						error);
	} else if (status == DVSM_OK) {
		struct dvsm_run run = dvsm_engine_begin(engine, cameras, count, patch_px);

		made->in_blocks = dvsm_engine_wants_blocks(engine);
		status = run_stage(&run, made, views, progress, progress_context, error);
	}
	free(cameras);
	if (status != DVSM_OK) {
		dvsm_scene_destroy(made);
		return status;
	}
	if (stats) {
		*stats = (struct dvsm_stats){
			.views = count,
			.tokens = (uint32_t)made->tokens,
			.keys = made->tokens,
			.time_ns = dvsm_engine_now_ns() - start_ns,
			.memory = {dvsm_engine_weight_bytes(engine), dvsm_scene_memory_bytes(made),
				   engine->workspace_bytes},
		};
	}
	*scene = made;
	return DVSM_OK;
}
