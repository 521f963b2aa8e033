/*
 * What fixed_math.h does once a row, for sixteen rows at a time: one in each 32-bit lane. Private.
 *
 * Numbers that become 15 bits are floats here, cut to 24 bits towards zero wherever they are made.
 * That is exact: R(a, s) is floor(a / 2^(s - 1)) plus 1, halved, and sees no bit below the 16th.
 * Each instruction names its rounding, so that no state of the processor has a part in it.
 */
#ifndef DVSM_KERNELS_FIXED_AVX512_LANES_H
#define DVSM_KERNELS_FIXED_AVX512_LANES_H

#include "kernels/fixed_avx512.h"
#include "kernels/tier.h"

/** Rows at a time. */
#define ROWS 16u

#define TOWARDS_ZERO (_MM_FROUND_TO_ZERO | _MM_FROUND_NO_EXC)

/* ---- one vector a row to one lane a row ---- */

typedef __m512i combine_fn(__m512i a, __m512i b);

/* The 128-bit lanes of four vectors, each combined to one, side by side. */
DVSM_INLINE __m512i fold_quarters(__m512i a, __m512i b, __m512i c, __m512i d, combine_fn *combine)
{
	__m512i ab = combine(_mm512_shuffle_i64x2(a, b, 0x44), _mm512_shuffle_i64x2(a, b, 0xee));
	__m512i cd = combine(_mm512_shuffle_i64x2(c, d, 0x44), _mm512_shuffle_i64x2(c, d, 0xee));

	return combine(_mm512_shuffle_i64x2(ab, cd, 0x88), _mm512_shuffle_i64x2(ab, cd, 0xdd));
}

/** Lane i is all lanes of rows[i], combined. */
DVSM_INLINE __m512i fold_rows(const __m512i rows[ROWS], combine_fn *combine)
{
	__m512i quarters[4], low, high;

	for (size_t k = 0; k < 4; k++)
		quarters[k] =
			fold_quarters(rows[k], rows[k + 4], rows[k + 8], rows[k + 12], combine);
	low = combine(_mm512_unpacklo_epi64(quarters[0], quarters[1]),
		      _mm512_unpackhi_epi64(quarters[0], quarters[1]));
	high = combine(_mm512_unpacklo_epi64(quarters[2], quarters[3]),
		       _mm512_unpackhi_epi64(quarters[2], quarters[3]));

	const __m512 a = _mm512_castsi512_ps(low), b = _mm512_castsi512_ps(high);

	return combine(_mm512_castps_si512(_mm512_shuffle_ps(a, b, 0x88)),
		       _mm512_castps_si512(_mm512_shuffle_ps(a, b, 0xdd)));
}

/** Zeros for the rows that are not there. */
static inline void clear_rows(__m512i rows[ROWS], size_t count)
{
	for (size_t i = count; i < ROWS; i++)
		rows[i] = _mm512_setzero_si512();
}

static inline __m512i min_s32(__m512i a, __m512i b)
{
	return _mm512_min_epi32(a, b);
}

static inline __m512i max_s32(__m512i a, __m512i b)
{
	return _mm512_max_epi32(a, b);
}

static inline __m512i add_s32(__m512i a, __m512i b)
{
	return _mm512_add_epi32(a, b);
}

static inline __m512i add_s64(__m512i a, __m512i b)
{
	return _mm512_add_epi64(a, b);
}

/* Lane j is the sum of the 64-bit lanes of rows[2 j]. */
static inline __m512i sum_every_other(const __m512i *rows)
{
	__m512i a = fold_quarters(rows[0], rows[4], rows[8], rows[12], add_s64);
	__m512i b = fold_quarters(rows[2], rows[6], rows[10], rows[14], add_s64);

	return _mm512_add_epi64(_mm512_unpacklo_epi64(a, b), _mm512_unpackhi_epi64(a, b));
}

/** The sums of the 64-bit lanes of each row. */
static inline struct wide sum_wide_rows(const __m512i rows[ROWS])
{
	return (struct wide){sum_every_other(rows), sum_every_other(rows + 1)};
}

/** sum + a, of which a is unsigned 32-bit lanes and the sum 64-bit ones. */
static inline __m512i add_wide(__m512i sum, __m512i a)
{
	sum = _mm512_add_epi64(sum, _mm512_and_si512(a, _mm512_set1_epi64(0xffffffff)));
	return _mm512_add_epi64(sum, odd_lanes(a));
}

/* ---- floats as they lie in memory ---- */

/** A number below 2^32. */
static inline __m512i float_make(__m512i number)
{
	return _mm512_castps_si512(_mm512_cvt_roundepu32_ps(number, TOWARDS_ZERO));
}

static inline __m512i float_multiply(__m512i a, __m512i b)
{
	return _mm512_castps_si512(
		_mm512_mul_round_ps(_mm512_castsi512_ps(a), _mm512_castsi512_ps(b), TOWARDS_ZERO));
}

