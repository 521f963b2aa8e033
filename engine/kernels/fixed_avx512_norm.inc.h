/*
 * LayerNorm to int8, sixteen rows at a time: what a row is brought to is found for all of them at
 * once, a row in each lane. Included by fixed_avx512.c.
 *
 * c and, of a gain of 2^14 throughout as that of norms that belong to the matrices behind them, y'
 * too are sums and shifts of x alone. Shifts to the right follow each other as one does:
 * floor((floor(a / 2^s) + h) / 2^r) = floor((a + h 2^s) / 2^(s + r)).
 */

/* Numbers of a row whose squares' sums fit 32 bits: twelve of 2^28 a lane. */
#define SQUARES 192u

/* |x| below which no sum with an offset leaves 32 bits: c' 2^t is below twice that. */
#define NORM_BITS 29

/* Of sixteen rows: c = (x + offset) >> shift, y' = (c gain + half) >> down. */
struct norm_rows {
	int32_t offset[ROWS], shift[ROWS];
	int32_t half[ROWS], down[ROWS], inverse[ROWS];
};

/* ---- what a row is brought to ---- */

struct extents {
	__m512i low, high;
};

static struct extents find_extents(const int32_t *x, size_t rows, size_t dim)
{
	const size_t whole = dim / 16 * 16;
	__m512i lows[ROWS], highs[ROWS];

	clear_rows(lows, rows);
	clear_rows(highs, rows);
	for (size_t i = 0; i < rows; i++, x += dim) {
		__m512i low = _mm512_set1_epi32(x[0]), high = low, a;

		DVSM_UNROLL_4
		for (size_t d = 0; d < whole; d += 16) {
			a = _mm512_loadu_si512(x + d);
			low = _mm512_min_epi32(low, a);
			high = _mm512_max_epi32(high, a);
		}
		a = _mm512_mask_loadu_epi32(low, first_lanes(dim - whole), x + whole);
		lows[i] = _mm512_min_epi32(low, a);
		highs[i] = _mm512_max_epi32(high, a);
	}
	return (struct extents){fold_rows(lows, min_s32), fold_rows(highs, max_s32)};
}

/* Sums of x' = (x + half) >> first, which fit a lane: each is below 2^30 / dim. */
static __m512i sum_rows(const int32_t *x, size_t rows, size_t dim, __m512i half, __m512i first)
{
	const size_t whole = dim / 16 * 16;
	__m512i sums[ROWS];
	int32_t halves[ROWS], shifts[ROWS];

	clear_rows(sums, rows);
	_mm512_storeu_si512(halves, half);
	_mm512_storeu_si512(shifts, first);
	for (size_t i = 0; i < rows; i++, x += dim) {
		const __m512i add = _mm512_set1_epi32(halves[i]), by = _mm512_set1_epi32(shifts[i]);
		__m512i sum = _mm512_setzero_si512(), a;

		DVSM_UNROLL_4
		for (size_t d = 0; d < whole; d += 16) {
			a = _mm512_add_epi32(_mm512_loadu_si512(x + d), add);
			sum = _mm512_add_epi32(sum, _mm512_srav_epi32(a, by));
		}
		/* R(0, first) is 0. */
		a = _mm512_maskz_loadu_epi32(first_lanes(dim - whole), x + whole);
		a = _mm512_srav_epi32(_mm512_add_epi32(a, add), by);
		sums[i] = _mm512_add_epi32(sum, a);
	}
	return fold_rows(sums, add_s32);
}

/* floor((2 sum + n) / (2 n)) of eight: exact in double, whose quotients are 2^-17 from the next
 * whole number or are one. */
static inline __m256i mean_of_eight(__m256i sum, size_t dim)
{
	const __m512d count = _mm512_set1_pd((double)dim), two = _mm512_set1_pd(2);
	const __m512d twice = _mm512_fmadd_pd(_mm512_cvtepi32_pd(sum), two, count);

	return _mm512_cvt_roundpd_epi32(_mm512_div_pd(twice, _mm512_mul_pd(two, count)),
					_MM_FROUND_TO_NEG_INF | _MM_FROUND_NO_EXC);
}

static inline __m512i mean_of(__m512i sum, size_t dim)
{
	__m256i low = mean_of_eight(_mm512_castsi512_si256(sum), dim);
	__m256i high = mean_of_eight(_mm512_extracti64x4_epi64(sum, 1), dim);

	return _mm512_inserti64x4(_mm512_castsi256_si512(low), high, 1);
}

