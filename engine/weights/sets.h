/*
 * A model's weights as the engines of one precision read them: one set for all of them, made for
 * the first and released with the last. Private to the engine.
 */
#ifndef DVSM_WEIGHTS_SETS_H
#define DVSM_WEIGHTS_SETS_H

#include <pthread.h>

#include "fixed/model.h"
#include "model/reader.h"
#include "weights/floats.h"

/** One of a model's sets; immutable while it has users. */
struct dvsm_weight_set {
	struct dvsm_engine_weights floats; /* f32, bf16 */
	struct dvsm_fixed_model *fixed;    /* NULL but in fixed */
	size_t bytes;                      /* beyond what the model keeps itself */
	uint32_t users; /* engines, and the model if it was opened for this precision */
};

/** Of a model; all sets are guarded by the mutex. */
struct dvsm_weight_sets {
	pthread_mutex_t mutex;
	struct dvsm_weight_set *of[DVSM_PRECISION_FIXED + 1];
};

/** No set yet; NULL without memory. */
struct dvsm_weight_sets *dvsm_weight_sets_create(void);

/** What the model itself holds goes with it: no engine may be left. NULL is fine. */
void dvsm_weight_sets_destroy(struct dvsm_weight_sets *sets);

/**
 * The set of a precision, made from what `reader` reads unless there is one; thread-safe.
 *
 * DVSM_UNSUPPORTED  a model that was opened for another precision, or that fixed does not take
 */
enum dvsm_status dvsm_weight_set_acquire(const struct dvsm_model *model,
					 enum dvsm_precision precision, struct dvsm_reader *reader,
					 const struct dvsm_weight_set **set,
					 struct dvsm_error *error);

/** Give it back; thread-safe. */
void dvsm_weight_set_release(const struct dvsm_model *model, enum dvsm_precision precision);

/** Bytes of all sets that exist. */
size_t dvsm_weight_sets_bytes(const struct dvsm_model *model);

#endif
