/* Template: fixed-point products of AVX2 and AVX-VNNI. */
#include "kernels/fixed_avx2.h"

/* Depth of the rows that is prepared at a time. */
#define CHUNK 4096u

/* gelu() of eight saturated numbers. */
static inline __m256i gelu_lanes(__m256i u, int fraction)
{
	const __m256i zero = _mm256_setzero_si256();
	__m256i positive = _mm256_max_epi32(u, zero);

	if (fraction < 2)
		return positive;

	const __m256i most = _mm256_set1_epi32(16383);
	const __m256i limit = _mm256_set1_epi32(16383 >> (12 - fraction));
	__m256i size = _mm256_abs_epi32(u);
	__m256i at = _mm256_sll_epi32(size, _mm_cvtsi32_si128(12 - fraction));

	at = _mm256_blendv_epi8(at, most, _mm256_cmpgt_epi32(size, limit));

	/* A point of the table and the next one, in the two halves of a lane. */
	__m256i points = _mm256_i32gather_epi32((const int *)(const void *)dvsm_fixed_gelu_tail,
						_mm256_srli_epi32(at, 8), 2);
	__m256i tail = _mm256_and_si256(points, _mm256_set1_epi32(0xffff));
	__m256i step = _mm256_sub_epi32(_mm256_srli_epi32(points, 16), tail);
	__m256i share = _mm256_slli_epi32(_mm256_and_si256(at, _mm256_set1_epi32(255)), 7);

	step = _mm256_add_epi32(_mm256_mullo_epi32(step, share), _mm256_set1_epi32(1 << 14));
	tail = _mm256_add_epi32(tail, _mm256_srai_epi32(step, 15));
	tail = _mm256_add_epi32(tail, _mm256_set1_epi32(1 << (16 - fraction)));
	return _mm256_sub_epi32(positive, _mm256_srl_epi32(tail, _mm_cvtsi32_si128(17 - fraction)));
}

/* As AVX-512 does it (fixed_avx512_finish.h): r in 32-bit lanes where the shifts allow. */
struct requantise {
	bool narrow;
	int cut;
};

static struct requantise requantise_prepare(const struct dvsm_fixed_gemm *job)
{
	const int bits = dvsm_fixed_bits((uint64_t)job->depth * 128 * 127);
	const int cut = bits > 15 ? bits - 15 : 0;
	int least = INT16_MAX, most = INT16_MIN;

	for (size_t j = 0; j < job->cols; j++) {
		int shift = job->w_mantissa[j] ? job->w_shift[j] : INT16_MAX;

		least = shift < least ? shift : least;
	}
	for (size_t i = 0; i < job->rows; i++)
		if (job->a_scale[i].mantissa && job->a_scale[i].exponent > most)
			most = job->a_scale[i].exponent;
	return (struct requantise){least - most > 15 + cut, cut};
}

/* r of eight sums, exact in 32 bits. */
static inline __m256i requantise_narrow(const struct requantise *how, __m256i factor, __m256i shift,
					__m256i sums)
{
	const __m256i one = _mm256_set1_epi32(1);
	__m256i words = _mm256_sll_epi32(sums, _mm_cvtsi32_si128(16 - how->cut));

	factor = _mm256_or_si256(factor, _mm256_slli_epi32(factor, 16));
	words = _mm256_blend_epi16(_mm256_mulhi_epu16(words, factor), words, 0xaa);
	words = _mm256_madd_epi16(words, _mm256_blend_epi16(one, factor, 0xaa));
	words = _mm256_srav_epi32(words, _mm256_sub_epi32(shift, _mm256_set1_epi32(16 + how->cut)));
	return _mm256_srai_epi32(_mm256_add_epi32(words, one), 1);
}

