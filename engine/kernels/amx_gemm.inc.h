/*
 * Template: matrix product of bfloat16 on AMX. Included by bf16_amx.c.
 *
 * A panel of weights is tiles as it lies: sixteen rows of pairs of sixteen columns. Two tiles of A
 * meet two of W in four tiles of sums, a block, so that each tile loaded is used twice. While the
 * tiles' unit multiplies one block, the vectors' units finish the one before, whose sums leave
 * their tiles between its first products.
 */

/* Rows and columns of a block of sums. */
#define BLOCK 32u

/* Depth that is summed at a time: of two panels it is half of the first-level cache. */
#define STRETCH 384u

struct product {
	const number *a;
	size_t a_stride, rows;
	const number *w;
	size_t depth, cols;
	void *c;
	size_t c_stride;
	enum dvsm_epilogue epilogue;
};

/* A block's sums, once they left tiles 0 to 3; it waits there or here for its epilogue, from `row`,
 * `col` on. */
struct block {
	_Alignas(64) float sums[BLOCK][BLOCK];
	size_t row, col;
	bool waits;
};

#define STORE_SUMS(tile, block)                                                                    \
	AMX_STORE(tile, (block)->sums[(tile) / 2 * TILE] + (tile) % 2 * TILE,                      \
		  sizeof((block)->sums[0]))

static void store_block(struct block *block)
{
	STORE_SUMS(0, block);
	STORE_SUMS(1, block);
	STORE_SUMS(2, block);
	STORE_SUMS(3, block);
}

/* Sums from their tile, which is empty then. */
#define LEAVE(tile, block)                                                                         \
	do {                                                                                       \
		STORE_SUMS(tile, block);                                                           \
		AMX_ZERO(tile);                                                                    \
	} while (0)

static void clear_sums(void)
{
	AMX_ZERO(0);
	AMX_ZERO(1);
	AMX_ZERO(2);
	AMX_ZERO(3);
}

/* The tile of A at depth d; in `room` when a part of it lies behind the depth, which counts as 0.
 */
static const number *tile_of(const struct product *p, size_t row, size_t d, number *room)
{
	const number *tile = p->a + dvsm_tile_place(row, d, p->a_stride);
	const size_t count = p->depth - d;

	if (count >= DEPTH)
		return tile;
	memset(room, 0, TILE * DEPTH * sizeof(number));
	for (size_t i = 0; i < TILE; i++)
		memcpy(room + i * DEPTH, tile + i * DEPTH, count * sizeof(number));
	amx_publish();
	return room;
}

/* The stretch `depth` .. `end` - 1 of a block of which rows, columns or depth may be missing. */
static void sum_part(const struct product *p, size_t row, size_t col, size_t depth, size_t end,
		     struct block *block)
{
	const bool two_rows = p->rows - row > TILE, two_cols = p->cols - col > TILE;
	const number *w = p->w + col * PANEL_DEPTH(p->depth);
	_Alignas(64) number room[TILE * DEPTH];

	clear_sums();
	for (size_t d = depth; d < end; d += DEPTH) {
		AMX_LOAD(4, tile_of(p, row, d, room), 64);
		AMX_LOAD(6, w + d * TILE, 64);
		AMX_DOT_BF16(0, 4, 6);
		if (two_cols) {
			AMX_LOAD(7, w + TILE * PANEL_DEPTH(p->depth) + d * TILE, 64);
			AMX_DOT_BF16(1, 4, 7);
		}
		if (two_rows) {
			AMX_LOAD(5, tile_of(p, row + TILE, d, room), 64);
			AMX_DOT_BF16(2, 5, 6);
			if (two_cols)
				AMX_DOT_BF16(3, 5, 7);
		}
	}
	store_block(block);
}

/* GELU needs a whole sum; elsewhere one stretch is added to what the one before left in c. */
static inline size_t stretch_depth(const struct product *p)
{
	return p->epilogue == DVSM_EPILOGUE_GELU ? p->depth : STRETCH;
}

static void multiply_part(const struct product *p, size_t row, size_t col)
{
	const size_t rows = p->rows - row < BLOCK ? p->rows - row : BLOCK;
	const size_t cols = p->cols - col < BLOCK ? p->cols - col : BLOCK;
	enum dvsm_epilogue epilogue = p->epilogue;
	size_t depth = 0;
	struct block block;

	do {
		const size_t left = p->depth - depth, most = stretch_depth(p);
		const size_t end = depth + (left < most ? left : most);

		sum_part(p, row, col, depth, end, &block);
		for (size_t i = 0; i < rows; i++) {
			for (size_t j = 0; j < cols; j += TILE) {
				size_t at = (row + i) * p->c_stride + col + j;

				if (epilogue == DVSM_EPILOGUE_GELU)
					at = left_at(row + i, col + j, p->c_stride);
				finish(p->c, at, cols - j, vf_load(block.sums[i] + j), epilogue);
			}
		}
		depth = end;
		if (epilogue == DVSM_EPILOGUE_STORE)
			epilogue = DVSM_EPILOGUE_ADD;
	} while (depth < p->depth);
}

