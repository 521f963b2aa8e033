#include <string.h>

#include "base/error.h"
#include "fixed/stages.h"
#include "forward/block.h"
#include "forward/engine.h"
#include "forward/picture.h"
#include "geometry/pose.h"
#include "scene/scene_internal.h"

static enum dvsm_status check(const struct dvsm_engine *engine, const struct dvsm_scene *scene,
			      const struct dvsm_camera *camera, uint32_t *patch_px,
			      struct dvsm_error *error)
{
	if (!engine || !scene || !camera)
		return dvsm_fail(error, DVSM_BAD_ARG,
				 "render: an engine, a scene and a camera are needed");
	const char *own = dvsm_scene_model_of(engine->model, scene->precision);

	if (strcmp(scene->model_sha256, own) != 0)
		return dvsm_fail(error, DVSM_MISMATCH,
				 "the scene was made with model %s, the engine has %s: reconstruct "
				 "it again",
				 scene->model_sha256, own);
	if (scene->precision != engine->precision)
		return dvsm_fail(error, DVSM_MISMATCH,
				 "the scene was made in %s, the engine computes in %s: reconstruct "
				 "it again or render it in %s",
				 dvsm_precision_name(scene->precision),
				 dvsm_precision_name(engine->precision),
				 dvsm_precision_name(scene->precision));
	return dvsm_engine_check_patch(engine, patch_px, error);
}

enum dvsm_status dvsm_render_reserve(struct dvsm_engine *engine, const struct dvsm_scene *scene,
				     const struct dvsm_camera *target, uint32_t patch_px,
				     struct dvsm_error *error)
{
	enum dvsm_status status = check(engine, scene, target, &patch_px, error);

	if (status == DVSM_OK)
		status = dvsm_engine_check_size(target, error);
	if (status == DVSM_OK)
		status = dvsm_engine_reserve(engine, target, 1, patch_px, error);
	return status;
}

static void run_stage(struct dvsm_engine *engine, const struct dvsm_scene *scene,
		      const struct dvsm_camera *camera, const struct dvsm_patch_plan *plan,
		      uint32_t patch_px, const struct dvsm_picture_out *out)
{
	struct dvsm_run run = dvsm_engine_begin(engine, camera, 1, patch_px);
	const struct dvsm_model_config *config = &run.model->config;
	const size_t tokens = dvsm_token_grid_count(plan->grid);
	struct dvsm_ray_map map =
		dvsm_ray_map_prepare(camera, &scene->normalisation, config->patch_px, patch_px);

	const size_t first_token[] = {0, tokens};
	const struct dvsm_group group = {first_token, 1};

	dvsm_picture_embed(&run, &map, plan, NULL, run.work.x);
	for (uint32_t layer = 0; layer < config->layers; layer++) {
		const struct dvsm_heads cache = {
			dvsm_scene_keys(scene, layer, 0),
			dvsm_scene_values(scene, layer, 0),
			scene->tokens,
		};

		dvsm_block_render(&run, layer, &group, &cache);
	}
	dvsm_picture_write(&run, plan, run.work.x, out);
}

static enum dvsm_status render(struct dvsm_engine *engine, const struct dvsm_scene *scene,
			       const struct dvsm_camera *camera, uint32_t patch_px,
			       const struct dvsm_picture_out *out, struct dvsm_stats *stats,
			       struct dvsm_error *error)
{
	uint64_t start_ns = dvsm_engine_now_ns();
	enum dvsm_status status = check(engine, scene, camera, &patch_px, error);

	if (status == DVSM_OK && !out->rgb && !out->bytes)
		status = dvsm_fail(error, DVSM_BAD_ARG, "render: no place for the picture");
	if (status == DVSM_OK)
		status = dvsm_target_check(camera, &scene->normalisation, "target camera", error);
	if (status == DVSM_OK)
		status = dvsm_engine_reserve(engine, camera, 1, patch_px, error);
	if (status != DVSM_OK)
		return status;

	struct dvsm_patch_plan plan = dvsm_patch_plan_make(
		camera->width, camera->height, engine->model->config.patch_px, patch_px);

	_Atomic uint64_t clamped = 0;

	if (engine->fixed) {
		struct dvsm_fixed_run run = dvsm_engine_begin_fixed(engine, camera, 1, patch_px);

		run.clamped = &clamped;
		dvsm_fixed_render(&run, scene, camera, &plan, patch_px, out);
	} else {
		run_stage(engine, scene, camera, &plan, patch_px, out);
	}
	if (stats) {
		*stats = (struct dvsm_stats){
			.views = scene->views,
			.tokens = (uint32_t)dvsm_token_grid_count(plan.grid),
			.keys = scene->tokens,
			.time_ns = dvsm_engine_now_ns() - start_ns,
			.saturated = clamped,
			.memory = {dvsm_engine_weight_bytes(engine), scene->cache_bytes,
				   engine->workspace_bytes},
		};
	}
	return DVSM_OK;
}

enum dvsm_status dvsm_render(struct dvsm_engine *engine, const struct dvsm_scene *scene,
			     const struct dvsm_camera *camera, uint32_t patch_px, float *out,
			     struct dvsm_stats *stats, struct dvsm_error *error)
{
	const struct dvsm_picture_out picture = {.rgb = out};

	return render(engine, scene, camera, patch_px, &picture, stats, error);
}

enum dvsm_status dvsm_render_rgb8(struct dvsm_engine *engine, const struct dvsm_scene *scene,
				  const struct dvsm_camera *camera, uint32_t patch_px, uint8_t *out,
				  struct dvsm_stats *stats, struct dvsm_error *error)
{
	const struct dvsm_picture_out picture = {.bytes = out};

	return render(engine, scene, camera, patch_px, &picture, stats, error);
}