static inline __m512i float_divide(float a, __m512i b)
{
	return _mm512_castps_si512(
		_mm512_div_round_ps(_mm512_set1_ps(a), _mm512_castsi512_ps(b), TOWARDS_ZERO));
}

/** Rounded to 15 bits, or to 14: an overflow of the mantissa is the next power of two. */
static inline __m512i float_round(__m512i a, int bits)
{
	const int unit = 1 << (24 - bits);

	a = _mm512_add_epi32(a, _mm512_set1_epi32(unit / 2));
	return _mm512_and_si512(a, _mm512_set1_epi32(-unit));
}

/** dvsm_fixed_bits() of what it was made of, but -126 for 0. */
static inline __m512i float_bits(__m512i a)
{
	return _mm512_sub_epi32(_mm512_srli_epi32(a, 23), _mm512_set1_epi32(126));
}

/** a 2^exponent */
static inline __m512i float_shift(__m512i a, __m512i exponent)
{
	return _mm512_add_epi32(a, _mm512_slli_epi32(exponent, 23));
}

/** floor(127 2^15 / a), a at least 1 */
static inline __m512i float_inverse(__m512i a)
{
	return _mm512_cvttps_epi32(_mm512_castsi512_ps(float_divide(127 << 15, a)));
}

/* ---- scales ---- */

/** Sixteen scales: number 2^exponent, number of 15 bits or 0. */
struct scale_lanes {
	__m512i number, exponent;
};

static inline struct scale_lanes scale_lanes_set(struct dvsm_fixed_scale scale)
{
	return (struct scale_lanes){float_make(_mm512_set1_epi32(scale.mantissa)),
				    _mm512_set1_epi32(scale.exponent)};
}

static inline struct scale_lanes scale_lanes_multiply(struct scale_lanes a, struct scale_lanes b)
{
	return (struct scale_lanes){float_round(float_multiply(a.number, b.number), 15),
				    _mm512_add_epi32(a.exponent, b.exponent)};
}

static inline struct scale_lanes scale_lanes_shift(struct scale_lanes a, __m512i exponent)
{
	return (struct scale_lanes){a.number, _mm512_add_epi32(a.exponent, exponent)};
}

/** The mantissas of 2^14 .. 2^15 - 1, or 0, and the exponents that belong to them. */
static inline struct scale_lanes scale_lanes_split(struct scale_lanes a)
{
	const __mmask16 some = _mm512_test_epi32_mask(a.number, a.number);
	__m512i low = _mm512_and_si512(_mm512_srli_epi32(a.number, 9), _mm512_set1_epi32(0x3fff));
	__m512i exponent = _mm512_sub_epi32(float_bits(a.number), _mm512_set1_epi32(15));

	return (struct scale_lanes){
		_mm512_maskz_or_epi32(some, low, _mm512_set1_epi32(0x4000)),
		_mm512_maskz_add_epi32(some, exponent, a.exponent),
	};
}

/** The first `count` of them to memory. */
static inline void scale_lanes_store(struct scale_lanes a, struct dvsm_fixed_scale *to,
				     size_t count)
{
	struct scale_lanes split = scale_lanes_split(a);

	_mm512_mask_storeu_epi32(
		to, first_lanes(count),
		_mm512_or_si512(split.number, _mm512_slli_epi32(split.exponent, 16)));
}

/**
 * dvsm_fixed_inverse_scale() of a whole number or 0. Adding 1/2 and cutting to the 24 bits of a
 * float rounds as it does: tests/kernels/test_fixed.c tries all inverses there are.
 */
static inline struct scale_lanes scale_lanes_inverse(__m512i inverse)
{
	const __mmask16 some = _mm512_test_epi32_mask(inverse, inverse);
	const __m512 quotient = _mm512_castsi512_ps(float_divide(1 << 30, float_make(inverse)));
	const __m512i number = _mm512_castps_si512(
		_mm512_add_round_ps(quotient, _mm512_set1_ps(0.5f), TOWARDS_ZERO));

	return (struct scale_lanes){_mm512_maskz_mov_epi32(some, float_round(number, 15)),
				    _mm512_set1_epi32(-15)};
}

/* ---- roots ---- */

/* Eight numbers n = m 4^half below 2^62, m of 31 or 32 bits: m, and bits(n) + 1022; 0 for 0. */
struct power_of_four {
	__m512i m, exponent;
};

static inline struct power_of_four split_powers(__m512i n)
{
	const __m512i bits = _mm512_castpd_si512(_mm512_cvt_roundepu64_pd(n, TOWARDS_ZERO));
	const __m512i one = _mm512_set1_epi64((int64_t)1 << 52);
	const __m512i exponent = _mm512_srli_epi64(bits, 52);
	/* Of the 53 bits that a double keeps m has 32 where n has an even number, else 31. */
	const __m512i down = _mm512_add_epi64(_mm512_and_si512(exponent, _mm512_set1_epi64(1)),
					      _mm512_set1_epi64(21));

	/* (bits & (2^52 - 1)) | 2^52 */
	return (struct power_of_four){
		_mm512_srlv_epi64(
			_mm512_ternarylogic_epi64(bits, _mm512_sub_epi64(one, _mm512_set1_epi64(1)),
						  one, 0xea),
			down),
		exponent,
	};
}

