/*
 * Fixed-point products for AVX-512 VNNI.
 *
 * vpdpbusd multiplies unsigned by signed bytes. The weights are the unsigned ones, 128 too large:
 * that takes one operation a vector of weights, which serves all rows, and A is broadcast from
 * where it lies. 128 times the sum of A's row is taken off where a sum begins.
 */
#include "kernels/fixed_avx512.h"
#include "kernels/fixed_tiers.h"
#include "kernels/tier.h"

/* 32 registers: 24 sums, 3 weights. */
#define ROWS   8
#define PANELS 3

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

/* 128 times the sum of each row, negative. */
static void offsets(const struct dvsm_fixed_gemm *job, size_t row, size_t rows, int32_t *offset)
{
	const __m512i ones = _mm512_set1_epi8(1);

	for (size_t i = 0; i < rows; i++) {
		const int8_t *a = job->a + (row + i) * job->a_stride;
		__m512i sum = _mm512_setzero_si512();

		for (size_t d = 0; d < job->depth; d += 64)
			sum = _mm512_dpbusd_epi32(sum, ones, _mm512_loadu_si512(a + d));
		offset[i] = -128 * _mm512_reduce_add_epi32(sum);
	}
}

static inline __m512i broadcast(const int8_t *a)
{
	int four;

	memcpy(&four, a, sizeof(four));
	return _mm512_set1_epi32(four);
}

/* `rows` x `panels` (constants where it is called) from row and column `row`, `col` on. */
DVSM_INLINE void tile(const int rows, const int panels, const struct dvsm_fixed_gemm *job,
		      size_t row, size_t col, const int32_t *offset,
		      const struct columns columns[PANELS])
{
	const __m512i flip = _mm512_set1_epi8(INT8_MIN);
	const int8_t *a = job->a + row * job->a_stride, *w = job->panels + col * job->depth;
	const size_t panel_bytes = DVSM_FIXED_PANEL * job->depth;
	__m512i sums[ROWS][PANELS];

	DVSM_UNROLL
	for (int i = 0; i < rows; i++) {
		DVSM_UNROLL
		for (int j = 0; j < panels; j++)
			sums[i][j] = _mm512_set1_epi32(offset[i]);
	}
	for (size_t d = 0; d < job->depth; d += 4) {
		__m512i b[PANELS];

		DVSM_UNROLL
		for (int j = 0; j < panels; j++)
			b[j] = _mm512_xor_si512(_mm512_load_si512(w + (size_t)j * panel_bytes +
								  d * DVSM_FIXED_PANEL),
						flip);
		DVSM_UNROLL
		for (int i = 0; i < rows; i++) {
			__m512i x = broadcast(a + (size_t)i * job->a_stride + d);

			DVSM_UNROLL
			for (int j = 0; j < panels; j++)
				sums[i][j] = _mm512_dpbusd_epi32(sums[i][j], b[j], x);
		}
	}
	DVSM_UNROLL
	for (int i = 0; i < rows; i++) {
		DVSM_UNROLL
		for (int j = 0; j < panels; j++)
			finish(job, row + (size_t)i, col + (size_t)j * DVSM_FIXED_PANEL,
			       &columns[j], sums[i][j]);
	}
}

/* All rows of `panels` panels. */
DVSM_INLINE void walk_rows(const int panels, const struct dvsm_fixed_gemm *job, size_t col,
			   const struct gelu *gelu)
{
	struct columns columns[PANELS];
	size_t left = job->cols - col, full = (size_t)panels * DVSM_FIXED_PANEL;
	size_t width = left < full ? left : full;

	for (int j = 0; j < panels; j++)
		columns[j] = load_columns(job, col + (size_t)j * DVSM_FIXED_PANEL);
	for (size_t row = 0, step; row < job->rows; row += step) {
		int32_t offset[ROWS];

		left = job->rows - row;
		step = left >= ROWS ? ROWS : left >= 4 ? 4 : 1;
		offsets(job, row, step, offset);
		if (step == ROWS)
			tile(ROWS, panels, job, row, col, offset, columns);
		else if (step == 4)
			tile(4, panels, job, row, col, offset, columns);
		else
			tile(1, panels, job, row, col, offset, columns);
		for (size_t i = row; gelu && i < row + step; i++)
			gelu_row(gelu, (int16_t *)job->c + i * job->c_stride + col, width);
	}
}

void dvsm_fixed_gemm_vnni(const struct dvsm_fixed_gemm *job)
{
	const bool with_gelu = job->epilogue == DVSM_FIXED_GELU;
	const struct gelu gelu = gelu_prepare(with_gelu ? job->fraction : 0);
	size_t col = 0;

	while (col < job->cols) {
		if (job->cols - col > (PANELS - 1) * DVSM_FIXED_PANEL) {
			walk_rows(PANELS, job, col, with_gelu ? &gelu : NULL);
			col += PANELS * DVSM_FIXED_PANEL;
		} else {
			walk_rows(1, job, col, with_gelu ? &gelu : NULL);
			col += DVSM_FIXED_PANEL;
		}
	}
}
