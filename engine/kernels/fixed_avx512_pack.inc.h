/*
 * Ranges and packing of keys and values. Included by fixed_avx512.c.
 */

/* ---- ranges ---- */

/* Rows whose sum fits 32 bits. */
#define RANGE_ROWS 32768u

/* Of the 32 channels of a vector. */
struct range_lanes {
	__m512i low, high, even, odd; /* sums of the channels of even and of odd words */
};

static inline void widen(struct range_lanes *lanes, __m512i x)
{
	/* What a product with them leaves of two words. */
	const __m512i even = _mm512_set1_epi32(1), odd = _mm512_set1_epi32(1 << 16);

	lanes->low = _mm512_min_epi16(lanes->low, x);
	lanes->high = _mm512_max_epi16(lanes->high, x);
	lanes->even = _mm512_add_epi32(lanes->even, _mm512_madd_epi16(x, even));
	lanes->odd = _mm512_add_epi32(lanes->odd, _mm512_madd_epi16(x, odd));
}

static void add_ranges(const struct range_lanes *lanes, size_t count,
		       struct dvsm_fixed_range *ranges)
{
	int16_t lows[32], highs[32];
	int32_t sums[2][16];

	_mm512_storeu_si512(lows, lanes->low);
	_mm512_storeu_si512(highs, lanes->high);
	_mm512_storeu_si512(sums[0], lanes->even);
	_mm512_storeu_si512(sums[1], lanes->odd);
	for (size_t d = 0; d < count && d < 32; d++) {
		ranges[d].sum += sums[d % 2][d / 2];
		ranges[d].low = lows[d] < ranges[d].low ? lows[d] : ranges[d].low;
		ranges[d].high = highs[d] > ranges[d].high ? highs[d] : ranges[d].high;
	}
}

/* Up to 64 channels of up to RANGE_ROWS rows. */
static void range_block(const int16_t *x, size_t x_stride, size_t rows, size_t channels,
			struct dvsm_fixed_range *ranges)
{
	const __mmask64 lanes = first_bytes(channels);
	const struct range_lanes none = {_mm512_set1_epi16(INT16_MAX), _mm512_set1_epi16(INT16_MIN),
					 _mm512_setzero_si512(), _mm512_setzero_si512()};
	struct range_lanes first = none, second = none;

	for (size_t i = 0; i < rows; i++, x += x_stride) {
		const struct pair pair = load_pair(x, lanes);

		widen(&first, pair.a);
		widen(&second, pair.b);
	}
	add_ranges(&first, channels, ranges);
	if (channels > 32)
		add_ranges(&second, channels - 32, ranges + 32);
}

static void range(const int16_t *x, size_t x_stride, size_t rows, size_t channels,
		  struct dvsm_fixed_range *ranges)
{
	while (rows > 0) {
		size_t count = rows < RANGE_ROWS ? rows : RANGE_ROWS;

		for (size_t d = 0; d < channels; d += GROUP)
			range_block(x + d, x_stride, count, count_from(d, channels, GROUP),
				    ranges + d);
		x += count * x_stride;
		rows -= count;
	}
}

/* ---- packing ---- */

/* Up to 64 channels, a word each, in two vectors as their numbers are. */
struct channels {
	struct pair mean, shift, inverse;
	__mmask64 lanes;
	size_t count;
};

static struct channels load_channels(const struct dvsm_fixed_channel *from, size_t left)
{
	const size_t count = left < GROUP ? left : GROUP;
	int16_t means[GROUP] = {0}, shifts[GROUP] = {0}, inverses[GROUP] = {0};

	for (size_t d = 0; d < count; d++) {
		means[d] = from[d].mean;
		shifts[d] = from[d].shift;
		inverses[d] = from[d].inverse;
	}
	return (struct channels){
		.mean = load_pair(means, ALL_LANES),
		.shift = load_pair(shifts, ALL_LANES),
		.inverse = load_pair(inverses, ALL_LANES),
		.lanes = first_bytes(count),
		.count = count,
	};
}

