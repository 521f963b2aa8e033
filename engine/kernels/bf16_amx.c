/*
 * The bfloat16 kernels for AMX-BF16, with AVX-512 BF16 around them.
 *
 * A panel of weights is tiles as it lies: sixteen rows of pairs of sixteen columns. Two tiles of A
 * meet two of B in four tiles of sums, so that each tile loaded is used twice. Attention has the
 * queries along the lanes, as dot_attention.inc.h has: the keys are A as they lie, the values A
 * once they are turned.
 */
#include "kernels/tier.h"
#include "kernels/vec_avx512bf16.h"

#include "kernels/amx.h"

#define GEMM_ROWS         1
#define GEMM_PANELS       1
#define ATTENTION_VECTORS 4

#include "kernels/math.inc.h"

#include "kernels/number_bf16.inc.h"

#include "kernels/norm.inc.h"

#include "kernels/gemm_finish.inc.h"

/* Rows and columns of a tile of sums, numbers of depth it takes in at a time, and a block's side.
 */
#define TILE  16u
#define DEPTH 32u
#define BLOCK 32u

/* Up to 32 x 32 sums on their way out. */
struct sums {
	_Alignas(64) float part[2][2][TILE][TILE];
};

/* A tile of A that is not whole: zeros where it has no rows or no depth. */
struct fringe {
	_Alignas(64) number rows[TILE][DEPTH];
};

/* Sixteen rows of a at depth d, in place or copied, of which `rows` and up to `depth` exist. */
static const number *whole_tile(const number *a, size_t a_stride, size_t rows, size_t d,
				size_t depth, struct fringe *fringe, size_t *stride)
{
	const size_t count = depth - d < DEPTH ? depth - d : DEPTH;

	*stride = a_stride * sizeof(number);
	if (rows >= TILE && count == DEPTH)
		return a + d;
	*stride = DEPTH * sizeof(number);
	memset(fringe, 0, sizeof(*fringe));
	for (size_t i = 0; i < rows && i < TILE; i++)
		memcpy(fringe->rows[i], a + i * a_stride + d, count * sizeof(number));
	return &fringe->rows[0][0];
}

/* ---- products ---- */

struct product {
	const number *a;
	size_t a_stride, rows;
	const number *w;
	size_t depth, cols;
	void *c;
	size_t c_stride;
	enum dvsm_epilogue epilogue;
};

/* A whole block's sums that wait for their epilogue, and where in c they go. */
struct pending {
	_Alignas(64) float sums[BLOCK][BLOCK];
	size_t at;
	bool full;
};

/* Sums of up to two tiles of rows with up to two panels. */
static void multiply(const number *a, size_t a_stride, size_t rows, const number *w, size_t depth,
		     size_t cols, struct sums *sums)
{
	const bool two_rows = rows > TILE, two_cols = cols > TILE;
	const number *next = w + TILE * PANEL_DEPTH(depth);
	struct fringe fringe;

	AMX_ZERO(0);
	AMX_ZERO(1);
	AMX_ZERO(2);
	AMX_ZERO(3);
	for (size_t d = 0; d < depth; d += DEPTH) {
		size_t stride;
		const number *from = whole_tile(a, a_stride, rows, d, depth, &fringe, &stride);

		AMX_LOAD(4, from, stride);
		AMX_LOAD(6, w + d * TILE, 64);
		AMX_DOT_BF16(0, 4, 6);
		if (two_cols) {
			AMX_LOAD(7, next + d * TILE, 64);
			AMX_DOT_BF16(1, 4, 7);
		}
		if (two_rows) {
			from = whole_tile(a + TILE * a_stride, a_stride, rows - TILE, d, depth,
					  &fringe, &stride);
			AMX_LOAD(5, from, stride);
			AMX_DOT_BF16(2, 5, 6);
			if (two_cols)
				AMX_DOT_BF16(3, 5, 7);
		}
	}
	AMX_STORE(0, sums->part[0][0], 64);
	AMX_STORE(1, sums->part[0][1], 64);
	AMX_STORE(2, sums->part[1][0], 64);
	AMX_STORE(3, sums->part[1][1], 64);
}

