/* How many operations MODEL.md asks for: the scale that does not depend on how they are done. */
#ifndef DIO_BENCH_COUNT_H
#define DIO_BENCH_COUNT_H

#include "dvsm/dvsm.h"

/** Tokens of a picture at a stage patch (MODEL.md, section 3). */
double dio_count_tokens(const struct dvsm_camera *camera, uint32_t patch_px);

/**
 * Multiplications and additions of the matrix products and of attention, nothing else.
 *
 * tokens   [views], of each context view; for render the `keys` they make together
 */
double dio_count_reconstruct(const struct dvsm_model_config *config, const double *tokens,
			     uint32_t views);
double dio_count_render(const struct dvsm_model_config *config, double tokens, double keys);

#endif
