/* The specification of the fixed-point kernels, in plain C. */
#include <string.h>

#include "kernels/fixed_math.h"

/* ---- products ---- */

static void store(const struct dvsm_fixed_gemm *job, size_t row, size_t col, int32_t sum)
{
	const struct dvsm_fixed_scale scale = job->a_scale[row];
	int shift = dvsm_fixed_clamp(job->w_shift[col] - scale.exponent, 1, 62);
	int64_t factor = dvsm_fixed_mulhrs(scale.mantissa, job->w_mantissa[col]);
	int64_t r = dvsm_fixed_round(sum * factor * (1 << 15), shift);
	size_t at = row * job->c_stride + col;

	switch (job->epilogue) {
	case DVSM_FIXED_ADD: {
		int32_t *c = (int32_t *)job->c + at;

		*c = (int32_t)((uint32_t)*c + (uint32_t)r);
		break;
	}
	case DVSM_FIXED_STORE:
		((int16_t *)job->c)[at] = dvsm_fixed_saturate(r);
		break;
	case DVSM_FIXED_GELU:
		((int16_t *)job->c)[at] = dvsm_fixed_gelu(dvsm_fixed_saturate(r), job->fraction);
		break;
	}
}

/* Sums of one row with the 16 columns of a panel. */
static void sum_panel(const int8_t *a, const int8_t *panel, size_t depth,
		      int32_t sums[DVSM_FIXED_PANEL])
{
	memset(sums, 0, DVSM_FIXED_PANEL * sizeof(*sums));
	for (size_t d = 0; d < depth; d += 4, panel += 4 * (size_t)DVSM_FIXED_PANEL) {
		for (size_t j = 0; j < DVSM_FIXED_PANEL; j++)
			sums[j] += a[d] * panel[4 * j] + a[d + 1] * panel[4 * j + 1] +
				   a[d + 2] * panel[4 * j + 2] + a[d + 3] * panel[4 * j + 3];
	}
}

static void gemm(const struct dvsm_fixed_gemm *job)
{
	for (size_t first = 0; first < job->cols; first += DVSM_FIXED_PANEL) {
		const int8_t *panel = job->panels + first * job->depth;
		size_t width =
			job->cols - first < DVSM_FIXED_PANEL ? job->cols - first : DVSM_FIXED_PANEL;

		for (size_t i = 0; i < job->rows; i++) {
			int32_t sums[DVSM_FIXED_PANEL];

			sum_panel(job->a + i * job->a_stride, panel, job->depth, sums);
			for (size_t j = 0; j < width; j++)
				store(job, i, first + j, sums[j]);
		}
	}
}

/* ---- norms ---- */

static uint32_t size_of(int32_t a)
{
	return a < 0 ? 0u - (uint32_t)a : (uint32_t)a;
}

static int positive(int a)
{
	return a > 0 ? a : 0;
}

/* x' without its mean, int32. Both shifts depend on the largest number alone. */
static int32_t centred(int32_t x, int shift, int32_t mean)
{
	return (int32_t)dvsm_fixed_round(x, shift) - mean;
}

struct row_norm {
	int first, second; /* shifts t and u */
	int32_t mean;
	uint32_t largest; /* |c gain| */
	uint64_t squares;
};

