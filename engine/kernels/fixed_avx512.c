/* The fixed-point kernels for AVX-512 F, BW, DQ, VL beside the products: norms and packing. */
#include "kernels/fixed_avx512_lanes.h"
#include "kernels/fixed_tiers.h"
#include "kernels/tier.h"

/* Numbers that become 64 bytes of a row. */
#define GROUP 64u

#define ALL_LANES (~(__mmask64)0)

/* The first n of 64 lanes. */
static inline __mmask64 first_bytes(size_t n)
{
	return n >= GROUP ? ALL_LANES : ((__mmask64)1 << n) - 1;
}

static inline __m512i load_s32(const int32_t *p, __mmask16 lanes)
{
	return lanes == 0xffff ? _mm512_loadu_si512(p) : _mm512_maskz_loadu_epi32(lanes, p);
}

/* Products of numbers of 16 bits in 32-bit lanes; b's upper halves are 0. */
static inline __m512i multiply_words(__m512i a, __m512i b)
{
	return _mm512_madd_epi16(a, b);
}

/* As multiply_words() takes its second numbers. */
static inline __m512i load_words(const int16_t *p, __mmask16 lanes)
{
	return _mm512_cvtepu16_epi32(lanes == 0xffff ? _mm256_loadu_si256((const __m256i *)p)
						     : _mm256_maskz_loadu_epi16(lanes, p));
}

/* 2^s / 2, or 0 for s = 0: what R(a, s) adds before it shifts. */
static inline __m512i half_of(__m512i s)
{
	return _mm512_srli_epi32(_mm512_sllv_epi32(_mm512_set1_epi32(1), s), 1);
}

static inline __m512i positive(__m512i a)
{
	return _mm512_max_epi32(a, _mm512_setzero_si512());
}

static inline __m512i negative(__m512i a)
{
	return _mm512_sub_epi32(_mm512_setzero_si512(), a);
}

/* The larger of low's and of high's distance from 0, where that lies between or a side has none. */
static inline __m512i larger_size(__m512i low, __m512i high)
{
	return _mm512_max_epi32(negative(low), high);
}

#include "kernels/fixed_avx512_norm.inc.h"
#include "kernels/fixed_avx512_words.inc.h"

/* ---- keys and values ---- */

/* Rows whose sum fits 32 bits. */
#define RANGE_ROWS 32768u

/* Up to 32 channels of up to RANGE_ROWS rows. */
static void range_block(const int16_t *x, size_t x_stride, size_t rows, size_t channels,
			struct dvsm_fixed_range *ranges)
{
	const __mmask32 lanes = first_words(channels);
	__m512i low = _mm512_set1_epi16(INT16_MAX), high = _mm512_set1_epi16(INT16_MIN);
	__m512i sums[2] = {_mm512_setzero_si512(), _mm512_setzero_si512()};
	int16_t lows[32], highs[32];
	int32_t totals[32];

	for (size_t i = 0; i < rows; i++) {
		__m512i a = _mm512_maskz_loadu_epi16(lanes, x + i * x_stride);

		low = _mm512_min_epi16(low, a);
		high = _mm512_max_epi16(high, a);
		sums[0] =
			_mm512_add_epi32(sums[0], _mm512_cvtepi16_epi32(_mm512_castsi512_si256(a)));
		sums[1] = _mm512_add_epi32(sums[1],
					   _mm512_cvtepi16_epi32(_mm512_extracti64x4_epi64(a, 1)));
	}
	_mm512_storeu_si512(lows, low);
	_mm512_storeu_si512(highs, high);
	_mm512_storeu_si512(totals, sums[0]);
	_mm512_storeu_si512(totals + 16, sums[1]);
	for (size_t d = 0; d < channels; d++) {
		ranges[d].sum += totals[d];
		ranges[d].low = lows[d] < ranges[d].low ? lows[d] : ranges[d].low;
		ranges[d].high = highs[d] > ranges[d].high ? highs[d] : ranges[d].high;
	}
}

static void range(const int16_t *x, size_t x_stride, size_t rows, size_t channels,
		  struct dvsm_fixed_range *ranges)
{
	while (rows > 0) {
		size_t count = rows < RANGE_ROWS ? rows : RANGE_ROWS;

		for (size_t d = 0; d < channels; d += 32)
			range_block(x + d, x_stride, count, channels - d < 32 ? channels - d : 32,
				    ranges + d);
		x += count * x_stride;
		rows -= count;
	}
}

/* Sixteen channels, laid out for their lanes. */
struct channel_lanes {
	__m256i mean, inverse;
	__m512i shift;
	__mmask16 lanes;
};

static struct channel_lanes load_channels(const struct dvsm_fixed_channel *channels, size_t count)
{
	int16_t means[16] = {0}, inverses[16] = {0};
	int32_t shifts[16] = {0};

