/*
 * A model's weights as the fixed-point path takes them (engine/FIXED_POINT.md, sections 2 and 3).
 * Private to the engine.
 */
#ifndef DVSM_FIXED_MODEL_H
#define DVSM_FIXED_MODEL_H

#include "fixed/quantise.h"
#include "kernels/fixed.h"
#include "model/model.h"

/** W[out][in] in int8 with a scale for each row, and where its products' binary point lies. */
struct dvsm_fixed_matrix {
	const int8_t *panels;
	const int32_t *sums;
	const int16_t *mantissas; /* [out] */
	int16_t *shifts;          /* [out] settled while the model is made */
	size_t out, in, depth;    /* depth: in, padded; twice that when fine */
	bool fine; /* rows of inputs are two planes side by side, and W beside R(W, 4) */
};

/** A LayerNorm before a product, with the residual stream's epsilon. */
struct dvsm_fixed_half {
	struct dvsm_fixed_gain norm;
	struct dvsm_fixed_matrix query, key_value;
	/* Epsilons of QK-norm in squared units of each head's 16-bit queries and keys, [heads]. */
	const int64_t *query_epsilon, *key_epsilon;
	/* Query weight times key weight, [D/h]; the mantissa carries the sign. */
	const struct dvsm_fixed_scale *qk_weight;
	const int16_t *value_fraction; /* [D] of the 16-bit values; least of them: */
	int mixed_fraction;            /* of attention's output */
	struct dvsm_fixed_matrix out;
	struct dvsm_fixed_gain mlp_norm;
	struct dvsm_fixed_matrix up;
	int hidden_fraction;
	struct dvsm_fixed_matrix down;
};

struct dvsm_fixed_block {
	struct dvsm_fixed_half intra, cross;
};

struct dvsm_fixed_model {
	int fraction; /* x of the residual stream stands for x 2^-fraction */
	struct dvsm_fixed_matrix patch_ray, patch_rgb;
	int embed_fraction; /* of the embedding's sums */
	struct dvsm_fixed_gain embed_norm;
	struct dvsm_fixed_gain final_norm;
	struct dvsm_fixed_matrix to_rgb;
	int rgb_fraction;
	struct dvsm_fixed_scale root_head; /* sqrt(D/h) */
	int key_fraction;                  /* of normalised keys */
	struct dvsm_fixed_block *blocks;   /* [layers]; in `memory` */
	size_t weight_bytes;               /* of `memory` */
	void *memory;                      /* everything, one allocation; owned */
};

struct dvsm_reader;

/**
 * Quantise a model. The result depends on its weights alone.
 *
 * reader  of its matrices; the caller looks at its status
 * fixed   release with dvsm_fixed_model_destroy()
 *
 * DVSM_UNSUPPORTED  a prior, or a matrix too wide: more than 65,536 numbers a row
 */
enum dvsm_status dvsm_fixed_model_create(const struct dvsm_model *model, struct dvsm_reader *reader,
					 struct dvsm_fixed_model **fixed, struct dvsm_error *error);
void dvsm_fixed_model_destroy(struct dvsm_fixed_model *fixed);

#endif
