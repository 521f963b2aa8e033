#include "weights/sets.h"

#include <stdlib.h>

#include "base/error.h"

struct dvsm_weight_sets *dvsm_weight_sets_create(void)
{
	struct dvsm_weight_sets *sets = calloc(1, sizeof(*sets));

	if (sets && pthread_mutex_init(&sets->mutex, NULL) != 0) {
		free(sets);
		sets = NULL;
	}
	return sets;
}

static void destroy(struct dvsm_weight_set *set)
{
	if (!set)
		return;
	dvsm_engine_weights_deinit(&set->floats);
	dvsm_fixed_model_destroy(set->fixed);
	free(set);
}

void dvsm_weight_sets_destroy(struct dvsm_weight_sets *sets)
{
	if (!sets)
		return;
	for (int p = DVSM_PRECISION_F32; p <= DVSM_PRECISION_FIXED; p++)
		destroy(sets->of[p]);
	pthread_mutex_destroy(&sets->mutex);
	free(sets);
}

static enum dvsm_status make(const struct dvsm_model *model, enum dvsm_precision precision,
			     struct dvsm_reader *reader, struct dvsm_weight_set **set,
			     struct dvsm_error *error)
{
	struct dvsm_weight_set *made = calloc(1, sizeof(*made));
	enum dvsm_status status;

	if (!made)
		return dvsm_fail(error, DVSM_NO_MEM, "no memory for an engine");
	if (precision == DVSM_PRECISION_FIXED)
		status = dvsm_fixed_model_create(model, reader, &made->fixed, error);
	else
		status = dvsm_engine_weights_init(model, precision, reader, &made->floats, error);
	if (status == DVSM_OK && reader->status != DVSM_OK)
		status = reader->status;
	if (status != DVSM_OK) {
		destroy(made);
		return status;
	}
	made->bytes = made->fixed ? made->fixed->weight_bytes : made->floats.bytes;
	*set = made;
	return DVSM_OK;
}

enum dvsm_status dvsm_weight_set_acquire(const struct dvsm_model *model,
					 enum dvsm_precision precision, struct dvsm_reader *reader,
					 const struct dvsm_weight_set **set,
					 struct dvsm_error *error)
{
	struct dvsm_weight_set **own = &model->sets->of[precision];
	enum dvsm_status status = DVSM_OK;

	if (model->one_precision && precision != model->precision)
		return dvsm_fail(error, DVSM_UNSUPPORTED,
				 "the model was opened for engines in %s, not %s: open it for %s "
				 "or for all",
				 dvsm_precision_name(model->precision),
				 dvsm_precision_name(precision), dvsm_precision_name(precision));
	pthread_mutex_lock(&model->sets->mutex);
	if (!*own)
		status = make(model, precision, reader, own, error);
	if (status == DVSM_OK) {
		(*own)->users++;
		*set = *own;
	}
	pthread_mutex_unlock(&model->sets->mutex);
	return status;
}

void dvsm_weight_set_release(const struct dvsm_model *model, enum dvsm_precision precision)
{
	struct dvsm_weight_set **own = &model->sets->of[precision];

	pthread_mutex_lock(&model->sets->mutex);
	if (--(*own)->users == 0) {
		destroy(*own);
		*own = NULL;
	}
	pthread_mutex_unlock(&model->sets->mutex);
}

size_t dvsm_weight_sets_bytes(const struct dvsm_model *model)
{
	size_t bytes = 0;

	pthread_mutex_lock(&model->sets->mutex);
	for (int p = DVSM_PRECISION_F32; p <= DVSM_PRECISION_FIXED; p++)
		bytes += model->sets->of[p] ? model->sets->of[p]->bytes : 0;
	pthread_mutex_unlock(&model->sets->mutex);
	return bytes;
}