/* To numbers of 8 bits: the lower bytes. */
static inline __m512i fit_words(__m512i x, __m512i mean, __m512i shift, __m512i inverse)
{
	const __m512i c = _mm512_subs_epi16(x, mean), up = _mm512_sllv_epi16(c, shift);
	/* What does not come back has left 16 bits: the last number on its side. */
	const __mmask32 over = _mm512_cmpneq_epi16_mask(_mm512_srav_epi16(up, shift), c);
	const __m512i last =
		_mm512_xor_si512(_mm512_srai_epi16(c, 15), _mm512_set1_epi16(INT16_MAX));

	return _mm512_and_si512(_mm512_mulhrs_epi16(_mm512_mask_mov_epi16(up, over, last), inverse),
				_mm512_set1_epi16(0xff));
}

/* A row's numbers in quarters, of which each has eight of the first 32 and eight of the others. */
static inline __m512i fit_row(const struct channels *channels, const int16_t *x)
{
	const struct pair u = load_pair(x, channels->lanes);

	return _mm512_packus_epi16(
		fit_words(u.a, channels->mean.a, channels->shift.a, channels->inverse.a),
		fit_words(u.b, channels->mean.b, channels->shift.b, channels->inverse.b));
}

/* One row's numbers in their order. */
static void fit_one(const struct channels *channels, const int16_t *x, int8_t numbers[GROUP])
{
	_mm512_storeu_si512(numbers, in_order_of_two(fit_row(channels, x)));
}

/* The first `count` of a vector's bytes, 64 at most. */
static inline void store_bytes(int8_t *to, __m512i bytes, size_t count)
{
	if (count >= GROUP)
		_mm512_storeu_si512(to, bytes);
	else
		_mm512_mask_storeu_epi8(to, first_bytes(count), bytes);
}

/* Quarter k of a, b, c and d side by side, k = 0 .. 3. */
struct quarters {
	__m512i of[4];
};

static inline struct quarters gather_quarters(__m512i a, __m512i b, __m512i c, __m512i d)
{
	const __m512i ab = _mm512_shuffle_i64x2(a, b, 0x44), cd = _mm512_shuffle_i64x2(c, d, 0x44);
	const __m512i ef = _mm512_shuffle_i64x2(a, b, 0xee), gh = _mm512_shuffle_i64x2(c, d, 0xee);

	return (struct quarters){{
		_mm512_shuffle_i64x2(ab, cd, 0x88),
		_mm512_shuffle_i64x2(ab, cd, 0xdd),
		_mm512_shuffle_i64x2(ef, gh, 0x88),
		_mm512_shuffle_i64x2(ef, gh, 0xdd),
	}};
}

/* ---- keys ---- */

/* Four channels of sixteen keys, of which the last channels may not be there. */
static inline void store_four(int8_t *to, __m512i numbers, size_t channels)
{
	if (channels >= 4)
		_mm512_storeu_si512(to, numbers);
	else
		_mm512_mask_storeu_epi8(to, 0x1111111111111111 * first_bytes(channels), numbers);
}

static void pack_sixteen_keys(const struct channels *channels, const int16_t *x, size_t x_stride,
			      int8_t *to)
{
	/* Of four keys each: a quarter's first, second, third and last four channels. */
	__m512i fours[4][4];

	for (size_t i = 0; i < 4; i++, x += 4 * x_stride) {
		const __m512i a = fit_row(channels, x), b = fit_row(channels, x + x_stride);
		const __m512i c = fit_row(channels, x + 2 * x_stride);
		const __m512i d = fit_row(channels, x + 3 * x_stride);
		const __m512i ab = _mm512_unpacklo_epi32(a, b), cd = _mm512_unpacklo_epi32(c, d);
		const __m512i ef = _mm512_unpackhi_epi32(a, b), gh = _mm512_unpackhi_epi32(c, d);

		fours[0][i] = _mm512_unpacklo_epi64(ab, cd);
		fours[1][i] = _mm512_unpackhi_epi64(ab, cd);
		fours[2][i] = _mm512_unpacklo_epi64(ef, gh);
		fours[3][i] = _mm512_unpackhi_epi64(ef, gh);
	}
	for (size_t k = 0; k < 4; k++) {
		const struct quarters quarters =
			gather_quarters(fours[k][0], fours[k][1], fours[k][2], fours[k][3]);

		for (size_t j = 0; j < 4; j++) {
			const size_t d = k / 2 * 32 + 8 * j + k % 2 * 4;

			if (d < channels->count)
				store_four(to + d * DVSM_FIXED_PANEL, quarters.of[j],
					   channels->count - d);
		}
	}
}

