#include "forward/engine.h"

#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "base/error.h"
#include "base/memory.h"
#include "geometry/pose.h"
#include "scene/scene_internal.h"

/* Kernels and weights of the precision. */
static enum dvsm_status choose_path(struct dvsm_engine *engine,
				    const struct dvsm_engine_options *options,
				    struct dvsm_error *error)
{
	uint32_t mask = options->cpu_mask ? options->cpu_mask : (uint32_t)DVSM_CPU_ALL;
	struct dvsm_reader reader = {.status = DVSM_OK};
	enum dvsm_status status = dvsm_weight_set_acquire(engine->model, options->precision,
							  &reader, &engine->weights, error);

	if (status != DVSM_OK)
		return status;
	engine->fixed = engine->weights->fixed;
	if (engine->fixed)
		engine->fixed_kernels = dvsm_fixed_kernels_choose(mask);
	else
		engine->kernels = dvsm_kernels_choose(options->precision, mask);
	return DVSM_OK;
}

enum dvsm_status dvsm_engine_create(const struct dvsm_model *model,
				    const struct dvsm_engine_options *options,
				    struct dvsm_engine **engine, struct dvsm_error *error)
{
	static const struct dvsm_engine_options defaults;
	enum dvsm_status status;

	if (!model || !engine)
		return dvsm_fail(error, DVSM_BAD_ARG, "engine: a model and a place are needed");
	if (!options)
		options = &defaults;
	if ((uint32_t)options->precision > DVSM_PRECISION_FIXED)
		return dvsm_fail(error, DVSM_UNSUPPORTED,
				 "engine: precision %d is none of f32, bf16 and fixed",
				 (int)options->precision);

	uint32_t threads = options->threads ? options->threads : dvsm_pool_processors();
	struct dvsm_engine *made = calloc(1, sizeof(*made));

	if (!made)
		return dvsm_fail(error, DVSM_NO_MEM, "no memory for an engine");
	made->model = model;
	made->precision = options->precision;
	made->deblock = options->deblock;
	status = choose_path(made, options, error);
	if (status == DVSM_OK)
		status = dvsm_pool_create(threads, &made->pool, error);
	if (status != DVSM_OK) {
		dvsm_engine_destroy(made);
		return status;
	}
	*engine = made;
	return DVSM_OK;
}

void dvsm_engine_destroy(struct dvsm_engine *engine)
{
	if (!engine)
		return;
	dvsm_pool_destroy(engine->pool);
	if (engine->weights)
		dvsm_weight_set_release(engine->model, engine->precision);
	free(engine->workspace);
	free(engine);
}

const char *dvsm_engine_get_cpu(const struct dvsm_engine *engine)
{
	return engine->fixed ? engine->fixed_kernels.name : engine->kernels->name;
}

uint32_t dvsm_engine_get_threads(const struct dvsm_engine *engine)
{
	return dvsm_pool_get_threads(engine->pool);
}

enum dvsm_precision dvsm_engine_get_precision(const struct dvsm_engine *engine)
{
	return engine->precision;
}

enum dvsm_status dvsm_engine_report(dvsm_progress_fn *progress, void *progress_context,
				    uint32_t done, uint32_t blocks, struct dvsm_error *error)
{
	if (progress && !progress(progress_context, (double)done / blocks))
		return dvsm_fail(error, DVSM_CANCELLED,
				 "reconstruction cancelled after block %u of %u", done, blocks);
	return DVSM_OK;
}

uint64_t dvsm_engine_now_ns(void)
{
	struct timespec now;

	clock_gettime(CLOCK_MONOTONIC, &now);
	return (uint64_t)now.tv_sec * 1000000000u + (uint64_t)now.tv_nsec;
}

enum dvsm_status dvsm_engine_check_patch(const struct dvsm_engine *engine, uint32_t *patch_px,
					 struct dvsm_error *error)
{
	if (*patch_px == 0)
		*patch_px = engine->model->config.patch_px;
	if (*patch_px > DVSM_MAX_PATCH_PX)
		return dvsm_fail(error, DVSM_BAD_ARG, "stage patch %u px: 1 to %u are possible",
				 *patch_px, DVSM_MAX_PATCH_PX);
	return DVSM_OK;
}

enum dvsm_status dvsm_engine_check_size(const struct dvsm_camera *camera, struct dvsm_error *error)
{
	if (camera->width < 1 || camera->width > DVSM_MAX_SIDE_PX || camera->height < 1 ||
	    camera->height > DVSM_MAX_SIDE_PX)
		return dvsm_fail(error, DVSM_BAD_ARG,
				 "picture of %u x %u px: 1 to %u a side are possible",
				 camera->width, camera->height, DVSM_MAX_SIDE_PX);
	return DVSM_OK;
}

static struct dvsm_job_size size_of(const struct dvsm_engine *engine,
				    const struct dvsm_camera *cameras, uint32_t count,
				    uint32_t patch_px)
{
	return dvsm_job_size_of(cameras, count, engine->model->config.patch_px, patch_px,
				dvsm_pool_get_threads(engine->pool),
				engine->fixed ? DVSM_FIXED_GROUPING : DVSM_GROUPING);
}

