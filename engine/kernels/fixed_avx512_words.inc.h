/*
 * Rows of int16 to int8, and QK-norm, some rows at a time: their scales are made with a row in each
 * lane. Included by fixed_avx512.c.
 *
 * The scales of the next rows are found before the numbers of some are written: the long chains of
 * the one fill the gaps of the other.
 */

/* To bytes, with saturation. */
static inline __m512i pack_pair(struct pair pair)
{
	return in_order_of_two(_mm512_packs_epi16(pair.a, pair.b));
}

/* Numbers of 16 bits for both words of their lanes. */
static inline __m512i in_both_words(__m512i a)
{
	return _mm512_or_si512(a, _mm512_slli_epi32(a, 16));
}

/* ---- int16 to int8 ---- */

/* In both words: a = R((x << shift) inverse, 15). */
struct fit_rows {
	int32_t shift[ROWS], inverse[ROWS];
};

static __m512i find_largest(const int16_t *x, size_t stride, size_t rows, size_t dim)
{
	const __m512i word = _mm512_set1_epi32(0xffff);
	__m512i sizes[ROWS];

	clear_rows(sizes, rows);
	for (size_t i = 0; i < rows; i++, x += stride) {
		__m512i first = _mm512_setzero_si512(), second = first;

		for (size_t d = 0; d < dim; d += GROUP) {
			const struct pair pair = load_up_to(x + d, dim - d);

			first = _mm512_max_epu16(first, _mm512_abs_epi16(pair.a));
			second = _mm512_max_epu16(second, _mm512_abs_epi16(pair.b));
		}
		first = _mm512_max_epu16(first, second);
		sizes[i] = _mm512_max_epu32(_mm512_srli_epi32(first, 16),
					    _mm512_and_si512(first, word));
	}
	return _mm512_min_epu32(fold_rows(sizes, max_s32), _mm512_set1_epi32(INT16_MAX));
}

/* dvsm_fixed_fit_make() of the rows from `first` on. */
static void fit_some(const struct dvsm_fixed_quantise *job, size_t first, struct fit_rows *fit)
{
	const size_t rows = count_from(first, job->rows, ROWS);
	const __m512i largest =
		find_largest(job->x + first * job->x_stride, job->x_stride, rows, job->dim);
	const __mmask16 some = _mm512_test_epi32_mask(largest, largest);
	const __m512i size = float_make(largest);
	const __m512i shift = _mm512_sub_epi32(_mm512_set1_epi32(15), float_bits(size));
	const __m512i inverse =
		_mm512_maskz_mov_epi32(some, float_inverse(float_shift(size, shift)));
	const __m512i exponent = _mm512_sub_epi32(_mm512_set1_epi32(-job->fraction), shift);

	_mm512_storeu_si512(fit->shift, in_both_words(shift));
	_mm512_storeu_si512(fit->inverse, in_both_words(inverse));
	scale_lanes_store(scale_lanes_shift(scale_lanes_inverse(inverse), exponent),
			  job->a_scale + first, rows);
}

static void write_fit(const struct dvsm_fixed_quantise *job, size_t first,
		      const struct fit_rows *fit)
{
	const size_t rows = count_from(first, job->rows, ROWS), dim = job->dim;
	const size_t filled = dvsm_fixed_pad(dim, GROUP);

	for (size_t i = 0; i < rows; i++) {
		const __m512i shift = _mm512_set1_epi32(fit->shift[i]);
		const __m512i inverse = _mm512_set1_epi32(fit->inverse[i]);
		const int16_t *x = job->x + (first + i) * job->x_stride;
		int8_t *a = job->a + (first + i) * job->a_stride;

		for (size_t d = 0; d < dim; d += GROUP) {
			struct pair pair = load_up_to(x + d, dim - d);

			pair.a = _mm512_mulhrs_epi16(_mm512_sllv_epi16(pair.a, shift), inverse);
			pair.b = _mm512_mulhrs_epi16(_mm512_sllv_epi16(pair.b, shift), inverse);
			_mm512_storeu_si512(a + d, pack_pair(pair));
		}
		memset(a + filled, 0, job->a_stride - filled);
	}
}

static void quantise(const struct dvsm_fixed_quantise *job)
{
	struct fit_rows fits[2];

	if (job->rows > 0)
		fit_some(job, 0, &fits[0]);
	for (size_t i = 0, at = 0; i < job->rows; i += ROWS, at ^= 1) {
		if (job->rows - i > ROWS)
			fit_some(job, i + ROWS, &fits[at ^ 1]);
		write_fit(job, i, &fits[at]);
	}
}

/* ---- int16 to two planes ---- */

static inline struct pair shift_pair(struct pair x, __m512i up)
{
	return (struct pair){_mm512_sllv_epi16(x.a, up), _mm512_sllv_epi16(x.b, up)};
}

