/*
 * The scalar arithmetic of the fixed-point path: what every tier does once a row, a query or a
 * channel, and the scalar set for each number. engine/FIXED_POINT.md states the error of each.
 * Private to the engine.
 */
#ifndef DVSM_KERNELS_FIXED_MATH_H
#define DVSM_KERNELS_FIXED_MATH_H

#include "kernels/fixed.h"

/** R(a, s) = floor(a / 2^s + 1/2), s 0..62; a is away from the ends by 2^(s - 1). */
static inline int64_t dvsm_fixed_round(int64_t a, int s)
{
	return s == 0 ? a : (a + ((int64_t)1 << (s - 1))) >> s;
}

static inline int dvsm_fixed_clamp(int a, int low, int high)
{
	return a < low ? low : a > high ? high : a;
}

static inline int16_t dvsm_fixed_saturate(int64_t a)
{
	return (int16_t)(a < INT16_MIN ? INT16_MIN : a > INT16_MAX ? INT16_MAX : a);
}

/** R(a b, 15): pmulhrsw, sqrdmulh. Not for a = b = -32768. */
static inline int16_t dvsm_fixed_mulhrs(int16_t a, int16_t b)
{
	return (int16_t)((a * b + 16384) >> 15);
}

/** Bits of a number: 0 for 0, 1 for 1, 15 for 32767. */
static inline int dvsm_fixed_bits(uint64_t a)
{
	return a ? 64 - __builtin_clzll(a) : 0;
}

/** ceil(log2 a), a >= 1. */
static inline int dvsm_fixed_log2_up(uint64_t a)
{
	return dvsm_fixed_bits(a - 1);
}

/** number 2^exponent with its mantissa rounded to 15 bits; number below 2^62. */
static inline struct dvsm_fixed_scale dvsm_fixed_scale_make(uint64_t number, int exponent)
{
	int excess = dvsm_fixed_bits(number) - 15;

	if (number == 0)
		return (struct dvsm_fixed_scale){0, 0};
	if (excess > 0)
		number = (uint64_t)dvsm_fixed_round((int64_t)number, excess);
	else
		number <<= -excess;
	if (number == 1u << 15) {
		number >>= 1;
		excess++;
	}
	return (struct dvsm_fixed_scale){(int16_t)number, (int16_t)(exponent + excess)};
}

static inline struct dvsm_fixed_scale dvsm_fixed_multiply(struct dvsm_fixed_scale a,
							  struct dvsm_fixed_scale b)
{
	return dvsm_fixed_scale_make((uint64_t)a.mantissa * (uint64_t)b.mantissa,
				     a.exponent + b.exponent);
}

/** a 2^exponent. */
static inline struct dvsm_fixed_scale dvsm_fixed_shift(struct dvsm_fixed_scale a, int exponent)
{
	if (a.mantissa)
		a.exponent = (int16_t)(a.exponent + exponent);
	return a;
}

/** 2^31 / sqrt((i + 32.5) 2^25), the first guess of dvsm_fixed_rsqrt(). */
extern const uint16_t dvsm_fixed_rsqrt_guess[96];

/** 1 / sqrt(n) to 15 bits, 0 for 0; n below 2^62. Two steps of Newton's from a table. */
static inline struct dvsm_fixed_scale dvsm_fixed_rsqrt(uint64_t n)
{
	int half = (dvsm_fixed_bits(n) - 31) >> 1; /* n = m 4^half, m of 31 or 32 bits */
	uint64_t m, y, y2;

	if (n == 0)
		return (struct dvsm_fixed_scale){0, 0};
	m = half >= 0 ? n >> (2 * half) : n << (-2 * half);
	y = dvsm_fixed_rsqrt_guess[(m >> 25) - 32];
	for (int i = 0; i < 2; i++) {
		y2 = y * y * m >> 31; /* 2^31 where y is exact */
		y = (y * (3 * ((uint64_t)1 << 31) - y2) + ((uint64_t)1 << 31)) >> 32;
	}
	return dvsm_fixed_scale_make(y, -31 - half);
}

/** 2^15 / inverse, what one unit is worth after a multiplication by it; 0 for 0. */
static inline struct dvsm_fixed_scale dvsm_fixed_inverse_scale(uint32_t inverse)
{
	if (inverse == 0)
		return (struct dvsm_fixed_scale){0, 0};
	return dvsm_fixed_scale_make(((1u << 30) + inverse / 2) / inverse, -15);
}

/** How rows of int16 become int8 by their largest number, 0..32767. */
struct dvsm_fixed_fit {
	int shift; /* to the left, 0..15 */
	int16_t inverse;
	struct dvsm_fixed_scale scale; /* of the int8, in units of the int16 */
};

