/*
 * Deblocking: tokens do not quite agree on colours along the seam between their patches, which
 * shows as a step. Private to the engine.
 *
 * Across a seam lie p1 p0 | q0 q1. What the step exceeds the mean slope beside it by,
 * e = (q0 - p0) - ((p0 - p1) + (q1 - q0)) / 2, is spread over the r = floor(q / 2) pixels nearest
 * to the seam on both sides: the i-th from it moves towards the other side by
 * e / 2 (1 - (2 i + 1) / (2 r)). A slope stays as it is, and no pixel belongs to two seams of one
 * direction. Patches of fewer than DVSM_DEBLOCK_LEAST_PX pixels are left alone.
 *
 * First all rows of tokens, then all seams between them; rows, and seams, in any order.
 */
#ifndef DVSM_GEOMETRY_DEBLOCK_H
#define DVSM_GEOMETRY_DEBLOCK_H

#include <stdint.h>

#include "geometry/resample.h"

#define DVSM_DEBLOCK_LEAST_PX 3u

/**
 * Even out the seams between neighbours of a row of tokens.
 *
 * patches   [rows * columns][q*q*3], the whole picture's tokens
 */
void dvsm_deblock_row(const struct dvsm_patch_plan *plan, float *patches, uint32_t row);

/** The same between rows `row` and `row` + 1. */
void dvsm_deblock_seam(const struct dvsm_patch_plan *plan, float *patches, uint32_t row);

#endif
