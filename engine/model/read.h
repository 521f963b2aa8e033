/* A model's tensors, from its file to where they are kept. Private to the engine. */
#ifndef DVSM_MODEL_READ_H
#define DVSM_MODEL_READ_H

#include "files/safetensors.h"
#include "model/model.h"

/**
 * Check the whole file and read it into a zeroed model of which one_precision and precision are
 * set. Its blocks and its block are allocated, and the caller's to free on failure too.
 *
 * DVSM_BAD_FILE     the file is damaged, or is no model
 * DVSM_UNSUPPORTED  another version, or a configuration that this build does not take
 */
enum dvsm_status dvsm_model_read(struct dvsm_safetensors *file, struct dvsm_model *model,
				 struct dvsm_error *error);

#endif
