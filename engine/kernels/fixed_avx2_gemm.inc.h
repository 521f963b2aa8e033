/* Template: fixed-point products of AVX2 and AVX-VNNI. */
#include "kernels/fixed_avx2.h"
#include "kernels/fixed_strip.inc.h"

/* GELU's table and its steps as bytes, the lower ones and the upper ones, 16 numbers a vector. */
struct gelu {
	int fraction;
	__m256i low[4], high[4], step_low[4], step_high[4];
};

static struct gelu gelu_prepare(int fraction)
{
	uint8_t bytes[4][64];
	struct gelu gelu = {.fraction = fraction};

	if (fraction < 2) /* there is nothing to look up */
		return gelu;
	/* Half a unit of the result goes with the table. */
	for (int i = 0; i < 64; i++) {
		const int at = dvsm_fixed_gelu_tail[i];
		const unsigned step = (unsigned)(dvsm_fixed_gelu_tail[i + 1] - at);
		const unsigned tail = (unsigned)at + (1u << (16 - fraction));

		bytes[0][i] = (uint8_t)tail;
		bytes[1][i] = (uint8_t)(tail >> 8);
		bytes[2][i] = (uint8_t)step;
		bytes[3][i] = (uint8_t)(step >> 8);
	}
	for (int i = 0; i < 4; i++) {
		__m256i *planes[4] = {&gelu.low[i], &gelu.high[i], &gelu.step_low[i],
				      &gelu.step_high[i]};

		for (int plane = 0; plane < 4; plane++)
			*planes[plane] = _mm256_broadcastsi128_si256(
				_mm_loadu_si128((const __m128i *)(bytes[plane] + 16 * i)));
	}
	return gelu;
}

/* Where in the table 16 saturated numbers lie, with 8 bits behind the point. */
static inline __m256i gelu_at(__m256i u, int fraction)
{
	const __m256i limit = _mm256_set1_epi16((int16_t)(16383 >> (12 - fraction)));

	return _mm256_sll_epi16(_mm256_min_epu16(_mm256_abs_epi16(u), limit),
				_mm_cvtsi32_si128(12 - fraction));
}

/* max(u, 0) less the table's number and the share of its step. */
static inline __m256i gelu_words(__m256i u, __m256i at, __m256i tail, __m256i step, int fraction)
{
	__m256i share = _mm256_slli_epi16(_mm256_and_si256(at, _mm256_set1_epi16(255)), 7);

	tail = _mm256_add_epi16(tail, _mm256_mulhrs_epi16(step, share));
	return _mm256_sub_epi16(_mm256_max_epi16(u, _mm256_setzero_si256()),
				_mm256_srl_epi16(tail, _mm_cvtsi32_si128(17 - fraction)));
}

/*
 * dvsm_fixed_gelu() of 32 numbers, fraction 2 at least. Beyond the table its last number counts
 * whose place the shift can write: less than half a unit of the result, as what belongs there.
 *
 * vpshufb looks up 16 bytes by the last four bits of a place, and gives 0 where the first is set.
 * To add 0x70 sets it for all places but 0..15.
 */
static inline void gelu_lanes(const struct gelu *gelu, __m256i u[2])
{
	const __m256i beyond = _mm256_set1_epi8(0x70);
	__m256i at[2] = {gelu_at(u[0], gelu->fraction), gelu_at(u[1], gelu->fraction)};
	__m256i index =
		_mm256_packus_epi16(_mm256_srli_epi16(at[0], 8), _mm256_srli_epi16(at[1], 8));
	__m256i low = _mm256_setzero_si256(), high = low, step_low = low, step_high = low;

	DVSM_UNROLL
	for (int i = 0; i < 4; i++) {
		__m256i here = _mm256_xor_si256(index, _mm256_set1_epi8((char)(16 * i)));

		here = _mm256_adds_epu8(here, beyond);
		low = _mm256_or_si256(low, _mm256_shuffle_epi8(gelu->low[i], here));
		high = _mm256_or_si256(high, _mm256_shuffle_epi8(gelu->high[i], here));
		step_low = _mm256_or_si256(step_low, _mm256_shuffle_epi8(gelu->step_low[i], here));
		step_high =
			_mm256_or_si256(step_high, _mm256_shuffle_epi8(gelu->step_high[i], here));
	}
	u[0] = gelu_words(u[0], at[0], _mm256_unpacklo_epi8(low, high),
			  _mm256_unpacklo_epi8(step_low, step_high), gelu->fraction);
	u[1] = gelu_words(u[1], at[1], _mm256_unpackhi_epi8(low, high),
			  _mm256_unpackhi_epi8(step_low, step_high), gelu->fraction);
}

