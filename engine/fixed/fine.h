/* Rows of activations in two planes of int8, for products that need them finer. Private. */
#ifndef DVSM_FIXED_FINE_H
#define DVSM_FIXED_FINE_H

#include <stddef.h>
#include <stdint.h>

/**
 * A row of 16-bit numbers to planes side by side: x 2^up = 2^8 (high + low / 16), where up = 15 -
 * bits(max |x|); high = min(R(x 2^up, 8), 127), low = R(what is left, 4).
 *
 * planes  high [plane], low [plane]; zeros behind count
 *
 * Returns up.
 */
int dvsm_fixed_fine_split(const int16_t *x, size_t count, size_t plane, int8_t *planes);

/**
 * The same of 256 high + low, as a norm leaves it: v = 2^7 (high' + low' / 16), high' = min(R(v,
 * 7), 127), low' = R(what is left, 3).
 */
void dvsm_fixed_fine_join(const int8_t *high, const int8_t *low, size_t plane, int8_t *planes);

#endif
