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

/*
 * R(a, s) of 32 bits as two shifts and a sum, none of which a branch decides: that is for the
 * compiler's vectors. No sum leaves 32 bits, and a shift of 32 and more leaves the sign, which is
 * 0.
 */
struct rounding {
	int before, half, after;
};

static inline struct rounding rounding_make(int s)
{
	return s == 0 ? (struct rounding){0, 0, 0} : (struct rounding){s > 32 ? 31 : s - 1, 1, 1};
}

static inline int32_t round_s32(int32_t a, struct rounding r)
{
	return ((a >> r.before) + r.half) >> r.after;
}

/* x' without its mean, int32. Both shifts depend on the largest number alone. */
static inline int32_t centred(int32_t x, struct rounding first, int32_t mean)
{
	return round_s32(x, first) - mean;
}

struct row_norm {
	struct rounding first, second; /* by t and u */
	int32_t mean;
	uint32_t largest; /* |c gain| */
	uint64_t squares;
};

static inline int32_t norm_number(const struct row_norm *row, int32_t x)
{
	return round_s32(centred(x, row->first, row->mean), row->second);
}

/* y' of a dvsm_fixed_narrow. */
struct narrowing {
	int up;
	struct rounding down;
};

static inline struct narrowing narrowing_make(int shift)
{
	return (struct narrowing){shift < 0 ? -shift : 0, rounding_make(shift > 0 ? shift : 0)};
}

static inline int32_t narrow_number(int32_t y, struct narrowing by)
{
	return round_s32((int32_t)((uint32_t)y << by.up), by.down);
}