/* A row to its GELU, in place. */
static void gelu_row(const struct gelu *gelu, int16_t *c, size_t count)
{
	size_t j = 0;

	for (; gelu->fraction >= 2 && j + 32 <= count; j += 32) {
		__m256i *at = (__m256i *)(c + j);
		__m256i u[2] = {_mm256_loadu_si256(at), _mm256_loadu_si256(at + 1)};

		gelu_lanes(gelu, u);
		_mm256_storeu_si256(at, u[0]);
		_mm256_storeu_si256(at + 1, u[1]);
	}
	for (; j < count; j++)
		c[j] = dvsm_fixed_gelu(c[j], gelu->fraction);
}

/* The sixteen columns of a panel: the mantissas of their scales, twice in each lane, and shifts. */
struct columns {
	__m256i mantissa[2], shift[2];
	size_t count;
};

static struct columns load_columns(const struct dvsm_fixed_gemm *job, size_t col)
{
	const size_t left = job->cols - col;
	const size_t count = left < DVSM_FIXED_PANEL ? left : DVSM_FIXED_PANEL;
	int16_t mantissas[DVSM_FIXED_PANEL] = {0}, shifts[DVSM_FIXED_PANEL] = {0};
	struct columns columns = {.count = count};

	memcpy(mantissas, job->w_mantissa + col, count * sizeof(*mantissas));
	memcpy(shifts, job->w_shift + col, count * sizeof(*shifts));
	for (size_t i = 0; i < 2; i++) {
		__m256i mantissa = load_s16(mantissas + 8 * i, 8);

		columns.mantissa[i] = _mm256_or_si256(mantissa, _mm256_slli_epi32(mantissa, 16));
		columns.shift[i] = load_s16(shifts + 8 * i, 8);
	}
	return columns;
}

/* r of eight sums, exact in 32 bits; factors are twice in each lane. */
static inline __m256i requantise_narrow(const struct requantise *how, __m256i factor, __m256i shift,
					__m256i sums)
{
	const __m256i one = _mm256_set1_epi32(1);
	__m256i words = _mm256_sll_epi32(sums, _mm_cvtsi32_si128(16 - how->cut));

	words = _mm256_blend_epi16(_mm256_mulhi_epu16(words, factor), words, 0xaa);
	words = _mm256_madd_epi16(words, _mm256_blend_epi16(one, factor, 0xaa));
	words = _mm256_srav_epi32(words, _mm256_sub_epi32(shift, _mm256_set1_epi32(16 + how->cut)));
	return _mm256_srai_epi32(_mm256_add_epi32(words, one), 1);
}

/* r of eight sums: modulo 2^32, or as int16 saturates it. */
static inline __m256i requantise(const struct requantise *how, bool adds, __m256i factor,
				 __m256i shift, __m256i sums)
{
	if (how->narrow)
		return requantise_narrow(how, factor, shift, sums);
	factor = _mm256_slli_epi32(_mm256_srli_epi32(factor, 16), 15);
	return round_products(sums, factor, clamp_lanes(shift, 1, 62), adds ? 0 : 1 << 15);
}

/* r added to sixteen numbers, or `count` of them. */
static inline void add_row(int32_t *c, const __m256i r[2], size_t count)
{
	int32_t part[DVSM_FIXED_PANEL];
	int32_t *to = count < DVSM_FIXED_PANEL ? memcpy(part, c, count * sizeof(*c)) : c;

	for (size_t i = 0; i < 2; i++) {
		__m256i *at = (__m256i *)(to + 8 * i);

		_mm256_storeu_si256(at, _mm256_add_epi32(_mm256_loadu_si256(at), r[i]));
	}
	if (count < DVSM_FIXED_PANEL)
		memcpy(c, part, count * sizeof(*c));
}

/* r, saturated, as sixteen numbers, or `count` of them. */
static inline void store_row(int16_t *c, const __m256i r[2], size_t count)
{
	__m256i words = _mm256_permute4x64_epi64(_mm256_packs_epi32(r[0], r[1]), 0xd8);

	if (count < DVSM_FIXED_PANEL)
		memcpy(c, &words, count * sizeof(*c));
	else
		_mm256_storeu_si256((__m256i *)c, words);
}

