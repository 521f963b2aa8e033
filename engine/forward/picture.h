/* Pictures to tokens and tokens to pictures (MODEL.md sections 3 and 5). Private to the engine. */
#ifndef DVSM_FORWARD_PICTURE_H
#define DVSM_FORWARD_PICTURE_H

#include "forward/steps.h"
#include "geometry/rays.h"
#include "geometry/resample.h"

/** Where a picture goes: to one of the two. */
struct dvsm_picture_out {
	float *rgb;     /* [height][width][3], unclamped */
	uint8_t *bytes; /* [height][width][3], clamped to 0..1 and rounded */
};

/**
 * Tokens of one view: x[tokens][D] = LN(W_ray rays [+ W_rgb (2 rgb - 1)]).
 *
 * rgb   [height][width][3], or NULL for a target
 */
void dvsm_picture_embed(const struct dvsm_run *run, const struct dvsm_ray_map *map,
			const struct dvsm_patch_plan *plan, const float *rgb, float *x);

/** Picture of one view from its tokens. */
void dvsm_picture_write(const struct dvsm_run *run, const struct dvsm_patch_plan *plan,
			const float *x, const struct dvsm_picture_out *out);

#endif
