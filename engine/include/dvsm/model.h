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

/**
 * Opaque; may be shared by threads and engines.
 *
 * Who owns what: engines read their weights in the form of their precision, a set that belongs to
 * the model and is the same for all of its engines of that precision. The first of them has it
 * made; it goes when the last of them is destroyed. A model of dvsm_model_open() also keeps its
 * matrices in float32, from which it makes sets (f32 itself needs no more). A model of
 * dvsm_model_open_for() has one set from the beginning to the end and no other form of a matrix.
 */
struct dvsm_model;

/** How an engine computes. A scene is rendered in the precision it was reconstructed in. */
enum dvsm_precision {
	DVSM_PRECISION_F32 = 0, /* float32 throughout */
	DVSM_PRECISION_BF16,    /* bfloat16 products, float32 sums */
	DVSM_PRECISION_FIXED,   /* integers alone: the same bits on every machine */
};

/** "f32", "bf16", "fixed". */
DVSM_API const char *dvsm_precision_name(enum dvsm_precision precision);

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

/**
 * Open a model for engines of one precision: its weights are converted as they are read, and no
 * other form of them is ever in memory. The file is read twice where they are (not in f32, unless
 * the file is quantised). Otherwise as dvsm_model_open().
 *
 * DVSM_IO           also a file that was written to meanwhile
 * DVSM_UNSUPPORTED  a model that the precision does not take: dvsm_engine_create() says which
 */
DVSM_API enum dvsm_status dvsm_model_open_for(const char *path, enum dvsm_precision precision,
					      struct dvsm_model **model, struct dvsm_error *error);

/** Release a model; NULL is fine. No engine or scene may use it afterwards. */
DVSM_API void dvsm_model_close(struct dvsm_model *model);

/** The configuration, owned by the model. */
DVSM_API const struct dvsm_model_config *dvsm_model_get_config(const struct dvsm_model *model);

/** SHA-256 of the file's bytes as 64 lower-case hex digits, owned by the model. */
DVSM_API const char *dvsm_model_get_sha256(const struct dvsm_model *model);

/** Bytes of weights in memory now, in all forms, whatever number of engines reads them. */
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
 * DVSM_UNSUPPORTED  a model with a prior, or one that was opened for one precision
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
