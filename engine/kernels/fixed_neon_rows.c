#include "kernels/fixed_neon_rows.h"

#include <arm_neon.h>
#include <string.h>

#include "kernels/fixed_math.h"

/* Vectors at the end of a row: what lies behind it is taken for 0. */

static inline int32x4_t load_s32(const int32_t *x, size_t left)
{
	int32_t lanes[4] = {0};

	if (left >= 4)
		return vld1q_s32(x);
	memcpy(lanes, x, left * sizeof(*lanes));
	return vld1q_s32(lanes);
}

static inline int16x8_t load_s16(const int16_t *x, size_t left)
{
	int16_t lanes[8] = {0};

	if (left >= 8)
		return vld1q_s16(x);
	memcpy(lanes, x, left * sizeof(*lanes));
	return vld1q_s16(lanes);
}

static inline int16x4_t load_gain(const int16_t *x, size_t left)
{
	int16_t lanes[4] = {0};

	if (left >= 4)
		return vld1_s16(x);
	memcpy(lanes, x, left * sizeof(*lanes));
	return vld1_s16(lanes);
}

/* Lanes before `left`, all of them when there are more. */
static inline uint32x4_t mask_s32(size_t left)
{
	static const uint32_t order[4] = {0, 1, 2, 3};

	return vcltq_u32(vld1q_u32(order), vdupq_n_u32(left < 4 ? (uint32_t)left : 4));
}

static inline uint32_t largest_s32(int32x4_t a)
{
	return vmaxvq_u32(vreinterpretq_u32_s32(vabsq_s32(a)));
}

/* y' = R(y, shift), a = R(y' inverse, 15), as int8 in 16 bits. */
static inline int16x4_t narrow_s32(int32x4_t y, const struct dvsm_fixed_narrow *narrow)
{
	y = vrshlq_s32(y, vdupq_n_s32(-narrow->shift));
	return vrshrn_n_s32(vmulq_n_s32(y, narrow->inverse), 15);
}

/* ---- LayerNorm ---- */

struct row_norm {
	const int32_t *x;
	size_t dim;
	int32x4_t first, second; /* shifts to the left: -t and -u */
	int32x4_t mean;
};

/* c' of four numbers; 0 behind the row. */
static inline int32x4_t centred(const struct row_norm *row, size_t d)
{
	const int32x4_t x = vrshlq_s32(load_s32(row->x + d, row->dim - d), row->first);

	return vandq_s32(vsubq_s32(x, row->mean), vreinterpretq_s32_u32(mask_s32(row->dim - d)));
}

/* c times gain. */
static inline int32x4_t gained(const struct row_norm *row, const int16_t *gain, size_t d,
			       int32x4_t *c)
{
	*c = vrshlq_s32(centred(row, d), row->second);
	return vmulq_s32(*c, vmovl_s16(load_gain(gain + d, row->dim - d)));
}

static int32_t mean_of(int64_t sum, int64_t count)
{
	const int64_t twice = 2 * sum + count, mean = twice / (2 * count);

	return (int32_t)(twice < 0 && mean * 2 * count != twice ? mean - 1 : mean);
}

static struct row_norm begin_row(const int32_t *x, size_t dim, int *shift)
{
	struct row_norm row = {.x = x, .dim = dim, .mean = vdupq_n_s32(0)};
	int32x4_t most = vdupq_n_s32(0);
	int64x2_t sum = vdupq_n_s64(0);
	int first, second;

	for (size_t d = 0; d < dim; d += 4)
		most = vorrq_s32(most, vabsq_s32(load_s32(x + d, dim - d)));
	/* The bits of the largest are those of all sizes together. */
	first = dvsm_fixed_bits(vmaxvq_u32(vreinterpretq_u32_s32(most))) -
		(30 - dvsm_fixed_log2_up(dim));
	first = first > 0 ? first : 0;
	row.first = vdupq_n_s32(-first);
	for (size_t d = 0; d < dim; d += 4)
		sum = vpadalq_s32(sum, vrshlq_s32(load_s32(x + d, dim - d), row.first));
	row.mean = vdupq_n_s32(mean_of(vaddvq_s64(sum), (int64_t)dim));

