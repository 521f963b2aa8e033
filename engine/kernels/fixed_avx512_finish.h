/* What a fixed-point product of AVX-512 does with its sums: VNNI's and AMX's alike. Private. */
#ifndef DVSM_KERNELS_FIXED_AVX512_FINISH_H
#define DVSM_KERNELS_FIXED_AVX512_FINISH_H

#include "kernels/fixed_avx512.h"

/* The columns of a tile as its epilogue needs them. */
struct columns {
	__m512i mantissa, shift;
	__mmask16 lanes;
};

static struct columns load_columns(const struct dvsm_fixed_gemm *job, size_t first)
{
	const __mmask16 lanes = first_lanes(job->cols - first);
	__m256i mantissa = _mm256_maskz_loadu_epi16(lanes, job->w_mantissa + first);
	__m256i shift = _mm256_maskz_loadu_epi16(lanes, job->w_shift + first);

	return (struct columns){_mm512_cvtepi16_epi32(mantissa), _mm512_cvtepi16_epi32(shift),
				lanes};
}

static inline void finish(const struct dvsm_fixed_gemm *job, size_t row, size_t col,
			  const struct columns *columns, __m512i sums)
{
	const struct dvsm_fixed_scale scale = job->a_scale[row];
	__m512i factor = _mm512_mullo_epi32(columns->mantissa, _mm512_set1_epi32(scale.mantissa));
	__m512i shift =
		clamp_shift(_mm512_sub_epi32(columns->shift, _mm512_set1_epi32(scale.exponent)));
	struct wide r = round_products(sums, factor, shift);
	size_t at = row * job->c_stride + col;

	if (job->epilogue == DVSM_FIXED_ADD) {
		int32_t *c = (int32_t *)job->c + at;
		__m512i before = _mm512_maskz_loadu_epi32(columns->lanes, c);

		_mm512_mask_storeu_epi32(c, columns->lanes, _mm512_add_epi32(before, wide_low(r)));
	} else {
		_mm512_mask_cvtepi32_storeu_epi16((int16_t *)job->c + at, columns->lanes,
						  wide_saturate(r, 1 << 15));
	}
}

/* One row of a tile to its GELU, in place; the table's neighbours are in `next`. */
struct gelu {
	__m512i table[2], next[2];
	__m512i limit;
	__m128i up, down;
	__m512i half;
	bool tails; /* below two fraction bits there are none */
};

static struct gelu gelu_prepare(int fraction)
{
	const int16_t *tail = dvsm_fixed_gelu_tail;
	struct gelu gelu = {.tails = fraction >= 2};

	if (!gelu.tails)
		return gelu;
	gelu.table[0] = _mm512_loadu_si512(tail);
	gelu.table[1] = _mm512_loadu_si512(tail + 32);
	gelu.next[0] = _mm512_loadu_si512(tail + 1);
	gelu.next[1] = _mm512_loadu_si512(tail + 33);
	gelu.limit = _mm512_set1_epi16((int16_t)(16383 >> (12 - fraction)));
	gelu.up = _mm_cvtsi32_si128(12 - fraction);
	gelu.down = _mm_cvtsi32_si128(17 - fraction);
	gelu.half = _mm512_set1_epi16((int16_t)(1 << (16 - fraction)));
	return gelu;
}

static inline __m512i gelu_lanes(const struct gelu *gelu, __m512i u)
{
	const __m512i most = _mm512_set1_epi16(INT16_MAX), zero = _mm512_setzero_si512();
	__m512i positive = _mm512_max_epi16(u, zero);

	if (!gelu->tails)
		return positive;

	__m512i size = _mm512_min_epu16(_mm512_abs_epi16(u), most);
	__mmask32 beyond = _mm512_cmpgt_epu16_mask(size, gelu->limit);
	__m512i at = _mm512_mask_mov_epi16(_mm512_sll_epi16(size, gelu->up), beyond,
					   _mm512_set1_epi16(16383));
	__m512i index = _mm512_srli_epi16(at, 8);
	__m512i share = _mm512_slli_epi16(_mm512_and_si512(at, _mm512_set1_epi16(255)), 7);
	__m512i tail = _mm512_permutex2var_epi16(gelu->table[0], index, gelu->table[1]);
	__m512i next = _mm512_permutex2var_epi16(gelu->next[0], index, gelu->next[1]);

	tail = _mm512_add_epi16(tail, _mm512_mulhrs_epi16(_mm512_sub_epi16(next, tail), share));
	tail = _mm512_srl_epi16(_mm512_add_epi16(tail, gelu->half), gelu->down);
	return _mm512_sub_epi16(positive, tail);
}

static void gelu_row(const struct gelu *gelu, int16_t *c, size_t count)
{
	for (size_t j = 0; j < count; j += 32) {
		__mmask32 lanes = count - j >= 32 ? 0xffffffffu : (1u << (count - j)) - 1;
		__m512i u = _mm512_maskz_loadu_epi16(lanes, c + j);

		_mm512_mask_storeu_epi16(c + j, lanes, gelu_lanes(gelu, u));
	}
}

#endif