/* R(epsilon, s) of the even lanes' s, 0..62. */
static inline __m512i round_epsilon(int64_t epsilon, __m512i s)
{
	const __m512i even = _mm512_and_si512(s, _mm512_set1_epi64(0xffffffff));
	const __m512i half = _mm512_srli_epi64(_mm512_sllv_epi64(_mm512_set1_epi64(1), even), 1);

	return _mm512_srlv_epi64(_mm512_add_epi64(_mm512_set1_epi64(epsilon), half), even);
}

/* ---- sums of squares, and the largest product ---- */

/* c of 64 numbers; 0 in lanes that are not there. */
struct quad {
	__m512i c[4];
};

DVSM_INLINE struct quad shift_group(const int32_t *x, __mmask64 lanes, __m512i offset,
				    __m512i shift)
{
	struct quad quad;

	for (size_t k = 0; k < 4; k++) {
		const __mmask16 some = (__mmask16)(lanes >> 16 * k);
		__m512i a = _mm512_add_epi32(load_s32(x + 16 * k, some), offset);

		a = _mm512_srav_epi32(a, shift);
		quad.c[k] = lanes == ALL_LANES ? a : _mm512_maskz_mov_epi32(some, a);
	}
	return quad;
}

struct measure {
	__m512i squares, largest; /* sums of 32 bits; |y|, not for a gain of ones */
};

DVSM_INLINE void measure_group(const int32_t *x, const int16_t *gain, __mmask64 lanes,
			       __m512i offset, __m512i shift, bool ones, struct measure *measure)
{
	const struct quad quad = shift_group(x, lanes, offset, shift);

	for (size_t k = 0; k < 4; k += 2) {
		const __m512i words = _mm512_packs_epi32(quad.c[k], quad.c[k + 1]);

		measure->squares =
			_mm512_add_epi32(measure->squares, _mm512_madd_epi16(words, words));
	}
	for (size_t k = 0; !ones && k < 4; k++) {
		const __mmask16 some = (__mmask16)(lanes >> 16 * k);
		const __m512i y = multiply_words(quad.c[k], load_words(gain + 16 * k, some));

		measure->largest = _mm512_max_epi32(measure->largest, _mm512_abs_epi32(y));
	}
}

/* The sums of squares of some rows and, unless the gain is of ones, the largest |y|. */
DVSM_INLINE struct wide measure_rows(const struct dvsm_fixed_norm *job, bool ones,
				     const struct norm_rows *by, __m512i *largest)
{
	const int16_t *gain = job->gain.gain;
	const size_t dim = job->dim;
	const int32_t *x = job->x;
	__m512i sums[ROWS], sizes[ROWS];

	clear_rows(sums, job->rows);
	clear_rows(sizes, job->rows);
	for (size_t i = 0; i < job->rows; i++, x += dim) {
		const __m512i offset = _mm512_set1_epi32(by->offset[i]);
		const __m512i shift = _mm512_set1_epi32(by->shift[i]);
		struct measure measure = {.largest = _mm512_setzero_si512()};
		__m512i sum = _mm512_setzero_si512();

		for (size_t first = 0; first < dim; first += SQUARES) {
			const size_t end = dim - first < SQUARES ? dim : first + SQUARES;
			size_t d = first;

			measure.squares = _mm512_setzero_si512();
			for (; d + GROUP <= end; d += GROUP)
				measure_group(x + d, gain + d, ALL_LANES, offset, shift, ones,
					      &measure);
			if (d < end)
				measure_group(x + d, gain + d, first_bytes(end - d), offset, shift,
					      ones, &measure);
			sum = add_wide(sum, measure.squares);
		}
		sums[i] = sum;
		sizes[i] = measure.largest;
	}
	if (!ones)
		*largest = fold_rows(sizes, max_s32);
	return sum_wide_rows(sums);
}

/* ---- the rows themselves ---- */