static inline struct dvsm_fixed_fit dvsm_fixed_fit_make(uint32_t largest)
{
	struct dvsm_fixed_fit fit = {0};

	if (largest == 0)
		return fit;
	fit.shift = 15 - dvsm_fixed_bits(largest);
	fit.inverse = (int16_t)((127u << 15) / (largest << fit.shift));
	fit.scale = dvsm_fixed_shift(dvsm_fixed_inverse_scale((uint32_t)fit.inverse), -fit.shift);
	return fit;
}

/** Of the upper plane of a row whose numbers were shifted up before they were split. */
static inline struct dvsm_fixed_scale dvsm_fixed_split_scale(int up, int fraction)
{
	return (struct dvsm_fixed_scale){1 << 14, (int16_t)(8 - up - 14 - fraction)};
}

/** What brings a key of this sum of squares to RMS 1: n = R(u mantissa, shift). */
struct dvsm_fixed_factor {
	int16_t mantissa;
	int shift;
};

static inline struct dvsm_fixed_factor dvsm_fixed_key_factor(const struct dvsm_fixed_keys *job,
							     uint64_t squares)
{
	struct dvsm_fixed_scale scale =
		dvsm_fixed_multiply(job->root, dvsm_fixed_rsqrt(squares + (uint64_t)job->epsilon));

	return (struct dvsm_fixed_factor){
		scale.mantissa, dvsm_fixed_clamp(-(scale.exponent + job->fraction), 0, 62)};
}

/**
 * How rows of int32 become int8 by their largest number, at most 2^30: y' = R(y, shift), or y
 * 2^-shift where shift is below 0, which is 2^13 .. 2^14 for the largest; a = R(y' inverse, 15).
 */
struct dvsm_fixed_narrow {
	int shift;
	int16_t inverse; /* 254..508, or 0 */
	struct dvsm_fixed_scale scale;
};

/**
 * fine      y' itself is wanted: the scale belongs to it
 * squares   sum of squares plus epsilon, of which the scale takes the inverse root
 */
static inline struct dvsm_fixed_narrow
dvsm_fixed_narrow_make(uint32_t largest, bool fine, uint64_t squares, struct dvsm_fixed_scale gain)
{
	struct dvsm_fixed_narrow narrow = {0};
	uint32_t top;

	if (largest == 0)
		return narrow;
	narrow.shift = dvsm_fixed_bits(largest) - 14;
	top = narrow.shift >= 0 ? (uint32_t)dvsm_fixed_round(largest, narrow.shift)
				: largest << -narrow.shift;
	narrow.inverse = (int16_t)((127u << 15) / top);
	narrow.scale = dvsm_fixed_multiply(dvsm_fixed_rsqrt(squares), gain);
	if (!fine)
		narrow.scale = dvsm_fixed_multiply(
			narrow.scale, dvsm_fixed_inverse_scale((uint32_t)narrow.inverse));
	narrow.scale = dvsm_fixed_shift(narrow.scale, narrow.shift);
	return narrow;
}

/** How a channel of `count` >= 1 keys or values becomes int8; scale in units of the int16. */
static inline struct dvsm_fixed_channel
dvsm_fixed_channel_make(const struct dvsm_fixed_range *range, int64_t count,
			struct dvsm_fixed_scale *scale)
{
	int64_t twice = 2 * range->sum + count, mean = twice / (2 * count);
	int largest;

	if (twice < 0 && mean * 2 * count != twice)
		mean--; /* division rounds to zero, the mean rounds down */
	largest = range->high - (int)mean > (int)mean - range->low ? range->high - (int)mean
								   : (int)mean - range->low;

	struct dvsm_fixed_fit fit =
		dvsm_fixed_fit_make((uint32_t)dvsm_fixed_clamp(largest, 0, INT16_MAX));

	*scale = fit.scale;
	return (struct dvsm_fixed_channel){(int16_t)mean, (int16_t)fit.shift, fit.inverse};
}

/** 2^17 g(i / 16), see dvsm_fixed_gelu(). */
extern const int16_t dvsm_fixed_gelu_tail[65];

/**
 * gelu(u) = max(u, 0) - g(|u|), g(a) = a Phi(-a), u and the result in units of 2^-fraction. g by
 * linear interpolation between 64 points of [0, 4), beyond which it is less than 2^-12 and taken
 * for 0.
 */
static inline int16_t dvsm_fixed_gelu(int16_t u, int fraction)
{
	int size = u < 0 ? (u == INT16_MIN ? INT16_MAX : -u) : u;
	int at, tail;

	if (fraction < 2) /* g is below half a unit everywhere */
		return u > 0 ? u : 0;
	at = size > 16383 >> (12 - fraction) ? 16383 : size << (12 - fraction);
	tail = dvsm_fixed_gelu_tail[at >> 8];
	tail += dvsm_fixed_mulhrs((int16_t)(dvsm_fixed_gelu_tail[(at >> 8) + 1] - tail),
				  (int16_t)((at & 255) << 7));
	return (int16_t)((u > 0 ? u : 0) - dvsm_fixed_round(tail, 17 - fraction));
}

