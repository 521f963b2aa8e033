/* Numbers in two planes of int8, for products that need one side of them finer. Private. */
#ifndef DVSM_FIXED_FINE_H
#define DVSM_FIXED_FINE_H

#include <stddef.h>
#include <stdint.h>

#include "kernels/fixed_math.h"

/** A fine product's input is high + low 2^-DVSM_FIXED_FINE_BITS. */
#define DVSM_FIXED_FINE_BITS 4

/** What a low plane's numbers are multiplied with: R(w, 4). */
static inline int8_t dvsm_fixed_fine_low(int8_t w)
{
	return (int8_t)dvsm_fixed_round(w, DVSM_FIXED_FINE_BITS);
}

/** Width of fine queries of a head of dim numbers, and of their keys: two planes. */
static inline size_t dvsm_fixed_fine_width(size_t dim)
{
	return 2 * dvsm_fixed_pad(dim, DVSM_FIXED_DEPTH);
}

/**
 * A row of 256 high + low, as a norm leaves it, to planes side by side as dvsm_fixed_split makes
 * them: v = 2^7 (high' + low' / 16), high' = min(R(v, 7), 127), low' = R(what is left, 3).
 *
 * planes  high' [plane], low' [plane]
 */
void dvsm_fixed_fine_join(const int8_t *high, const int8_t *low, size_t plane, int8_t *planes);

/** n[dim] = R(n gain, 15). */
void dvsm_fixed_fine_weigh(int16_t *n, const int16_t *gain, size_t dim);

/**
 * One head's packed keys of dvsm_fixed_pad(dim, DVSM_FIXED_HEAD) numbers to those that fine queries
 * meet: k, then R(k, 4), each filled up to a plane.
 *
 * padded  keys, a multiple of DVSM_FIXED_PANEL
 * fine    packed keys of dvsm_fixed_fine_width(dim) numbers
 */
void dvsm_fixed_fine_keys(const int8_t *keys, size_t padded, size_t dim, int8_t *fine);

#endif
