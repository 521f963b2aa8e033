/*
 * Template: the fixed-point kernels of rows, of keys and of values in plain C. The specification,
 * and what a compiler makes of it for AVX2: whoever includes it chooses by its flags.
 */
#include <string.h>

#include "kernels/fixed_math.h"

/* ---- norms ---- */

static inline uint32_t size_of(int32_t a)
{
	return a < 0 ? 0u - (uint32_t)a : (uint32_t)a;
}

static int positive(int a)
{
	return a > 0 ? a : 0;
}

/* R(a, s) of 32 bits: no sum leaves them, and a shift of 32 and more leaves the sign, which is 0.
 */
static inline int32_t round_s32(int32_t a, int s)
{
	const int before = s > 32 ? 31 : s - 1;

	return s == 0 ? a : ((a >> before) + 1) >> 1;
}

/* x' without its mean, int32. Both shifts depend on the largest number alone. */
static inline int32_t centred(int32_t x, int shift, int32_t mean)
{
	return round_s32(x, shift) - mean;
}

struct row_norm {
	int first, second; /* shifts t and u */
	int32_t mean;
	uint32_t largest; /* |c gain| */
	uint64_t squares;
};

static inline int32_t norm_number(const struct row_norm *row, int32_t x)
{
	return round_s32(centred(x, row->first, row->mean), row->second);
}

/* dvsm_fixed_narrow_shift() */
static inline int32_t narrow_number(int32_t y, int shift)
{
	return shift >= 0 ? round_s32(y, shift) : y * (1 << -shift);
}

static struct row_norm measure_row(const int32_t *x, size_t dim,
				   const struct dvsm_fixed_gain *weights)
{
	struct row_norm row = {0};
	uint32_t largest = 0;
	int64_t sum = 0, twice, mean;
	const int64_t count = (int64_t)dim;

	for (size_t d = 0; d < dim; d++)
		largest = size_of(x[d]) > largest ? size_of(x[d]) : largest;
	row.first = positive(dvsm_fixed_bits(largest) - (30 - dvsm_fixed_log2_up(dim)));
	for (size_t d = 0; d < dim; d++)
		sum += round_s32(x[d], row.first);
	twice = 2 * sum + count;
	mean = twice / (2 * count);
	row.mean = (int32_t)(twice < 0 && mean * 2 * count != twice ? mean - 1 : mean);

	largest = 0;
	for (size_t d = 0; d < dim; d++) {
		uint32_t size = size_of(centred(x[d], row.first, row.mean));

		largest = size > largest ? size : largest;
	}
	row.second = positive(dvsm_fixed_bits(largest) - 14);
	row.squares = (uint64_t)dvsm_fixed_round(
		weights->epsilon, dvsm_fixed_clamp(2 * (row.first + row.second), 0, 62));
	largest = 0;
	for (size_t d = 0; d < dim; d++) {
		int16_t c = (int16_t)norm_number(&row, x[d]); /* 14 bits and a sign */
		uint32_t size = size_of(c * weights->gain[d]);

		row.squares += (uint32_t)(c * c);
		largest = size > largest ? size : largest;
	}
	row.largest = largest;
	return row;
}

static void norm(const struct dvsm_fixed_norm *job)
{
	for (size_t i = 0; i < job->rows; i++) {
		const int32_t *x = job->x + i * job->dim;
		int8_t *high = job->high + i * job->out_stride;
		int8_t *low = job->fine ? job->low + i * job->out_stride : NULL;
		struct row_norm row = measure_row(x, job->dim, &job->gain);
		struct dvsm_fixed_narrow narrow = dvsm_fixed_narrow_make(
			row.largest, job->fine, row.squares, job->gain.scale);

		memset(high, 0, job->out_stride);
		if (low)
			memset(low, 0, job->out_stride);
		for (size_t d = 0; d < job->dim; d++) {
			int32_t y = narrow_number(norm_number(&row, x[d]) * job->gain.gain[d],
						  narrow.shift);

			if (low) {
				high[d] = (int8_t)((y + 128) >> 8);
				low[d] = (int8_t)(y - high[d] * 256);
			} else {
				high[d] = (int8_t)((y * narrow.inverse + (1 << 14)) >> 15);
			}
		}
		job->a_scale[i] = narrow.scale;
	}
}