enum dvsm_status dvsm_engine_measure(const struct dvsm_engine *engine,
				     const struct dvsm_camera *cameras, uint32_t count,
				     uint32_t patch_px, size_t *bytes, struct dvsm_error *error)
{
	const struct dvsm_model_config *config = &engine->model->config;
	struct dvsm_job_size size = size_of(engine, cameras, count, patch_px);
	struct dvsm_arena arena = {0};

	if (engine->fixed)
		dvsm_fixed_workspace_place(&arena, config, &size);
	else
		dvsm_workspace_place(&arena, config, &size, engine->kernels);
	if (arena.overflow)
		return dvsm_fail(error, DVSM_NO_MEM,
				 "workspace of %zu tokens does not fit the address space: "
				 "use fewer views or a larger patch",
				 size.tokens);
	*bytes = arena.used;
	return DVSM_OK;
}

enum dvsm_status dvsm_engine_reserve(struct dvsm_engine *engine, const struct dvsm_camera *cameras,
				     uint32_t count, uint32_t patch_px, struct dvsm_error *error)
{
	size_t bytes = 0;
	enum dvsm_status status =
		dvsm_engine_measure(engine, cameras, count, patch_px, &bytes, error);

	if (status != DVSM_OK || bytes <= engine->workspace_bytes)
		return status;

	/* Its content dies with every run: let the old one go first, to need only the new one. */
	free(engine->workspace);
	engine->workspace_bytes = 0;
	engine->workspace = dvsm_aligned_alloc(bytes);
	if (!engine->workspace)
		return dvsm_fail(error, DVSM_NO_MEM,
				 "no memory for a workspace of %.1f MB: use fewer views or a "
				 "larger patch",
				 (double)bytes / 1e6);
	/* Have its pages now, not in the frame in which a thread first comes to its part. */
	memset(engine->workspace, 0, bytes);
	engine->workspace_bytes = bytes;
	return DVSM_OK;
}

struct dvsm_run dvsm_engine_begin(const struct dvsm_engine *engine,
				  const struct dvsm_camera *cameras, uint32_t count,
				  uint32_t patch_px)
{
	const struct dvsm_model_config *config = &engine->model->config;
	struct dvsm_job_size size = size_of(engine, cameras, count, patch_px);
	struct dvsm_arena arena = {.base = engine->workspace};

	return (struct dvsm_run){
		.model = engine->model,
		.weights = &engine->weights->floats.w,
		.kernels = engine->kernels,
		.pool = engine->pool,
		.trace = dvsm_trace_begin(engine->trace, size.tokens),
		.deblock = engine->deblock,
		.work = dvsm_workspace_place(&arena, config, &size, engine->kernels),
	};
}

struct dvsm_fixed_run dvsm_engine_begin_fixed(const struct dvsm_engine *engine,
					      const struct dvsm_camera *cameras, uint32_t count,
					      uint32_t patch_px)
{
	const struct dvsm_model_config *config = &engine->model->config;
	struct dvsm_job_size size = size_of(engine, cameras, count, patch_px);
	struct dvsm_arena arena = {.base = engine->workspace};

	return (struct dvsm_fixed_run){
		.config = config,
		.model = engine->fixed,
		.kernels = &engine->fixed_kernels,
		.pool = engine->pool,
		.trace = dvsm_trace_begin(engine->trace, size.tokens),
		.deblock = engine->deblock,
		.work = dvsm_fixed_workspace_place(&arena, config, &size),
	};
}

enum dvsm_status dvsm_plan(const struct dvsm_engine *engine, const struct dvsm_camera *cameras,
			   uint32_t views, uint32_t patch_px, const struct dvsm_camera *target,
			   uint32_t target_patch_px, struct dvsm_memory *memory,
			   struct dvsm_error *error)
{
	enum dvsm_status status;
	size_t cache = 0, workspace = 0, render = 0;

	if (!engine || !cameras || !memory || views < 1 || views > DVSM_MAX_VIEWS)
		return dvsm_fail(error, DVSM_BAD_ARG, "plan: %u views, 1 to %u are possible", views,
				 DVSM_MAX_VIEWS);
	status = dvsm_engine_check_patch(engine, &patch_px, error);
	if (status == DVSM_OK)
		status = dvsm_engine_check_patch(engine, &target_patch_px, error);
	for (uint32_t i = 0; status == DVSM_OK && i < views; i++)
		status = dvsm_engine_check_size(&cameras[i], error);
	if (status == DVSM_OK && target)
		status = dvsm_engine_check_size(target, error);
	if (status == DVSM_OK)
		status = dvsm_scene_measure(&engine->model->config, engine->precision, cameras,
					    views, patch_px, NULL, &cache, error);
	if (status == DVSM_OK)
		status = dvsm_engine_measure(engine, cameras, views, patch_px, &workspace, error);
	if (status == DVSM_OK && target)
		status = dvsm_engine_measure(engine, target, 1, target_patch_px, &render, error);
	if (status != DVSM_OK)
		return status;
	memory->weights_bytes = dvsm_engine_weight_bytes(engine);
	memory->cache_bytes = cache;
	memory->workspace_bytes = workspace > render ? workspace : render;
	return DVSM_OK;
}
