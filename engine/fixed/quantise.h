/* Weights to integers. Double arithmetic with + - * / alone: the same on every machine. Private. */
#ifndef DVSM_FIXED_QUANTISE_H
#define DVSM_FIXED_QUANTISE_H

#include <stddef.h>
#include <stdint.h>

#include "kernels/fixed.h"

/** A positive number rounded up to 15 bits of mantissa; 0 for 0. */
struct dvsm_fixed_scale dvsm_fixed_scale_above(double number);

/** A number rounded to 15 bits of mantissa, which carries its sign. */
struct dvsm_fixed_scale dvsm_fixed_scale_near(double number);

/** The value of a scale. */
double dvsm_fixed_value(struct dvsm_fixed_scale scale);

/** A row of weights to -127..127 times the scale. */
struct dvsm_fixed_scale dvsm_fixed_quantise_row(const double *weights, size_t count,
						int8_t *numbers);

/** A norm's weight as 16-bit gains that share one exponent: weight = gain 2^exponent. */
int dvsm_fixed_quantise_gain(const float *weights, size_t count, int16_t *gains);

/** number 2^exponent, rounded half up, 0 .. 2^60: an epsilon in squared units. */
int64_t dvsm_fixed_quantise_epsilon(double number, int exponent);

/** Largest f with bound 2^f <= limit, at most 64 and at least -64. */
int dvsm_fixed_fraction(double bound, double limit);

#endif