/* One row of a whole block. */
DVSM_INLINE void finish_row(const struct product *p, const struct block *block, size_t row,
			    enum dvsm_epilogue epilogue)
{
	vf left = vf_load(block->sums[row]), right = vf_load(block->sums[row] + TILE);
	float *c = (float *)p->c + (block->row + row) * p->c_stride + block->col;

	if (epilogue == DVSM_EPILOGUE_GELU) {
		number *numbers =
			(number *)p->c + left_at(block->row + row, block->col, p->c_stride);

		vp_store(numbers, vp_join(num_gelu(left), num_gelu(right)));
		return;
	}
	if (epilogue == DVSM_EPILOGUE_ADD) {
		left = vf_add(vf_load(c), left);
		right = vf_add(vf_load(c + TILE), right);
	}
	vf_store(c, left);
	vf_store(c + TILE, right);
}

/* The block that waits goes out at once. */
DVSM_INLINE void flush(const struct product *p, struct block *block, enum dvsm_epilogue epilogue)
{
	if (!block->waits)
		return;
	store_block(block);
	for (size_t row = 0; row < BLOCK; row++)
		finish_row(p, block, row, epilogue);
	block->waits = false;
}

/* What passes by the first-level cache, because the rest is to stay there. */
enum stream { STREAM_NONE, STREAM_A, STREAM_W };

#define LOAD_UNLESS(streams, tile, from)                                                           \
	do {                                                                                       \
		if (streams)                                                                       \
			AMX_STREAM(tile, from, 64);                                                \
		else                                                                               \
			AMX_LOAD(tile, from, 64);                                                  \
	} while (0)

/* Two tiles of A with two of W, and what is to be done behind each product. */
#define MULTIPLY_STEP(a, a2, w, w2, stream, before, behind)                                        \
	do {                                                                                       \
		LOAD_UNLESS((stream) == STREAM_W, 6, w);                                           \
		LOAD_UNLESS((stream) == STREAM_A, 4, a);                                           \
		before(0);                                                                         \
		AMX_DOT_BF16(0, 4, 6);                                                             \
		behind;                                                                            \
		LOAD_UNLESS((stream) == STREAM_W, 7, w2);                                          \
		before(1);                                                                         \
		AMX_DOT_BF16(1, 4, 7);                                                             \
		behind;                                                                            \
		LOAD_UNLESS((stream) == STREAM_A, 5, a2);                                          \
		before(2);                                                                         \
		AMX_DOT_BF16(2, 5, 6);                                                             \
		behind;                                                                            \
		before(3);                                                                         \
		AMX_DOT_BF16(3, 5, 7);                                                             \
		behind;                                                                            \
	} while (0)

#define NOTHING(tile)     (void)0
#define LEAVE_BLOCK(tile) LEAVE(tile, block)

/* A part of a product's depth, all rows, two panels: what multiply_whole() works on. */
struct stretch {
	size_t depth, steps, col;
	const char *next; /* weights that come next, of both panels, step after step */
	size_t ahead;     /* lines of them that each step calls into the second-level cache */
	size_t share;     /* rows of the block before that leave behind each product, times 2^16 */
	enum stream stream;
};

static inline void call_ahead(const struct stretch *stretch, const char **next)
{
	for (size_t i = 0; i < stretch->ahead; i++, *next += 64)
		_mm_prefetch(*next, _MM_HINT_T1);
}

/* The rows of a block on their way: how many went, how many should have. */
struct leaving {
	size_t row, due;
};

/* Behind a product: the rows whose turn it is. */
DVSM_INLINE void go_on(const struct product *p, const struct stretch *stretch,
		       const struct block *block, enum dvsm_epilogue epilogue,
		       struct leaving *leaving)
{
	leaving->due += stretch->share;
	for (; leaving->row < leaving->due >> 16; leaving->row++)
		finish_row(p, block, leaving->row, epilogue);
}

/*
 * The sums of one whole block, and beside them the epilogue of the block before: a row or two
 * behind a product, because the vectors' and the tiles' units work at the same time only where
 * their instructions lie within some hundred of each other.
 */
