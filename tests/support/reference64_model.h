/* Weights of the double reference. Private to it. */
#ifndef TESTS_SUPPORT_REFERENCE64_MODEL_H
#define TESTS_SUPPORT_REFERENCE64_MODEL_H

#include "support/reference64.h"

/** A matrix of a model file, [out][in] there; here transposed, so that a product runs along rows.
 */
struct reference_matrix {
	size_t in, out;
	double *numbers; /* [in][out]; owned */
};

/** Half a block: attention and the MLP behind it. */
struct reference_half {
	double *norm, *q_norm, *k_norm, *mlp_norm;
	struct reference_matrix qkv, out, up, down;
};

enum reference_half_index { REFERENCE_INTRA, REFERENCE_CROSS };

struct support_reference {
	struct dvsm_model_config config;
	struct reference_matrix patch_ray, patch_rgb, to_rgb;
	double *embed_norm, *final_norm;
	struct reference_half (*blocks)[2]; /* [layers][intra, cross] */
	struct support_reference_range *range;
};

#endif
