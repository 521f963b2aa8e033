/*
 * Products and attention of the fixed-point path for Advanced SIMD. The including file defines
 *
 *   dot_rows            rows that one call of dot_tile() takes at most
 *   dot_tile(a, b, b_step, groups, sums)
 *                       sums[row][16] = products of dot_rows rows of A with 16 columns of B. A
 *                       group is four numbers deep: four bytes of a row, and 64 bytes of B, column
 *                       by column, b_step bytes from one to the next; groups is a multiple of 4.
 *
 * and, where dot_tile() wants the columns in another order, DOT_PACKS and
 *
 *   dot_piece           groups that are packed at a time, a multiple of 4
 *   dot_columns(b, &b_step, groups, room)
 *                       packs them, for all rows, into dot_room bytes of room
 *
 * All numbers of B are -127..127, those of A -128..127, so that two products fit 16 bits.
 */
#include <arm_neon.h>
#include <string.h>

#include "kernels/fixed_math.h"

#define WIDTH ((size_t)DVSM_FIXED_PANEL)

#if !defined(DOT_PACKS)
enum { dot_piece = 1 << 16, dot_room = 1 };

static inline const int8_t *dot_columns(const int8_t *b, size_t *b_step, size_t groups,
					int8_t *room)
{
	(void)b_step, (void)groups, (void)room;
	return b;
}
#endif

/* Any number of rows with a piece of B, stored or added: the last ones are done as if there were
 * more, from rows that are there. */
static void dot_block(const int8_t *a, size_t a_stride, size_t rows, const int8_t *b, size_t b_step,
		      size_t groups, bool adds, int32_t *sums, size_t sums_stride)
{
	int32_t tile[dot_rows * WIDTH];

	for (size_t row = 0; row < rows; row += dot_rows) {
		const size_t left = rows - row < dot_rows ? rows - row : dot_rows;
		const int8_t *at[dot_rows];

		for (size_t i = 0; i < dot_rows; i++)
			at[i] = a + (row + (i < left ? i : 0)) * a_stride;
		dot_tile(at, b, b_step, groups, tile);
		for (size_t i = 0; i < left; i++) {
			int32_t *to = sums + (row + i) * sums_stride;

			for (size_t j = 0; j < WIDTH; j += 4) {
				int32x4_t sum = vld1q_s32(tile + i * WIDTH + j);

				vst1q_s32(to + j, adds ? vaddq_s32(vld1q_s32(to + j), sum) : sum);
			}
		}
	}
}

static void dot(const int8_t *a, size_t a_stride, size_t rows, const int8_t *b, size_t b_step,
		size_t groups, int32_t *sums, size_t sums_stride)
{
	int8_t room[dot_room];
	size_t first = 0;

	do {
		const size_t count = groups - first < dot_piece ? groups - first : dot_piece;
		size_t step = b_step;
		const int8_t *columns = dot_columns(b + first * b_step, &step, count, room);

		dot_block(a + 4 * first, a_stride, rows, columns, step, count, first > 0, sums,
			  sums_stride);
		first += count;
	} while (first < groups);
}

/* ---- products ---- */

/* R(t f 2^15, shift) of four columns, as two pairs of 64 bits. */
static inline void requantise(int32x4_t sums, struct dvsm_fixed_scale scale, int16x4_t mantissa,
			      int16x4_t shift, int64x2_t *low, int64x2_t *high)
{
	const int32x4_t factor = vshll_n_s16(vqrdmulh_n_s16(mantissa, scale.mantissa), 15);
	int32x4_t left = vsubq_s32(vdupq_n_s32(scale.exponent), vmovl_s16(shift));

	left = vmaxq_s32(vminq_s32(left, vdupq_n_s32(-1)), vdupq_n_s32(-62));
	*low = vrshlq_s64(vmull_s32(vget_low_s32(sums), vget_low_s32(factor)),
			  vmovl_s32(vget_low_s32(left)));
	*high = vrshlq_s64(vmull_high_s32(sums, factor), vmovl_high_s32(left));
}

/* The tail of gelu at 64 points and the differences to the next ones, as bytes for table look-up.
 */
struct gelu_table {
	uint8x16x4_t low, high, next_low, next_high;
};

