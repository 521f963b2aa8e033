/*
 * Template: fixed-point products of AMX, included by fixed_amx.c.
 *
 * Two tiles of A meet two of B in four tiles of sums, a block, so that each tile loaded is used
 * twice. The tiles' unit and the vectors' work at the same time only where their instructions lie
 * within a few hundred of each other: so the sums of a block leave their tiles between the first
 * products of the next one, and its rows go out behind the others, one or two at a time.
 */
#include "kernels/fixed_avx512_finish.h"

/* Rows and columns of a block. */
#define BLOCK ((size_t)2 * TILE)

/* Products of tiles in a step of depth. */
#define PRODUCTS ((size_t)4)

/* Rows of A that are longer pass by the first-level cache, where the panels' stay. */
#define LONG_ROW ((size_t)512)

/* A block of sums on its way out, a row at a time. Until they are stored the sums are in tiles 0 to
 * 3. */
struct block {
	_Alignas(64) int32_t sums[2][2][TILE][TILE]; /* [rows' tile][columns' tile] */
	struct row_scales scales;
	struct columns columns[2];
	size_t rows;      /* 0: there is none */
	unsigned char *c; /* where the first row goes */
};

/* What all blocks of a product have in common. */
struct product {
	const struct dvsm_fixed_gemm *job;
	struct requantise how;
	struct gelu gelu;
	size_t c_bytes; /* from row to row */
	size_t share;   /* of a block's rows that go out behind a product of tiles, times 2^16 */
	size_t ahead;   /* bytes of the next panels each product calls to the second-level cache */
	size_t called;  /* those of all products of a block */
};

/* What becomes of the sums: constant where functions are called. */
struct finish {
	enum requantise_way way;
	bool adds, gelu;
};

/* What brings out a block's rows: copies, because what is stored could else have changed them. */
struct outlet {
	struct requantise how;
	struct gelu gelu;
	struct columns left, right;
	__m512i order;
	__mmask32 lanes;
	size_t c_bytes;
};

DVSM_INLINE struct outlet open_outlet(const struct product *product, const struct block *block)
{
	return (struct outlet){
		.how = product->how,
		.gelu = product->gelu,
		.left = block->columns[0],
		.right = block->columns[1],
		.order = keep(_mm512_setr_epi64(0, 2, 4, 6, 1, 3, 5, 7)),
		.lanes = block->columns[0].lanes | (__mmask32)block->columns[1].lanes << TILE,
		.c_bytes = product->c_bytes,
	};
}

/* A row's 32 columns to their place. */
DVSM_INLINE void finish_row(const struct finish finish, const struct outlet *outlet,
			    const struct block *block, size_t row, unsigned char *to)
{
	const struct row_lanes scale = load_row(&block->scales, row);
	const int32_t *from = block->sums[0][0][0] + row / TILE * TILE * TILE + row * TILE;
	__m512i low = requantise(finish.way, finish.adds, &outlet->how, &scale, &outlet->left,
				 _mm512_load_si512(from));
	__m512i high = requantise(finish.way, finish.adds, &outlet->how, &scale, &outlet->right,
				  _mm512_load_si512(from + TILE * TILE));

	if (finish.adds) {
		int32_t *c = (int32_t *)(void *)to, *next = c + TILE;

		low = _mm512_add_epi32(low, _mm512_maskz_loadu_epi32(outlet->left.lanes, c));
		high = _mm512_add_epi32(high, _mm512_maskz_loadu_epi32(outlet->right.lanes, next));
		_mm512_mask_storeu_epi32(c, outlet->left.lanes, low);
		_mm512_mask_storeu_epi32(next, outlet->right.lanes, high);
	} else {
		__m512i words = _mm512_packs_epi32(low, high);

		words = _mm512_permutexvar_epi64(outlet->order, words);

		if (finish.gelu)
			words = gelu_lanes(&outlet->gelu, words);
		_mm512_mask_storeu_epi16(to, outlet->lanes, words);
	}
}

/* The block on its way, and how far its rows have gone. */
struct leaving {
	struct outlet outlet;
	const struct block *block;
	unsigned char *to;
	size_t row;
	size_t due, share; /* rows that should have gone, and that each product adds, times 2^16 */
	const int8_t *coming; /* weights that come next */
	size_t ahead;
};