static struct row_norm measure_row(const int32_t *x, size_t dim,
				   const struct dvsm_fixed_gain *weights)
{
	struct row_norm row = {0};
	uint32_t largest = 0;
	int first, second;
	int64_t sum = 0, twice, mean;
	const int64_t count = (int64_t)dim;

	for (size_t d = 0; d < dim; d++)
		largest = size_of(x[d]) > largest ? size_of(x[d]) : largest;
	first = positive(dvsm_fixed_bits(largest) - (30 - dvsm_fixed_log2_up(dim)));
	row.first = rounding_make(first);
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
	second = positive(dvsm_fixed_bits(largest) - 14);
	row.second = rounding_make(second);
	row.squares = (uint64_t)dvsm_fixed_round(weights->epsilon,
						 dvsm_fixed_clamp(2 * (first + second), 0, 62));
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

/* A row in one plane, and in two. */
static void write_norm(const int32_t *restrict x, size_t dim, const int16_t *restrict gain,
		       const struct row_norm *norm, struct narrowing by, int32_t inverse,
		       int8_t *restrict out)
{
	const struct row_norm row = *norm;

	for (size_t d = 0; d < dim; d++) {
		int32_t y = narrow_number(norm_number(&row, x[d]) * gain[d], by);

		out[d] = (int8_t)((y * inverse + (1 << 14)) >> 15);
	}
}

static void write_planes(const int32_t *restrict x, size_t dim, const int16_t *restrict gain,
			 const struct row_norm *norm, struct narrowing by, int8_t *restrict high,
			 int8_t *restrict low)
{
	const struct row_norm row = *norm;

	for (size_t d = 0; d < dim; d++) {
		int32_t y = narrow_number(norm_number(&row, x[d]) * gain[d], by);

		/* The lower plane is what is left of the lowest byte, signed. */
		high[d] = (int8_t)((y + 128) >> 8);
		low[d] = (int8_t)y;
	}
}

static void norm(const struct dvsm_fixed_norm *job)
{
	const size_t rest = job->out_stride - job->dim;

	for (size_t i = 0; i < job->rows; i++) {
		const int32_t *x = job->x + i * job->dim;
		int8_t *high = job->high + i * job->out_stride;
		struct row_norm row = measure_row(x, job->dim, &job->gain);
		struct dvsm_fixed_narrow narrow = dvsm_fixed_narrow_make(
			row.largest, job->fine, row.squares, job->gain.scale);
		const struct narrowing by = narrowing_make(narrow.shift);

		memset(high + job->dim, 0, rest);
		if (job->fine) {
			int8_t *low = job->low + i * job->out_stride;

			memset(low + job->dim, 0, rest);
			write_planes(x, job->dim, job->gain.gain, &row, by, high, low);
		} else {
			write_norm(x, job->dim, job->gain.gain, &row, by, narrow.inverse, high);
		}
		job->a_scale[i] = narrow.scale;
	}
}

/* Numbers of 16 bits, shifted to the top, to 8. */
static void write_fit(const int16_t *restrict x, size_t dim, int shift, int32_t inverse,
		      int8_t *restrict a)
{
	for (size_t d = 0; d < dim; d++)
		a[d] = (int8_t)(((int16_t)(x[d] * (1 << shift)) * inverse + (1 << 14)) >> 15);
}

/* 32767 at most. */
static uint32_t largest_of(const int16_t *x, size_t dim)
{
	uint32_t largest = 0;

	for (size_t d = 0; d < dim; d++)
		largest = size_of(x[d]) > largest ? size_of(x[d]) : largest;
	return largest > INT16_MAX ? INT16_MAX : largest;
}

static void quantise(const struct dvsm_fixed_quantise *job)
{
	for (size_t i = 0; i < job->rows; i++) {
		const int16_t *x = job->x + i * job->x_stride;
		int8_t *a = job->a + i * job->a_stride;
		struct dvsm_fixed_fit fit = dvsm_fixed_fit_make(largest_of(x, job->dim));

		write_fit(x, job->dim, fit.shift, fit.inverse, a);
		memset(a + job->dim, 0, job->a_stride - job->dim);
		job->a_scale[i] = dvsm_fixed_shift(fit.scale, -job->fraction);
	}
}

/* 16-bit lanes throughout: no sum leaves them. */
static void write_split(const int16_t *restrict x, size_t dim, int up, int8_t *restrict high,
			int8_t *restrict low)
{
	for (size_t d = 0; d < dim; d++) {
		int16_t wide = (int16_t)((uint16_t)x[d] << up);
		int16_t top = (int16_t)((int16_t)((wide >> 7) + 1) >> 1);

		top = top < 127 ? top : 127;
		high[d] = (int8_t)top;
		low[d] = (int8_t)((int16_t)(wide - top * 256 + 8) >> 4);
	}
}

static void split(const struct dvsm_fixed_split *job)
{
	const size_t rest = job->plane - job->dim;

	for (size_t i = 0; i < job->rows; i++) {
		int8_t *high = job->planes + 2 * i * job->plane, *low = high + job->plane;
		const int16_t *x = job->x + i * job->x_stride;
		const int up = 15 - dvsm_fixed_bits(largest_of(x, job->dim));

		write_split(x, job->dim, up, high, low);
		memset(high + job->dim, 0, rest);
		memset(low + job->dim, 0, rest);
		job->a_scale[i] = dvsm_fixed_split_scale(up, job->fraction);
	}
}

static uint64_t sum_squares(const int16_t *u, size_t dim)
{
	uint64_t squares = 0;

	for (size_t d = 0; d < dim; d++)
		squares += (uint32_t)(u[d] * u[d]);
	return squares;
}

static void write_query(const int16_t *restrict u, size_t dim, const int16_t *restrict gain,
			struct narrowing by, int32_t inverse, int8_t *restrict q)
{
	for (size_t d = 0; d < dim; d++)
		q[d] = (int8_t)((narrow_number(u[d] * gain[d], by) * inverse + (1 << 14)) >> 15);
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

	write_query(u, dim, weights->gain, narrowing_make(narrow.shift), narrow.inverse, q);
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
		const struct rounding by = rounding_make(factor.shift);

		for (size_t d = 0; d < job->dim; d++)
			n[d] = saturate_s32(round_s32(u[d] * factor.mantissa, by));
	}
}

/* ---- keys and values ---- */

/* Channels at a time, one array for each of what belongs to them. */
#define CHANNELS 64u

/* Rows whose sum fits 32 bits. */
#define RANGE_ROWS 32768u

struct range_block {
	int32_t sum[CHANNELS];
	int16_t low[CHANNELS], high[CHANNELS];
};

