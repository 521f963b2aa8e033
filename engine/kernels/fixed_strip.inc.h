/*
 * Template: what the fixed-point products of SSE4.1, AVX2 and AVX-VNNI share. Rows are prepared
 * together, a strip of them, while a panel of weights stays in the cache. Included behind
 * BYTE_ROWS, the rows of a tile, and row_prepare() with its ROW_ROOM().
 */

/* Depth of a row that is prepared at a time, and room for the rows prepared together. */
#define CHUNK      4096u
#define STRIP_ROWS (8u * BYTE_ROWS)
#define STRIP_ROOM (STRIP_ROWS * ROW_ROOM(CHUNK / 4))

/* Rows on their way, prepared up to a chunk of their depth. */
struct strip {
	struct row_bytes rows[STRIP_ROWS];
	uint8_t room[STRIP_ROOM];
};

/* Rows that go into a strip: whole tiles of them. */
static size_t strip_rows(const struct dvsm_fixed_gemm *job)
{
	size_t rows = STRIP_ROWS;

	if (job->depth > CHUNK)
		return BYTE_ROWS;
	if (rows * ROW_ROOM(job->depth) > STRIP_ROOM)
		rows = STRIP_ROOM / ROW_ROOM(job->depth);
	return rows / BYTE_ROWS * BYTE_ROWS;
}

/* `count` numbers from depth `d` on of `rows` rows, as the strip's from `at` on. */
static void prepare(const struct dvsm_fixed_gemm *job, size_t row, size_t at, size_t rows, size_t d,
		    size_t count, struct strip *strip)
{
	for (size_t i = 0; i < rows; i++)
		strip->rows[at + i] = row_prepare(job->a + (row + i) * job->a_stride + d, count,
						  strip->room + (at + i) * ROW_ROOM(count));
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