	most = vdupq_n_s32(0);
	for (size_t d = 0; d < dim; d += 4)
		most = vorrq_s32(most, vabsq_s32(centred(&row, d)));
	second = dvsm_fixed_bits(vmaxvq_u32(vreinterpretq_u32_s32(most))) - 14;
	second = second > 0 ? second : 0;
	row.second = vdupq_n_s32(-second);
	*shift = first + second;
	return row;
}

static struct dvsm_fixed_narrow
weigh_row(const struct row_norm *row, const struct dvsm_fixed_gain *weights, int shift, bool fine)
{
	uint64x2_t squares = vdupq_n_u64(0);
	uint32x4_t most = vdupq_n_u32(0);

	for (size_t d = 0; d < row->dim; d += 4) {
		int32x4_t c, y = gained(row, weights->gain, d, &c);

		squares = vpadalq_u32(squares, vreinterpretq_u32_s32(vmulq_s32(c, c)));
		most = vmaxq_u32(most, vreinterpretq_u32_s32(vabsq_s32(y)));
	}
	return dvsm_fixed_narrow_make(
		vmaxvq_u32(most), fine,
		vaddvq_u64(squares) + (uint64_t)dvsm_fixed_round(
					      weights->epsilon, dvsm_fixed_clamp(2 * shift, 0, 62)),
		weights->scale);
}

static inline void store_s8(int8_t *to, int16x4_t first, int16x4_t second)
{
	vst1_s8(to, vmovn_s16(vcombine_s16(first, second)));
}

static void write_row(const struct row_norm *row, const int16_t *gain,
		      const struct dvsm_fixed_narrow *narrow, int8_t *out)
{
	for (size_t d = 0; d < row->dim; d += 8) {
		int16x4_t second = vdup_n_s16(0), first;
		int32x4_t c;

		first = narrow_s32(gained(row, gain, d, &c), narrow);
		if (d + 4 < row->dim)
			second = narrow_s32(gained(row, gain, d + 4, &c), narrow);
		store_s8(out + d, first, second);
	}
}

/* 256 high + low = y'; y' has 15 bits and a sign. */
static void write_fine_row(const struct row_norm *row, const int16_t *gain, int shift, int8_t *high,
			   int8_t *low)
{
	const int32x4_t left = vdupq_n_s32(-shift);

	for (size_t d = 0; d < row->dim; d += 8) {
		int16x4_t second = vdup_n_s16(0), first;
		int16x8_t y, upper;
		int32x4_t c;

		first = vmovn_s32(vrshlq_s32(gained(row, gain, d, &c), left));
		if (d + 4 < row->dim)
			second = vmovn_s32(vrshlq_s32(gained(row, gain, d + 4, &c), left));
		y = vcombine_s16(first, second);
		upper = vrshrq_n_s16(y, 8);
		vst1_s8(high + d, vmovn_s16(upper));
		vst1_s8(low + d, vmovn_s16(vsubq_s16(y, vshlq_n_s16(upper, 8))));
	}
}

void dvsm_fixed_neon_norm(const struct dvsm_fixed_norm *job)
{
	const size_t written = dvsm_fixed_pad(job->dim, 8);

	for (size_t i = 0; i < job->rows; i++) {
		int8_t *high = job->high + i * job->out_stride;
		int8_t *low = job->fine ? job->low + i * job->out_stride : NULL;
		int shift;
		const struct row_norm row = begin_row(job->x + i * job->dim, job->dim, &shift);
		const struct dvsm_fixed_narrow narrow =
			weigh_row(&row, &job->gain, shift, job->fine);

		memset(high + written, 0, job->out_stride - written);
		if (low) {
			write_fine_row(&row, job->gain.gain, narrow.shift, high, low);
			memset(low + written, 0, job->out_stride - written);
		} else {
			write_row(&row, job->gain.gain, &narrow, high);
		}
		job->a_scale[i] = narrow.scale;
	}
}

/* ---- int16 to int8 ---- */

