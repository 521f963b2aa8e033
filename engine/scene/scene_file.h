/*
 * The scene's file: safetensors with the KV-cache, the cameras and the normalisation.
 * Private to the engine.
 *
 *   __metadata__   format "dvsm-scene", version "1"
 *                  config {"dim","heads","layers","patch"}, patch being the stage patch p1
 *                  model_sha256   of the model's file
 *                  sha256         over the config's text, model_sha256 and all tensors' bytes
 *   cameras        F64 [views, 22]   width height fx fy cx cy world_from_camera (row-major 4x4)
 *   normalisation  F64 [13]          axes (3x3), origin, scale
 *   keys, values   F32 or BF16 [layers, heads, tokens, dim / heads], as the precision is
 *
 * In fixed point keys and values lie as attention reads them (kernels/fixed.h), filled up with
 * zeros, and scales stand beside them, each a mantissa and an exponent:
 *
 *   keys, turned_values I8 [layers, heads, padded tokens, padded dim / heads]; values are turned
 *                       within their head (fixed/turn.h)
 *   k_scale, v_scale    I16 [layers, dim, 2]
 *   v_mean              I16 [layers, dim]
 */
#ifndef DVSM_SCENE_SCENE_FILE_H
#define DVSM_SCENE_SCENE_FILE_H

#include "dvsm/engine.h"
#include "files/dtype.h"

#define DVSM_SCENE_FORMAT  "dvsm-scene"
#define DVSM_SCENE_VERSION "1"

#define DVSM_SCENE_CAMERA_NUMBERS        22
#define DVSM_SCENE_NORMALISATION_NUMBERS 13

/** The type of keys and values. */
static inline enum dvsm_dtype dvsm_scene_dtype(enum dvsm_precision precision)
{
	if (precision == DVSM_PRECISION_FIXED)
		return DVSM_DTYPE_I8;
	return precision == DVSM_PRECISION_BF16 ? DVSM_DTYPE_BF16 : DVSM_DTYPE_F32;
}

#endif
