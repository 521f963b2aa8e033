/* What a fixed-point product of AVX-512 does with its sums: VNNI's and AMX's alike. Private. */
#ifndef DVSM_KERNELS_FIXED_AVX512_FINISH_H
#define DVSM_KERNELS_FIXED_AVX512_FINISH_H

#include "kernels/fixed_avx512.h"
#include "kernels/tier.h"

/*
 * r = R(t f, shift - 15) of 32-bit sums t in 32-bit lanes. With t = 2^cut high + low, of which high
 * fits 16 bits, floor(t f / 2^cut) = high f + floor(low f / 2^cut): two multiplications of words.
 * What is left of the shift must then be a bit at least, or there is nothing to round; where a
 * column and a row leave less, the products take 64 bits. Where they leave enough for a cut of 16,
 * high and low are the sum's words as they lie.
 */
enum requantise_way { REQUANTISE_WIDE, REQUANTISE_CUT, REQUANTISE_WORDS };

struct requantise {
	enum requantise_way way;
	int cut;
	__m512i up; /* 16 - cut: low to the top of its word */
	__m512i one, upper;
};

/* The least shift of a job's columns and rows; those of scale 0 yield 0 with any. */
static int least_shift(const struct dvsm_fixed_gemm *job)
{
	const __m512i zero = _mm512_setzero_si512();
	__m512i least = _mm512_set1_epi16(INT16_MAX);
	int most = INT16_MIN;

	for (size_t j = 0; j < job->cols; j += 32) {
		const __mmask32 lanes = first_words(job->cols - j);
		__m512i mantissa = _mm512_maskz_loadu_epi16(lanes, job->w_mantissa + j);
		__m512i shift = _mm512_maskz_loadu_epi16(lanes, job->w_shift + j);

		least = _mm512_mask_min_epi16(least, _mm512_cmpneq_epi16_mask(mantissa, zero),
					      least, shift);
	}
	for (size_t i = 0; i < job->rows; i++)
		if (job->a_scale[i].mantissa && job->a_scale[i].exponent > most)
			most = job->a_scale[i].exponent;

	__m512i halves[2] = {_mm512_cvtepi16_epi32(_mm512_castsi512_si256(least)),
			     _mm512_cvtepi16_epi32(_mm512_extracti64x4_epi64(least, 1))};

	return _mm512_reduce_min_epi32(_mm512_min_epi32(halves[0], halves[1])) - most;
}

static struct requantise requantise_prepare(const struct dvsm_fixed_gemm *job)
{
	/* |t| is at most 128 times 127 a step of depth, and high is below 2^15. */
	const int bits = dvsm_fixed_bits((uint64_t)job->depth * 128 * 127);
	const int least = least_shift(job);
	int cut = bits > 15 ? bits - 15 : 0;
	enum requantise_way way = REQUANTISE_WIDE;

	if (least > 15 + 16) {
		way = REQUANTISE_WORDS;
		cut = 16;
	} else if (least > 15 + cut) {
		way = REQUANTISE_CUT;
	}
	return (struct requantise){
		.way = way,
		.cut = cut,
		.up = _mm512_set1_epi32(16 - cut),
		.one = keep(_mm512_set1_epi32(1)),
		.upper = keep(_mm512_set1_epi32(~0xffff)),
	};
}

/* The columns of a tile as its epilogue needs them. */
struct columns {
	__m512i mantissa; /* twice in each lane */
	__m512i shift;
	__mmask16 lanes;
};

static struct columns load_columns(const struct dvsm_fixed_gemm *job, size_t first)
{
	const __mmask16 lanes = first < job->cols ? first_lanes(job->cols - first) : 0;
	__m512i mantissa =
		_mm512_cvtepu16_epi32(_mm256_maskz_loadu_epi16(lanes, job->w_mantissa + first));
	__m256i shift = _mm256_maskz_loadu_epi16(lanes, job->w_shift + first);

	return (struct columns){_mm512_or_si512(mantissa, _mm512_slli_epi32(mantissa, 16)),
				_mm512_cvtepi16_epi32(shift), lanes};
}

/* The scale of a row in all lanes: its mantissa twice in each. */
struct row_lanes {
	__m512i mantissa, exponent;
};

/* Scales of up to 32 rows as load_row() takes them. */
struct row_scales {
	_Alignas(64) int32_t mantissas[32], exponents[32];
};

static inline void prepare_rows(const struct requantise *how, const struct dvsm_fixed_scale *scales,
				size_t rows, struct row_scales *out)
{
	/* Of words, the shift is without what the cut and the last bit take. */
	const __m512i taken = _mm512_set1_epi32(how->way == REQUANTISE_WIDE ? 0 : 16 + how->cut);
	const __m512i low = _mm512_set1_epi32(0xffff);

	for (size_t i = 0; i < rows; i += 16) {
		__m512i pairs = _mm512_maskz_loadu_epi32(first_lanes(rows - i), scales + i);
		__m512i mantissa = _mm512_and_si512(pairs, low);

		mantissa = _mm512_or_si512(mantissa, _mm512_slli_epi32(mantissa, 16));
		_mm512_store_si512(out->mantissas + i, mantissa);
		_mm512_store_si512(out->exponents + i,
				   _mm512_add_epi32(_mm512_srai_epi32(pairs, 16), taken));
	}
}

