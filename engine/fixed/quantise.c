#include "fixed/quantise.h"

#include <math.h>

#include "kernels/fixed_math.h"

/* frexp and ldexp move exponents alone, floor is exact: no rounding is left to a library. */

struct dvsm_fixed_scale dvsm_fixed_scale_above(double number)
{
	int exponent;
	double mantissa = ceil(ldexp(frexp(number, &exponent), 15));

	if (!(number > 0))
		return (struct dvsm_fixed_scale){0, 0};
	return dvsm_fixed_scale_make((uint64_t)mantissa, exponent - 15);
}

struct dvsm_fixed_scale dvsm_fixed_scale_near(double number)
{
	int exponent;
	double mantissa = floor(ldexp(frexp(fabs(number), &exponent), 15) + 0.5);
	struct dvsm_fixed_scale scale = dvsm_fixed_scale_make((uint64_t)mantissa, exponent - 15);

	if (number < 0)
		scale.mantissa = (int16_t)-scale.mantissa;
	return scale;
}

double dvsm_fixed_value(struct dvsm_fixed_scale scale)
{
	return ldexp(scale.mantissa, scale.exponent);
}

static double largest_of(const float *weights, size_t count)
{
	double largest = 0;

	for (size_t i = 0; i < count; i++)
		largest = fabs((double)weights[i]) > largest ? fabs((double)weights[i]) : largest;
	return largest;
}

struct dvsm_fixed_scale dvsm_fixed_quantise_row(const double *weights, size_t count,
						int8_t *numbers)
{
	double largest = 0;

	for (size_t d = 0; d < count; d++)
		largest = fabs(weights[d]) > largest ? fabs(weights[d]) : largest;

	struct dvsm_fixed_scale scale = dvsm_fixed_scale_above(largest / 127);
	double unit = dvsm_fixed_value(scale);

	for (size_t i = 0; i < count; i++)
		numbers[i] = unit > 0 ? (int8_t)floor(weights[i] / unit + 0.5) : 0;
	return scale;
}

int dvsm_fixed_quantise_gain(const float *weights, size_t count, int16_t *gains)
{
	int exponent;

	/* largest < 2^exponent, so that largest 2^(15 - exponent) rounds to 32768 at most. */
	frexp(largest_of(weights, count), &exponent);
	for (size_t i = 0; i < count; i++) {
		double gain = floor(ldexp(weights[i], 15 - exponent) + 0.5);

		gains[i] = (int16_t)(gain > 32767 ? 32767 : gain < -32767 ? -32767 : gain);
	}
	return exponent - 15;
}

int64_t dvsm_fixed_quantise_epsilon(double number, int exponent)
{
	double scaled = floor(ldexp(number, exponent) + 0.5);

	return scaled > 0x1p60 ? (int64_t)1 << 60 : (int64_t)scaled;
}

int dvsm_fixed_fraction(double bound, double limit)
{
	int exponent;

	if (!(bound > 0))
		return 64;
	/* limit / bound is in [2^(exponent - 1), 2^exponent). */
	frexp(limit / bound, &exponent);
	return dvsm_fixed_clamp(exponent - 1, -64, 64);
}
