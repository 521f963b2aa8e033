#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/error.h"
#include "forward/block.h"
#include "forward/engine.h"
#include "forward/fixed_stages.h"
#include "forward/picture.h"
#include "geometry/pose.h"
#include "geometry/rays.h"
#include "scene/scene_internal.h"

/* Most viewpoints that are worked at in one go. */
#define TOGETHER 16u

/* Tokens of a thread's share with which it reads weights seldom enough. */
#define SHARE_TOKENS 256u

static enum dvsm_status check(const struct dvsm_engine *engine, const struct dvsm_scene *scene,
			      const struct dvsm_camera *cameras, uint32_t *patch_px,
			      struct dvsm_error *error)
{
	if (!engine || !scene || !cameras)
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

static struct dvsm_grouping grouping_of(const struct dvsm_engine *engine)
{
	return engine->fixed ? DVSM_FIXED_GROUPING : DVSM_GROUPING;
}

/* The first of some viewpoints that are worked at in one go; first_token has room for TOGETHER. */
static struct dvsm_group group_of(const struct dvsm_engine *engine,
				  const struct dvsm_camera *cameras, uint32_t count,
				  uint32_t patch_px, size_t *first_token)
{
	const uint32_t most = count < TOGETHER ? count : TOGETHER;

	first_token[0] = 0;
	for (uint32_t v = 0; v < most; v++)
		first_token[v + 1] = first_token[v] + dvsm_camera_tokens(&cameras[v], patch_px);
	return dvsm_group_from(first_token, most, 0, grouping_of(engine));
}

uint32_t dvsm_render_batch_size(const struct dvsm_engine *engine, const struct dvsm_camera *camera,
				uint32_t patch_px)
{
	size_t first_token[TOGETHER + 1];
	size_t tokens, wanted;

	if (dvsm_engine_check_patch(engine, &patch_px, NULL) != DVSM_OK ||
	    dvsm_engine_check_size(camera, NULL) != DVSM_OK)
		return 1;
	tokens = group_of(engine, camera, 1, patch_px, first_token).first_token[1];
	wanted = SHARE_TOKENS * (size_t)dvsm_pool_get_threads(engine->pool);
	if (wanted > grouping_of(engine).most)
		wanted = grouping_of(engine).most;
	if (wanted < 2 * tokens)
		return 1;
	return wanted / tokens < TOGETHER ? (uint32_t)(wanted / tokens) : TOGETHER;
}

/* Room for each of the groups that the viewpoints make. */
static enum dvsm_status reserve(struct dvsm_engine *engine, const struct dvsm_camera *cameras,
				uint32_t count, uint32_t patch_px, struct dvsm_error *error)
{
	size_t first_token[TOGETHER + 1];
	enum dvsm_status status = DVSM_OK;
	struct dvsm_group group;

	for (uint32_t at = 0; status == DVSM_OK && at < count; at += group.views) {
		group = group_of(engine, cameras + at, count - at, patch_px, first_token);
		status = dvsm_engine_reserve(engine, cameras + at, group.views, patch_px, error);
	}
	return status;
}

enum dvsm_status dvsm_render_batch_reserve(struct dvsm_engine *engine,
					   const struct dvsm_scene *scene,
					   const struct dvsm_camera *cameras, uint32_t count,
					   uint32_t patch_px, struct dvsm_error *error)
{
	enum dvsm_status status = check(engine, scene, cameras, &patch_px, error);

	for (uint32_t i = 0; status == DVSM_OK && i < count; i++)
		status = dvsm_engine_check_size(&cameras[i], error);
	if (status == DVSM_OK)
		status = reserve(engine, cameras, count, patch_px, error);
	return status;
}

enum dvsm_status dvsm_render_reserve(struct dvsm_engine *engine, const struct dvsm_scene *scene,
				     const struct dvsm_camera *target, uint32_t patch_px,
				     struct dvsm_error *error)
{
	return dvsm_render_batch_reserve(engine, scene, target, 1, patch_px, error);
}

static void run_stage(struct dvsm_engine *engine, const struct dvsm_scene *scene,
		      const struct dvsm_group *group, const struct dvsm_camera *cameras,
		      uint32_t patch_px, const struct dvsm_picture_out *out)
{
	struct dvsm_run run = dvsm_engine_begin(engine, cameras, group->views, patch_px);
	const struct dvsm_model_config *config = &run.model->config;

	for (uint32_t v = 0; v < group->views; v++)
		dvsm_picture_embed(&run, &cameras[v], &scene->normalisation, patch_px, NULL,
				   run.work.x + group->first_token[v] * config->dim);
	for (uint32_t layer = 0; layer < config->layers; layer++) {
		const struct dvsm_heads cache = {
			dvsm_scene_keys(scene, layer, 0),
			dvsm_scene_values(scene, layer, 0),
			scene->tokens,
		};

		dvsm_block_render(&run, layer, group, &cache);
	}
	for (uint32_t v = 0; v < group->views; v++)
		dvsm_picture_write(&run, &cameras[v], patch_px,
				   run.work.x + group->first_token[v] * config->dim, &out[v]);
}

/* "target camera", or which one of several. */
struct name {
	char text[40];
};

static struct name name_of(uint32_t index, uint32_t count)
{
	struct name name = {"target camera"};

