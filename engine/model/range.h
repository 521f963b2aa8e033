/* What a model's arithmetic can reach at most. Private to the engine. */
#ifndef DVSM_MODEL_RANGE_H
#define DVSM_MODEL_RANGE_H

#include "files/safetensors.h"
#include "model/model.h"

/**
 * Check that no scene and no picture can bring a model's numbers out of float32's range: a bound on
 * every intermediate number, from the largest weight of each tensor of a loaded file. A model that
 * passes gives neither an infinity nor a NaN; trained weights stay below the bound by many orders.
 *
 * DVSM_BAD_FILE  one line that names the tensor with which the bound is passed
 */
enum dvsm_status dvsm_range_check(const struct dvsm_safetensors *file,
				  const struct dvsm_model_config *config, struct dvsm_error *error);

/**
 * Whether a cache with keys and values of up to these magnitudes keeps rendering with `model` in
 * range; any that the model makes does.
 */
bool dvsm_range_holds_cache(const struct dvsm_model *model, double largest_key,
			    double largest_value);

#endif