static struct gelu_table gelu_table_load(void)
{
	struct gelu_table table;

	for (int i = 0; i < 4; i++) {
		uint8x16x2_t here = vld2q_u8((const uint8_t *)(dvsm_fixed_gelu_tail + 16 * i));
		uint8x16x2_t next = vld2q_u8((const uint8_t *)(dvsm_fixed_gelu_tail + 16 * i + 1));

		table.low.val[i] = here.val[0];
		table.high.val[i] = here.val[1];
		table.next_low.val[i] = next.val[0];
		table.next_high.val[i] = next.val[1];
	}
	return table;
}

static inline int16x8_t look_up(const uint8x16x4_t *low, const uint8x16x4_t *high, uint8x8_t at)
{
	return vreinterpretq_s16_u16(
		vorrq_u16(vmovl_u8(vqtbl4_u8(*low, at)), vshll_n_u8(vqtbl4_u8(*high, at), 8)));
}

/* dvsm_fixed_gelu() of eight numbers. */
static inline int16x8_t gelu(const struct gelu_table *table, int16x8_t u, int fraction)
{
	const int16x8_t positive = vmaxq_s16(u, vdupq_n_s16(0));
	uint16x8_t at;
	int16x8_t tail, next;

	if (fraction < 2)
		return positive;
	at = vqshlq_u16(vreinterpretq_u16_s16(vqabsq_s16(u)),
			vdupq_n_s16((int16_t)(12 - fraction)));
	at = vminq_u16(at, vdupq_n_u16(16383));

	const uint8x8_t index = vshrn_n_u16(at, 8);
	const int16x8_t part =
		vreinterpretq_s16_u16(vshlq_n_u16(vandq_u16(at, vdupq_n_u16(255)), 7));

	tail = look_up(&table->low, &table->high, index);
	next = look_up(&table->next_low, &table->next_high, index);
	tail = vaddq_s16(tail, vqrdmulhq_s16(vsubq_s16(next, tail), part));
	return vsubq_s16(positive, vrshlq_s16(tail, vdupq_n_s16((int16_t)(fraction - 17))));
}

static void store_row(const struct dvsm_fixed_gemm *job, const struct gelu_table *table, size_t row,
		      size_t first, const int32_t *sums)
{
	const size_t left = job->cols - first < WIDTH ? job->cols - first : WIDTH;
	const struct dvsm_fixed_scale scale = job->a_scale[row];
	const bool adds = job->epilogue == DVSM_FIXED_ADD;
	int16_t mantissas[WIDTH] = {0}, shifts[WIDTH] = {0}, narrow[WIDTH];
	const int16_t *mantissa = job->w_mantissa + first, *shift = job->w_shift + first;
	const size_t at = row * job->c_stride + first;
	int32_t wide[WIDTH];

	if (left < WIDTH) {
		mantissa = memcpy(mantissas, mantissa, left * sizeof(*mantissas));
		shift = memcpy(shifts, shift, left * sizeof(*shifts));
	}
	for (size_t j = 0; j < WIDTH; j += 4) {
		int64x2_t low, high;

		requantise(vld1q_s32(sums + j), scale, vld1_s16(mantissa + j), vld1_s16(shift + j),
			   &low, &high);
		if (adds)
			vst1q_s32(wide + j, vmovn_high_s64(vmovn_s64(low), high));
		else
			vst1_s16(narrow + j, vqmovn_s32(vqmovn_high_s64(vqmovn_s64(low), high)));
	}
	if (adds) {
		int32_t *c = (int32_t *)job->c + at;

		for (size_t j = 0; j < left; j++)
			c[j] = (int32_t)((uint32_t)c[j] + (uint32_t)wide[j]);
		return;
	}
	if (job->epilogue == DVSM_FIXED_GELU)
		for (size_t j = 0; j < WIDTH; j += 8)
			vst1q_s16(narrow + j, gelu(table, vld1q_s16(narrow + j), job->fraction));
	memcpy((int16_t *)job->c + at, narrow, left * sizeof(*narrow));
}

/* Rows in blocks that stay in the first cache while all panels pass by. */
#define ROW_BLOCK 32