/* A block that is not whole: its sums at once, then their epilogue. */
static void multiply_part(const struct product *p, size_t row, size_t col)
{
	const size_t rows = p->rows - row < BLOCK ? p->rows - row : BLOCK;
	struct sums sums;

	multiply(p->a + row * p->a_stride, p->a_stride, rows, p->w + col * PANEL_DEPTH(p->depth),
		 p->depth, p->cols - col, &sums);
	for (size_t i = 0; i < rows; i++) {
		for (size_t j = 0; j < BLOCK && col + j < p->cols; j += TILE)
			finish(p->c, (row + i) * p->c_stride + col + j, p->cols - col - j,
			       vf_load(sums.part[i / TILE][j / TILE][i % TILE]), p->epilogue);
	}
}

/* Rows first .. end - 1 of a whole block on their way out. */
DVSM_INLINE void finish_rows(const struct pending *pending, size_t first, size_t end, void *c,
			     size_t c_stride, enum dvsm_epilogue epilogue)
{
	for (size_t i = first; i < end; i++) {
		const size_t at = pending->at + i * c_stride;
		vf left = vf_load(pending->sums[i]), right = vf_load(pending->sums[i] + TILE);

		if (epilogue == DVSM_EPILOGUE_GELU) {
			vp_store((number *)c + at, vp_join(num_gelu(left), num_gelu(right)));
			continue;
		}
		if (epilogue == DVSM_EPILOGUE_ADD) {
			left = vf_add(vf_load((float *)c + at), left);
			right = vf_add(vf_load((float *)c + at + TILE), right);
		}
		vf_store((float *)c + at, left);
		vf_store((float *)c + at + TILE, right);
	}
}

/*
 * The sums of one whole block, and beside its products the epilogue of the block before, which
 * `pending` holds: the tiles' unit and the vectors' units work at the same time. `ahead` lines of
 * the weights that come next are called into the second-level cache a step.
 */
DVSM_INLINE void multiply_whole(const struct product *p, size_t row, size_t col,
				struct pending *pending, const char *next, size_t ahead,
				enum dvsm_epilogue epilogue)
{
	const size_t steps = p->depth / DEPTH, share = (BLOCK + steps - 1) / steps;
	const size_t stride = p->a_stride * sizeof(number);
	const number *a = p->a + row * p->a_stride;
	const number *w = p->w + col * PANEL_DEPTH(p->depth);
	const number *w2 = w + TILE * PANEL_DEPTH(p->depth);
	size_t done = pending->full ? 0 : BLOCK;

	AMX_ZERO(0);
	AMX_ZERO(1);
	AMX_ZERO(2);
	AMX_ZERO(3);
	for (size_t d = 0; d < p->depth; d += DEPTH) {
		AMX_LOAD(6, w + d * TILE, 64);
		AMX_LOAD(4, a + d, stride);
		AMX_DOT_BF16(0, 4, 6);
		AMX_LOAD(7, w2 + d * TILE, 64);
		AMX_DOT_BF16(1, 4, 7);
		AMX_LOAD(5, a + TILE * p->a_stride + d, stride);
		AMX_DOT_BF16(2, 5, 6);
		AMX_DOT_BF16(3, 5, 7);
		for (size_t i = 0; i < ahead; i++, next += 64)
			_mm_prefetch(next, _MM_HINT_T1);
		if (done < BLOCK) {
			size_t end = done + share < BLOCK ? done + share : BLOCK;

			finish_rows(pending, done, end, p->c, p->c_stride, epilogue);
			done = end;
		}
	}
	finish_rows(pending, done, BLOCK, p->c, p->c_stride, epilogue);
	AMX_STORE(0, pending->sums[0], BLOCK * sizeof(float));
	AMX_STORE(1, pending->sums[0] + TILE, BLOCK * sizeof(float));
	AMX_STORE(2, pending->sums[TILE], BLOCK * sizeof(float));
	AMX_STORE(3, pending->sums[TILE] + TILE, BLOCK * sizeof(float));
	pending->at = row * p->c_stride + col;
	pending->full = true;
}

