/*
 * A model in memory: configuration and weights (MODEL.md section 6). Vectors are float32. Matrices
 * are panels of float32, packed while the file is read, or, in a model that was opened for another
 * precision, in its weight set alone. Private to the engine.
 */
#ifndef DVSM_MODEL_MODEL_H
#define DVSM_MODEL_MODEL_H

#include <stdbool.h>

#include "dvsm/model.h"
#include "kernels/pack.h"

/**
 * Half a block: attention and the MLP behind it; everything 64-byte aligned. The file's qkv matrix
 * is two here, because rendering needs only the query rows of cross.qkv.
 * D = dim, h = heads, M = mlp_ratio * dim.
 */
struct dvsm_half_weights {
	const float *norm;            /* [D]     LN before attention */
	struct dvsm_matrix query;     /* [D][D]  head-major */
	struct dvsm_matrix key_value; /* [2D][D] rows: all k, all v; head-major inside */
	const float *q_norm;          /* [D/h]   */
	const float *k_norm;          /* [D/h]   */
	float score_bound; /* none of attention's scores is larger, in powers of 2; 0: not known */
	struct dvsm_matrix out;  /* [D][D]  */
	const float *mlp_norm;   /* [D]     LN before the MLP */
	struct dvsm_matrix up;   /* [M][D]  */
	struct dvsm_matrix down; /* [D][M]  */
};

struct dvsm_block_weights {
	struct dvsm_half_weights intra; /* within the token's own view */
	struct dvsm_half_weights cross; /* over the tokens of all context views */
};

struct dvsm_weights {
	struct dvsm_matrix patch_ray;      /* [D][6qq] */
	struct dvsm_matrix patch_rgb;      /* [D][3qq] */
	struct dvsm_matrix prior_proj;     /* [D][Dp], panels NULL when the model has no prior */
	const float *embed_norm;           /* [D]      */
	const float *final_norm;           /* [D]      */
	struct dvsm_matrix to_rgb;         /* [3qq][D] */
	struct dvsm_block_weights *blocks; /* [layers] */
};

struct dvsm_weight_sets;

struct dvsm_model {
	struct dvsm_model_config config;
	char sha256[65];        /* of the file's bytes, lower-case hex */
	char source_sha256[65]; /* of the file it was quantised from; else as sha256 */
	bool turned;            /* weights are those of precision fixed: dvsm_model_quantise() */
	struct dvsm_weights weights;
	uint64_t weight_count;
	size_t weight_bytes;           /* of `block` */
	float *block;                  /* tensors, one allocation; owned */
	bool one_precision;            /* opened for `precision`: it has that set, no other */
	enum dvsm_precision precision; /* undefined otherwise */
	struct dvsm_weight_sets *sets; /* what engines read, made as they need it; owned */
};

#endif