	if (count > 1)
		snprintf(name.text, sizeof(name.text), "target camera %u", index);
	return name;
}

/* Everything that can be refused. */
static enum dvsm_status check_batch(const struct dvsm_engine *engine,
				    const struct dvsm_scene *scene,
				    const struct dvsm_camera *cameras, uint32_t count,
				    uint32_t *patch_px, const struct dvsm_picture_out *out,
				    struct dvsm_error *error)
{
	enum dvsm_status status = check(engine, scene, cameras, patch_px, error);

	if (status == DVSM_OK && (count == 0 || !out))
		return dvsm_fail(error, DVSM_BAD_ARG, "render: no viewpoint, or no pictures");
	for (uint32_t i = 0; status == DVSM_OK && i < count; i++) {
		if (!out[i].rgb && !out[i].bytes)
			return dvsm_fail(error, DVSM_BAD_ARG, "render: no place for the picture");
		status = dvsm_target_check(&cameras[i], &scene->normalisation,
					   name_of(i, count).text, error);
	}
	return status;
}

/* The scene as these kernels read it: itself, unless an engine of another tier made it. */
static enum dvsm_status turn_scene(const struct dvsm_engine *engine, const struct dvsm_scene *scene,
				   struct dvsm_scene *turned, struct dvsm_error *error)
{
	*turned = *scene;
	if (scene->in_blocks == dvsm_engine_wants_blocks(engine))
		return DVSM_OK;
	return dvsm_scene_reorder(scene, &turned->keys, &turned->values, error);
}

enum dvsm_status dvsm_render_batch(struct dvsm_engine *engine, const struct dvsm_scene *scene,
				   const struct dvsm_camera *cameras, uint32_t count,
				   uint32_t patch_px, const struct dvsm_picture_out *out,
				   struct dvsm_stats *stats, struct dvsm_error *error)
{
	uint64_t start_ns = dvsm_engine_now_ns();
	enum dvsm_status status = check_batch(engine, scene, cameras, count, &patch_px, out, error);
	size_t first_token[TOGETHER + 1], tokens = 0;
	_Atomic uint64_t clamped = 0;
	struct dvsm_scene turned;
	struct dvsm_group group;

	if (status == DVSM_OK)
		status = reserve(engine, cameras, count, patch_px, error);
	if (status == DVSM_OK)
		status = turn_scene(engine, scene, &turned, error);
	if (status != DVSM_OK)
		return status;
	for (uint32_t at = 0; at < count; at += group.views) {
		group = group_of(engine, cameras + at, count - at, patch_px, first_token);
		tokens += first_token[group.views];
		if (engine->fixed) {
			struct dvsm_fixed_run run = dvsm_engine_begin_fixed(engine, cameras + at,
									    group.views, patch_px);

			run.clamped = &clamped;
			dvsm_fixed_render(&run, &turned, &group, cameras + at, patch_px, out + at);
		} else {
			run_stage(engine, &turned, &group, cameras + at, patch_px, out + at);
		}
	}
	if (turned.keys != scene->keys)
		free(turned.keys);
	if (stats) {
		*stats = (struct dvsm_stats){
			.views = scene->views,
			.tokens = (uint32_t)tokens,
			.keys = scene->tokens,
			.time_ns = dvsm_engine_now_ns() - start_ns,
			.saturated = clamped,
			.memory = {dvsm_engine_weight_bytes(engine), dvsm_scene_memory_bytes(scene),
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

	return dvsm_render_batch(engine, scene, camera, 1, patch_px, &picture, stats, error);
}

enum dvsm_status dvsm_render_rgb8(struct dvsm_engine *engine, const struct dvsm_scene *scene,
				  const struct dvsm_camera *camera, uint32_t patch_px, uint8_t *out,
				  struct dvsm_stats *stats, struct dvsm_error *error)
{
	const struct dvsm_picture_out picture = {.bytes = out};

	return dvsm_render_batch(engine, scene, camera, 1, patch_px, &picture, stats, error);
}