/* Two panels stay in the first-level cache while all rows pass by. */
DVSM_INLINE void gemm_blocks(const struct product *p, enum dvsm_epilogue epilogue)
{
	const size_t whole_rows = p->depth % DEPTH || p->depth == 0 ? 0 : p->rows / BLOCK * BLOCK;
	const size_t pair_bytes = BLOCK * PANEL_DEPTH(p->depth) * sizeof(number);
	const size_t blocks = whole_rows / BLOCK;
	struct pending pending;

	pending.full = false;
	for (size_t col = 0; col < p->cols; col += BLOCK) {
		const bool whole = p->cols - col >= BLOCK;
		const char *next = (const char *)(p->w + col * PANEL_DEPTH(p->depth)) + pair_bytes;
		size_t lines = whole && p->cols - col > BLOCK + TILE ? BLOCK : 0;
		size_t ahead = blocks ? (lines + blocks - 1) / blocks : 0;
		size_t row = 0;

		for (; whole && row < whole_rows; row += BLOCK) {
			size_t at = row / BLOCK * ahead;

			multiply_whole(p, row, col, &pending, next + at * (p->depth / DEPTH) * 64,
				       at + ahead <= lines ? ahead : 0, epilogue);
		}
		for (; row < p->rows; row += BLOCK)
			multiply_part(p, row, col);
	}
	if (pending.full)
		finish_rows(&pending, 0, BLOCK, p->c, p->c_stride, epilogue);
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
		gemm_blocks(&product, DVSM_EPILOGUE_STORE);
		break;
	case DVSM_EPILOGUE_ADD:
		gemm_blocks(&product, DVSM_EPILOGUE_ADD);
		break;
	case DVSM_EPILOGUE_GELU:
		gemm_blocks(&product, DVSM_EPILOGUE_GELU);
		break;
	}
	amx_close();
}

/* ---- attention ---- */

#include "kernels/attention_state.inc.h"
#include "kernels/dot_weigh.inc.h"

/* Behind the pairs of queries: the values of a tile, turned to [head_dim][DVSM_ATTENTION_KEYS]. */
static number *turned_values(const struct attention_state *state, size_t head_dim)
{
	return query_pairs(state) + dvsm_bf16_depth(head_dim) * QUERY_LANES;
}

static void prepare(const struct attention_state *state, size_t head_dim)
{
	zip_queries(state, head_dim, dvsm_bf16_depth(head_dim));
}

/* Scores of 32 keys with 32 queries; keys that are not there get scores of 0. */
static void score_block(const struct attention_state *state, const number *k, size_t keys,
			size_t head_dim, size_t key, size_t query)
{
	const bool two = key + TILE < keys;
	const size_t lanes = QUERY_LANES * sizeof(float);
	float *scores = state->scores + key * QUERY_LANES + query;
	struct fringe fringe;

	AMX_ZERO(0);
	AMX_ZERO(1);
	AMX_ZERO(2);
	AMX_ZERO(3);
	for (size_t d = 0; d < head_dim; d += DEPTH) {
		const number *q = query_pairs(state) + d * QUERY_LANES + 2 * query, *from;
		size_t stride;

		AMX_LOAD(6, q, lanes);
		AMX_LOAD(7, q + 2 * TILE, lanes);
		from = whole_tile(k + key * head_dim, head_dim, keys - key, d, head_dim, &fringe,
				  &stride);
		AMX_LOAD(4, from, stride);
		AMX_DOT_BF16(0, 4, 6);
		AMX_DOT_BF16(1, 4, 7);
		if (two) {
			from = whole_tile(k + (key + TILE) * head_dim, head_dim, keys - key - TILE,
					  d, head_dim, &fringe, &stride);
			AMX_LOAD(5, from, stride);
			AMX_DOT_BF16(2, 5, 6);
			AMX_DOT_BF16(3, 5, 7);
		}
	}
	AMX_STORE(0, scores, lanes);
	AMX_STORE(1, scores + TILE, lanes);
	AMX_STORE(2, scores + TILE * QUERY_LANES, lanes);
	AMX_STORE(3, scores + TILE * QUERY_LANES + TILE, lanes);
}