static void gemm(const struct dvsm_fixed_gemm *job)
{
	const struct gelu_table table = gelu_table_load();
	int32_t sums[ROW_BLOCK * WIDTH];

	for (size_t row = 0; row < job->rows; row += ROW_BLOCK) {
		const size_t rows = job->rows - row < ROW_BLOCK ? job->rows - row : ROW_BLOCK;

		for (size_t first = 0; first < job->cols; first += WIDTH) {
			dot(job->a + row * job->a_stride, job->a_stride, rows,
			    job->panels + first * job->depth, 4 * WIDTH, job->depth / 4, sums,
			    WIDTH);
			for (size_t i = 0; i < rows; i++)
				store_row(job, &table, row + i, first, sums + i * WIDTH);
		}
	}
}

/* ---- attention ---- */

/*
 * Weights p are 15 bits wide and positive, what multiplies is signed and 8 wide: p >> 8 goes in as
 * it is, p & 255 without 128; as often the sum of the values is added again.
 */
#define LOW_OFFSET 128

/* The scratch of one call. */
struct places {
	int16_t *scores; /* [queries][scores_stride] words of all keys where kept, else of a tile */
	size_t scores_stride;
	bool kept;
	int8_t *high, *low; /* [queries][DVSM_FIXED_KEYS] */
	int64_t *o;         /* [queries][head_width] */
	int32_t *sums;      /* [queries][WIDTH] twice */
	int64_t *total;     /* [queries] sums of p */
	int16_t *top;       /* [queries] */
	int16_t *shift;     /* [queries] of their words */
};

static struct places place(const struct dvsm_fixed_attention *job)
{
	const size_t queries = DVSM_FIXED_QUERIES, keys = DVSM_FIXED_KEYS;
	struct places made;

	made.scores = job->scratch;
	made.kept = dvsm_fixed_scores_fit(queries, job->keys);
	made.scores_stride = dvsm_fixed_scores_stride(made.kept ? job->keys : keys);
	made.o = (int64_t *)(void *)(made.scores + DVSM_FIXED_SCORES);
	made.total = made.o + queries * job->head_width;
	made.sums = (int32_t *)(void *)(made.total + queries);
	/* head_width is at least WIDTH: sums fit what the other accumulators leave. */
	made.top = (int16_t *)(void *)(made.sums + queries * WIDTH * 2);
	made.shift = made.top + queries;
	made.high = (int8_t *)(made.shift + queries);
	made.low = made.high + queries * keys;
	return made;
}

static int16_t largest_of(const int16_t *scores, size_t count)
{
	int16x8_t most = vdupq_n_s16(INT16_MIN);
	size_t key = 0;
	int16_t largest;

	for (; key + 8 <= count; key += 8)
		most = vmaxq_s16(most, vld1q_s16(scores + key));
	largest = vmaxvq_s16(most);
	for (; key < count; key++)
		largest = scores[key] > largest ? scores[key] : largest;
	return largest;
}

/* A slope in all lanes; shifts to the right are negative. */
struct slope_lanes {
	int16x8_t top, left, right;
	uint16_t factor;
};

static inline struct slope_lanes slope_lanes_make(struct dvsm_fixed_slope slope, int16_t top)
{
	return (struct slope_lanes){
		.top = vdupq_n_s16(top),
		.left = vdupq_n_s16((int16_t)(16 - slope.fraction)),
		.right = vdupq_n_s16((int16_t)-slope.fraction),
		.factor = slope.factor,
	};
}

/* dvsm_fixed_exp2() of eight numbers. */
static inline uint16x8_t exp2_of(uint16x8_t x, const struct slope_lanes *slope)
{
	const int16x8_t a = vdupq_n_s16(DVSM_FIXED_EXP2_A), b = vdupq_n_s16(DVSM_FIXED_EXP2_B);
	const int16x8_t one = vreinterpretq_s16_u16(vdupq_n_u16(DVSM_FIXED_EXP2_ONE));
	const int16x8_t t = vreinterpretq_s16_u16(vshlq_u16(x, slope->left));
	int16x8_t r, whole;

	r = vsubq_s16(b, vqrdmulhq_n_s16(t, DVSM_FIXED_EXP2_C));
	r = vsubq_s16(a, vqrdmulhq_s16(t, r));
	r = vsubq_s16(one, vqrdmulhq_s16(t, r));
	/* A shift takes its lowest byte alone. */
	whole = vreinterpretq_s16_u16(vminq_u16(vrshlq_u16(x, slope->right), vdupq_n_u16(17)));
	return vrshrq_n_u16(vshlq_u16(vreinterpretq_u16_s16(r), vnegq_s16(whole)), 1);
}