DVSM_INLINE struct leaving open_leaving(const struct product *product, const struct block *block)
{
	return (struct leaving){
		.outlet = open_outlet(product, block),
		.block = block,
		.to = block->c,
		.share = block->rows * product->share,
	};
}

DVSM_INLINE void finish_rows(const struct finish finish, struct leaving *leaving, size_t end)
{
	for (; leaving->row < end; leaving->row++, leaving->to += leaving->outlet.c_bytes)
		finish_row(finish, &leaving->outlet, leaving->block, leaving->row, leaving->to);
}

/* Beside a product: the rows whose turn it is. */
DVSM_INLINE void go_on(const struct finish finish, struct leaving *leaving)
{
	leaving->due += leaving->share;
	for (size_t i = 0; i < leaving->ahead; i += 64)
		_mm_prefetch(leaving->coming + i, _MM_HINT_T1);
	leaving->coming += leaving->ahead;
	finish_rows(finish, leaving, leaving->due >> 16);
}

/* Sums from their tile, which is empty then. */
#define LEAVE(tile, block)                                                                         \
	do {                                                                                       \
		AMX_STORE(tile, (block)->sums[(tile) / 2][(tile) % 2], 64);                        \
		AMX_ZERO(tile);                                                                    \
	} while (0)

/* What is on its way goes out at once. */
DVSM_INLINE void flush(const struct finish finish, const struct product *product,
		       struct block *block)
{
	struct leaving leaving = open_leaving(product, block);

	LEAVE(0, block);
	LEAVE(1, block);
	LEAVE(2, block);
	LEAVE(3, block);
	finish_rows(finish, &leaving, block->rows);
	block->rows = 0;
}

/* A block whose rows or columns are not all there; rows that are not count as 0. Tiles 0 to 3 are
 * empty. */
static void multiply_part(const struct dvsm_fixed_gemm *job, size_t row, size_t col)
{
	const size_t rows = job->rows - row < BLOCK ? job->rows - row : BLOCK;
	const int8_t *w = job->panels + col * job->depth, *next = w + TILE * job->depth;
	const bool two_cols = col + TILE < job->cols;
	_Alignas(64) int8_t a[2][TILE][DEPTH];

	memset(a, 0, sizeof(a));
	for (size_t d = 0; d < job->depth; d += DEPTH) {
		for (size_t i = 0; i < rows; i++)
			memcpy(a[i / TILE][i % TILE], job->a + (row + i) * job->a_stride + d,
			       DEPTH);
		amx_publish();
		AMX_LOAD(4, a[0], DEPTH);
		AMX_LOAD(5, a[1], DEPTH);
		AMX_LOAD(6, w + d * TILE, 64);
		AMX_DOT_SIGNED(0, 4, 6);
		AMX_DOT_SIGNED(2, 5, 6);
		if (two_cols) {
			AMX_LOAD(7, next + d * TILE, 64);
			AMX_DOT_SIGNED(1, 4, 7);
			AMX_DOT_SIGNED(3, 5, 7);
		}
	}
}

#define LOAD_ROWS(tile, from, stride)                                                              \
	do {                                                                                       \
		if (long_rows)                                                                     \
			AMX_STREAM(tile, from, stride);                                            \
		else                                                                               \
			AMX_LOAD(tile, from, stride);                                              \
	} while (0)

/* The sums of a whole block, while the block before leaves. */
DVSM_INLINE void multiply(const struct finish finish, const bool long_rows,
			  const struct product *product, size_t row, size_t col,
			  struct block *before)
{
	const struct dvsm_fixed_gemm *job = product->job;
	const size_t stride = job->a_stride;
	const int8_t *a = job->a + row * stride, *lower = a + TILE * stride;
	const int8_t *w = job->panels + col * job->depth, *next = w + TILE * job->depth;
	struct leaving leaving = open_leaving(product, before);