/* What y' becomes, of 64 numbers: a = R(y' inverse, 15), or its two planes. */
static inline void write_group(const struct quad *y, __m512i inverse, int8_t *high, int8_t *low)
{
	__m512i a = _mm512_packs_epi32(y->c[0], y->c[1]), b = _mm512_packs_epi32(y->c[2], y->c[3]);

	if (low) {
		const __m512i byte = _mm512_set1_epi16(0xff), half = _mm512_set1_epi16(128);

		/* The lower plane is what is left of the lowest byte, signed. */
		_mm512_storeu_si512(
			low, in_order_of_four(_mm512_packus_epi16(_mm512_and_si512(a, byte),
								  _mm512_and_si512(b, byte))));
		a = _mm512_srai_epi16(_mm512_add_epi16(a, half), 8);
		b = _mm512_srai_epi16(_mm512_add_epi16(b, half), 8);
	} else {
		a = _mm512_mulhrs_epi16(a, inverse);
		b = _mm512_mulhrs_epi16(b, inverse);
	}
	_mm512_storeu_si512(high, in_order_of_four(_mm512_packs_epi16(a, b)));
}

/* The factors of one row. */
struct norm_factors {
	__m512i offset, shift, half, down, inverse;
};

static inline struct norm_factors norm_factors_of(const struct norm_rows *by, size_t row)
{
	return (struct norm_factors){
		.offset = _mm512_set1_epi32(by->offset[row]),
		.shift = _mm512_set1_epi32(by->shift[row]),
		.half = _mm512_set1_epi32(by->half[row]),
		.down = _mm512_set1_epi32(by->down[row]),
		.inverse = _mm512_set1_epi16((int16_t)by->inverse[row]),
	};
}

DVSM_INLINE void norm_group(const int32_t *x, const int16_t *gain, __mmask64 lanes, bool ones,
			    const struct norm_factors *by, int8_t *high, int8_t *low)
{
	struct quad quad = shift_group(x, lanes, by->offset, by->shift);

	for (size_t k = 0; !ones && k < 4; k++) {
		const __mmask16 some = (__mmask16)(lanes >> 16 * k);
		__m512i y = multiply_words(quad.c[k], load_words(gain + 16 * k, some));

		quad.c[k] = _mm512_srav_epi32(_mm512_add_epi32(y, by->half), by->down);
	}
	write_group(&quad, by->inverse, high, low);
}

DVSM_INLINE void write_rows(const struct dvsm_fixed_norm *job, bool ones,
			    const struct norm_rows *by)
{
	const size_t dim = job->dim, filled = dvsm_fixed_pad(dim, GROUP);

	for (size_t i = 0; i < job->rows; i++) {
		const int32_t *x = job->x + i * dim;
		const struct norm_factors factors = norm_factors_of(by, i);
		int8_t *high = job->high + i * job->out_stride;
		int8_t *low = job->fine ? job->low + i * job->out_stride : NULL;
		size_t d = 0;

		for (; d + GROUP <= dim; d += GROUP)
			norm_group(x + d, job->gain.gain + d, ALL_LANES, ones, &factors, high + d,
				   low ? low + d : NULL);
		if (d < dim)
			norm_group(x + d, job->gain.gain + d, first_bytes(dim - d), ones, &factors,
				   high + d, low ? low + d : NULL);
		memset(high + filled, 0, job->out_stride - filled);
		if (low)
			memset(low + filled, 0, job->out_stride - filled);
	}
}

/* ---- sixteen rows ---- */

/* c = (x + offset) >> shift of sixteen rows, and the c of their ends. */
struct centring {
	__m512i offset, shift, low, high;
};

/* t and u of rows whose numbers, at both ends, have at most NORM_BITS bits. */
static struct centring centre_rows(const int32_t *x, size_t rows, size_t dim, struct extents ends)
{
	const __m512i bits = float_bits(float_make(larger_size(ends.low, ends.high)));
	const __m512i first =
		positive(_mm512_sub_epi32(bits, _mm512_set1_epi32(30 - dvsm_fixed_log2_up(dim))));
	const __m512i half = half_of(first);
	const __m512i mean = mean_of(sum_rows(x, rows, dim, half, first), dim);
	__m512i offset = _mm512_sub_epi32(half, _mm512_sllv_epi32(mean, first));

	/* c' rises with x: the ends of x are its ends. */
	const __m512i low = _mm512_srav_epi32(_mm512_add_epi32(ends.low, offset), first);
	const __m512i high = _mm512_srav_epi32(_mm512_add_epi32(ends.high, offset), first);
	const __m512i second = positive(_mm512_sub_epi32(
		float_bits(float_make(larger_size(low, high))), _mm512_set1_epi32(14)));
	const __m512i shift = _mm512_add_epi32(first, second);

