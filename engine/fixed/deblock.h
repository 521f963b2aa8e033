/* geometry/deblock.h in integers. Private to the engine. */
#ifndef DVSM_FIXED_DEBLOCK_H
#define DVSM_FIXED_DEBLOCK_H

#include "geometry/deblock.h"

/**
 * As dvsm_deblock_row() and dvsm_deblock_seam(), of colours within DVSM_FIXED_COLOUR_LIMIT, which
 * they keep to; weights in units of 2^-16, one rounding.
 */
void dvsm_fixed_deblock_row(const struct dvsm_patch_plan *plan, int32_t *patches, uint32_t row);
void dvsm_fixed_deblock_seam(const struct dvsm_patch_plan *plan, int32_t *patches, uint32_t row);

#endif