static void pack_key(const struct channels *channels, const int16_t *x, int8_t *to)
{
	const size_t count = channels->count;
	int8_t numbers[GROUP];

	fit_one(channels, x, numbers);
	for (size_t d = 0; d < count; d += 4)
		memcpy(to + d * DVSM_FIXED_PANEL, numbers + d, count - d < 4 ? count - d : 4);
}

static void pack_keys(const struct dvsm_fixed_pack *job)
{
	for (size_t d = 0; d < job->dim; d += GROUP) {
		const struct channels channels = load_channels(job->channels + d, job->dim - d);

		for (size_t i = 0, step; i < job->rows; i += step) {
			const size_t key = job->first + i, at = key % DVSM_FIXED_PANEL;
			const int16_t *x = job->x + i * job->x_stride + d;
			int8_t *to = job->packed + (key - at) * job->head_width +
				     d * DVSM_FIXED_PANEL + 4 * at;

			step = at == 0 && job->rows - i >= DVSM_FIXED_PANEL ? DVSM_FIXED_PANEL : 1;
			if (step > 1)
				pack_sixteen_keys(&channels, x, job->x_stride, to);
			else
				pack_key(&channels, x, to);
		}
	}
}

/* ---- values ---- */

static void pack_four_values(const struct channels *channels, const int16_t *x, size_t x_stride,
			     int8_t *to)
{
	/* Two quarters' first fours of channels, and their second, in turns. */
	const __m512i first = _mm512_setr_epi64(0, 1, 8, 9, 2, 3, 10, 11);
	const __m512i second = _mm512_setr_epi64(4, 5, 12, 13, 6, 7, 14, 15);
	const __m512i a = fit_row(channels, x), b = fit_row(channels, x + x_stride);
	const __m512i c = fit_row(channels, x + 2 * x_stride);
	const __m512i d = fit_row(channels, x + 3 * x_stride);

	for (size_t at = 0; at < channels->count; at += 32, to += 128) {
		const __m512i ab = at ? _mm512_unpackhi_epi8(a, b) : _mm512_unpacklo_epi8(a, b);
		const __m512i cd = at ? _mm512_unpackhi_epi8(c, d) : _mm512_unpacklo_epi8(c, d);
		const __m512i low = _mm512_unpacklo_epi16(ab, cd);
		const __m512i high = _mm512_unpackhi_epi16(ab, cd);
		const size_t bytes = 4 * (channels->count - at);

		store_bytes(to, _mm512_permutex2var_epi64(low, first, high), bytes);
		if (bytes > 64)
			store_bytes(to + 64, _mm512_permutex2var_epi64(low, second, high),
				    bytes - 64);
	}
}

static void pack_value(const struct channels *channels, const int16_t *x, int8_t *to)
{
	int8_t numbers[GROUP];

	fit_one(channels, x, numbers);
	for (size_t d = 0; d < channels->count; d++)
		to[4 * d] = numbers[d];
}

static void pack_values(const struct dvsm_fixed_pack *job)
{
	for (size_t d = 0; d < job->dim; d += GROUP) {
		const struct channels channels = load_channels(job->channels + d, job->dim - d);

		for (size_t i = 0, step; i < job->rows; i += step) {
			const size_t key = job->first + i, at = key % 4;
			const int16_t *x = job->x + i * job->x_stride + d;
			int8_t *to = job->packed + (key - at) * job->head_width + 4 * d + at;

			step = at == 0 && job->rows - i >= 4 ? 4 : 1;
			if (step > 1)
				pack_four_values(&channels, x, job->x_stride, to);
			else
				pack_value(&channels, x, to);
		}
	}
}
