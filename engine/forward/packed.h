/* A model's matrices as the kernels read them. Private to the engine. */
#ifndef DVSM_FORWARD_PACKED_H
#define DVSM_FORWARD_PACKED_H

#include "forward/arena.h"
#include "model/model.h"

/** W[out][in] as panels (kernels.h, dvsm_pack_panels). */
struct dvsm_matrix {
	const float *panels;
	size_t out, in;
};

/** Half a block; the query rows stand alone because rendering needs only those of cross.qkv. */
struct dvsm_packed_half {
	struct dvsm_matrix query;     /* [D][D]  */
	struct dvsm_matrix key_value; /* [2D][D] */
	struct dvsm_matrix out;	      /* [D][D]  */
	struct dvsm_matrix up;	      /* [M][D]  */
	struct dvsm_matrix down;      /* [D][M]  */
};

struct dvsm_packed_block {
	struct dvsm_packed_half intra, cross;
};

struct dvsm_packed {
	struct dvsm_matrix patch_ray, patch_rgb, to_rgb;
	struct dvsm_packed_block *blocks; /* [layers] */
	void *memory;			  /* of all of it, one allocation; owned */
	size_t bytes;
};

/**
 * Pack a model's matrices. The norms' weights stay in the model, which must outlive `packed`.
 * Release with dvsm_packed_deinit().
 *
 * DVSM_NO_MEM  does not fit
 */
enum dvsm_status dvsm_packed_init(struct dvsm_packed *packed, const struct dvsm_model *model,
				  struct dvsm_error *error);

void dvsm_packed_deinit(struct dvsm_packed *packed);

#endif