static void quantise(const struct dvsm_fixed_quantise *job)
{
	for (size_t i = 0; i < job->rows; i++) {
		const int16_t *x = job->x + i * job->x_stride;
		int8_t *a = job->a + i * job->a_stride;
		uint32_t largest = 0;

		for (size_t d = 0; d < job->dim; d++)
			largest = size_of(x[d]) > largest ? size_of(x[d]) : largest;

		struct dvsm_fixed_fit fit =
			dvsm_fixed_fit_make(largest > INT16_MAX ? INT16_MAX : largest);

		for (size_t d = 0; d < job->dim; d++)
			a[d] = (int8_t)dvsm_fixed_mulhrs((int16_t)(x[d] * (1 << fit.shift)),
							 fit.inverse);
		memset(a + job->dim, 0, job->a_stride - job->dim);
		job->a_scale[i] = dvsm_fixed_shift(fit.scale, -job->fraction);
	}
}

static uint64_t sum_squares(const int16_t *u, size_t dim)
{
	uint64_t squares = 0;

	for (size_t d = 0; d < dim; d++)
		squares += (uint32_t)(u[d] * u[d]);
	return squares;
}

static void query(const int16_t *u, size_t dim, const struct dvsm_fixed_gain *weights, int8_t *q,
		  struct dvsm_fixed_scale *scale)
{
	uint32_t largest = 0;

	for (size_t d = 0; d < dim; d++) {
		uint32_t size = size_of(u[d] * weights->gain[d]);

		largest = size > largest ? size : largest;
	}

	struct dvsm_fixed_narrow narrow = dvsm_fixed_narrow_make(
		largest, false, sum_squares(u, dim) + (uint64_t)weights->epsilon, weights->scale);

	for (size_t d = 0; d < dim; d++)
		q[d] = (int8_t)((narrow_number(u[d] * weights->gain[d], narrow.shift) *
					 narrow.inverse +
				 (1 << 14)) >>
				15);
	*scale = narrow.scale;
}

#include "kernels/fixed_queries.inc.h"

static inline int16_t saturate_s32(int32_t a)
{
	return (int16_t)(a < INT16_MIN ? INT16_MIN : a > INT16_MAX ? INT16_MAX : a);
}

static void keys(const struct dvsm_fixed_keys *job)
{
	for (size_t i = 0; i < job->rows; i++) {
		const int16_t *u = job->u + i * job->u_stride;
		int16_t *n = job->n + i * job->n_stride;
		const struct dvsm_fixed_factor factor =
			dvsm_fixed_key_factor(job, sum_squares(u, job->dim));

		for (size_t d = 0; d < job->dim; d++)
			n[d] = saturate_s32(round_s32(u[d] * factor.mantissa, factor.shift));
	}
}

/* ---- keys and values ---- */

static void range(const int16_t *x, size_t x_stride, size_t rows, size_t channels,
		  struct dvsm_fixed_range *ranges)
{
	for (size_t i = 0; i < rows; i++, x += x_stride) {
		for (size_t d = 0; d < channels; d++) {
			ranges[d].sum += x[d];
			ranges[d].low = x[d] < ranges[d].low ? x[d] : ranges[d].low;
			ranges[d].high = x[d] > ranges[d].high ? x[d] : ranges[d].high;
		}
	}
}

static int8_t pack_number(int16_t x, const struct dvsm_fixed_channel *channel)
{
	int32_t c = dvsm_fixed_saturate((int64_t)x - channel->mean);

	return (int8_t)dvsm_fixed_round(
		dvsm_fixed_saturate((int64_t)c * (1 << channel->shift)) * channel->inverse, 15);
}

static void pack_keys(const struct dvsm_fixed_pack *job)
{
	for (size_t i = 0; i < job->rows; i++) {
		size_t key = job->first + i;
		int8_t *to = job->packed +
			     key / DVSM_FIXED_PANEL * DVSM_FIXED_PANEL * job->head_width +
			     key % DVSM_FIXED_PANEL * 4;

		for (size_t d = 0; d < job->dim; d++)
			to[d / 4 * 4 * DVSM_FIXED_PANEL + d % 4] =
				pack_number(job->x[i * job->x_stride + d], &job->channels[d]);
	}
}

static void pack_values(const struct dvsm_fixed_pack *job)
{
	for (size_t i = 0; i < job->rows; i++) {
		size_t key = job->first + i;
		int8_t *to = job->packed + key / 4 * 4 * job->head_width + key % 4;

		for (size_t d = 0; d < job->dim; d++)
			to[4 * d] = pack_number(job->x[i * job->x_stride + d], &job->channels[d]);
	}
}
