#include "model/read.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/error.h"
#include "base/memory.h"
#include "model/config.h"
#include "model/names.h"
#include "model/range.h"

/*
 * The walk over all tensors of a model. It runs twice over the same code: first without memory, to
 * check every tensor and add up the space, then to place the weights in it.
 */
struct walk {
	const struct dvsm_safetensors *file;
	struct dvsm_model *model;
	struct dvsm_error *error;
	bool panels;             /* matrices are kept; otherwise where they lie in the file */
	enum dvsm_status status; /* of the first failure */
	float *block;            /* NULL in the measuring walk */
	size_t used_bytes;       /* of the block so far */
	uint64_t count;          /* of weights so far */
};

/* The tensor of this name and shape, counted; NULL when there is none or the walk has failed. */
static struct dvsm_tensor *require(struct walk *walk, const char *name, uint32_t rank,
				   const uint64_t *shape)
{
	struct dvsm_tensor *tensor;
	if (walk->status != DVSM_OK)
		return NULL;
	walk->status =
		dvsm_safetensors_require(walk->file, name, NULL, rank, shape, &tensor, walk->error);
	if (walk->status != DVSM_OK)
		return NULL;
	walk->count += tensor->count;
	return tensor;
}

/* The next `floats` floats of the block, where `fits` says that this is a number. */
static float *take(struct walk *walk, size_t floats, bool fits)
{
	size_t bytes, end, at = walk->used_bytes;
	if (!fits || !dvsm_size_mul(floats, sizeof(float), &bytes) ||
	    !dvsm_size_align(bytes, &bytes) || !dvsm_size_add(at, bytes, &end)) {
		walk->status = dvsm_fail(walk->error, DVSM_NO_MEM,
					 "%s: the weights do not fit the address space",
					 dvsm_name_tail(walk->file->source.name));
		return NULL;
	}
	walk->used_bytes = end;
	return walk->block ? walk->block + at / sizeof(float) : NULL;
}

/*
 * The tensor of a matrix. Where it is I8, a vector NAME_scale stands before it in the file and
 * makes weights of it.
 */
static struct dvsm_tensor *require_matrix(struct walk *walk, const char *name, uint32_t rows,
					  uint32_t columns)
{
	const enum dvsm_dtype i8 = DVSM_DTYPE_I8, f32 = DVSM_DTYPE_F32;
	const uint64_t shape[2] = {rows, columns};
	struct dvsm_tensor *tensor = dvsm_safetensors_find(walk->file, name), *scale;
	char scale_name[96];
	if (!tensor || tensor->dtype != DVSM_DTYPE_I8 || walk->status != DVSM_OK)
		return require(walk, name, 2, shape);
	snprintf(scale_name, sizeof(scale_name), "%s_scale", name);
	walk->status =
		dvsm_safetensors_require(walk->file, name, &i8, 2, shape, &tensor, walk->error);
	if (walk->status == DVSM_OK)
		walk->status = dvsm_safetensors_require(walk->file, scale_name, &f32, 1, shape,
							&scale, walk->error);
	if (walk->status == DVSM_OK && scale->begin > tensor->begin)
		walk->status =
			dvsm_fail(walk->error, DVSM_BAD_FILE, "%s: tensor %s: must stand before %s",
				  dvsm_name_tail(walk->file->source.name), scale_name, name);
	if (walk->status != DVSM_OK)
		return NULL;
	walk->count += tensor->count;
	scale->destination = take(walk, rows, true);
	tensor->row_scale = scale->destination;
	return tensor;
}

static void visit_vector(struct walk *walk, const char *name, uint32_t length,
			 const float **weights)
{
	struct dvsm_tensor *tensor = require(walk, name, 1, (const uint64_t[]){length});
	if (tensor)
		*weights = tensor->destination = take(walk, tensor->count, true);
}

/* Rows first .. first + rows - 1 of a tensor, whose numbers are yet to come: room for them. */
static float *take_matrix(struct walk *walk, const struct dvsm_tensor *tensor, uint32_t first,
			  uint32_t rows, struct dvsm_matrix *matrix)
{
	const size_t columns = (size_t)tensor->shape[1];
	float *panels = NULL;
	size_t floats = 0;
	if (walk->panels) {
		bool fits = dvsm_pack_size(rows, columns, &floats);
		panels = take(walk, floats, fits);
	}
	if (panels)
		dvsm_pack_pad(rows, columns, panels);
	*matrix = (struct dvsm_matrix){
		.panels = panels,
		.out = rows,
		.in = columns,
		.tensor = (size_t)(tensor - walk->file->tensors),
		.first_row = first,
	};
	return panels;
}

static void place_matrix(const struct dvsm_tensor *tensor, size_t first, const float *numbers,
			 size_t count)
{
	dvsm_pack_run(numbers, first, count, (size_t)tensor->shape[1], tensor->destination);
}