/* out = out shrink + sums, for up to sixteen numbers of the head from `d` on. */
static void add_part(const struct attention_state *state, size_t head_dim, size_t d, size_t query,
		     float part[TILE][TILE])
{
	vf shrink = vf_load(state->shrink + query);

	for (size_t i = 0; i < TILE && d + i < head_dim; i++) {
		float *o = state->out + (d + i) * QUERY_LANES + query;

		vf_store(o, vf_fma(vf_load(o), shrink, vf_load(part[i])));
	}
}

/* The weights of a tile times 32 numbers of the head, for 32 queries. */
static void value_block(const struct attention_state *state, size_t head_dim, size_t keys, size_t d,
			size_t query)
{
	const size_t lanes = QUERY_LANES * sizeof(float), row = DVSM_ATTENTION_KEYS;
	const number *v = turned_values(state, head_dim) + d * row;
	struct sums sums;

	AMX_ZERO(0);
	AMX_ZERO(1);
	AMX_ZERO(2);
	AMX_ZERO(3);
	for (size_t key = 0; key < keys; key += DEPTH) {
		const number *weights =
			(const number *)state->scores + key * QUERY_LANES + 2 * query;

		AMX_LOAD(6, weights, lanes);
		AMX_LOAD(7, weights + 2 * TILE, lanes);
		AMX_LOAD(4, v + key, row * sizeof(number));
		AMX_LOAD(5, v + TILE * row + key, row * sizeof(number));
		AMX_DOT_BF16(0, 4, 6);
		AMX_DOT_BF16(1, 4, 7);
		AMX_DOT_BF16(2, 5, 6);
		AMX_DOT_BF16(3, 5, 7);
	}
	AMX_STORE(0, sums.part[0][0], 64);
	AMX_STORE(1, sums.part[0][1], 64);
	AMX_STORE(2, sums.part[1][0], 64);
	AMX_STORE(3, sums.part[1][1], 64);
	for (size_t j = 0; j < 2; j++) {
		add_part(state, head_dim, d, query + j * TILE, sums.part[0][j]);
		add_part(state, head_dim, d + TILE, query + j * TILE, sums.part[1][j]);
	}
}

/* out[j][i] = in[i][j] of 32-bit elements; rows of `out` are out_stride bytes apart. */
static void turn_block(__m512i in[TILE], unsigned char *out, size_t out_stride)
{
	__m512i a[TILE], b[TILE];

	for (size_t i = 0; i < TILE; i += 2) {
		a[i] = _mm512_unpacklo_epi32(in[i], in[i + 1]);
		a[i + 1] = _mm512_unpackhi_epi32(in[i], in[i + 1]);
	}
	for (size_t i = 0; i < TILE; i += 4) {
		b[i] = _mm512_unpacklo_epi64(a[i], a[i + 2]);
		b[i + 1] = _mm512_unpackhi_epi64(a[i], a[i + 2]);
		b[i + 2] = _mm512_unpacklo_epi64(a[i + 1], a[i + 3]);
		b[i + 3] = _mm512_unpackhi_epi64(a[i + 1], a[i + 3]);
	}
	/* b[4 r + c], quarter l, is column 4 l + c of rows 4 r and on. */
	for (size_t c = 0; c < 4; c++) {
		__m512i low = _mm512_shuffle_i32x4(b[c], b[c + 4], 0x88);
		__m512i high = _mm512_shuffle_i32x4(b[c], b[c + 4], 0xdd);
		__m512i low2 = _mm512_shuffle_i32x4(b[c + 8], b[c + 12], 0x88);
		__m512i high2 = _mm512_shuffle_i32x4(b[c + 8], b[c + 12], 0xdd);

		_mm512_storeu_si512(out + c * out_stride, _mm512_shuffle_i32x4(low, low2, 0x88));
		_mm512_storeu_si512(out + (c + 4) * out_stride,
				    _mm512_shuffle_i32x4(high, high2, 0x88));
		_mm512_storeu_si512(out + (c + 8) * out_stride,
				    _mm512_shuffle_i32x4(low, low2, 0xdd));
		_mm512_storeu_si512(out + (c + 12) * out_stride,
				    _mm512_shuffle_i32x4(high, high2, 0xdd));
	}
}

