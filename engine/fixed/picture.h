/* Pictures to tokens and tokens to pictures in fixed point. Private to the engine. */
#ifndef DVSM_FIXED_PICTURE_H
#define DVSM_FIXED_PICTURE_H

#include "dvsm/engine.h"
#include "fixed/run.h"
#include "geometry/pose.h"

/** Fraction bits of a finished colour, 0..1 and beyond. */
#define DVSM_FIXED_COLOUR 16

/** Colours are at most this in size, 128: there float32 is as exact as 32 bits. */
#define DVSM_FIXED_COLOUR_LIMIT (128 << DVSM_FIXED_COLOUR)

/**
 * Tokens of one view: x[tokens][D] = LN(W_ray rays [+ W_rgb (2 rgb - 1)]).
 *
 * rgb   [height][width][3], or NULL for a target
 */
void dvsm_fixed_picture_embed(const struct dvsm_fixed_run *run, const struct dvsm_camera *camera,
			      const struct dvsm_normalisation *normalisation, uint32_t patch_px,
			      const float *rgb, int32_t *x);

/** Picture of one view from its tokens; floats are multiples of 2^-16, up to 128. */
void dvsm_fixed_picture_write(const struct dvsm_fixed_run *run, const struct dvsm_camera *camera,
			      uint32_t patch_px, const int32_t *x,
			      const struct dvsm_picture_out *out);

#endif
