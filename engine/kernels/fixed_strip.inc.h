/*
 * Template: rows of a fixed-point product that are prepared together, while a panel of weights
 * stays in the cache. Included behind BYTE_ROWS, the rows of a tile, and row_prepare() with its
 * ROW_ROOM().
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
