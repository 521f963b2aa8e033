/* Opening and closing a model: its file, and what engines read of it. Private to the engine. */
#ifndef DVSM_WEIGHTS_OPEN_H
#define DVSM_WEIGHTS_OPEN_H

#include <stddef.h>

#include "dvsm/model.h"

/**
 * Open a model from the bytes of its file; `name` stands for the file in error texts.
 * Otherwise as dvsm_model_open(). The bytes are borrowed for the call.
 */
enum dvsm_status dvsm_model_open_bytes(const void *bytes, size_t size, const char *name,
				       struct dvsm_model **model, struct dvsm_error *error);

/** The same as dvsm_model_open_for(). */
enum dvsm_status dvsm_model_open_bytes_for(const void *bytes, size_t size, const char *name,
					   enum dvsm_precision precision, struct dvsm_model **model,
					   struct dvsm_error *error);

#endif