void dvsm_fixed_neon_quantise(const struct dvsm_fixed_quantise *job)
{
	const size_t written = dvsm_fixed_pad(job->dim, 8);

	for (size_t i = 0; i < job->rows; i++) {
		const int16_t *x = job->x + i * job->x_stride;
		int8_t *a = job->a + i * job->a_stride;
		int16x8_t most = vdupq_n_s16(0);

		for (size_t d = 0; d < job->dim; d += 8)
			most = vmaxq_s16(most, vqabsq_s16(load_s16(x + d, job->dim - d)));

		const struct dvsm_fixed_fit fit = dvsm_fixed_fit_make((uint32_t)vmaxvq_s16(most));
		const int16x8_t shift = vdupq_n_s16((int16_t)fit.shift);

		for (size_t d = 0; d < job->dim; d += 8)
			vst1_s8(a + d, vmovn_s16(vqrdmulhq_n_s16(
					       vshlq_s16(load_s16(x + d, job->dim - d), shift),
					       fit.inverse)));
		memset(a + written, 0, job->a_stride - written);
		job->a_scale[i] = dvsm_fixed_shift(fit.scale, -job->fraction);
	}
}

/* ---- queries and keys ---- */

/* Sum of squares of a head; its numbers times gain, the largest of them. */
static uint64_t sum_squares(const int16_t *u, size_t dim)
{
	uint64x2_t squares = vdupq_n_u64(0);

	for (size_t d = 0; d < dim; d += 8) {
		const int16x8_t x = load_s16(u + d, dim - d);

		squares = vpadalq_u32(squares, vreinterpretq_u32_s32(vmull_s16(vget_low_s16(x),
									       vget_low_s16(x))));
		squares = vpadalq_u32(squares, vreinterpretq_u32_s32(vmull_high_s16(x, x)));
	}
	return vaddvq_u64(squares);
}

static void query(const int16_t *u, size_t dim, const struct dvsm_fixed_gain *weights, int8_t *q,
		  struct dvsm_fixed_scale *scale)
{
	uint32_t largest = 0;
	struct dvsm_fixed_narrow narrow;

	for (size_t d = 0; d < dim; d += 8) {
		const int16x8_t x = load_s16(u + d, dim - d);
		const int16x8_t gain = load_s16(weights->gain + d, dim - d);
		const uint32_t low = largest_s32(vmull_s16(vget_low_s16(x), vget_low_s16(gain)));
		const uint32_t high = largest_s32(vmull_high_s16(x, gain));

		largest = low > largest ? low : largest;
		largest = high > largest ? high : largest;
	}
	narrow = dvsm_fixed_narrow_make(
		largest, false, sum_squares(u, dim) + (uint64_t)weights->epsilon, weights->scale);
	for (size_t d = 0; d < dim; d += 8) {
		const int16x8_t x = load_s16(u + d, dim - d);
		const int16x8_t gain = load_s16(weights->gain + d, dim - d);

		store_s8(q + d, narrow_s32(vmull_s16(vget_low_s16(x), vget_low_s16(gain)), &narrow),
			 narrow_s32(vmull_high_s16(x, gain), &narrow));
	}
	*scale = narrow.scale;
}

#include "kernels/fixed_queries.inc.h"

void dvsm_fixed_neon_queries(const struct dvsm_fixed_queries *job)
{
	queries(job);
}

void dvsm_fixed_neon_keys(const struct dvsm_fixed_keys *job)
{
	for (size_t i = 0; i < job->rows; i++) {
		const int16_t *u = job->u + i * job->u_stride;
		int16_t *n = job->n + i * job->n_stride, lanes[8];
		const struct dvsm_fixed_factor factor =
			dvsm_fixed_key_factor(job, sum_squares(u, job->dim));
		const int32x4_t shift = vdupq_n_s32(-factor.shift);

		for (size_t d = 0; d < job->dim; d += 8) {
			const size_t left = job->dim - d;
			const int16x8_t x = load_s16(u + d, left);
			const int32x4_t low =
				vrshlq_s32(vmull_n_s16(vget_low_s16(x), factor.mantissa), shift);
			const int32x4_t high =
				vrshlq_s32(vmull_high_n_s16(x, factor.mantissa), shift);

			vst1q_s16(lanes, vqmovn_high_s32(vqmovn_s32(low), high));
			memcpy(n + d, lanes, (left < 8 ? left : 8) * sizeof(*lanes));
		}
	}
}

/* ---- keys and values ---- */

/* Rows that 32 bits of sum hold. */
#define RANGE_ROWS 65535u

