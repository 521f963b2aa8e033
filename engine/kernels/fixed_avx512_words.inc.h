/*
 * Rows of int16 to int8 and QK-norm, several rows at a time, of which each is a lane where scales
 * are made. Included by fixed_avx512.c.
 *
 * While the numbers of some rows are written, the scales of the next are found: their long chains
 * of few operations fill the gaps.
 */

static inline __m512i load_s16(const int16_t *p, __mmask32 lanes)
{
	return lanes == 0xffffffff ? _mm512_loadu_si512(p) : _mm512_maskz_loadu_epi16(lanes, p);
}

static inline size_t rows_from(size_t first, size_t rows, size_t most)
{
	return rows - first < most ? rows - first : most;
}

/* 64 words, packed to bytes with saturation, and their quarters in order again. */
static inline __m512i pack_words(__m512i a, __m512i b)
{
	const __m512i order = _mm512_setr_epi64(0, 2, 4, 6, 1, 3, 5, 7);

	return _mm512_permutexvar_epi64(order, _mm512_packs_epi16(a, b));
}

/* ---- int16 to int8 ---- */

/* Of these rows of a hidden layer both passes find x in the first-level cache. */
#define FIT_ROWS 8u

struct fit_rows {
	int32_t shift[ROWS], inverse[ROWS]; /* twice, for two words */
};

static __m512i twice(__m512i a)
{
	return _mm512_or_si512(a, _mm512_slli_epi32(a, 16));
}

static __m512i largest_of(const int16_t *x, size_t stride, size_t rows, size_t dim)
{
	__m512i sizes[ROWS] = {0};

	for (size_t i = 0; i < rows; i++, x += stride) {
		__m512i largest = _mm512_setzero_si512(), a;
		size_t d = 0;

		for (; d + 32 <= dim; d += 32) {
			a = _mm512_loadu_si512(x + d);
			largest = _mm512_max_epu16(largest, _mm512_abs_epi16(a));
		}
		a = _mm512_maskz_loadu_epi16(first_words(dim - d), x + d);
		largest = _mm512_max_epu16(largest, _mm512_abs_epi16(a));
		sizes[i] = _mm512_max_epu32(_mm512_srli_epi32(largest, 16),
					    _mm512_and_si512(largest, _mm512_set1_epi32(0xffff)));
	}
	return _mm512_min_epi32(fold_rows(sizes, max_s32), _mm512_set1_epi32(INT16_MAX));
}

/* dvsm_fixed_fit_make() of some rows, whose scales are stored. */
static struct fit_rows fit_rows_make(const struct dvsm_fixed_quantise *job, size_t first)
{
	const size_t rows = rows_from(first, job->rows, FIT_ROWS);
	const __m512i largest =
		largest_of(job->x + first * job->x_stride, job->x_stride, rows, job->dim);
	const __mmask16 some = _mm512_test_epi32_mask(largest, largest);
	const __m512i size = float_make(largest);
	const __m512i shift = _mm512_sub_epi32(_mm512_set1_epi32(15), float_bits(size));
	const __m512i inverse =
		_mm512_maskz_mov_epi32(some, float_inverse(float_shift(size, shift)));
	const __m512i exponent =
		_mm512_sub_epi32(_mm512_set1_epi32(-job->fraction), shift);
	struct fit_rows fit;

	_mm512_storeu_si512(fit.shift, twice(shift));
	_mm512_storeu_si512(fit.inverse, twice(inverse));
	scale_lanes_store(scale_lanes_shift(scale_lanes_inverse(inverse), exponent),
			  job->a_scale + first, rows);
	return fit;
}

static void write_fit(const struct dvsm_fixed_quantise *job, size_t first,
		      const struct fit_rows *fit)
{
	const size_t rows = rows_from(first, job->rows, FIT_ROWS);
	const size_t dim = job->dim, filled = dvsm_fixed_pad(dim, GROUP);

	for (size_t i = 0; i < rows; i++) {
		const __m512i inverse = _mm512_set1_epi32(fit->inverse[i]);
		const __m512i shift = _mm512_set1_epi32(fit->shift[i]);
		const int16_t *x = job->x + (first + i) * job->x_stride;
		int8_t *to = job->a + (first + i) * job->a_stride;

		for (size_t d = 0; d < dim; d += GROUP) {
			const bool whole = d + GROUP <= dim;
			__m512i a = load_s16(x + d, whole ? ~0u : first_words(dim - d)), b;
			
			b = load_s16(x + d + 32, lanes >> 32);
			a = _mm512_mulhrs_epi16(_mm512_sllv_epi16(a, shift), inverse);
			b = _mm512_mulhrs_epi16(_mm512_sllv_epi16(b, shift), inverse);
			_mm512_storeu_si512(to + d, pack_words(a, b));
		}
		memset(to + filled, 0, job->a_stride - filled);
	}
}