/* min(R(x, 8), 127) */
static inline __m512i top_words(__m512i x)
{
	const __m512i one = _mm512_set1_epi16(1);

	x = _mm512_srai_epi16(_mm512_add_epi16(_mm512_srai_epi16(x, 7), one), 1);
	return _mm512_min_epi16(x, _mm512_set1_epi16(127));
}

/* R(x - 256 top, 4) */
static inline __m512i rest_words(__m512i x, __m512i top)
{
	const __m512i rest = _mm512_sub_epi16(x, _mm512_slli_epi16(top, 8));

	return _mm512_srai_epi16(_mm512_add_epi16(rest, _mm512_set1_epi16(8)), 4);
}

static void split_row(const int16_t *x, size_t dim, int up, int8_t *high, int8_t *low)
{
	const __m512i by = _mm512_set1_epi16((int16_t)up);

	for (size_t d = 0; d < dim; d += GROUP) {
		const struct pair u = shift_pair(load_up_to(x + d, dim - d), by);
		const struct pair top = {top_words(u.a), top_words(u.b)};
		const struct pair rest = {rest_words(u.a, top.a), rest_words(u.b, top.b)};

		_mm512_storeu_si512(high + d, pack_pair(top));
		_mm512_storeu_si512(low + d, pack_pair(rest));
	}
}

static void split(const struct dvsm_fixed_split *job)
{
	const size_t filled = dvsm_fixed_pad(job->dim, GROUP), rest = job->plane - filled;
	int32_t largest[ROWS];

	for (size_t i = 0; i < job->rows; i++) {
		const int16_t *x = job->x + i * job->x_stride;
		int8_t *high = job->planes + 2 * i * job->plane, *low = high + job->plane;

		if (i % ROWS == 0)
			_mm512_storeu_si512(largest,
					    find_largest(x, job->x_stride,
							 count_from(i, job->rows, ROWS), job->dim));

		const int up = 15 - dvsm_fixed_bits((uint32_t)largest[i % ROWS]);

		split_row(x, job->dim, up, high, low);
		memset(high + filled, 0, rest);
		memset(low + filled, 0, rest);
		job->a_scale[i] = dvsm_fixed_split_scale(up, job->fraction);
	}
}

/* ---- QK-norm ---- */

/* Two squares are 2^31 at most, as 32 bits without a sign hold. */
static inline __m512i add_squares(__m512i squares, struct pair u)
{
	squares = add_wide(squares, _mm512_madd_epi16(u.a, u.a));
	return add_wide(squares, _mm512_madd_epi16(u.b, u.b));
}

/* The sum of squares of each row, and epsilon. */
static inline struct wide sum_squares(const __m512i sums[ROWS], int64_t epsilon)
{
	const __m512i more = _mm512_set1_epi64(epsilon);
	const struct wide squares = sum_wide_rows(sums);

	return (struct wide){_mm512_add_epi64(squares.even, more),
			     _mm512_add_epi64(squares.odd, more)};
}

/* ---- queries ---- */

/* 64 numbers of a gain, for the products with the lower and with the upper words of lanes. */
struct query_gain {
	__m512i low[2], high[2];
};

static inline struct query_gain load_query_gain(const int16_t *gain, __mmask64 lanes)
{
	const __m512i word = _mm512_set1_epi32(0xffff);
	const struct pair pair = load_pair(gain, lanes);

	return (struct query_gain){
		{_mm512_and_si512(pair.a, word), _mm512_and_si512(pair.b, word)},
		{_mm512_andnot_si512(word, pair.a), _mm512_andnot_si512(word, pair.b)},
	};
}

/* Some rows of one head. */
struct query_rows {
	const int16_t *u;
	size_t u_stride, count;
	int8_t *q;
	size_t q_stride;
};

/* y' = (y + half) << up >> 16 of 16 bits; inverse in both words. */
struct query_factors {
	int32_t half[ROWS], up[ROWS], inverse[ROWS];
};

DVSM_INLINE void measure_queries(const struct query_rows *rows, size_t d,
				 const struct query_gain *gain, __mmask64 lanes,
				 __m512i squares[ROWS], __m512i largest[ROWS])
{
	const int16_t *x = rows->u + d;

	for (size_t i = 0; i < rows->count; i++, x += rows->u_stride) {
		const struct pair u = load_pair(x, lanes);
		__m512i a = _mm512_abs_epi32(_mm512_madd_epi16(u.a, gain->low[0]));
		__m512i b = _mm512_abs_epi32(_mm512_madd_epi16(u.a, gain->high[0]));
		__m512i c = _mm512_abs_epi32(_mm512_madd_epi16(u.b, gain->low[1]));
		__m512i e = _mm512_abs_epi32(_mm512_madd_epi16(u.b, gain->high[1]));

		a = _mm512_max_epi32(_mm512_max_epi32(a, b), _mm512_max_epi32(c, e));
		largest[i] = d > 0 ? _mm512_max_epi32(largest[i], a) : a;
		squares[i] = add_squares(d > 0 ? squares[i] : _mm512_setzero_si512(), u);
	}
}

