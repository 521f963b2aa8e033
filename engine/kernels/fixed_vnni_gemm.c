/*
 * Fixed-point products for AVX-512 VNNI.
 *
 * vpdpbusd multiplies unsigned by signed bytes. A's numbers are the unsigned ones, 128 too large: a
 * strip of rows is copied so, and 128 times the sum of a column's weights is taken off where a sum
 * begins.
 */
#include "kernels/fixed_avx512_finish.h"
#include "kernels/fixed_tiers.h"
#include "kernels/tier.h"

/* 32 registers: 24 sums, 3 weights. */
#define ROWS   8
#define PANELS 3

/* Most rows of a strip, and its bytes: one row of the greatest depth. */
#define STRIP      64u
#define STRIP_ROOM 65536u

/* Rows of A, 128 more each number, `depth` bytes apart. */
static void copy_rows(const struct dvsm_fixed_gemm *job, size_t row, size_t rows, uint8_t *strip)
{
	const __m512i flip = _mm512_set1_epi8(INT8_MIN);

	for (size_t i = 0; i < rows; i++) {
		const int8_t *a = job->a + (row + i) * job->a_stride;

		for (size_t d = 0; d < job->depth; d += 64)
			_mm512_store_si512(strip + i * job->depth + d,
					   _mm512_xor_si512(_mm512_loadu_si512(a + d), flip));
	}
}

static inline __m512i broadcast(const uint8_t *a)
{
	int four;

	memcpy(&four, a, sizeof(four));
	return _mm512_set1_epi32(four);
}

/* Sixteen sums of a row to their place. */
DVSM_INLINE void finish(const struct dvsm_fixed_gemm *job, const struct requantise *how,
			const struct row_lanes *scale, size_t row, size_t col,
			const struct columns *columns, __m512i sums)
{
	size_t at = row * job->c_stride + col;

	if (job->epilogue == DVSM_FIXED_ADD) {
		int32_t *c = (int32_t *)job->c + at;
		__m512i before = _mm512_maskz_loadu_epi32(columns->lanes, c);
		__m512i r = requantise(how->way, true, how, scale, columns, sums);

		_mm512_mask_storeu_epi32(c, columns->lanes, _mm512_add_epi32(before, r));
	} else {
		__m512i r = requantise(how->way, false, how, scale, columns, sums);

		_mm512_mask_cvtsepi32_storeu_epi16((int16_t *)job->c + at, columns->lanes, r);
	}
}

/* A row's columns to their GELU, in place. */
static void gelu_row(const struct gelu *gelu, int16_t *c, size_t count)
{
	for (size_t j = 0; j < count; j += 32) {
		__mmask32 lanes = count - j >= 32 ? 0xffffffffu : (1u << (count - j)) - 1;
		__m512i u = _mm512_maskz_loadu_epi16(lanes, c + j);

		_mm512_mask_storeu_epi16(c + j, lanes, gelu_lanes(gelu, u));
	}
}

/* `rows` x `panels` (constants where it is called) from row and column `row`, `col` on; `a` is the
 * row in its strip, `begin` what the columns' sums begin with. */
DVSM_INLINE void tile(const int rows, const int panels, const struct dvsm_fixed_gemm *job,
		      const struct requantise *how, const uint8_t *a, size_t row, size_t col,
		      const __m512i begin[PANELS], const struct columns columns[PANELS])
{
	const int8_t *w = job->panels + col * job->depth;
	const size_t panel_bytes = DVSM_FIXED_PANEL * job->depth;
	__m512i sums[ROWS][PANELS], done[ROWS][PANELS];
	struct row_scales scales;

	DVSM_UNROLL
	for (int i = 0; i < rows; i++) {
		DVSM_UNROLL
		for (int j = 0; j < panels; j++)
			sums[i][j] = begin[j];
	}
	for (size_t d = 0; d < job->depth; d += 4) {
		__m512i b[PANELS];

		DVSM_UNROLL
		for (int j = 0; j < panels; j++)
			b[j] = _mm512_load_si512(w + (size_t)j * panel_bytes +
						 d * DVSM_FIXED_PANEL);
		DVSM_UNROLL
		for (int i = 0; i < rows; i++) {
			__m512i x = broadcast(a + (size_t)i * job->depth + d);

			DVSM_UNROLL
			for (int j = 0; j < panels; j++)
				sums[i][j] = _mm512_dpbusd_epi32(sums[i][j], x, b[j]);
		}
	}
	DVSM_UNROLL
	for (int i = 0; i < rows; i++) {
		DVSM_UNROLL
		for (int j = 0; j < panels; j++)
			_mm512_store_si512(&done[i][j], sums[i][j]);
	}
	/* By way of memory: unrolled, this much code would push the sums out of their registers. */
	prepare_rows(how, job->a_scale + row, (size_t)rows, &scales);
	for (int i = 0; i < rows; i++) {
		const struct row_lanes scale = load_row(&scales, (size_t)i);

		for (int j = 0; j < panels; j++)
			finish(job, how, &scale, row + (size_t)i,
			       col + (size_t)j * DVSM_FIXED_PANEL, &columns[j], done[i][j]);
	}
}

