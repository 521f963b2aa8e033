#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/arena.h"
#include "base/error.h"
#include "base/memory.h"
#include "files/safetensors.h"
#include "fixed/quantise.h"
#include "fixed/turn.h"
#include "model/model.h"

/* Tensors of half a block: three norms' vectors and the MLP's, four matrices with their scales. */
#define HALF_TENSORS 12
#define END_TENSORS  8

struct name {
	char text[96];
};

/*
 * The walk over the model's tensors, in the order of the file: numbers of 32 bits first, for their
 * alignment, and so that scales stand before their matrices. It measures, then fills.
 */
struct export
{
	const struct dvsm_model *model;
	struct dvsm_arena arena;
	struct dvsm_tensor_out *tensors;
	struct name *names;
	size_t count;
	bool matrices; /* the int8 part of the walk */
	double *rows;  /* room for the largest matrix, turned */
	dvsm_quantise_report_fn *report;
	void *context;
};

static const char *keep_name(struct export *export, const char *name)
{
	struct name *kept = &export->names[export->count];

	snprintf(kept->text, sizeof(kept->text), "%s", name);
	return kept->text;
}

static void add(struct export *export, const char *name, enum dvsm_dtype dtype, uint64_t rows,
		uint64_t columns, const void *bytes)
{
	const uint64_t count = columns ? rows * columns : rows;

	if (export->arena.base)
		export->tensors[export->count] = (struct dvsm_tensor_out){
			.name = keep_name(export, name),
			.dtype = dtype,
			.rank = columns ? 2 : 1,
			.shape = {rows, columns},
			.bytes = bytes,
			.size = (size_t)count * dvsm_dtype_bytes(dtype),
		};
	export->count++;
}

/* The embedding's norm, rounded as the integers have it. */
static void add_norm(struct export *export, const char *name, const float *weights)
{
	const size_t dim = export->model->config.dim;
	float *out;
	int16_t *gains;
	int exponent;

	if (export->matrices)
		return;
	out = dvsm_arena_take(&export->arena, dim, sizeof(*out));
	gains = dvsm_arena_take(&export->arena, dim, sizeof(*gains));
	if (export->arena.base) {
		exponent = dvsm_fixed_quantise_gain(weights, dim, gains);
		for (size_t d = 0; d < dim; d++)
			out[d] = (float)ldexp(gains[d], exponent);
	}
	add(export, name, DVSM_DTYPE_F32, dim, 0, out);
}

/* The others' weights are part of the matrices behind them. */
static void add_unit_norm(struct export *export, const char *name)
{
	const size_t dim = export->model->config.dim;
	float *out;

	if (export->matrices)
		return;
	out = dvsm_arena_take(&export->arena, dim, sizeof(*out));
	for (size_t d = 0; export->arena.base && d < dim; d++)
		out[d] = 1;
	add(export, name, DVSM_DTYPE_F32, dim, 0, out);
}

static void add_vector(struct export *export, const char *name, const float *weights, size_t count)
{
	if (!export->matrices)
		add(export, name, DVSM_DTYPE_F32, count, 0, weights);
}

/* Squares of a row and of what int8 leaves out of it. */
struct energy {
	double weights, errors;
};

static double ratio_db(struct energy energy)
{
	return energy.errors > 0 ? 10 * log10(energy.weights / energy.errors) : INFINITY;
}

static struct energy measure(const double *weights, const int8_t *numbers, size_t count,
			     double unit)
{
	struct energy energy = {0, 0};

	for (size_t d = 0; d < count; d++) {
		double error = weights[d] - numbers[d] * unit;

		energy.weights += weights[d] * weights[d];
		energy.errors += error * error;
	}
	return energy;
}

/* Rows of one or two matrices that lie below each other in the file. */
static void fill_rows(struct export *export, const char *name,
		      const struct dvsm_fixed_place *parts[2], int8_t *numbers, float *scales)
{
	const size_t in = parts[0]->matrix->in;
	struct energy all = {0, 0};
	double worst_db = INFINITY;
	size_t row = 0;

	for (int p = 0; p < 2 && parts[p]; p++) {
		dvsm_fixed_turn_matrix(parts[p], export->rows);
		for (size_t j = 0; j < parts[p]->matrix->out; j++, row++) {
			const double *weights = export->rows + j * in;
			int8_t *to = numbers + row * in;
			double unit = dvsm_fixed_value(dvsm_fixed_quantise_row(weights, in, to));
			struct energy energy = measure(weights, to, in, unit);

			scales[row] = (float)unit;
			all.weights += energy.weights;
			all.errors += energy.errors;
			worst_db = fmin(worst_db, ratio_db(energy));
		}
	}
	if (export->report)
		export->report(export->context, name, ratio_db(all), worst_db);
}

static void add_matrix(struct export *export, const char *name,
		       const struct dvsm_fixed_place *first, const struct dvsm_fixed_place *second)
{
	const struct dvsm_fixed_place *parts[2] = {first, second};
	const size_t in = first->matrix->in;
	const size_t rows = first->matrix->out + (second ? second->matrix->out : 0);
	char scale_name[sizeof(struct name)];

	snprintf(scale_name, sizeof(scale_name), "%s_scale", name);
	if (!export->matrices) {
		float *scales = dvsm_arena_take(&export->arena, rows, sizeof(*scales));
		int8_t *numbers = dvsm_arena_take(&export->arena, rows, in);

		if (export->arena.base)
			fill_rows(export, name, parts, numbers, scales);
		add(export, scale_name, DVSM_DTYPE_F32, rows, 0, scales);
		return;
	}
	/* The numbers lie behind the scales, which the first part of the walk placed. */
	for (size_t i = 0; export->arena.base && i < export->count; i++) {
		const struct dvsm_tensor_out *scales = &export->tensors[i];

		if (strcmp(scales->name, scale_name) == 0) {
			size_t bytes = (scales->size + DVSM_ALIGN - 1) / DVSM_ALIGN * DVSM_ALIGN;

			add(export, name, DVSM_DTYPE_I8, rows, in,
			    (const unsigned char *)scales->bytes + bytes);
			return;
		}
	}
	export->count++;
}

