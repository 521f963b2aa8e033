/* A model's weights as the engine's precision reads them. Private to the engine. */
#ifndef DVSM_WEIGHTS_FLOATS_H
#define DVSM_WEIGHTS_FLOATS_H

#include "model/model.h"

/** The model's own vectors and matrices, the latter with `pairs` where the precision needs them. */
struct dvsm_engine_weights {
	struct dvsm_weights w;
	void *block; /* of matrices that are not the model's; NULL for none; owned, as w.blocks is
		      */
	size_t bytes;
};

struct dvsm_reader;

/**
 * Make them from a model and what the reader, whose status the caller looks at, reads of it; the
 * model is borrowed. Release with dvsm_engine_weights_deinit(), which takes
 * zeroed ones too.
 *
 * DVSM_NO_MEM  no memory for them
 */
enum dvsm_status dvsm_engine_weights_init(const struct dvsm_model *model,
					  enum dvsm_precision precision, struct dvsm_reader *reader,
					  struct dvsm_engine_weights *weights,
					  struct dvsm_error *error);
void dvsm_engine_weights_deinit(struct dvsm_engine_weights *weights);

#endif
