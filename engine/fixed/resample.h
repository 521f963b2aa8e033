/* The last steps of a picture in integers: sigmoid, patches to rows, bytes. Private. */
#ifndef DVSM_FIXED_RESAMPLE_H
#define DVSM_FIXED_RESAMPLE_H

#include <stddef.h>
#include <stdint.h>

#include "geometry/resample.h"

/** 1 / (1 + exp(-y)), y and the result in units of 2^-16, to 2^-14. */
int32_t dvsm_fixed_sigmoid(int32_t y);

/**
 * Row y of a picture out of its patches: geometry/resample.h's weights as fractions of integers,
 * one rounding at the end.
 *
 * patches   [tokens][q*q*3], each at most 2^24 in size
 * scratch   twice plan->scratch_bytes, 8-byte aligned
 *
 * Returns [width][3] in the scratch.
 */
const int32_t *dvsm_fixed_join_row(const struct dvsm_patch_plan *plan, const int32_t *patches,
				   uint32_t y, void *scratch);

/** A colour in units of 2^-16 to a byte, clamped and rounded. */
static inline uint8_t dvsm_fixed_colour_byte(int32_t colour)
{
	if (colour <= 0)
		return 0;
	return colour >= 1 << 16 ? 255 : (uint8_t)(((uint32_t)colour * 255 + (1 << 15)) >> 16);
}

#endif