static void widen_block(const int16_t *restrict x, size_t count, struct range_block *restrict block)
{
	for (size_t d = 0; d < count; d++) {
		block->sum[d] += x[d];
		block->low[d] = x[d] < block->low[d] ? x[d] : block->low[d];
		block->high[d] = x[d] > block->high[d] ? x[d] : block->high[d];
	}
}

static void range_rows(const int16_t *x, size_t x_stride, size_t rows, size_t count,
		       struct dvsm_fixed_range *ranges)
{
	struct range_block block;

	for (size_t d = 0; d < count; d++) {
		block.sum[d] = 0;
		block.low[d] = ranges[d].low;
		block.high[d] = ranges[d].high;
	}
	for (size_t i = 0; i < rows; i++)
		widen_block(x + i * x_stride, count, &block);
	for (size_t d = 0; d < count; d++)
		ranges[d] = (struct dvsm_fixed_range){ranges[d].sum + block.sum[d], block.low[d],
						      block.high[d]};
}

static void range(const int16_t *x, size_t x_stride, size_t rows, size_t channels,
		  struct dvsm_fixed_range *ranges)
{
	for (size_t row = 0; row < rows; row += RANGE_ROWS) {
		const size_t left = rows - row;

		for (size_t at = 0; at < channels; at += CHANNELS)
			range_rows(x + row * x_stride + at, x_stride,
				   left < RANGE_ROWS ? left : RANGE_ROWS,
				   channels - at < CHANNELS ? channels - at : CHANNELS,
				   ranges + at);
	}
}

struct pack_channels {
	int32_t mean[CHANNELS], factor[CHANNELS], inverse[CHANNELS];
};

static void take_channels(const struct dvsm_fixed_channel *channels, size_t count,
			  struct pack_channels *taken)
{
	for (size_t d = 0; d < count; d++) {
		taken->mean[d] = channels[d].mean;
		taken->factor[d] = 1 << channels[d].shift;
		taken->inverse[d] = channels[d].inverse;
	}
}

static void pack_row(const int16_t *restrict x, size_t count,
		     const struct pack_channels *restrict channels, int8_t *restrict out)
{
	for (size_t d = 0; d < count; d++) {
		int32_t c = saturate_s32(x[d] - channels->mean[d]);

		c = saturate_s32(c * channels->factor[d]);
		out[d] = (int8_t)((c * channels->inverse[d] + (1 << 14)) >> 15);
	}
}

static size_t pack_count(const struct dvsm_fixed_pack *job, size_t first)
{
	return job->dim - first < CHANNELS ? job->dim - first : CHANNELS;
}

static void pack_keys(const struct dvsm_fixed_pack *job)
{
	for (size_t at = 0; at < job->dim; at += CHANNELS) {
		const size_t count = pack_count(job, at);
		struct pack_channels channels;

		take_channels(job->channels + at, count, &channels);
		for (size_t i = 0; i < job->rows; i++) {
			const size_t key = job->first + i;
			int8_t *to = job->packed +
				     key / DVSM_FIXED_PANEL * DVSM_FIXED_PANEL * job->head_width +
				     at * DVSM_FIXED_PANEL + key % DVSM_FIXED_PANEL * 4;
			int8_t numbers[CHANNELS];

			pack_row(job->x + i * job->x_stride + at, count, &channels, numbers);
			for (size_t d = 0; d < count; d += 4)
				memcpy(to + d * DVSM_FIXED_PANEL, numbers + d,
				       count - d < 4 ? count - d : 4);
		}
	}
}

static void pack_values(const struct dvsm_fixed_pack *job)
{
	for (size_t at = 0; at < job->dim; at += CHANNELS) {
		const size_t count = pack_count(job, at);
		struct pack_channels channels;

		take_channels(job->channels + at, count, &channels);
		for (size_t i = 0; i < job->rows; i++) {
			const size_t key = job->first + i;
			int8_t *to = job->packed + key / 4 * 4 * job->head_width + 4 * at + key % 4;
			int8_t numbers[CHANNELS];

			pack_row(job->x + i * job->x_stride + at, count, &channels, numbers);
			for (size_t d = 0; d < count; d++)
				to[4 * d] = numbers[d];
		}
	}
}