/* Sixteen sums of a row to their place. */
static inline void finish(const struct dvsm_fixed_gemm *job, const struct requantise *how,
			  const struct columns *columns, size_t row, size_t col,
			  const __m256i sums[2])
{
	const struct dvsm_fixed_scale scale = job->a_scale[row];
	const __m256i mantissa = _mm256_set1_epi16(scale.mantissa);
	const __m256i exponent = _mm256_set1_epi32(scale.exponent);
	const size_t at = row * job->c_stride + col;
	const bool adds = job->epilogue == DVSM_FIXED_ADD;
	__m256i r[2];

	for (int i = 0; i < 2; i++)
		r[i] = requantise(how, adds, _mm256_mulhrs_epi16(columns->mantissa[i], mantissa),
				  _mm256_sub_epi32(columns->shift[i], exponent), sums[i]);
	if (adds)
		add_row((int32_t *)job->c + at, r, columns->count);
	else
		store_row((int16_t *)job->c + at, r, columns->count);
}

/* Columns `col` and on of `rows` rows (a constant where it is called), the strip's from `at` on. */
DVSM_INLINE void tile(const int rows, const struct dvsm_fixed_gemm *job,
		      const struct requantise *how, const struct columns *columns, size_t row,
		      size_t col, struct strip *strip, size_t at)
{
	const int8_t *w = job->panels + col * job->depth;
	__m256i sums[BYTE_ROWS][2], done[BYTE_ROWS][2];

	DVSM_UNROLL
	for (int i = 0; i < rows; i++)
		sums[i][0] = sums[i][1] = _mm256_setzero_si256();
	for (size_t d = 0; d < job->depth; d += CHUNK) {
		size_t count = job->depth - d < CHUNK ? job->depth - d : CHUNK;

		if (job->depth > CHUNK)
			prepare(job, row, at, (size_t)rows, d, count, strip);
		DVSM_UNROLL
		for (int i = 0; i < rows; i++) {
			__m256i begin = row_begin(&strip->rows[at + (size_t)i]);

			sums[i][0] = _mm256_add_epi32(sums[i][0], begin);
			sums[i][1] = _mm256_add_epi32(sums[i][1], begin);
		}
		dot_bytes(rows, strip->rows + at, w + d * DVSM_FIXED_PANEL, count / 4, sums);
	}
	DVSM_UNROLL
	for (int i = 0; i < rows; i++) {
		_mm256_store_si256(&done[i][0], sums[i][0]);
		_mm256_store_si256(&done[i][1], sums[i][1]);
	}
	/* By way of memory: unrolled, this much code would push the sums out of their registers. */
	for (int i = 0; i < rows; i++)
		finish(job, how, columns, row + (size_t)i, col, done[i]);
}

/* The rows of a strip, `first` and on, with all columns: a panel of weights stays in the cache
 * while they pass. */
static void walk_strip(const struct dvsm_fixed_gemm *job, const struct requantise *how,
		       size_t first, size_t rows, struct strip *strip)
{
	if (job->depth <= CHUNK)
		prepare(job, first, 0, rows, 0, job->depth, strip);
	for (size_t col = 0; col < job->cols; col += DVSM_FIXED_PANEL) {
		const struct columns columns = load_columns(job, col);
		size_t i = 0;

		for (; i + BYTE_ROWS <= rows; i += BYTE_ROWS)
			tile(BYTE_ROWS, job, how, &columns, first + i, col, strip, i);
		if (BYTE_ROWS > 4 && i + 4 <= rows) {
			tile(4, job, how, &columns, first + i, col, strip, i);
			i += 4;
		}
		for (; i < rows; i++)
			tile(1, job, how, &columns, first + i, col, strip, i);
	}
}

static void gemm(const struct dvsm_fixed_gemm *job)
{
	const bool with_gelu = job->epilogue == DVSM_FIXED_GELU;
	const struct gelu gelu = gelu_prepare(with_gelu ? job->fraction : 0);
	const struct requantise how = requantise_prepare(job);
	const size_t step = strip_rows(job);
	struct strip strip;

	for (size_t row = 0; row < job->rows; row += step) {
		const size_t rows = job->rows - row < step ? job->rows - row : step;

		walk_strip(job, &how, row, rows, &strip);
		for (size_t i = row; with_gelu && i < row + rows; i++)
			gelu_row(&gelu, (int16_t *)job->c + i * job->c_stride, job->cols);
	}
}