/* What the sums of a panel begin with: -128 times its columns' sums. */
static inline __m512i load_begin(const struct dvsm_fixed_gemm *job, size_t col)
{
	const __mmask16 lanes = col < job->cols ? first_lanes(job->cols - col) : 0;
	__m512i sums = _mm512_maskz_loadu_epi32(lanes, job->w_sum + col);

	return _mm512_sub_epi32(_mm512_setzero_si512(), _mm512_slli_epi32(sums, 7));
}

/* The rows of a strip, of `panels` panels. */
DVSM_INLINE void walk_rows(const int panels, const struct dvsm_fixed_gemm *job,
			   const struct requantise *how, const uint8_t *strip, size_t first,
			   size_t rows, size_t col, const struct gelu *gelu)
{
	struct columns columns[PANELS];
	__m512i begin[PANELS];
	size_t left = job->cols - col, full = (size_t)panels * DVSM_FIXED_PANEL;
	size_t width = left < full ? left : full;

	for (int j = 0; j < panels; j++) {
		columns[j] = load_columns(job, col + (size_t)j * DVSM_FIXED_PANEL);
		begin[j] = load_begin(job, col + (size_t)j * DVSM_FIXED_PANEL);
	}
	for (size_t i = 0, step; i < rows; i += step) {
		const uint8_t *a = strip + i * job->depth;
		const size_t row = first + i;

		left = rows - i;
		step = left >= ROWS ? ROWS : left >= 4 ? 4 : 1;
		if (step == ROWS)
			tile(ROWS, panels, job, how, a, row, col, begin, columns);
		else if (step == 4)
			tile(4, panels, job, how, a, row, col, begin, columns);
		else
			tile(1, panels, job, how, a, row, col, begin, columns);
		for (size_t k = row; gelu && k < row + step; k++)
			gelu_row(gelu, (int16_t *)job->c + k * job->c_stride + col, width);
	}
}

static void walk_strip(const struct dvsm_fixed_gemm *job, const struct requantise *how,
		       const uint8_t *strip, size_t first, size_t rows, const struct gelu *gelu)
{
	size_t col = 0;

	while (col < job->cols) {
		if (job->cols - col > (PANELS - 1) * DVSM_FIXED_PANEL) {
			walk_rows(PANELS, job, how, strip, first, rows, col, gelu);
			col += PANELS * DVSM_FIXED_PANEL;
		} else {
			walk_rows(1, job, how, strip, first, rows, col, gelu);
			col += DVSM_FIXED_PANEL;
		}
	}
}

void dvsm_fixed_gemm_vnni(const struct dvsm_fixed_gemm *job)
{
	_Alignas(64) uint8_t strip[STRIP_ROOM];
	const bool with_gelu = job->epilogue == DVSM_FIXED_GELU;
	const struct gelu gelu = gelu_prepare(with_gelu ? job->fraction : 0);
	const struct requantise how = requantise_prepare(job);
	const size_t most = STRIP * job->depth > STRIP_ROOM ? STRIP_ROOM / job->depth : STRIP;
	const size_t step = most > ROWS ? most / ROWS * ROWS : most;

	for (size_t row = 0; row < job->rows; row += step) {
		const size_t rows = job->rows - row < step ? job->rows - row : step;

		copy_rows(job, row, rows, strip);
		walk_strip(job, &how, strip, row, rows, with_gelu ? &gelu : NULL);
	}
}