static void visit_matrix(struct walk *walk, const char *name, uint32_t rows, uint32_t columns,
			 struct dvsm_matrix *matrix)
{
	struct dvsm_tensor *tensor = require_matrix(walk, name, rows, columns);
	if (!tensor)
		return;
	tensor->destination = take_matrix(walk, tensor, 0, rows, matrix);
	tensor->place = place_matrix;
}

/* The first third of the rows to the query matrix, the rest to the one that lies behind it. */
static void place_qkv(const struct dvsm_tensor *tensor, size_t first, const float *numbers,
		      size_t count)
{
	size_t dim = (size_t)tensor->shape[1], queries = dim * dim, size = 0;
	size_t left = first < queries ? queries - first : 0;
	size_t head = count < left ? count : left;
	float *panels = tensor->destination;
	dvsm_pack_run(numbers, first, head, dim, panels);
	if (head < count && dvsm_pack_size(dim, dim, &size))
		dvsm_pack_run(numbers + head, first + head - queries, count - head, dim,
			      panels + size);
}

static void visit_qkv(struct walk *walk, const char *name, uint32_t dim,
		      struct dvsm_half_weights *w)
{
	struct dvsm_tensor *tensor = require_matrix(walk, name, 3 * dim, dim);
	if (!tensor)
		return;
	tensor->destination = take_matrix(walk, tensor, 0, dim, &w->query);
	tensor->place = place_qkv;
	take_matrix(walk, tensor, dim, 2 * dim, &w->key_value);
}

static void visit_half(struct walk *walk, uint32_t index, const char *half,
		       struct dvsm_half_weights *w)
{
	const struct dvsm_model_config *config = &walk->model->config;
	uint32_t dim = config->dim, head_dim = dim / config->heads;
	uint32_t hidden = dim * config->mlp_ratio;
#define NAME(rest) dvsm_name_half(index, half, rest).text
	visit_vector(walk, NAME("_norm"), dim, &w->norm);
	visit_qkv(walk, NAME(".qkv"), dim, w);
	visit_vector(walk, NAME(".q_norm"), head_dim, &w->q_norm);
	visit_vector(walk, NAME(".k_norm"), head_dim, &w->k_norm);
	visit_matrix(walk, NAME(".out"), dim, dim, &w->out);
	visit_vector(walk, NAME("_mlp_norm"), dim, &w->mlp_norm);
	visit_matrix(walk, NAME("_mlp.up"), hidden, dim, &w->up);
	visit_matrix(walk, NAME("_mlp.down"), dim, hidden, &w->down);
#undef NAME
}

static void visit_all(struct walk *walk)
{
	const struct dvsm_model_config *config = &walk->model->config;
	struct dvsm_weights *w = &walk->model->weights;
	uint32_t pixels = config->patch_px * config->patch_px;
	visit_matrix(walk, "patch_ray.weight", config->dim, 6 * pixels, &w->patch_ray);
	visit_matrix(walk, "patch_rgb.weight", config->dim, 3 * pixels, &w->patch_rgb);
	if (config->prior_dim)
		visit_matrix(walk, "prior_proj.weight", config->dim, config->prior_dim,
			     &w->prior_proj);
	visit_vector(walk, "embed_norm.weight", config->dim, &w->embed_norm);
	for (uint32_t i = 0; i < config->layers; i++) {
		visit_half(walk, i, "intra", &w->blocks[i].intra);
		visit_half(walk, i, "cross", &w->blocks[i].cross);
	}
	visit_vector(walk, "final_norm.weight", config->dim, &w->final_norm);
	visit_matrix(walk, "to_rgb.weight", 3 * pixels, config->dim, &w->to_rgb);
}

/* A block of weights that the config does not count: the file and its config do not agree. */
static enum dvsm_status check_layer_count(const struct dvsm_safetensors *file,
					  const struct dvsm_model *model, struct dvsm_error *error)
{
	char name[80];
	snprintf(name, sizeof(name), "blocks.%u.intra_norm.weight", model->config.layers);
	if (dvsm_safetensors_find(file, name))
		return dvsm_fail(error, DVSM_BAD_FILE,
				 "%s: tensor %s: config states %u layers, there are more",
				 dvsm_name_tail(file->source.name), name, model->config.layers);
	return DVSM_OK;
}

static enum dvsm_status check_format(const struct dvsm_safetensors *file, struct dvsm_error *error)
{
	const char *name = dvsm_name_tail(file->source.name);
	const char *format = dvsm_safetensors_get_metadata(file, "format");
	const char *version = dvsm_safetensors_get_metadata(file, "version");
	if (!format || strcmp(format, "dvsm") != 0)
		return dvsm_fail(error, DVSM_BAD_FILE,
				 "%s: is no model: metadata format is %.40s, must be dvsm", name,
				 format ? format : "missing");
	if (!version)
		return dvsm_fail(error, DVSM_BAD_FILE, "%s: metadata version is missing", name);
	if (strcmp(version, "1") != 0)
		return dvsm_fail(error, DVSM_UNSUPPORTED,
				 "%s: model version %.40s is not known to this build, only 1", name,
				 version);
	return DVSM_OK;
}