static void range_block(const int16_t *x, size_t x_stride, size_t rows, size_t channels,
			struct dvsm_fixed_range *ranges)
{
	int16x8_t low = vdupq_n_s16(INT16_MAX), high = vdupq_n_s16(INT16_MIN);
	int32x4_t sums[2] = {vdupq_n_s32(0), vdupq_n_s32(0)};
	int16_t lows[8], highs[8];
	int32_t totals[8];

	for (size_t i = 0; i < rows; i++) {
		const int16x8_t row = load_s16(x + i * x_stride, channels);

		low = vminq_s16(low, row);
		high = vmaxq_s16(high, row);
		sums[0] = vaddw_s16(sums[0], vget_low_s16(row));
		sums[1] = vaddw_high_s16(sums[1], row);
	}
	vst1q_s16(lows, low);
	vst1q_s16(highs, high);
	vst1q_s32(totals, sums[0]);
	vst1q_s32(totals + 4, sums[1]);
	for (size_t d = 0; d < 8 && d < channels; d++) {
		ranges[d].sum += totals[d];
		ranges[d].low = lows[d] < ranges[d].low ? lows[d] : ranges[d].low;
		ranges[d].high = highs[d] > ranges[d].high ? highs[d] : ranges[d].high;
	}
}

void dvsm_fixed_neon_range(const int16_t *x, size_t x_stride, size_t rows, size_t channels,
			   struct dvsm_fixed_range *ranges)
{
	for (size_t i = 0; i < rows; i += RANGE_ROWS) {
		const size_t some = rows - i < RANGE_ROWS ? rows - i : RANGE_ROWS;

		for (size_t d = 0; d < channels; d += 8)
			range_block(x + i * x_stride + d, x_stride, some, channels - d, ranges + d);
	}
}

/* Eight channels' means, shifts and inverses, and numbers as they say. */
static inline int8x8_t pack_numbers(int16x8_t x, const int16x8x3_t *channels)
{
	const int16x8_t c = vqshlq_s16(vqsubq_s16(x, channels->val[0]), channels->val[1]);

	return vmovn_s16(vqrdmulhq_s16(c, channels->val[2]));
}

static int16x8x3_t load_channels(const struct dvsm_fixed_channel *channels, size_t left)
{
	struct dvsm_fixed_channel some[8] = {{0}};

	if (left < 8)
		channels = memcpy(some, channels, left * sizeof(*some));
	return vld3q_s16(&channels->mean);
}

void dvsm_fixed_neon_pack_keys(const struct dvsm_fixed_pack *job)
{
	const size_t group = 4 * (size_t)DVSM_FIXED_PANEL;

	for (size_t d = 0; d < job->dim; d += 8) {
		const size_t left = job->dim - d < 8 ? job->dim - d : 8;
		const int16x8x3_t channels = load_channels(job->channels + d, left);

		for (size_t i = 0; i < job->rows; i++) {
			const size_t key = job->first + i;
			int8_t *to = job->packed +
				     key / DVSM_FIXED_PANEL * DVSM_FIXED_PANEL * job->head_width +
				     key % DVSM_FIXED_PANEL * 4 + d / 4 * group;
			int8_t lanes[8];

			vst1_s8(lanes, pack_numbers(load_s16(job->x + i * job->x_stride + d, left),
						    &channels));
			memcpy(to, lanes, left < 4 ? left : 4);
			if (left > 4)
				memcpy(to + group, lanes + 4, left - 4);
		}
	}
}

void dvsm_fixed_neon_pack_values(const struct dvsm_fixed_pack *job)
{
	for (size_t d = 0; d < job->dim; d += 8) {
		const size_t left = job->dim - d < 8 ? job->dim - d : 8;
		const int16x8x3_t channels = load_channels(job->channels + d, left);

		for (size_t i = 0; i < job->rows; i++) {
			const size_t key = job->first + i;
			int8_t *to = job->packed + key / 4 * 4 * job->head_width + key % 4 + 4 * d;
			int8_t lanes[8];

			vst1_s8(lanes, pack_numbers(load_s16(job->x + i * job->x_stride + d, left),
						    &channels));
			for (size_t j = 0; j < left; j++)
				to[4 * j] = lanes[j];
		}
	}
}
