/* Model weights: a safetensors file (MODEL.md, section 6), read, checked and packed. */
#ifndef DVSM_MODEL_H
#define DVSM_MODEL_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "dvsm/status.h"

#ifdef __cplusplus
extern "C" {
#endif

/** Opaque; immutable once open, may be shared by threads and engines. */
struct dvsm_model;

/** What the file's `config` states; all values checked at open. */
struct dvsm_model_config {
	uint32_t dim;       /* D, token width */
	uint32_t heads;     /* h, divides dim */
	uint32_t layers;    /* L, blocks */
	uint32_t patch_px;  /* q, side of the patch the weights were made for */
	uint32_t mlp_ratio; /* hidden width of an MLP / D */
	uint32_t prior_dim; /* Dp, features a token of the prior; 0 without one */
	double norm_eps;    /* epsilon of every norm */
	bool rgb_sigmoid;   /* rgb_out "sigmoid" instead of "linear" */
};

/**
 * Open a model file.
 *
 * path    a safetensors file: F32, F16, BF16, or what dvsm_model_quantise() wrote
 * model   receives the model; release with dvsm_model_close()
 * error   NULL, or receives one line that names the tensor and the fault
 *
 * DVSM_IO        cannot be opened or read
 * DVSM_BAD_FILE  malformed: header, offsets, shapes, types, missing tensor, non-finite number
 */
DVSM_API enum dvsm_status dvsm_model_open(const char *path, struct dvsm_model **model,
					  struct dvsm_error *error);

/** Release a model; NULL is fine. No engine or scene may use it afterwards. */
DVSM_API void dvsm_model_close(struct dvsm_model *model);

/** The configuration, owned by the model. */
DVSM_API const struct dvsm_model_config *dvsm_model_get_config(const struct dvsm_model *model);

/** SHA-256 of the file's bytes as 64 lower-case hex digits, owned by the model. */
DVSM_API const char *dvsm_model_get_sha256(const struct dvsm_model *model);

/** Bytes of packed weights in memory: all of them, whatever number of engines reads them. */
DVSM_API size_t dvsm_model_get_weight_bytes(const struct dvsm_model *model);

/**
 * How far a matrix of int8 is from its weights: 10 log10 of the weights' squares over the errors',
 * for the whole and for its worst row.
 */
typedef void dvsm_quantise_report_fn(void *context, const char *tensor, double all_db,
				     double worst_row_db);

/**
 * Write a model in int8 with a scale for each row, as precision fixed makes it of any model: with
 * that precision the file gives the same bits as the model, and scenes of either open with the
 * other. Other precisions take it too; their scenes are its own.
 *
 * report   NULL, or called for every matrix
 *
 * DVSM_UNSUPPORTED  a model with a prior
 * DVSM_IO           the system refused to write
 */
DVSM_API enum dvsm_status dvsm_model_quantise(const struct dvsm_model *model, const char *path,
					      dvsm_quantise_report_fn *report, void *context,
					      struct dvsm_error *error);

/** Number of weights. */
DVSM_API uint64_t dvsm_model_get_weight_count(const struct dvsm_model *model);

#ifdef __cplusplus
}
#endif
#endif