/* R(y, shift) of 32 products of words to 16 bits each. */
static inline __m512i narrow_words(__m512i u, __m512i low_gain, __m512i high_gain, __m512i half,
				   __m512i up)
{
	/* Upper words to the lower ones' places. */
	const __m512i upper = _mm512_set4_epi32(0x0f0e0f0e, 0x0b0a0b0a, 0x07060706, 0x03020302);
	__m512i low = _mm512_madd_epi16(u, low_gain), high = _mm512_madd_epi16(u, high_gain);

	low = _mm512_sllv_epi32(_mm512_add_epi32(low, half), up);
	high = _mm512_sllv_epi32(_mm512_add_epi32(high, half), up);
	return _mm512_mask_shuffle_epi8(high, 0x3333333333333333, low, upper);
}

DVSM_INLINE void write_queries(const struct query_rows *rows, size_t d,
			       const struct query_gain *gain, __mmask64 lanes, __mmask64 to,
			       const struct query_factors *by)
{
	const int16_t *x = rows->u + d;
	int8_t *q = rows->q + d;

	for (size_t i = 0; i < rows->count; i++, x += rows->u_stride, q += rows->q_stride) {
		const __m512i half = _mm512_set1_epi32(by->half[i]);
		const __m512i up = _mm512_set1_epi32(by->up[i]);
		const __m512i inverse = _mm512_set1_epi32(by->inverse[i]);
		struct pair u = load_pair(x, lanes);

		u.a = narrow_words(u.a, gain->low[0], gain->high[0], half, up);
		u.b = narrow_words(u.b, gain->low[1], gain->high[1], half, up);
		u.a = _mm512_mulhrs_epi16(u.a, inverse);
		u.b = _mm512_mulhrs_epi16(u.b, inverse);
		if (to == ALL_LANES)
			_mm512_storeu_si512(q, pack_pair(u));
		else
			_mm512_mask_storeu_epi8(q, to, pack_pair(u));
	}
}

static struct query_rows query_rows_of(const struct dvsm_fixed_queries *job, size_t head,
				       size_t first)
{
	return (struct query_rows){
		.u = job->u + first * job->u_stride + head * job->dim,
		.u_stride = job->u_stride,
		.count = count_from(first, job->rows, ROWS),
		.q = job->q + (first * job->heads + head) * job->head_width,
		.q_stride = job->heads * job->head_width,
	};
}

/* Scales of sixteen rows' queries, which are stored, and what their numbers are made with. */
static void scale_queries(const struct dvsm_fixed_queries *job, size_t head, size_t first,
			  struct query_factors *by)
{
	const struct query_rows rows = query_rows_of(job, head, first);
	const struct dvsm_fixed_gain *weights = &job->gains[head];
	__m512i sums[ROWS], sizes[ROWS];
	struct dvsm_fixed_scale scales[ROWS];

	clear_rows(sums, rows.count);
	clear_rows(sizes, rows.count);
	for (size_t d = 0; d < job->dim; d += GROUP) {
		const __mmask64 lanes = first_bytes(job->dim - d);
		const struct query_gain gain = load_query_gain(weights->gain + d, lanes);

		if (lanes == ALL_LANES)
			measure_queries(&rows, d, &gain, ALL_LANES, sums, sizes);
		else
			measure_queries(&rows, d, &gain, lanes, sums, sizes);
	}

	const struct wide squares = sum_squares(sums, weights->epsilon);
	const struct narrow_lanes narrow = narrow_lanes_make(
		fold_rows(sizes, max_s32), false, squares, scale_lanes_set(weights->scale));

	/* Products are below 2^30: the shift is 16 at most. */
	_mm512_storeu_si512(by->half, half_of(positive(narrow.shift)));
	_mm512_storeu_si512(by->up, _mm512_sub_epi32(_mm512_set1_epi32(16), narrow.shift));
	_mm512_storeu_si512(by->inverse, in_both_words(narrow.inverse));
	scale_lanes_store(narrow.scale, scales, ROWS);
	for (size_t i = 0; i < rows.count; i++)
		job->q_scale[(first + i) * job->heads + head] = scales[i];
}

static void finish_queries(const struct dvsm_fixed_queries *job, size_t head, size_t first,
			   const struct query_factors *by)
{
	const struct query_rows rows = query_rows_of(job, head, first);

	for (size_t d = 0; d < job->dim; d += GROUP) {
		const __mmask64 lanes = first_bytes(job->dim - d);
		const __mmask64 to = first_bytes(job->head_width - d);
		const struct query_gain gain = load_query_gain(job->gains[head].gain + d, lanes);

		if (lanes == ALL_LANES)
			write_queries(&rows, d, &gain, ALL_LANES, ALL_LANES, by);
		else
			write_queries(&rows, d, &gain, lanes, to, by);
	}
}