	for (size_t d = 0; d < count && d < 16; d++) {
		means[d] = channels[d].mean;
		inverses[d] = channels[d].inverse;
		shifts[d] = channels[d].shift;
	}
	return (struct channel_lanes){
		.mean = _mm256_loadu_si256((const __m256i *)means),
		.inverse = _mm256_loadu_si256((const __m256i *)inverses),
		.shift = _mm512_loadu_si512(shifts),
		.lanes = first_lanes(count),
	};
}

/* Sixteen numbers of one key. */
static inline __m128i pack_lanes(const struct channel_lanes *channels, const int16_t *x)
{
	__m256i a = _mm256_maskz_loadu_epi16(channels->lanes, x);
	__m512i c = _mm512_cvtepi16_epi32(_mm256_subs_epi16(a, channels->mean));

	a = _mm512_cvtsepi32_epi16(_mm512_sllv_epi32(c, channels->shift));
	return _mm256_cvtepi16_epi8(_mm256_mulhrs_epi16(a, channels->inverse));
}

/* The first `count` channels' bytes of one key, `step` bytes from group to group of `group`. */
static void store_bytes(__m128i numbers, size_t count, int8_t *to, size_t group, size_t step)
{
	int8_t bytes[16];

	_mm_storeu_si128((__m128i *)bytes, numbers);
	for (size_t d = 0; d < count; d++)
		to[d / group * step + d % group] = bytes[d];
}

static void pack_keys(const struct dvsm_fixed_pack *job)
{
	for (size_t d = 0; d < job->dim; d += 16) {
		const struct channel_lanes channels =
			load_channels(job->channels + d, job->dim - d);
		const size_t count = job->dim - d < 16 ? job->dim - d : 16;

		for (size_t i = 0; i < job->rows; i++) {
			size_t key = job->first + i;
			int8_t *to = job->packed +
				     key / DVSM_FIXED_PANEL * DVSM_FIXED_PANEL * job->head_width +
				     key % DVSM_FIXED_PANEL * 4 + d * DVSM_FIXED_PANEL;
			__m128i numbers = pack_lanes(&channels, job->x + i * job->x_stride + d);

			if (count == 16) {
				_mm_storeu_si32(to, numbers);
				_mm_storeu_si32(to + 64, _mm_srli_si128(numbers, 4));
				_mm_storeu_si32(to + 128, _mm_srli_si128(numbers, 8));
				_mm_storeu_si32(to + 192, _mm_srli_si128(numbers, 12));
			} else {
				store_bytes(numbers, count, to, 4, 64);
			}
		}
	}
}

/* Sixteen channels of four keys side by side. */
static void pack_four(const struct channel_lanes *channels, const int16_t *x, size_t x_stride,
		      int8_t *to)
{
	__m128i a = pack_lanes(channels, x), b = pack_lanes(channels, x + x_stride);
	__m128i c = pack_lanes(channels, x + 2 * x_stride);
	__m128i e = pack_lanes(channels, x + 3 * x_stride);
	__m256i ab = _mm256_set_m128i(_mm_unpackhi_epi8(a, b), _mm_unpacklo_epi8(a, b));
	__m256i ce = _mm256_set_m128i(_mm_unpackhi_epi8(c, e), _mm_unpacklo_epi8(c, e));
	__m512i low = _mm512_cvtepu16_epi32(ab), high = _mm512_cvtepu16_epi32(ce);

	_mm512_mask_storeu_epi32(to, channels->lanes,
				 _mm512_or_si512(low, _mm512_slli_epi32(high, 16)));
}

static void pack_values(const struct dvsm_fixed_pack *job)
{
	for (size_t d = 0; d < job->dim; d += 16) {
		const struct channel_lanes channels =
			load_channels(job->channels + d, job->dim - d);
		const size_t count = job->dim - d < 16 ? job->dim - d : 16;

		for (size_t i = 0, step; i < job->rows; i += step) {
			size_t key = job->first + i;
			const int16_t *x = job->x + i * job->x_stride + d;
			int8_t *to = job->packed + key / 4 * 4 * job->head_width + 4 * d;

			step = key % 4 == 0 && job->rows - i >= 4 ? 4 : 1;
			if (step == 4)
				pack_four(&channels, x, job->x_stride, to);
			else
				store_bytes(pack_lanes(&channels, x), count, to + key % 4, 1, 4);
		}
	}
}

const struct dvsm_fixed_kernels dvsm_fixed_kernels_avx512 = {
	.cpu = DVSM_CPU_AVX512,
	.name = "avx512",
	.norm = norm,
	.quantise = quantise,
	.queries = queries,
	.keys = keys,
	.range = range,
	.pack_keys = pack_keys,
	.pack_values = pack_values,
};