DVSM_INLINE void multiply_whole(const struct product *p, size_t row, const struct stretch *stretch,
				struct block *block, enum dvsm_epilogue epilogue)
{
	const number *a = p->a + left_at(row, stretch->depth, p->a_stride);
	const number *a2 = p->a + left_at(row + TILE, stretch->depth, p->a_stride);
	const number *w = p->w + stretch->col * PANEL_DEPTH(p->depth) + stretch->depth * TILE;
	const number *w2 = w + TILE * PANEL_DEPTH(p->depth);
	const char *next = stretch->next + row / BLOCK * stretch->steps * stretch->ahead * 64;
	struct leaving leaving = {.row = block->waits ? 0 : BLOCK};

	call_ahead(stretch, &next);
	MULTIPLY_STEP(a, a2, w, w2, stretch->stream, LEAVE_BLOCK, (void)0);
	for (size_t step = 1; step < stretch->steps; step++) {
		const size_t at = step * TILE * DEPTH;

		call_ahead(stretch, &next);
		MULTIPLY_STEP(a + at, a2 + at, w + at, w2 + at, stretch->stream, NOTHING,
			      go_on(p, stretch, block, epilogue, &leaving));
	}
	for (; leaving.row < BLOCK; leaving.row++)
		finish_row(p, block, leaving.row, epilogue);
	block->row = row;
	block->col = stretch->col;
	block->waits = true;
}

/* Two panels, or a stretch of them, stay in the first-level cache while all rows pass by. */
DVSM_INLINE void multiply_stretch(const struct product *p, const struct stretch *stretch,
				  struct block *block, enum dvsm_epilogue epilogue)
{
	for (size_t row = 0; row + BLOCK <= p->rows; row += BLOCK)
		multiply_whole(p, row, stretch, block, epilogue);
}

/* Blocks that are whole, of two panels. Behind the last ones lie those of the next call, as a rule;
 * to call what nobody will use, or what is not there, does no harm. */
DVSM_INLINE void multiply_panels(const struct product *p, size_t col, struct block *block,
				 enum dvsm_epilogue epilogue)
{
	const size_t blocks = p->rows / BLOCK, line = 64;
	const size_t most = stretch_depth(p);

	for (size_t depth = 0; depth < p->depth; depth += most) {
		const size_t left = p->depth - depth, steps = (left < most ? left : most) / DEPTH;
		struct stretch stretch = {
			.depth = depth,
			.steps = steps,
			.col = col,
			.next = (const char *)(p->w + (col + BLOCK) * PANEL_DEPTH(p->depth)) +
				depth / DEPTH * BLOCK * line,
			.ahead = (BLOCK + blocks - 1) / blocks,
			.share = steps > 1 ? ((size_t)BLOCK << 16) / (4 * (steps - 1)) : 0,
			.stream = steps * DEPTH <= STRETCH ? STREAM_A : STREAM_NONE,
		};

		/* The block before is still of the first stretch. */
		if (depth == most && epilogue == DVSM_EPILOGUE_STORE)
			flush(p, block, epilogue);
		if (depth > 0 && epilogue == DVSM_EPILOGUE_STORE)
			multiply_stretch(p, &stretch, block, DVSM_EPILOGUE_ADD);
		else
			multiply_stretch(p, &stretch, block, epilogue);
	}
	if (p->depth > most && epilogue == DVSM_EPILOGUE_STORE)
		flush(p, block, DVSM_EPILOGUE_ADD);
}

DVSM_INLINE void multiply(const struct product *p, enum dvsm_epilogue epilogue)
{
	const bool whole_depth = p->depth > 0 && p->depth % DEPTH == 0;
	struct block block;

	block.waits = false;
	for (size_t col = 0; col < p->cols; col += BLOCK) {
		size_t row = 0;

		if (whole_depth && p->rows >= BLOCK && p->cols - col >= BLOCK) {
			multiply_panels(p, col, &block, epilogue);
			row = p->rows / BLOCK * BLOCK;
		}
		if (row < p->rows)
			flush(p, &block, epilogue);
		for (; row < p->rows; row += BLOCK)
			multiply_part(p, row, col);
	}
	flush(p, &block, epilogue);
}

static void gemm(const void *a, size_t a_stride, size_t rows, const void *panels, size_t depth,
		 size_t cols, void *c, size_t c_stride, enum dvsm_epilogue epilogue)
{
	const struct amx_config config = amx_whole_tiles();
	const struct product product = {a,    a_stride, rows,     panels,  depth,
					cols, c,        c_stride, epilogue};

	amx_open(&config);
	switch (epilogue) {
	case DVSM_EPILOGUE_STORE:
		multiply(&product, DVSM_EPILOGUE_STORE);
		break;
	case DVSM_EPILOGUE_ADD:
		multiply(&product, DVSM_EPILOGUE_ADD);
		break;
	case DVSM_EPILOGUE_GELU:
		multiply(&product, DVSM_EPILOGUE_GELU);
		break;
	}
	amx_close();
}