	leaving.ahead = long_rows ? 0 : product->ahead;
	leaving.coming = next + TILE * job->depth + row / BLOCK * product->called;
	LOAD_ROWS(4, a, stride);
	AMX_LOAD(6, w, 64);
	LEAVE(0, before);
	AMX_DOT_SIGNED(0, 4, 6);
	AMX_LOAD(7, next, 64);
	LEAVE(1, before);
	AMX_DOT_SIGNED(1, 4, 7);
	LOAD_ROWS(5, lower, stride);
	LEAVE(2, before);
	AMX_DOT_SIGNED(2, 5, 6);
	LEAVE(3, before);
	AMX_DOT_SIGNED(3, 5, 7);
	for (size_t d = DEPTH; d < job->depth; d += DEPTH) {
		w += DEPTH * TILE;
		next += DEPTH * TILE;
		LOAD_ROWS(4, a + d, stride);
		AMX_LOAD(6, w, 64);
		AMX_DOT_SIGNED(0, 4, 6);
		go_on(finish, &leaving);
		AMX_LOAD(7, next, 64);
		AMX_DOT_SIGNED(1, 4, 7);
		go_on(finish, &leaving);
		LOAD_ROWS(5, lower + d, stride);
		AMX_DOT_SIGNED(2, 5, 6);
		go_on(finish, &leaving);
		AMX_DOT_SIGNED(3, 5, 7);
		go_on(finish, &leaving);
	}
	finish_rows(finish, &leaving, before->rows);
}

DVSM_INLINE void walk(const struct finish finish, const bool long_rows,
		      const struct product *product)
{
	const struct dvsm_fixed_gemm *job = product->job;
	const size_t number = finish.adds ? sizeof(int32_t) : sizeof(int16_t);
	struct block block;

	block.rows = 0;
	for (size_t col = 0; col < job->cols; col += BLOCK) {
		const struct columns columns[2] = {load_columns(job, col),
						   load_columns(job, col + TILE)};

		for (size_t row = 0; row < job->rows; row += BLOCK) {
			const size_t left = job->rows - row, rows = left < BLOCK ? left : BLOCK;

			if (job->depth > 0 && rows == BLOCK && job->cols - col > TILE) {
				multiply(finish, long_rows, product, row, col, &block);
			} else {
				flush(finish, product, &block);
				multiply_part(job, row, col);
			}
			prepare_rows(&product->how, job->a_scale + row, rows, &block.scales);
			block.columns[0] = columns[0];
			block.columns[1] = columns[1];
			block.rows = rows;
			block.c = (unsigned char *)job->c + row * product->c_bytes + col * number;
		}
	}
	flush(finish, product, &block);
}

static void gemm(const struct dvsm_fixed_gemm *job)
{
	const struct amx_config config = amx_whole_tiles();
	const bool adds = job->epilogue == DVSM_FIXED_ADD, gelu = job->epilogue == DVSM_FIXED_GELU;
	const size_t steps = job->depth / DEPTH;
	const size_t blocks = (job->rows + BLOCK - 1) / BLOCK;
	/* Of two panels a step has as many lines as a block has columns. */
	const size_t lines = BLOCK / PRODUCTS;
	const size_t ahead = blocks ? (lines + blocks - 1) / blocks * 64 : 0;

	amx_open(&config);
	AMX_KEEP_AWAKE(0, 4, 5);

	const struct product product = {
		.job = job,
		.how = requantise_prepare(job),
		.gelu = gelu_prepare(gelu ? job->fraction : 0),
		.c_bytes = job->c_stride * (adds ? sizeof(int32_t) : sizeof(int16_t)),
		.ahead = ahead,
		.called = ahead * PRODUCTS * (steps - 1),
		.share = steps > 1 ? ((size_t)1 << 16) / (PRODUCTS * (steps - 1)) : 0,
	};
	const enum requantise_way way = product.how.way;

	if (adds && way == REQUANTISE_WIDE)
		walk((struct finish){REQUANTISE_WIDE, true, false}, false, &product);
	else if (adds && job->depth <= LONG_ROW)
		walk((struct finish){REQUANTISE_CUT, true, false}, false, &product);
	else if (adds)
		walk((struct finish){REQUANTISE_CUT, true, false}, true, &product);
	else if (way == REQUANTISE_WIDE)
		walk((struct finish){REQUANTISE_WIDE, false, gelu}, false, &product);
	else if (way == REQUANTISE_CUT)
		walk((struct finish){REQUANTISE_CUT, false, gelu}, false, &product);
	else if (gelu)
		walk((struct finish){REQUANTISE_WORDS, false, true}, false, &product);
	else
		walk((struct finish){REQUANTISE_WORDS, false, false}, false, &product);
	amx_close();
}