/* 2^-t = 1 - 2t (A - 2t (B - 2t C)) for t in [-1/2, 1/2), to 9.4e-5, in units of 1 / ONE: what of
 * it is largest, 2^(1/2), fits 16 bits. */
#define DVSM_FIXED_EXP2_ONE 46300
#define DVSM_FIXED_EXP2_A   16051
#define DVSM_FIXED_EXP2_B   2808
#define DVSM_FIXED_EXP2_C   318

/**
 * Scores of a query become words, s >> shift: the least shift with which all fit 16 bits, whatever
 * the int8 keys are.
 *
 * sum  of |q|: |s| <= 128 sum <= 2^shift 32640
 */
static inline int dvsm_fixed_word_shift(uint32_t sum)
{
	int shift = 0;

	while (sum > 255u << shift)
		shift++;
	return shift;
}

static inline int dvsm_fixed_score_shift(const int8_t *q, size_t key_width)
{
	uint32_t sum = 0;

	for (size_t d = 0; d < key_width; d++)
		sum += (uint32_t)(q[d] < 0 ? -q[d] : q[d]);
	return dvsm_fixed_word_shift(sum);
}

/**
 * 23150 2^-(x 2^-fraction), rounded: 0 from 16 powers of two on.
 *
 * x         0..65535
 * fraction  bits of x, 1..11
 */
static inline uint16_t dvsm_fixed_exp2(uint32_t x, int fraction)
{
	/* The whole power nearest to x, and what is left: a fraction of 16 bits with a sign. */
	uint32_t whole = ((x >> (fraction - 1)) + 1) >> 1;
	int16_t t = (int16_t)(uint16_t)(x << (16 - fraction)), r = DVSM_FIXED_EXP2_C;

	if (whole > 16)
		return 0;
	r = (int16_t)(DVSM_FIXED_EXP2_B - dvsm_fixed_mulhrs(t, r));
	r = (int16_t)(DVSM_FIXED_EXP2_A - dvsm_fixed_mulhrs(t, r));

	uint32_t power = (uint32_t)(DVSM_FIXED_EXP2_ONE - dvsm_fixed_mulhrs(t, r));

	return (uint16_t)(((power >> whole) + 1) >> 1);
}

/** What a query's scores, as words, are worth: x = way factor >> 16, which has `fraction` bits. */
struct dvsm_fixed_slope {
	uint16_t factor;
	int fraction;
};

/**
 * The finest there is: factor is 2^15 at least where fraction is less than 11. Scores of which one
 * step is worth half a power of two or more, which no rounding of int8 could tell apart, count as
 * if it were worth that.
 *
 * scale  powers of two that 1 is worth, as a score before it becomes a word
 * shift  of its words
 */
static inline struct dvsm_fixed_slope dvsm_fixed_slope_make(struct dvsm_fixed_scale scale,
							    int shift)
{
	const int fraction = -15 - scale.exponent - shift;
	const int factor = 2 * scale.mantissa;

	if (fraction < 1)
		return (struct dvsm_fixed_slope){factor ? 65535 : 0, 1};
	if (fraction > 11)
		return (struct dvsm_fixed_slope){
			(uint16_t)(factor >> dvsm_fixed_clamp(fraction - 11, 0, 16)), 11};
	return (struct dvsm_fixed_slope){(uint16_t)factor, fraction};
}

/**
 * What turns O = sum of p v into the output. The sum of p has `bits` bits, so |O| is below 2^(bits
 * + 7): O' = O 2^(24 - bits), rounded where that drops bits, fits 32 and is as exact whatever the
 * sum is. O / sum = O' inverse 2^-38.
 */
struct dvsm_fixed_quotient {
	int16_t inverse;
	int up; /* 24 - bits */
};

enum { DVSM_FIXED_QUOTIENT_BITS = 38 };

/** 0 without keys */
static inline struct dvsm_fixed_quotient dvsm_fixed_divide(uint64_t sum)
{
	if (sum == 0)
		return (struct dvsm_fixed_quotient){0, 0};

	int bits = dvsm_fixed_bits(sum);
	uint64_t high = bits > 31 ? sum >> (bits - 31) : sum << (31 - bits);
	uint64_t inverse = ((uint64_t)1 << 45) / high;

	return (struct dvsm_fixed_quotient){
		.inverse = (int16_t)(inverse > INT16_MAX ? INT16_MAX : inverse),
		.up = 24 - bits,
	};
}

/** O' of one channel. */
static inline int32_t dvsm_fixed_lift(int64_t o, struct dvsm_fixed_quotient quotient)
{
	if (quotient.up >= 0)
		return (int32_t)(o * ((int64_t)1 << quotient.up));
	return (int32_t)dvsm_fixed_round(o, -quotient.up);
}

#endif
