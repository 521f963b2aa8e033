/* Pictures to tokens and tokens to pictures (MODEL.md sections 3 and 5). Private to the engine. */
#ifndef DVSM_FORWARD_PICTURE_H
#define DVSM_FORWARD_PICTURE_H

#include "dvsm/engine.h"
#include "forward/steps.h"
#include "geometry/pose.h"

/**
 * Tokens of one view: x[tokens][D] = LN(W_ray rays [+ W_rgb (2 rgb - 1)]).
 *
 * rgb   [height][width][3], or NULL for a target
 */
void dvsm_picture_embed(const struct dvsm_run *run, const struct dvsm_camera *camera,
			const struct dvsm_normalisation *normalisation, uint32_t patch_px,
			const float *rgb, float *x);

/** Picture of one view from its tokens. */
void dvsm_picture_write(const struct dvsm_run *run, const struct dvsm_camera *camera,
			uint32_t patch_px, const float *x, const struct dvsm_picture_out *out);

#endif
