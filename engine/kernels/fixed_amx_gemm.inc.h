/*
 * Template: fixed-point products of AMX, included by fixed_amx.c.
 *
 * Two tiles of A meet two of B in four tiles of sums, so that each tile loaded is used twice. While
 * they multiply, the block before is brought out.
 */
#include "kernels/fixed_avx512_finish.h"

/* Rows and columns of a block. */
#define BLOCK ((size_t)2 * TILE)

/* Rows of a block that go out while the last products of the next one are on their way: loads would
 * wait for stores that wait for these, where addresses are alike in their lower 12 bits. */
#define LAST_ROWS ((size_t)8)

/* A block of sums on its way out, a row at a time. */
struct block {
	_Alignas(64) int32_t sums[2][2][TILE][TILE]; /* [rows' tile][columns' tile] */
	struct row_scales scales;
	struct columns columns[2];
	size_t rows;
	unsigned char *c; /* where the first row goes */
};

/* What all blocks of a product have in common. */
struct product {
	const struct dvsm_fixed_gemm *job;
	struct requantise how;
	struct gelu gelu;
	size_t c_bytes; /* from row to row */
	size_t share;   /* rows of the block before that go out in a step */
};

/* What becomes of the sums: constant where functions are called, but for products of 64 bits. */
struct finish {
	bool narrow, adds, gelu;
};

/* What brings out a block's rows: copies, because what is stored could else have changed them. */
struct outlet {
	struct requantise how;
	struct gelu gelu;
	struct columns left, right;
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
	__m512i low = requantise(finish.narrow, finish.adds, &outlet->how, &scale, &outlet->left,
				 _mm512_load_si512(from));
	__m512i high = requantise(finish.narrow, finish.adds, &outlet->how, &scale, &outlet->right,
				  _mm512_load_si512(from + TILE * TILE));

	if (finish.adds) {
		int32_t *c = (int32_t *)(void *)to, *next = c + TILE;

		low = _mm512_add_epi32(low, _mm512_maskz_loadu_epi32(outlet->left.lanes, c));
		high = _mm512_add_epi32(high, _mm512_maskz_loadu_epi32(outlet->right.lanes, next));
		_mm512_mask_storeu_epi32(c, outlet->left.lanes, low);
		_mm512_mask_storeu_epi32(next, outlet->right.lanes, high);
	} else {
		const __m512i order = _mm512_setr_epi64(0, 2, 4, 6, 1, 3, 5, 7);
		__m512i words = _mm512_permutexvar_epi64(order, _mm512_packs_epi32(low, high));

		if (finish.gelu)
			words = gelu_lanes(&outlet->gelu, words);
		_mm512_mask_storeu_epi16(to, outlet->lanes, words);
	}
}

DVSM_INLINE void finish_rows(const struct finish finish, const struct outlet *outlet,
			     const struct block *block, size_t first, size_t end)
{
	unsigned char *to = block->c + first * outlet->c_bytes;

	for (size_t row = first; row < end; row++, to += outlet->c_bytes)
		finish_row(finish, outlet, block, row, to);
}

DVSM_INLINE void flush(const struct finish finish, const struct product *product,
		       const struct block *block)
{
	const struct outlet outlet = open_outlet(product, block);

	finish_rows(finish, &outlet, block, 0, block->rows);
}

/* A block whose rows or columns are not all there; rows that are not count as 0. */
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

