/* How far precision fixed is from float32, layer by layer. */
#include <math.h>
#include <stdlib.h>

#include "base/error.h"
#include "dvsm/dvsm.h"
#include "fixed/trace.h"
#include "forward/engine.h"

/* Reconstruct and render everything in one precision. */
static enum dvsm_status run_once(const struct dvsm_measure_job *job, enum dvsm_precision precision,
				 struct dvsm_trace *trace, struct dvsm_error *error)
{
	const struct dvsm_engine_options options = {.threads = job->threads,
						    .precision = precision};
	struct dvsm_engine *engine = NULL;
	struct dvsm_scene *scene = NULL;
	float *picture = NULL;
	enum dvsm_status status = dvsm_engine_create(job->model, &options, &engine, error);

	if (status != DVSM_OK)
		return status;
	if (engine->fixed)
		dvsm_trace_turn_round(trace, engine->fixed->key_fraction);
	engine->trace = trace;
	status = dvsm_reconstruct(engine, job->views, job->view_count, job->patch_recon, NULL, NULL,
				  &scene, NULL, error);
	for (uint32_t i = 0; status == DVSM_OK && i < job->target_count; i++) {
		const struct dvsm_camera *target = &job->targets[i];

		free(picture);
		picture = malloc((size_t)target->width * target->height * 3 * sizeof(*picture));
		status = picture ? dvsm_render(engine, scene, target, job->patch_render, picture,
					       NULL, error)
				 : dvsm_fail(error, DVSM_NO_MEM, "no memory for a picture");
	}
	free(picture);
	dvsm_scene_destroy(scene);
	dvsm_engine_destroy(engine);
	return status;
}

/* NaN where nothing was looked at: behind the last cross-view half without a target. */
static double decibels(const struct dvsm_trace *trace, size_t half, enum dvsm_trace_what what)
{
	const struct dvsm_trace_energy *energy = &trace->energies[half * DVSM_TRACE_COUNT + what];

	if (!(energy->numbers > 0))
		return NAN;
	return energy->errors > 0 ? 10 * log10(energy->numbers / energy->errors) : INFINITY;
}

enum dvsm_status dvsm_activations_measure(const struct dvsm_measure_job *job,
					  struct dvsm_half_error *errors, struct dvsm_error *error)
{
	struct dvsm_trace trace;
	enum dvsm_status status;

	if (!job || !job->model || !errors)
		return dvsm_fail(error, DVSM_BAD_ARG, "measure: a model and a place are needed");
	if (!dvsm_trace_init(&trace, job->model, 1 + (size_t)job->target_count))
		return dvsm_fail(error, DVSM_NO_MEM, "no memory to compare precisions");
	status = run_once(job, DVSM_PRECISION_F32, &trace, error);
	if (status == DVSM_OK)
		status = run_once(job, DVSM_PRECISION_FIXED, &trace, error);
	for (size_t i = 0; status == DVSM_OK && i < 2 * (size_t)job->model->config.layers; i++)
		errors[i] = (struct dvsm_half_error){
			.keys_db = decibels(&trace, i, DVSM_TRACE_KEYS),
			.values_db = decibels(&trace, i, DVSM_TRACE_VALUES),
			.attention_db = decibels(&trace, i, DVSM_TRACE_ATTENTION),
			.hidden_db = decibels(&trace, i, DVSM_TRACE_HIDDEN),
			.output_db = decibels(&trace, i, DVSM_TRACE_OUTPUT),
		};
	dvsm_trace_deinit(&trace);
	return status;
}
