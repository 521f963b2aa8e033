/* The engine's insides, shared by its stages. Private to engine/forward. */
#ifndef DVSM_FORWARD_ENGINE_H
#define DVSM_FORWARD_ENGINE_H

#include "dvsm/engine.h"
#include "fixed/run.h"
#include "forward/steps.h"
#include "weights/sets.h"

struct dvsm_engine {
	const struct dvsm_model *model;        /* borrowed */
	const struct dvsm_weight_set *weights; /* shared with engines like this one; acquired */
	const struct dvsm_kernels *kernels;
	const struct dvsm_fixed_model *fixed; /* of the weights; NULL but in fixed */
	struct dvsm_fixed_kernels fixed_kernels;
	struct dvsm_pool *pool;
	enum dvsm_precision precision;
	bool deblock;
	struct dvsm_trace *trace; /* NULL but while precisions are compared; borrowed */
	void *workspace;          /* grows to the largest job so far; owned */
	size_t workspace_bytes;
};

/** A stage patch as the caller gave it, 0 meaning the model's; DVSM_BAD_ARG outside 1..256. */
enum dvsm_status dvsm_engine_check_patch(const struct dvsm_engine *engine, uint32_t *patch_px,
					 struct dvsm_error *error);

/** Sizes alone: 1..16384 each; DVSM_BAD_ARG outside. */
enum dvsm_status dvsm_engine_check_size(const struct dvsm_camera *camera, struct dvsm_error *error);

/** Bytes of workspace for pictures of these checked cameras; DVSM_NO_MEM when it does not fit. */
enum dvsm_status dvsm_engine_measure(const struct dvsm_engine *engine,
				     const struct dvsm_camera *cameras, uint32_t count,
				     uint32_t patch_px, size_t *bytes, struct dvsm_error *error);

/** Make the workspace large enough for them. */
enum dvsm_status dvsm_engine_reserve(struct dvsm_engine *engine, const struct dvsm_camera *cameras,
				     uint32_t count, uint32_t patch_px, struct dvsm_error *error);

/** Lay the reserved workspace out for a run over them; allocates nothing. */
struct dvsm_run dvsm_engine_begin(const struct dvsm_engine *engine,
				  const struct dvsm_camera *cameras, uint32_t count,
				  uint32_t patch_px);

/** The same in fixed. */
struct dvsm_fixed_run dvsm_engine_begin_fixed(const struct dvsm_engine *engine,
					      const struct dvsm_camera *cameras, uint32_t count,
					      uint32_t patch_px);

/** Whether the cache of a scene is in blocks (kernels/lay.h) for this engine's kernels. */
static inline bool dvsm_engine_wants_blocks(const struct dvsm_engine *engine)
{
	const struct dvsm_model_config *config = &engine->model->config;

	return !engine->fixed &&
	       dvsm_kernels_want_blocks(engine->kernels, config->dim / config->heads);
}

/** Of what the model keeps, and what engines of this precision share. */
static inline size_t dvsm_engine_weight_bytes(const struct dvsm_engine *engine)
{
	return engine->model->weight_bytes + engine->weights->bytes;
}

/** Say how many blocks of a reconstruction are done; DVSM_CANCELLED when the caller asks to stop.
 */
enum dvsm_status dvsm_engine_report(dvsm_progress_fn *progress, void *progress_context,
				    uint32_t done, uint32_t blocks, struct dvsm_error *error);

/** CLOCK_MONOTONIC. */
uint64_t dvsm_engine_now_ns(void);

#endif
