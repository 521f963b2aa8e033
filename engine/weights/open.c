#include "weights/open.h"

#include <stdlib.h>

#include "base/error.h"
#include "model/read.h"
#include "weights/sets.h"

/* What engines of the model's one precision read, which the model has from now on. */
static enum dvsm_status make_set(struct dvsm_safetensors *file, const struct dvsm_model *model,
				 struct dvsm_error *error)
{
	const struct dvsm_weight_set *set;
	struct dvsm_reader reader = {.status = DVSM_OK};
	enum dvsm_status status = DVSM_OK;
	if (!model->weights.patch_ray.panels)
		status = dvsm_reader_init(&reader, model, file, error);
	if (status == DVSM_OK)
		status = dvsm_weight_set_acquire(model, model->precision, &reader, &set, error);
	dvsm_reader_deinit(&reader);
	return status;
}

/* Reads and closes `file`. only: NULL, or the one precision. */
static enum dvsm_status open_model(struct dvsm_safetensors *file, const enum dvsm_precision *only,
				   struct dvsm_model **model, struct dvsm_error *error)
{
	struct dvsm_model *opened = calloc(1, sizeof(*opened));
	enum dvsm_status status = DVSM_OK;
	if (opened) {
		opened->one_precision = only != NULL;
		opened->precision = only ? *only : DVSM_PRECISION_F32;
		opened->sets = dvsm_weight_sets_create();
	}
	if (!opened || !opened->sets)
		status = dvsm_fail(error, DVSM_NO_MEM, "%s: no memory for a model",
				   dvsm_name_tail(file->source.name));
	if (status == DVSM_OK)
		status = dvsm_model_read(file, opened, error);
	if (status == DVSM_OK && only)
		status = make_set(file, opened, error);
	dvsm_safetensors_close(file);
	if (status == DVSM_OK)
		*model = opened;
	else
		dvsm_model_close(opened);
	return status;
}

static enum dvsm_status open_path(const char *path, const enum dvsm_precision *only,
				  struct dvsm_model **model, struct dvsm_error *error)
{
	struct dvsm_safetensors file;
	if (!path || !model)
		return dvsm_fail(error, DVSM_BAD_ARG, "no model file was named");
	enum dvsm_status status = dvsm_safetensors_open(path, &file, error);
	return status == DVSM_OK ? open_model(&file, only, model, error) : status;
}

static enum dvsm_status check_precision(enum dvsm_precision precision, struct dvsm_error *error)
{
	if ((uint32_t)precision > DVSM_PRECISION_FIXED)
		return dvsm_fail(error, DVSM_UNSUPPORTED,
				 "model: precision %d is none of f32, bf16 and fixed",
				 (int)precision);
	return DVSM_OK;
}

enum dvsm_status dvsm_model_open(const char *path, struct dvsm_model **model,
				 struct dvsm_error *error)
{
	return open_path(path, NULL, model, error);
}

enum dvsm_status dvsm_model_open_for(const char *path, enum dvsm_precision precision,
				     struct dvsm_model **model, struct dvsm_error *error)
{
	enum dvsm_status status = check_precision(precision, error);
	return status == DVSM_OK ? open_path(path, &precision, model, error) : status;
}

static enum dvsm_status open_bytes(const void *bytes, size_t size, const char *name,
				   const enum dvsm_precision *only, struct dvsm_model **model,
				   struct dvsm_error *error)
{
	struct dvsm_safetensors file;
	enum dvsm_status status = dvsm_safetensors_open_bytes(bytes, size, name, &file, error);
	return status == DVSM_OK ? open_model(&file, only, model, error) : status;
}

enum dvsm_status dvsm_model_open_bytes(const void *bytes, size_t size, const char *name,
				       struct dvsm_model **model, struct dvsm_error *error)
{
	return open_bytes(bytes, size, name, NULL, model, error);
}

enum dvsm_status dvsm_model_open_bytes_for(const void *bytes, size_t size, const char *name,
					   enum dvsm_precision precision, struct dvsm_model **model,
					   struct dvsm_error *error)
{
	enum dvsm_status status = check_precision(precision, error);
	return status == DVSM_OK ? open_bytes(bytes, size, name, &precision, model, error) : status;
}

void dvsm_model_close(struct dvsm_model *model)
{
	if (!model)
		return;
	dvsm_weight_sets_destroy(model->sets);
	free(model->weights.blocks);
	free(model->block);
	free(model);
}

size_t dvsm_model_get_weight_bytes(const struct dvsm_model *model)
{
	return model->weight_bytes + dvsm_weight_sets_bytes(model);
}