static int32_t norm_number(const struct row_norm *row, int32_t x)
{
	return (int32_t)dvsm_fixed_round(centred(x, row->first, row->mean), row->second);
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
		sum += dvsm_fixed_round(x[d], row.first);
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
	for (size_t d = 0; d < dim; d++) {
		int32_t c = norm_number(&row, x[d]);
		uint32_t size = size_of(c * weights->gain[d]);

		row.squares += (uint64_t)((int64_t)c * c);
		row.largest = size > row.largest ? size : row.largest;
	}
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
			int32_t y = dvsm_fixed_narrow_shift(
				norm_number(&row, x[d]) * job->gain.gain[d], narrow.shift);

			if (low) {
				high[d] = (int8_t)((y + 128) >> 8);
				low[d] = (int8_t)(y - high[d] * 256);
			} else {
				high[d] = (int8_t)dvsm_fixed_round(y * narrow.inverse, 15);
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
			a[d] = (int8_t)dvsm_fixed_round(x[d] * (1 << fit.shift) * fit.inverse, 15);
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
		q[d] = (int8_t)dvsm_fixed_round(
			dvsm_fixed_narrow_shift(u[d] * weights->gain[d], narrow.shift) *
				narrow.inverse,
			15);
	*scale = narrow.scale;
}

#include "kernels/fixed_queries.inc.h"

static void keys(const struct dvsm_fixed_keys *job)
{
	for (size_t i = 0; i < job->rows; i++) {
		const int16_t *u = job->u + i * job->u_stride;
		int16_t *n = job->n + i * job->n_stride;
		const struct dvsm_fixed_factor factor =
			dvsm_fixed_key_factor(job, sum_squares(u, job->dim));

		for (size_t d = 0; d < job->dim; d++)
			n[d] = dvsm_fixed_saturate(
				dvsm_fixed_round(u[d] * factor.mantissa, factor.shift));
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

/* ---- attention ---- */

/* Scores of a tile's keys; the last group of 16 may reach into the padding. Returns the largest. */
static int32_t score(const struct dvsm_fixed_attention *job, const int8_t *q, size_t first,
		     size_t count, int32_t *scores)
{
	int32_t largest = INT32_MIN;

	for (size_t key = 0; key < count; key += DVSM_FIXED_PANEL)
		sum_panel(q, job->k + (first + key) * job->head_width, job->head_width,
			  scores + key);
	for (size_t key = 0; key < count; key++)
		largest = scores[key] > largest ? scores[key] : largest;
	return largest;
}

static uint16_t weight(struct dvsm_fixed_slope slope, int32_t top, int32_t s)
{
	uint32_t way = top > s ? (uint32_t)(top - s) >> slope.down : 0;

	return dvsm_fixed_exp2((way < 65535 ? way : 65535) * slope.factor >> 16, slope.up);
}

/* O += the tile's weighted values; p is [tile], v the tile's values. */
static void mix(const uint16_t *p, const int8_t *v, size_t count, size_t dim, size_t head_width,
		int64_t *o)
{
	for (size_t d = 0; d < dim; d++) {
		int32_t high = 0, low = 0;

		for (size_t key = 0; key < count; key++) {
			int32_t value = v[key / 4 * 4 * head_width + 4 * d + key % 4];

			high += (p[key] >> 8) * value;
			low += (p[key] & 255) * value;
		}
		o[d] += high + dvsm_fixed_round(low, 8);
	}
}

static void attend(const struct dvsm_fixed_attention *job, const int8_t *q,
		   struct dvsm_fixed_scale scale, int64_t *o, int16_t *out)
{
	struct dvsm_fixed_slope slope = dvsm_fixed_slope_make(scale);
	int32_t scores[DVSM_FIXED_KEYS], top = 0;
	uint16_t p[DVSM_FIXED_KEYS];
	int64_t sum = 0;

	memset(o, 0, job->dim * sizeof(*o));
	for (size_t first = 0; first < job->keys; first += DVSM_FIXED_KEYS) {
		size_t count =
			job->keys - first < DVSM_FIXED_KEYS ? job->keys - first : DVSM_FIXED_KEYS;
		int32_t largest = score(job, q, first, count, scores);

		if (first == 0) {
			top = largest;
		} else if (largest > top) {
			int steps = dvsm_fixed_raise(scale, largest, &top);

			sum = dvsm_fixed_round(sum, steps);
			for (size_t d = 0; d < job->dim; d++)
				o[d] = dvsm_fixed_round(o[d], steps);
		}
		for (size_t key = 0; key < count; key++) {
			p[key] = weight(slope, top, scores[key]);
			sum += p[key];
		}
		mix(p, job->v + first * job->head_width, count, job->dim, job->head_width, o);
	}

	struct dvsm_fixed_quotient quotient = dvsm_fixed_divide((uint64_t)sum);

	for (size_t d = 0; d < job->dim; d++) {
		int shift = dvsm_fixed_clamp(quotient.behind - job->v_scale[d].exponent, 1, 62);
		int64_t product = dvsm_fixed_round(o[d], quotient.before) *
				  (quotient.inverse * job->v_scale[d].mantissa);

		out[d] = dvsm_fixed_saturate(job->v_mean[d] + dvsm_fixed_round(product, shift));
	}
}

static void attention(const struct dvsm_fixed_attention *job)
{
	for (size_t i = 0; i < job->queries; i++)
		attend(job, job->q + i * job->q_stride, job->q_scale[i * job->scale_stride],
		       job->scratch, job->out + i * job->out_stride);
}

const struct dvsm_fixed_kernels dvsm_fixed_kernels_scalar = {
	.cpu = DVSM_CPU_SCALAR,
	.name = "scalar",
	.gemm = gemm,
	.norm = norm,
	.quantise = quantise,
	.queries = queries,
	.keys = keys,
	.range = range,
	.pack_keys = pack_keys,
	.pack_values = pack_values,
	.attention = attention,
};