/* How far eight words are from the top. */
static inline uint16x8_t distance(const int16_t *words, const struct slope_lanes *slope)
{
	const uint16x8_t way = vreinterpretq_u16_s16(vsubq_s16(slope->top, vld1q_s16(words)));
	const uint32x4_t low = vmull_n_u16(vget_low_u16(way), slope->factor);
	const uint32x4_t high = vmull_n_u16(vget_high_u16(way), slope->factor);

	return vuzp2q_u16(vreinterpretq_u16_u32(low), vreinterpretq_u16_u32(high));
}

/* Both planes of p for `padded` keys, 0 behind `count` of them; the sum of p. */
static uint32_t weigh(const int16_t *words, size_t count, size_t padded,
		      const struct slope_lanes *slope, int8_t *high, int8_t *low)
{
	static const uint16_t order[8] = {0, 1, 2, 3, 4, 5, 6, 7};
	uint32x4_t sum = vdupq_n_u32(0);

	for (size_t key = 0; key < padded; key += 8) {
		const size_t left = count > key ? count - key : 0;
		uint16x8_t p = exp2_of(distance(words + key, slope), slope);

		if (left < 8)
			p = vandq_u16(p, vcltq_u16(vld1q_u16(order), vdupq_n_u16((uint16_t)left)));
		sum = vpadalq_u16(sum, p);
		vst1_s8(high + key, vreinterpret_s8_u8(vshrn_n_u16(p, 8)));
		vst1_s8(low + key, veor_s8(vreinterpret_s8_u8(vmovn_u16(p)), vdup_n_s8(INT8_MIN)));
	}
	return vaddvq_u32(sum);
}

/* Sums of each of 16 channels over the tile's values. */
static void sum_values(const int8_t *v, size_t step, size_t groups, int32_t sums[WIDTH])
{
	int32x4_t sum[4] = {vdupq_n_s32(0), vdupq_n_s32(0), vdupq_n_s32(0), vdupq_n_s32(0)};

	for (size_t group = 0; group < groups; group++, v += step)
		for (int i = 0; i < 4; i++)
			sum[i] = vpadalq_s16(sum[i], vpaddlq_s8(vld1q_s8(v + 16 * i)));
	for (int i = 0; i < 4; i++)
		vst1q_s32(sums + 4 * i, sum[i]);
}

/* O += the tile's weighted values, 16 channels at a time. */
static void mix(const struct dvsm_fixed_attention *job, const struct places *at, const int8_t *v,
		size_t padded)
{
	int32_t *high = at->sums, *low = high + DVSM_FIXED_QUERIES * WIDTH;
	const size_t step = 4 * job->head_width;
	int32_t values[WIDTH];

	for (size_t first = 0; first < job->head_width; first += WIDTH) {
		sum_values(v + 4 * first, step, padded / 4, values);
		dot(at->high, DVSM_FIXED_KEYS, job->queries, v + 4 * first, step, padded / 4, high,
		    WIDTH);
		dot(at->low, DVSM_FIXED_KEYS, job->queries, v + 4 * first, step, padded / 4, low,
		    WIDTH);
		for (size_t i = 0; i < job->queries; i++) {
			int64_t *o = at->o + i * job->head_width + first;

			for (size_t j = 0; j < WIDTH; j += 4) {
				const int32x4_t all = vld1q_s32(values + j);
				int32x4_t more = vmlaq_n_s32(vld1q_s32(low + i * WIDTH + j), all,
							     LOW_OFFSET);

				more = vmlaq_n_s32(more, vld1q_s32(high + i * WIDTH + j), 256);
				vst1q_s64(o + j, vaddw_s32(vld1q_s64(o + j), vget_low_s32(more)));
				vst1q_s64(o + j + 2, vaddw_high_s32(vld1q_s64(o + j + 2), more));
			}
		}
	}
}