/* Sixteen numbers of a key's value, 0 where there are none. */
static inline __m512i value_lanes(const number *v, size_t keys, size_t head_dim, size_t key,
				  size_t d)
{
	const size_t left = key < keys && d < head_dim ? head_dim - d : 0;
	const __mmask16 lanes = left >= TILE ? 0xffff : (__mmask16)((1u << left) - 1);

	if (left == 0)
		return _mm512_setzero_si512();
	return _mm512_cvtepu16_epi32(_mm256_maskz_loadu_epi16(lanes, v + key * head_dim + d));
}

/* Values to their turned place, pairs of keys as 32-bit elements, zeros behind keys and head. */
static void turn_values(const struct attention_state *state, const number *v, size_t keys,
			size_t head_dim)
{
	const size_t row = DVSM_ATTENTION_KEYS;

	for (size_t key = 0; key < keys; key += 2 * TILE) {
		for (size_t d = 0; d < dvsm_bf16_depth(head_dim); d += TILE) {
			__m512i pairs[TILE];

			for (size_t i = 0; i < TILE; i++) {
				__m512i even = value_lanes(v, keys, head_dim, key + 2 * i, d);
				__m512i odd = value_lanes(v, keys, head_dim, key + 2 * i + 1, d);

				pairs[i] = _mm512_or_si512(even, _mm512_slli_epi32(odd, 16));
			}
			turn_block(
				pairs,
				(unsigned char *)(turned_values(state, head_dim) + d * row + key),
				row * sizeof(number));
		}
	}
}

/* Weights of keys that are not there, up to whole tiles, are 0. */
static void clear_weights(const struct attention_state *state, size_t keys)
{
	const size_t from = (keys + 1) / 2 * 2, to = (keys + DEPTH - 1) / DEPTH * DEPTH;

	memset((number *)state->scores + from * QUERY_LANES, 0,
	       (to - from) * QUERY_LANES * sizeof(number));
}

/* One tile of up to DVSM_ATTENTION_KEYS keys. */
static void attend(const struct attention_state *state, const number *k, const number *v,
		   size_t keys, size_t head_dim)
{
	for (size_t key = 0; key < keys; key += 2 * TILE) {
		for (size_t query = 0; query < QUERY_LANES; query += 2 * TILE)
			score_block(state, k, keys, head_dim, key, query);
	}
	weigh(state, keys);
	clear_weights(state, keys);
	turn_values(state, v, keys, head_dim);
	for (size_t d = 0; d < head_dim; d += 2 * TILE) {
		for (size_t query = 0; query < QUERY_LANES; query += 2 * TILE)
			value_block(state, head_dim, keys, d, query);
	}
}

#include "kernels/attention_frame.inc.h"

static void attention_on_tiles(const struct dvsm_attention *job)
{
	const struct amx_config config = amx_whole_tiles();

	amx_open(&config);
	attention(job);
	amx_close();
}

const struct dvsm_kernels dvsm_kernels_bf16_amx = {
	.cpu = DVSM_CPU_AMX_BF16,
	.name = "amx",
	.number_bytes = sizeof(number),
	.gemm = gemm,
	.layer_norm = layer_norm,
	.embed_norm = embed_norm,
	.key_norm = key_norm,
	.query_norm = query_norm,
	.convert = convert,
	.attention = attention_on_tiles,
	.to_colour = to_colour,
};
