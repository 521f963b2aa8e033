/* Rows of activations in two planes of int8, for products that need them finer. Private. */
#ifndef DVSM_FIXED_FINE_H
#define DVSM_FIXED_FINE_H

#include <stddef.h>
#include <stdint.h>

/**
 * A row of 256 high + low, as a norm leaves it, to planes side by side as dvsm_fixed_split makes
 * them: v = 2^7 (high' + low' / 16), high' = min(R(v, 7), 127), low' = R(what is left, 3).
 *
 * planes  high' [plane], low' [plane]
 */
void dvsm_fixed_fine_join(const int8_t *high, const int8_t *low, size_t plane, int8_t *planes);

#endif