/* Scores of a query's tile, sixteen keys, to words. */
static inline void keep_words(const int32_t sums[WIDTH], int shift, int16_t words[WIDTH])
{
	const int32x4_t down = vdupq_n_s32(-shift);

	for (size_t i = 0; i < WIDTH; i += 8)
		vst1q_s16(words + i,
			  vcombine_s16(vmovn_s32(vshlq_s32(vld1q_s32(sums + i), down)),
				       vmovn_s32(vshlq_s32(vld1q_s32(sums + i + 4), down))));
}

/* Words of a tile of keys, the first of which is `first`. */
static void score(const struct dvsm_fixed_attention *job, const struct places *at, size_t first,
		  size_t padded)
{
	int16_t *scores = at->scores + (at->kept ? first : 0);

	for (size_t key = 0; key < padded; key += WIDTH) {
		dot(job->q, job->q_stride, job->queries, job->k + (first + key) * job->key_width,
		    4 * WIDTH, job->key_width / 4, at->sums, WIDTH);
		for (size_t i = 0; i < job->queries; i++)
			keep_words(at->sums + i * WIDTH, at->shift[i],
				   scores + i * at->scores_stride + key);
	}
}

static void find_tops(const struct places *at, size_t queries, size_t first, size_t count)
{
	for (size_t i = 0; i < queries; i++) {
		const int16_t *scores = at->scores + i * at->scores_stride;
		const int16_t largest = largest_of(scores + (at->kept ? first : 0), count);

		if (first == 0 || largest > at->top[i])
			at->top[i] = largest;
	}
}

static void weigh_tile(const struct dvsm_fixed_attention *job, const struct places *at,
		       size_t first, size_t count, size_t padded)
{
	for (size_t i = 0; i < job->queries; i++) {
		const struct dvsm_fixed_scale scale = job->q_scale[i * job->scale_stride];
		const struct slope_lanes slope =
			slope_lanes_make(dvsm_fixed_slope_make(scale, at->shift[i]), at->top[i]);
		const int16_t *words = at->scores + i * at->scores_stride + (at->kept ? first : 0);

		at->total[i] += weigh(words, count, padded, &slope, at->high + i * DVSM_FIXED_KEYS,
				      at->low + i * DVSM_FIXED_KEYS);
	}
}

static void finish(const struct dvsm_fixed_attention *job, const int64_t *o, int64_t total,
		   int16_t *out)
{
	const struct dvsm_fixed_quotient quotient = dvsm_fixed_divide((uint64_t)total);

	for (size_t d = 0; d < job->dim; d++) {
		int shift = dvsm_fixed_clamp(DVSM_FIXED_QUOTIENT_BITS - job->v_scale[d].exponent, 1,
					     62);
		int64_t product = (int64_t)dvsm_fixed_lift(o[d], quotient) *
				  (quotient.inverse * job->v_scale[d].mantissa);

		out[d] = dvsm_fixed_saturate(job->v_mean[d] + dvsm_fixed_round(product, shift));
	}
}

static void attention(const struct dvsm_fixed_attention *job)
{
	const struct places at = place(job);

	memset(at.o, 0, job->queries * job->head_width * sizeof(*at.o));
	memset(at.total, 0, job->queries * sizeof(*at.total));
	for (size_t i = 0; i < job->queries; i++)
		at.shift[i] =
			(int16_t)dvsm_fixed_score_shift(job->q + i * job->q_stride, job->key_width);
	for (size_t first = 0; first < job->keys; first += DVSM_FIXED_KEYS) {
		const size_t count = dvsm_fixed_tile_keys(job, first);

		score(job, &at, first, dvsm_fixed_pad(count, WIDTH));
		find_tops(&at, job->queries, first, count);
	}
	for (size_t first = 0; first < job->keys; first += DVSM_FIXED_KEYS) {
		const size_t count = dvsm_fixed_tile_keys(job, first);
		const size_t padded = dvsm_fixed_pad(count, WIDTH);

		if (!at.kept)
			score(job, &at, first, padded);
		weigh_tile(job, &at, first, count, padded);
		mix(job, &at, job->v + first * job->head_width, padded);
	}
	for (size_t i = 0; i < job->queries; i++)
		finish(job, at.o + i * job->head_width, at.total[i],
		       job->out + i * job->out_stride);
}