/* Eight sums of a row to their place. */
static inline void finish(const struct dvsm_fixed_gemm *job, const struct requantise *how,
			  size_t row, size_t col, __m256i sums)
{
	const struct dvsm_fixed_scale scale = job->a_scale[row];
	const size_t left = job->cols - col, at = row * job->c_stride + col;
	const bool adds = job->epilogue == DVSM_FIXED_ADD;
	__m256i factor = _mm256_mulhrs_epi16(load_s16(job->w_mantissa + col, left),
					     _mm256_set1_epi16(scale.mantissa));
	__m256i shift = _mm256_sub_epi32(load_s16(job->w_shift + col, left),
					 _mm256_set1_epi32(scale.exponent));
	__m256i r;

	if (how->narrow)
		r = requantise_narrow(how, factor, shift, sums);
	else
		r = round_products(sums, _mm256_slli_epi32(factor, 15), clamp_lanes(shift, 1, 62),
				   adds ? 0 : 1 << 15);
	if (adds) {
		int32_t *c = (int32_t *)job->c + at;
		__m256i mask = _mm256_cmpgt_epi32(_mm256_set1_epi32(left < 8 ? (int)left : 8),
						  _mm256_setr_epi32(0, 1, 2, 3, 4, 5, 6, 7));

		r = _mm256_add_epi32(r, _mm256_maskload_epi32(c, mask));
		_mm256_maskstore_epi32(c, mask, r);
		return;
	}
	r = clamp_lanes(r, INT16_MIN, INT16_MAX);
	if (job->epilogue == DVSM_FIXED_GELU)
		r = gelu_lanes(r, job->fraction);
	store_s16((int16_t *)job->c + at, r, left);
}

/* Rows on their way, prepared up to a chunk of their depth. */
struct strip {
	struct row_bytes rows[BYTE_ROWS];
	uint8_t room[BYTE_ROWS][ROW_ROOM(CHUNK)];
};

DVSM_INLINE void prepare(const int rows, const struct dvsm_fixed_gemm *job, size_t row, size_t d,
			 size_t count, struct strip *strip)
{
	for (int i = 0; i < rows; i++)
		strip->rows[i] = row_prepare(job->a + (row + (size_t)i) * job->a_stride + d, count,
					     strip->room[i]);
}

/* `rows` rows (a constant where it is called) with the panel of column `col` on. */
DVSM_INLINE void tile(const int rows, const struct dvsm_fixed_gemm *job,
		      const struct requantise *how, size_t row, size_t col, struct strip *strip)
{
	const int8_t *w = job->panels + col * job->depth;
	__m256i sums[BYTE_ROWS][2], done[BYTE_ROWS][2];

	DVSM_UNROLL
	for (int i = 0; i < rows; i++)
		sums[i][0] = sums[i][1] = _mm256_setzero_si256();
	for (size_t d = 0; d < job->depth; d += CHUNK) {
		size_t count = job->depth - d < CHUNK ? job->depth - d : CHUNK;

		if (job->depth > CHUNK)
			prepare(rows, job, row, d, count, strip);
		DVSM_UNROLL
		for (int i = 0; i < rows; i++) {
			__m256i begin = row_begin(&strip->rows[i]);

			sums[i][0] = _mm256_add_epi32(sums[i][0], begin);
			sums[i][1] = _mm256_add_epi32(sums[i][1], begin);
		}
		dot_bytes(rows, strip->rows, w + d * DVSM_FIXED_PANEL, count / 4, sums);
	}
	DVSM_UNROLL
	for (int i = 0; i < rows; i++) {
		_mm256_store_si256(&done[i][0], sums[i][0]);
		_mm256_store_si256(&done[i][1], sums[i][1]);
	}
	/* By way of memory: unrolled, this much code would push the sums out of their registers. */
	for (int i = 0; i < rows; i++) {
		finish(job, how, row + (size_t)i, col, done[i][0]);
		if (col + 8 < job->cols)
			finish(job, how, row + (size_t)i, col + 8, done[i][1]);
	}
}

/* All columns of `rows` rows: those are prepared once, the weights stream past them. */
DVSM_INLINE void walk_columns(const int rows, const struct dvsm_fixed_gemm *job,
			      const struct requantise *how, size_t row)
{
	struct strip strip;

	prepare(rows, job, row, 0, job->depth < CHUNK ? job->depth : CHUNK, &strip);
	for (size_t col = 0; col < job->cols; col += DVSM_FIXED_PANEL)
		tile(rows, job, how, row, col, &strip);
}

static void gemm(const struct dvsm_fixed_gemm *job)
{
	const struct requantise how = requantise_prepare(job);
	size_t row = 0;

	for (; row + BYTE_ROWS <= job->rows; row += BYTE_ROWS)
		walk_columns(BYTE_ROWS, job, &how, row);
	if (BYTE_ROWS > 4 && row + 4 <= job->rows) {
		walk_columns(4, job, &how, row);
		row += 4;
	}
	for (; row < job->rows; row++)
		walk_columns(1, job, &how, row);
}
