/* Models of any size with random weights, cameras to look at them with, and views of noise. */
#ifndef TESTS_SUPPORT_RANDOM_MODEL_H
#define TESTS_SUPPORT_RANDOM_MODEL_H

#include "dvsm/dvsm.h"
#include "support/random.h"

/**
 * The bytes of a model file (F32) with weights scaled so that numbers keep their size from layer
 * to layer; NULL when memory runs out. The config's prior_dim must be 0. Release with free().
 */
unsigned char *support_random_model_file(const struct dvsm_model_config *config,
					 struct support_random *random, size_t *size);

/** The model of such a file; NULL with a printed line. Release with dvsm_model_close(). */
struct dvsm_model *support_random_model(const struct dvsm_model_config *config,
					struct support_random *random);

/** Camera `index` of `count` on a ring of radius 2 around the origin, looking at it. */
struct dvsm_camera support_ring_camera(uint32_t width, uint32_t height, uint32_t index,
				       uint32_t count);

/** A view of noise, 0 to 1, which is drawn into rgb[height][width][3] of the camera's size and
 * borrowed. */
struct dvsm_view support_random_view(struct support_random *random,
				     const struct dvsm_camera *camera, float *rgb);

#endif