static void queries_of_head(const struct dvsm_fixed_queries *job, size_t head)
{
	struct query_factors factors[2];

	if (job->rows > 0)
		scale_queries(job, head, 0, &factors[0]);
	for (size_t i = 0, at = 0; i < job->rows; i += ROWS, at ^= 1) {
		if (job->rows - i > ROWS)
			scale_queries(job, head, i + ROWS, &factors[at ^ 1]);
		finish_queries(job, head, i, &factors[at]);
	}
}

static void queries(const struct dvsm_fixed_queries *job)
{
	for (size_t head = 0; head < job->heads; head++)
		queries_of_head(job, head);
}

/* ---- keys ---- */

/* n = (u mantissa + half) >> shift; the mantissa in both words. */
struct key_factors {
	int32_t mantissa[ROWS], half[ROWS], shift[ROWS];
};

/* dvsm_fixed_key_factor() of sixteen rows. */
static void scale_keys(const struct dvsm_fixed_keys *job, size_t first, struct key_factors *by)
{
	const size_t rows = count_from(first, job->rows, ROWS);
	const int16_t *u = job->u + first * job->u_stride;
	__m512i sums[ROWS];

	clear_rows(sums, rows);
	for (size_t i = 0; i < rows; i++, u += job->u_stride) {
		__m512i sum = _mm512_setzero_si512();

		for (size_t d = 0; d < job->dim; d += GROUP)
			sum = add_squares(sum, load_up_to(u + d, job->dim - d));
		sums[i] = sum;
	}

	const struct wide squares = sum_squares(sums, job->epsilon);
	const struct scale_lanes scale = scale_lanes_split(
		scale_lanes_multiply(scale_lanes_set(job->root), scale_lanes_rsqrt(squares)));
	/* Products are below 2^30: by 31 and more they are rounded to 0. */
	const __m512i shift =
		_mm512_min_epi32(positive(negative(_mm512_add_epi32(
					 scale.exponent, _mm512_set1_epi32(job->fraction)))),
				 _mm512_set1_epi32(31));

	_mm512_storeu_si512(by->mantissa, in_both_words(scale.number));
	_mm512_storeu_si512(by->half, half_of(shift));
	_mm512_storeu_si512(by->shift, shift);
}

/* R(u mantissa, shift) of 32 numbers, saturated. */
static inline __m512i scale_words(__m512i u, __m512i mantissa, __m512i half, __m512i shift)
{
	const __m512i low = _mm512_mullo_epi16(u, mantissa), high = _mm512_mulhi_epi16(u, mantissa);
	__m512i a = _mm512_unpacklo_epi16(low, high), b = _mm512_unpackhi_epi16(low, high);

	a = _mm512_srav_epi32(_mm512_add_epi32(a, half), shift);
	b = _mm512_srav_epi32(_mm512_add_epi32(b, half), shift);
	return _mm512_packs_epi32(a, b);
}

static void finish_keys(const struct dvsm_fixed_keys *job, size_t first,
			const struct key_factors *by)
{
	const size_t rows = count_from(first, job->rows, ROWS);

	for (size_t i = 0; i < rows; i++) {
		const __m512i mantissa = _mm512_set1_epi32(by->mantissa[i]);
		const __m512i half = _mm512_set1_epi32(by->half[i]);
		const __m512i shift = _mm512_set1_epi32(by->shift[i]);
		const int16_t *u = job->u + (first + i) * job->u_stride;
		int16_t *n = job->n + (first + i) * job->n_stride;
		size_t d = 0;

		for (; d + 32 <= job->dim; d += 32)
			_mm512_storeu_si512(n + d, scale_words(_mm512_loadu_si512(u + d), mantissa,
							       half, shift));
		if (d < job->dim) {
			const __mmask32 lanes = first_words(job->dim - d);
			const __m512i a = _mm512_maskz_loadu_epi16(lanes, u + d);

			_mm512_mask_storeu_epi16(n + d, lanes,
						 scale_words(a, mantissa, half, shift));
		}
	}
}

static void keys(const struct dvsm_fixed_keys *job)
{
	struct key_factors factors[2];

	if (job->rows > 0)
		scale_keys(job, 0, &factors[0]);
	for (size_t i = 0, at = 0; i < job->rows; i += ROWS, at ^= 1) {
		if (job->rows - i > ROWS)
			scale_keys(job, i + ROWS, &factors[at ^ 1]);
		finish_keys(job, i, &factors[at]);
	}
}
