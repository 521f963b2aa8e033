/* A model in memory: configuration and float32 weights (MODEL.md section 6). Private to the engine.
 */
#ifndef DVSM_MODEL_MODEL_H
#define DVSM_MODEL_MODEL_H

#include "dvsm/model.h"

/**
 * Half a block: attention and the MLP behind it. Row-major [out][in], each 64-byte aligned.
 * D = dim, h = heads, M = mlp_ratio * dim.
 */
struct dvsm_half_weights {
	const float *norm;     /* [D]       LN before attention */
	const float *qkv;      /* [3D][D]   rows: all q, all k, all v; head-major inside */
	const float *q_norm;   /* [D/h]     */
	const float *k_norm;   /* [D/h]     */
	const float *out;      /* [D][D]    */
	const float *mlp_norm; /* [D]       LN before the MLP */
	const float *up;       /* [M][D]    */
	const float *down;     /* [D][M]    */
};

struct dvsm_block_weights {
	struct dvsm_half_weights intra; /* within the token's own view */
	struct dvsm_half_weights cross; /* over the tokens of all context views */
};

struct dvsm_weights {
	const float *patch_ray;		   /* [D][6qq] */
	const float *patch_rgb;		   /* [D][3qq] */
	const float *prior_proj;	   /* [D][Dp], NULL when the model has no prior */
	const float *embed_norm;	   /* [D]      */
	const float *final_norm;	   /* [D]      */
	const float *to_rgb;		   /* [3qq][D] */
	struct dvsm_block_weights *blocks; /* [layers] */
};

struct dvsm_model {
	struct dvsm_model_config config;
	char sha256[65]; /* of the file's bytes, lower-case hex */
	struct dvsm_weights weights;
	uint64_t weight_count;
	size_t weight_bytes; /* of `block` */
	float *block;	     /* all tensors, one allocation; owned */
};

/**
 * Open a model from the bytes of its file; `name` stands for the file in error texts.
 * Otherwise as dvsm_model_open(). The bytes are borrowed for the call.
 */
enum dvsm_status dvsm_model_open_bytes(const void *bytes, size_t size, const char *name,
				       struct dvsm_model **model, struct dvsm_error *error);

#endif