static enum dvsm_status fail_memory(const struct dvsm_safetensors *file, size_t bytes,
				    struct dvsm_error *error)
{
	return dvsm_fail(error, DVSM_NO_MEM, "%s: no memory for %zu bytes of weights",
			 dvsm_name_tail(file->source.name), bytes);
}

/* Check all tensors, then make room for them and point the file's load at it. */
static enum dvsm_status place_weights(const struct dvsm_safetensors *file, struct dvsm_model *model,
				      struct dvsm_error *error)
{
	model->weights.blocks = calloc(model->config.layers, sizeof(*model->weights.blocks));
	if (!model->weights.blocks)
		return fail_memory(file, 0, error);

	/* Where engines turn or round every matrix, none is kept as it lies in the file. */
	const bool panels =
		!model->one_precision || (model->precision == DVSM_PRECISION_F32 && !model->turned);
	struct walk measure = {.file = file, .model = model, .error = error, .panels = panels};
	visit_all(&measure);
	if (measure.status != DVSM_OK)
		return measure.status;

	/* The file holds what was measured, so a small file cannot ask for much: padding to whole
	 * panels makes no matrix more than 16 times larger. */
	model->block = dvsm_aligned_alloc(measure.used_bytes);
	if (!model->block)
		return fail_memory(file, measure.used_bytes, error);
	struct walk place = measure;
	place.block = model->block;
	place.used_bytes = 0;
	place.count = 0;
	visit_all(&place);
	model->weight_bytes = place.used_bytes;
	model->weight_count = place.count;
	return place.status;
}

/* A model that was quantised stands for the one it was made from wherever the bits are the same. */
static enum dvsm_status keep_source(const struct dvsm_safetensors *file, struct dvsm_model *model,
				    struct dvsm_error *error)
{
	const char *source = dvsm_safetensors_get_metadata(file, "source_sha256");
	if (!model->turned || !source)
		source = model->sha256;
	if (strlen(source) != 64 || strspn(source, "0123456789abcdef") != 64)
		return dvsm_fail(error, DVSM_BAD_FILE,
				 "%s: metadata source_sha256 is not 64 lower-case hex digits",
				 dvsm_name_tail(file->source.name));
	memcpy(model->source_sha256, source, sizeof(model->source_sha256));
	return DVSM_OK;
}

static bool is_one(const float *weights, uint32_t count)
{
	uint32_t d = 0;

	while (d < count && weights[d] == 1)
		d++;
	return d == count;
}

/* The matrices of a turned model hold what its norms multiply by. */
static enum dvsm_status check_turned(const struct dvsm_safetensors *file,
				     const struct dvsm_model *model, struct dvsm_error *error)
{
	const struct dvsm_weights *w = &model->weights;
	const uint32_t dim = model->config.dim;
	bool ones = !model->turned || is_one(w->final_norm, dim);

	for (uint32_t i = 0; model->turned && i < model->config.layers; i++)
		ones = ones && is_one(w->blocks[i].intra.norm, dim) &&
		       is_one(w->blocks[i].intra.mlp_norm, dim) &&
		       is_one(w->blocks[i].cross.norm, dim) &&
		       is_one(w->blocks[i].cross.mlp_norm, dim);
	if (ones)
		return DVSM_OK;
	return dvsm_fail(error, DVSM_BAD_FILE,
			 "%s: quantisation int8-turned: a norm's weight is not 1: quantise the "
			 "model again",
			 dvsm_name_tail(file->source.name));
}

enum dvsm_status dvsm_model_read(struct dvsm_safetensors *file, struct dvsm_model *model,
				 struct dvsm_error *error)
{
	enum dvsm_status status = check_format(file, error);
	if (status == DVSM_OK)
		status =
			dvsm_config_parse(dvsm_safetensors_get_metadata(file, "config"),
					  file->source.name, &model->config, &model->turned, error);
	if (status == DVSM_OK)
		status = check_layer_count(file, model, error);
	if (status == DVSM_OK)
		status = place_weights(file, model, error);
	if (status == DVSM_OK)
		status = dvsm_safetensors_load(file, NULL, model->sha256, error);
	if (status == DVSM_OK)
		status = dvsm_range_check(file, &model->config, error);
	if (status == DVSM_OK)
		status = check_turned(file, model, error);
	if (status == DVSM_OK)
		status = keep_source(file, model, error);
	return status;
}