/* The sums of a whole block; between the steps, the rows of the block before. */
DVSM_INLINE void multiply(const struct finish finish, const struct product *product, size_t row,
			  size_t col, const struct block *before)
{
	const struct dvsm_fixed_gemm *job = product->job;
	const size_t stride = job->a_stride;
	const int8_t *a = job->a + row * stride, *lower = a + TILE * stride;
	const int8_t *w = job->panels + col * job->depth, *next = w + TILE * job->depth;
	const struct outlet outlet = open_outlet(product, before);
	const size_t rows = before->rows, share = product->share;
	const size_t early = rows < LAST_ROWS ? 0 : rows - LAST_ROWS;
	size_t done = 0;

	for (size_t d = 0; d < job->depth; d += DEPTH, w += DEPTH * TILE, next += DEPTH * TILE) {
		AMX_LOAD(4, a + d, stride);
		AMX_LOAD(6, w, 64);
		AMX_LOAD(7, next, 64);
		AMX_LOAD(5, lower + d, stride);
		AMX_DOT_SIGNED(0, 4, 6);
		AMX_DOT_SIGNED(1, 4, 7);
		AMX_DOT_SIGNED(2, 5, 6);
		AMX_DOT_SIGNED(3, 5, 7);
		/* The block before waits for its last products: none of its rows in the first step.
		 */
		if (d > 0) {
			size_t end = early - done < share ? early : done + share;

			finish_rows(finish, &outlet, before, done, end);
			done = end;
		}
	}
	finish_rows(finish, &outlet, before, done, rows);
}

DVSM_INLINE void block_sums(const struct finish finish, const struct product *product, size_t row,
			    size_t col, struct block *block, const struct block *before)
{
	const struct dvsm_fixed_gemm *job = product->job;

	AMX_ZERO(0);
	AMX_ZERO(1);
	AMX_ZERO(2);
	AMX_ZERO(3);
	if (job->rows - row >= BLOCK && job->cols - col > TILE) {
		multiply(finish, product, row, col, before);
	} else {
		multiply_part(job, row, col);
		flush(finish, product, before);
	}
	AMX_STORE(0, block->sums[0][0], 64);
	AMX_STORE(1, block->sums[0][1], 64);
	AMX_STORE(2, block->sums[1][0], 64);
	AMX_STORE(3, block->sums[1][1], 64);
}

DVSM_INLINE void walk(const struct finish finish, const struct product *product)
{
	const struct dvsm_fixed_gemm *job = product->job;
	const size_t number = finish.adds ? sizeof(int32_t) : sizeof(int16_t);
	struct block blocks[2];
	int at = 0;

	blocks[1].rows = 0;
	for (size_t col = 0; col < job->cols; col += BLOCK) {
		const struct columns columns[2] = {load_columns(job, col),
						   load_columns(job, col + TILE)};

		for (size_t row = 0; row < job->rows; row += BLOCK, at ^= 1) {
			const size_t left = job->rows - row, rows = left < BLOCK ? left : BLOCK;
			struct block *block = &blocks[at];

			block_sums(finish, product, row, col, block, &blocks[at ^ 1]);
			prepare_rows(&product->how, job->a_scale + row, rows, &block->scales);
			block->columns[0] = columns[0];
			block->columns[1] = columns[1];
			block->rows = rows;
			block->c = (unsigned char *)job->c + row * product->c_bytes + col * number;
		}
	}
	flush(finish, product, &blocks[at ^ 1]);
}

static void gemm(const struct dvsm_fixed_gemm *job)
{
	const struct amx_config config = amx_whole_tiles();
	const bool adds = job->epilogue == DVSM_FIXED_ADD, gelu = job->epilogue == DVSM_FIXED_GELU;

	amx_open(&config);
	AMX_KEEP_AWAKE(0, 4, 5);

	const struct product product = {
		.job = job,
		.how = requantise_prepare(job),
		.gelu = gelu_prepare(gelu ? job->fraction : 0),
		.c_bytes = job->c_stride * (adds ? sizeof(int32_t) : sizeof(int16_t)),
		.share = (BLOCK - LAST_ROWS) * DEPTH / (job->depth | 1) + 1,
	};

	if (!product.how.narrow)
		walk((struct finish){false, adds, gelu}, &product);
	else if (adds)
		walk((struct finish){true, true, false}, &product);
	else if (gelu)
		walk((struct finish){true, false, true}, &product);
	else
		walk((struct finish){true, false, false}, &product);
	amx_close();
}