	offset = _mm512_add_epi32(offset, _mm512_sllv_epi32(half_of(second), first));
	return (struct centring){
		.offset = offset,
		.shift = shift,
		.low = _mm512_srav_epi32(_mm512_add_epi32(ends.low, offset), shift),
		.high = _mm512_srav_epi32(_mm512_add_epi32(ends.high, offset), shift),
	};
}

/* Rows of a job as a job of their own. */
static struct dvsm_fixed_norm part_of(const struct dvsm_fixed_norm *job, size_t first, size_t rows)
{
	struct dvsm_fixed_norm part = *job;

	part.x += first * job->dim;
	part.rows = rows;
	part.high += first * job->out_stride;
	part.low += job->fine ? first * job->out_stride : 0;
	part.a_scale += first;
	return part;
}

/* y' by c's factors and the narrowing's, and then the rows. */
DVSM_INLINE void finish_rows(const struct dvsm_fixed_norm *job, bool ones,
			     const struct centring *centring, const struct narrow_lanes *narrow,
			     struct norm_rows *by)
{
	_mm512_storeu_si512(by->half, half_of(narrow->shift));
	_mm512_storeu_si512(by->down, narrow->shift);
	_mm512_storeu_si512(by->inverse, narrow->inverse);
	if (ones && !_mm512_cmplt_epi32_mask(narrow->shift, _mm512_set1_epi32(14))) {
		const __m512i down = _mm512_sub_epi32(narrow->shift, _mm512_set1_epi32(14));
		const __m512i half = _mm512_sllv_epi32(half_of(down), centring->shift);

		_mm512_storeu_si512(by->offset, _mm512_add_epi32(centring->offset, half));
		_mm512_storeu_si512(by->shift, _mm512_add_epi32(centring->shift, down));
		write_rows(job, true, by);
	} else {
		write_rows(job, false, by);
	}
}

/*
 * A job of at most sixteen rows. Where one has larger numbers than there are in a stream, or so
 * small products that they would be shifted up, the specification does them all.
 */
DVSM_INLINE void norm_rows(const struct dvsm_fixed_norm *job, bool ones)
{
	const struct extents ends = find_extents(job->x, job->rows, job->dim);
	const __m512i size = larger_size(ends.low, ends.high);

	if (_mm512_cmpge_epi32_mask(size, _mm512_set1_epi32(1 << NORM_BITS))) {
		dvsm_fixed_kernels_scalar.norm(job);
		return;
	}

	const struct centring centring = centre_rows(job->x, job->rows, job->dim, ends);
	const __m512i twice = _mm512_slli_epi32(centring.shift, 1);
	struct norm_rows by;
	__m512i largest = _mm512_slli_epi32(larger_size(centring.low, centring.high), 14);

	_mm512_storeu_si512(by.offset, centring.offset);
	_mm512_storeu_si512(by.shift, centring.shift);

	struct wide squares = measure_rows(job, ones, &by, &largest);

	squares.even = _mm512_add_epi64(squares.even, round_epsilon(job->gain.epsilon, twice));
	squares.odd =
		_mm512_add_epi64(squares.odd, round_epsilon(job->gain.epsilon, odd_lanes(twice)));

	const struct narrow_lanes narrow =
		narrow_lanes_make(largest, job->fine, squares, scale_lanes_set(job->gain.scale));

	if (_mm512_movepi32_mask(narrow.shift)) {
		dvsm_fixed_kernels_scalar.norm(job);
		return;
	}
	scale_lanes_store(narrow.scale, job->a_scale, job->rows);
	finish_rows(job, ones, &centring, &narrow, &by);
}

/* Whether all of a gain is 2^14. */
static bool is_of_ones(const int16_t *gain, size_t dim)
{
	const __m512i one = _mm512_set1_epi16(1 << 14);
	__mmask32 other = 0;

	for (size_t d = 0; d < dim; d += 32) {
		const __mmask32 lanes = first_words(dim - d);

		other |= _mm512_mask_cmpneq_epi16_mask(lanes, one,
						       _mm512_maskz_loadu_epi16(lanes, gain + d));
	}
	return other == 0;
}

static void norm(const struct dvsm_fixed_norm *job)
{
	const bool ones = is_of_ones(job->gain.gain, job->dim);

	for (size_t i = 0; i < job->rows; i += ROWS) {
		const struct dvsm_fixed_norm part = part_of(job, i, count_from(i, job->rows, ROWS));

		if (ones)
			norm_rows(&part, true);
		else
			norm_rows(&part, false);
	}
}