/* The table's guesses for the 96 values of the highest seven bits of m. */
static inline __m512i guess_roots(__m512i m)
{
	const uint16_t *table = dvsm_fixed_rsqrt_guess;
	const __m512i at = _mm512_sub_epi32(_mm512_srli_epi32(m, 25), _mm512_set1_epi32(32));
	const __m512i low = _mm512_maskz_permutex2var_epi16(0x55555555, _mm512_loadu_si512(table),
							    at, _mm512_loadu_si512(table + 32));
	const __mmask16 upper = _mm512_cmpgt_epi32_mask(at, _mm512_set1_epi32(63));
	const __m512i high =
		_mm512_maskz_permutexvar_epi16(0x55555555, at, _mm512_loadu_si512(table + 64));

	return _mm512_mask_mov_epi32(low, upper, high);
}

/*
 * A step of Newton's as dvsm_fixed_rsqrt() takes it, with y taken out of the product: y + R(y (2^31
 * - floor(y^2 m / 2^31)), 32), of which the difference has few bits. y^2 fits 32 bits: no guess and
 * no first step from one is above 65,530.
 */
static inline __m512i improve_roots(__m512i y, __m512i m)
{
	const __m512i one = _mm512_set1_epi64((int64_t)1 << 31);
	const __m512i y_odd = odd_lanes(y);
	__m512i even = _mm512_mul_epu32(_mm512_mul_epu32(y, y), m);
	__m512i odd = _mm512_mul_epu32(_mm512_mul_epu32(y_odd, y_odd), odd_lanes(m));

	even = _mm512_sub_epi64(one, _mm512_srli_epi64(even, 31));
	odd = _mm512_sub_epi64(one, _mm512_srli_epi64(odd, 31));
	even = _mm512_add_epi64(_mm512_mul_epi32(y, even), one);
	odd = _mm512_add_epi64(_mm512_mul_epi32(y_odd, odd), one);
	return _mm512_add_epi32(y, _mm512_mask_blend_epi32(0xaaaa, odd_lanes(even), odd));
}

/** dvsm_fixed_rsqrt() */
static inline struct scale_lanes scale_lanes_rsqrt(struct wide n)
{
	const struct power_of_four even = split_powers(n.even), odd = split_powers(n.odd);
	const __m512i m = wide_low((struct wide){even.m, odd.m});
	const __m512i exponent = wide_low((struct wide){even.exponent, odd.exponent});
	/* floor((bits(n) - 31) / 2) */
	const __m512i half =
		_mm512_srai_epi32(_mm512_sub_epi32(exponent, _mm512_set1_epi32(1022 + 31)), 1);
	const __mmask16 some = _mm512_test_epi32_mask(exponent, exponent);
	const __m512i y = improve_roots(improve_roots(guess_roots(m), m), m);

	return (struct scale_lanes){
		_mm512_maskz_mov_epi32(some, float_round(float_make(y), 15)),
		_mm512_sub_epi32(_mm512_set1_epi32(-31), half),
	};
}

/* ---- rows of int32 to int8 ---- */

/** dvsm_fixed_narrow of sixteen rows. */
struct narrow_lanes {
	__m512i shift, inverse;
	struct scale_lanes scale;
};

/** dvsm_fixed_narrow_make() */
static inline struct narrow_lanes narrow_lanes_make(__m512i largest, bool fine, struct wide squares,
						    struct scale_lanes gain)
{
	const __mmask16 some = _mm512_test_epi32_mask(largest, largest);
	const __m512i size = float_make(largest);
	const __m512i shift = _mm512_sub_epi32(float_bits(size), _mm512_set1_epi32(14));
	const __m512i up = _mm512_sub_epi32(_mm512_setzero_si512(), shift);
	const __m512i top = float_shift(float_round(size, 14), up);
	struct narrow_lanes narrow = {
		.shift = _mm512_maskz_mov_epi32(some, shift),
		.inverse = _mm512_maskz_mov_epi32(some, float_inverse(top)),
		.scale = scale_lanes_multiply(scale_lanes_rsqrt(squares), gain),
	};

	if (!fine)
		narrow.scale =
			scale_lanes_multiply(narrow.scale, scale_lanes_inverse(narrow.inverse));
	narrow.scale = scale_lanes_shift(narrow.scale, narrow.shift);
	narrow.scale.number = _mm512_maskz_mov_epi32(some, narrow.scale.number);
	return narrow;
}

#endif