static inline struct row_lanes load_row(const struct row_scales *scales, size_t row)
{
	return (struct row_lanes){_mm512_set1_epi32(scales->mantissas[row]),
				  _mm512_set1_epi32(scales->exponents[row])};
}

/* r of sixteen sums, exact in 32 bits. */
DVSM_INLINE __m512i requantise_narrow(const enum requantise_way way, const struct requantise *how,
				      const struct row_lanes *row, const struct columns *columns,
				      __m512i sums)
{
	__m512i factor = _mm512_mulhrs_epi16(columns->mantissa, row->mantissa);
	__m512i one_and_factor = _mm512_or_si512(_mm512_and_si512(factor, how->upper), how->one);
	__m512i shift = _mm512_sub_epi32(columns->shift, row->exponent);
	__m512i words = way == REQUANTISE_WORDS ? sums : _mm512_sllv_epi32(sums, how->up);

	words = _mm512_mask_mulhi_epu16(words, 0x55555555, words, factor);
	words = _mm512_srav_epi32(_mm512_madd_epi16(words, one_and_factor), shift);
	return _mm512_srai_epi32(_mm512_add_epi32(words, how->one), 1);
}

static inline struct wide requantise_wide(const struct row_lanes *row,
					  const struct columns *columns, __m512i sums)
{
	__m512i factor = _mm512_mulhrs_epi16(columns->mantissa, row->mantissa);

	factor = _mm512_slli_epi32(_mm512_srli_epi32(factor, 16), 15);
	return round_products(sums, factor,
			      clamp_shift(_mm512_sub_epi32(columns->shift, row->exponent)));
}

/* r of sixteen sums: modulo 2^32, or as int16 saturates it. */
DVSM_INLINE __m512i requantise(const enum requantise_way way, const bool adds,
			       const struct requantise *how, const struct row_lanes *row,
			       const struct columns *columns, __m512i sums)
{
	if (way != REQUANTISE_WIDE)
		return requantise_narrow(way, how, row, columns, sums);
	return adds ? wide_low(requantise_wide(row, columns, sums))
		    : wide_saturate(requantise_wide(row, columns, sums), 1 << 15);
}

/* GELU's table with half a unit of the result in it, and its steps. */
struct gelu {
	__m512i table[2], steps[2];
	__m512i limit, up, down;
	__m512i zero, low_byte, high_byte;
	bool tails; /* below two fraction bits there are none */
};

static struct gelu gelu_prepare(int fraction)
{
	const int16_t *tail = dvsm_fixed_gelu_tail;
	struct gelu gelu = {.tails = fraction >= 2, .zero = keep(_mm512_setzero_si512())};

	if (!gelu.tails)
		return gelu;
	for (int i = 0; i < 2; i++) {
		__m512i at = _mm512_loadu_si512(tail + 32 * i);
		__m512i next = _mm512_loadu_si512(tail + 32 * i + 1);

		gelu.table[i] =
			_mm512_add_epi16(at, _mm512_set1_epi16((int16_t)(1 << (16 - fraction))));
		gelu.steps[i] = _mm512_sub_epi16(next, at);
	}
	gelu.limit = _mm512_set1_epi16((int16_t)(16383 >> (12 - fraction)));
	gelu.up = _mm512_set1_epi16((int16_t)(12 - fraction));
	gelu.down = _mm512_set1_epi16((int16_t)(17 - fraction));
	gelu.low_byte = keep(_mm512_set1_epi16(255));
	gelu.high_byte = keep(_mm512_set4_epi32((int)0x800f800d, (int)0x800b8009, (int)0x80078005,
						(int)0x80038001));
	return gelu;
}

/*
 * Beyond the table its last number counts whose place `up` can write: less than half a unit of the
 * result, as what belongs there. Shifts and the choice of a maximum find one port of a processor's,
 * shuffles and comparisons another: the work is split between both.
 */
static inline __m512i gelu_lanes(const struct gelu *gelu, __m512i u)
{
	const __mmask32 negative = _mm512_cmplt_epi16_mask(u, gelu->zero);
	__m512i positive = _mm512_maskz_mov_epi16(~negative, u);

	if (!gelu->tails)
		return positive;

	__m512i size =
		_mm512_min_epu16(_mm512_mask_sub_epi16(u, negative, gelu->zero, u), gelu->limit);
	__m512i at = _mm512_sllv_epi16(size, gelu->up);
	__m512i index = _mm512_shuffle_epi8(at, gelu->high_byte);
	__m512i share = _mm512_slli_epi16(_mm512_and_si512(at, gelu->low_byte), 7);
	__m512i tail = _mm512_permutex2var_epi16(gelu->table[0], index, gelu->table[1]);
	__m512i step = _mm512_permutex2var_epi16(gelu->steps[0], index, gelu->steps[1]);

	tail = _mm512_add_epi16(tail, _mm512_mulhrs_epi16(step, share));
	return _mm512_sub_epi16(positive, _mm512_srlv_epi16(tail, gelu->down));
}

#endif