static void add_half(struct export *export, uint32_t layer, const char *half,
		     const struct dvsm_half_weights *w)
{
	const struct dvsm_model_config *config = &export->model->config;
	const struct dvsm_fixed_half_places places = dvsm_fixed_places_of(export->model, w);
	const size_t head = config->dim / config->heads;
	char name[sizeof(struct name)];

#define NAME(rest) (snprintf(name, sizeof(name), "blocks.%u.%s%s.weight", layer, half, rest), name)
	add_unit_norm(export, NAME("_norm"));
	add_matrix(export, NAME(".qkv"), &places.query, &places.key_value);
	add_vector(export, NAME(".q_norm"), w->q_norm, head);
	add_vector(export, NAME(".k_norm"), w->k_norm, head);
	add_matrix(export, NAME(".out"), &places.out, NULL);
	add_unit_norm(export, NAME("_mlp_norm"));
	add_matrix(export, NAME("_mlp.up"), &places.up, NULL);
	add_matrix(export, NAME("_mlp.down"), &places.down, NULL);
#undef NAME
}

static void add_all(struct export *export)
{
	const struct dvsm_weights *w = &export->model->weights;
	const struct dvsm_fixed_place ray = dvsm_fixed_place_plain(&w->patch_ray);
	const struct dvsm_fixed_place rgb = dvsm_fixed_place_plain(&w->patch_rgb);
	const struct dvsm_fixed_place to_rgb = dvsm_fixed_place_rgb(export->model);

	export->count = 0;
	for (int part = 0; part < 2; part++) {
		export->matrices = part == 1;
		add_matrix(export, "patch_ray.weight", &ray, NULL);
		add_matrix(export, "patch_rgb.weight", &rgb, NULL);
		add_norm(export, "embed_norm.weight", w->embed_norm);
		for (uint32_t i = 0; i < export->model->config.layers; i++) {
			add_half(export, i, "intra", &w->blocks[i].intra);
			add_half(export, i, "cross", &w->blocks[i].cross);
		}
		add_unit_norm(export, "final_norm.weight");
		add_matrix(export, "to_rgb.weight", &to_rgb, NULL);
	}
}

static enum dvsm_status write_file(const struct export *export, const char *path,
				   struct dvsm_error *error)
{
	const struct dvsm_model_config *c = &export->model->config;
	char config[320];

	snprintf(config, sizeof(config),
		 "{\"dim\": %u, \"heads\": %u, \"layers\": %u, \"patch\": %u, \"mlp_ratio\": %u, "
		 "\"norm_eps\": %.17g, \"rgb_out\": \"%s\", \"pose_norm\": \"gs-lrm\", "
		 "\"prior\": null, \"quantisation\": \"int8-turned\"}",
		 c->dim, c->heads, c->layers, c->patch_px, c->mlp_ratio, c->norm_eps,
		 c->rgb_sigmoid ? "sigmoid" : "linear");

	const struct dvsm_metadata_out metadata[] = {
		{"format", "dvsm"},
		{"version", "1"},
		{"config", config},
		{"source_sha256", export->model->source_sha256},
	};

	return dvsm_safetensors_write(path, metadata, sizeof(metadata) / sizeof(metadata[0]),
				      export->tensors, export->count, error);
}

enum dvsm_status dvsm_model_quantise(const struct dvsm_model *model, const char *path,
				     dvsm_quantise_report_fn *report, void *context,
				     struct dvsm_error *error)
{
	struct export export = {.model = model, .report = report, .context = context};
	enum dvsm_status status;
	void *memory;

	if (!model || !path)
		return dvsm_fail(error, DVSM_BAD_ARG, "no model, or no file to write it to");
	if (model->config.prior_dim)
		return dvsm_fail(error, DVSM_UNSUPPORTED,
				 "a model with a prior is not quantised: use one without");
	if (model->one_precision)
		return dvsm_fail(error, DVSM_UNSUPPORTED,
				 "the model was opened for one precision, which leaves nothing to "
				 "quantise: open it for all");

	const struct dvsm_model_config *config = &model->config;
	size_t most = END_TENSORS + (size_t)config->layers * 2 * HALF_TENSORS;
	size_t hidden = (size_t)config->dim * config->mlp_ratio;
	size_t rays = 6 * (size_t)config->patch_px * config->patch_px;
	size_t longest = hidden > rays ? hidden : rays;
	size_t tallest = longest > 2 * (size_t)config->dim ? longest : 2 * (size_t)config->dim;

	add_all(&export);
	memory = export.arena.overflow ? NULL : dvsm_aligned_alloc(export.arena.used);
	export.tensors = calloc(most, sizeof(*export.tensors));
	export.names = calloc(most, sizeof(*export.names));
	export.rows = calloc(tallest * config->dim, sizeof(*export.rows));
	if (memory && export.tensors && export.names && export.rows) {
		export.arena = (struct dvsm_arena){.base = memory};
		add_all(&export);
		status = write_file(&export, path, error);
	} else {
		status = dvsm_fail(error, DVSM_NO_MEM, "%s: no memory to write it",
				   dvsm_name_tail(path));
	}
	free(memory);
	free(export.tensors);
	free(export.names);
	free(export.rows);
	return status;
}
