/*
 * Pictures to patches and back (MODEL.md sections 1, 3 and 5). Private to the engine.
 *
 * Per axis: exact box average when shrinking, bilinear with half-pixel centres and clamped edges
 * when growing, a copy when equal. The resampled picture is never stored: a row at a time goes
 * from source to destination through the caller's scratch, so that threads share the rows of one
 * picture freely and the result does not depend on how they do.
 */
#ifndef DVSM_GEOMETRY_RESAMPLE_H
#define DVSM_GEOMETRY_RESAMPLE_H

#include <stddef.h>
#include <stdint.h>

#include "geometry/rays.h"

/** A picture of width x height beside its map of (columns q) x (rows q) pixels. */
struct dvsm_patch_plan {
	uint32_t width, height;
	uint32_t patch_px; /* q */
	struct dvsm_token_grid grid;
	size_t scratch_bytes; /* that each concurrent call of the two functions below needs */
};

/**
 * Plan the way between a W x H picture and the tokens of its grid.
 *
 * patch_px        q, patch side of the weights
 * stage_patch_px  p, which decides the grid
 */
struct dvsm_patch_plan dvsm_patch_plan_make(uint32_t width, uint32_t height, uint32_t patch_px,
					    uint32_t stage_patch_px);

/**
 * Cut a picture into patches of 2 rgb - 1, token rows first_row .. first_row + count - 1.
 *
 * rgb       [height][width][3]
 * patches   [rows * columns][q*q*3], base of the WHOLE picture's tokens; only the rows asked for
 *           are written
 * scratch   plan->scratch_bytes, 8-byte aligned
 */
void dvsm_patch_cut_rows(const struct dvsm_patch_plan *plan, const float *rgb, uint32_t first_row,
			 uint32_t count, float *patches, void *scratch);

/**
 * Put patches back on the grid and resample row y of the picture.
 *
 * patches   [rows * columns][q*q*3], the whole picture's tokens
 * rgb       [width][3]
 * scratch   plan->scratch_bytes, 8-byte aligned
 */
void dvsm_patch_join_row(const struct dvsm_patch_plan *plan, const float *patches, uint32_t y,
			 float *rgb, void *scratch);

/**
 * Put patches back on the grid and resample to the picture, picture rows first_row ..
 * first_row + count - 1. Values are copied through as they are.
 *
 * patches   [rows * columns][q*q*3], the whole picture's tokens
 * rgb       [height][width][3], base of the WHOLE picture; only the rows asked for are written
 * scratch   plan->scratch_bytes, 8-byte aligned
 */
void dvsm_patch_join_rows(const struct dvsm_patch_plan *plan, const float *patches,
			  uint32_t first_row, uint32_t count, float *rgb, void *scratch);

#endif
