/*
 * Fixed-point products and attention of SSE4.1: small x86 cores without AVX. Two rows, or queries,
 * meet sixteen columns at a time.
 */
#include <smmintrin.h>
#include <string.h>

#include "kernels/fixed_signs.h"
#include "kernels/fixed_tiers.h"
#include "kernels/tier.h"

/* 16 registers: 8 sums, a column, 2 on the way to a sum, ones, 2 signs and 2 sizes. */
#define BYTE_ROWS 2
#define QUERIES   4
#define VECTORS   (DVSM_FIXED_PANEL / 4)

#include "kernels/fixed_strip.inc.h"

static inline __m128i broadcast(const void *four)
{
	int bits;

	memcpy(&bits, four, sizeof(bits));
	return _mm_set1_epi32(bits);
}

/* sums += `steps` times four numbers of two rows with sixteen packed columns, 64 bytes a step. */
DVSM_INLINE void dot_bytes(const struct row_bytes a[BYTE_ROWS], const int8_t *columns, size_t steps,
			   __m128i sums[BYTE_ROWS][VECTORS])
{
	const __m128i ones = _mm_set1_epi16(1);

	for (size_t at = 0; at < 8 * steps; at += 8, columns += 64) {
		__m128i signs[BYTE_ROWS], sizes[BYTE_ROWS];

		DVSM_UNROLL
		for (int i = 0; i < BYTE_ROWS; i++) {
			signs[i] = broadcast(a[i].steps + at);
			sizes[i] = broadcast(a[i].steps + at + 4);
		}
		DVSM_UNROLL
		for (size_t j = 0; j < VECTORS; j++) {
			__m128i column = _mm_load_si128((const __m128i *)(columns + 16 * j));

			DVSM_UNROLL
			for (int i = 0; i < BYTE_ROWS; i++) {
				__m128i flipped = _mm_xor_si128(column, signs[i]);
				__m128i pairs = _mm_maddubs_epi16(sizes[i], flipped);

				sums[i][j] = _mm_add_epi32(sums[i][j], _mm_madd_epi16(pairs, ones));
			}
		}
	}
}

/* ---- products ---- */

/* The sixteen columns of a panel: the mantissas of their scales, twice in each lane, and shifts. */
struct columns {
	__m128i mantissa[VECTORS];
	int shift[DVSM_FIXED_PANEL];
	size_t count;
};

static struct columns load_columns(const struct dvsm_fixed_gemm *job, size_t col)
{
	const size_t left = job->cols - col;
	struct columns columns = {.count = left < DVSM_FIXED_PANEL ? left : DVSM_FIXED_PANEL};
	int16_t mantissas[DVSM_FIXED_PANEL] = {0};

	for (size_t j = 0; j < columns.count; j++) {
		mantissas[j] = job->w_mantissa[col + j];
		columns.shift[j] = job->w_shift[col + j];
	}
	for (size_t j = 0; j < VECTORS; j++) {
		__m128i four = _mm_loadl_epi64((const __m128i *)(mantissas + 4 * j));

		columns.mantissa[j] = _mm_unpacklo_epi16(four, four);
	}
	return columns;
}

/* Four lanes to the right, by as many shifts: SSE has one for all. */
static inline __m128i shift_lanes(__m128i a, const int by[4])
{
	if (by[0] == by[1] && by[0] == by[2] && by[0] == by[3])
		return _mm_sra_epi32(a, _mm_cvtsi32_si128(by[0]));

	__m128i first = _mm_sra_epi32(a, _mm_cvtsi32_si128(by[0]));
	__m128i second = _mm_sra_epi32(a, _mm_cvtsi32_si128(by[1]));
	__m128i third = _mm_sra_epi32(a, _mm_cvtsi32_si128(by[2]));
	__m128i fourth = _mm_sra_epi32(a, _mm_cvtsi32_si128(by[3]));

	return _mm_blend_epi16(_mm_blend_epi16(first, second, 0x0c),
			       _mm_blend_epi16(third, fourth, 0xc0), 0xf0);
}

/* r of a row's sixteen sums, in place, exact in 32 bits. */
static void requantise_narrow(const struct requantise *how, const struct columns *columns,
			      struct dvsm_fixed_scale scale, int32_t sums[DVSM_FIXED_PANEL])
{
	const __m128i one = _mm_set1_epi32(1), up = _mm_cvtsi32_si128(16 - how->cut);
	const __m128i mantissa = _mm_set1_epi16(scale.mantissa);

	for (size_t j = 0; j < VECTORS; j++) {
		__m128i *at = (__m128i *)(sums + 4 * j);
		__m128i factor = _mm_mulhrs_epi16(columns->mantissa[j], mantissa);
		__m128i words = _mm_sll_epi32(_mm_load_si128(at), up);
		int by[4];

		for (size_t k = 0; k < 4; k++)
			by[k] = columns->shift[4 * j + k] - scale.exponent - 16 - how->cut;
		words = _mm_blend_epi16(_mm_mulhi_epu16(words, factor), words, 0xaa);
		words = _mm_madd_epi16(words, _mm_blend_epi16(one, factor, 0xaa));
		words = _mm_add_epi32(shift_lanes(words, by), one);
		_mm_store_si128(at, _mm_srai_epi32(words, 1));
	}
}

/* The same in 64 bits: modulo 2^32, or as int16 saturates it. */
static void requantise_wide(const struct columns *columns, bool adds, const int16_t *mantissa,
			    struct dvsm_fixed_scale scale, int32_t sums[DVSM_FIXED_PANEL])
{
	for (size_t j = 0; j < columns->count; j++) {
		int shift = dvsm_fixed_clamp(columns->shift[j] - scale.exponent, 1, 62);
		int64_t factor = dvsm_fixed_mulhrs(scale.mantissa, mantissa[j]);
		int64_t r = dvsm_fixed_round(sums[j] * factor * (1 << 15), shift);

		sums[j] = adds ? (int32_t)(uint32_t)r : dvsm_fixed_saturate(r);
	}
}

/* A row's sixteen sums to their place. */
static void finish(const struct dvsm_fixed_gemm *job, const struct requantise *how,
		   const struct columns *columns, size_t row, size_t col,
		   int32_t sums[DVSM_FIXED_PANEL])
{
	const bool adds = job->epilogue == DVSM_FIXED_ADD;
	const size_t at = row * job->c_stride + col;

	if (how->narrow)
		requantise_narrow(how, columns, job->a_scale[row], sums);
	else
		requantise_wide(columns, adds, job->w_mantissa + col, job->a_scale[row], sums);
	if (adds) {
		int32_t *c = (int32_t *)job->c + at;

		for (size_t j = 0; j < columns->count; j++)
			c[j] = (int32_t)((uint32_t)c[j] + (uint32_t)sums[j]);
		return;
	}

	int16_t *c = (int16_t *)job->c + at;

	for (size_t j = 0; j < columns->count; j++)
		c[j] = dvsm_fixed_saturate(sums[j]);
	if (job->epilogue == DVSM_FIXED_GELU)
		for (size_t j = 0; j < columns->count; j++)
			c[j] = dvsm_fixed_gelu(c[j], job->fraction);
}

/* Rows `row` and on, the strip's from `at` on, with a panel; `rows` of the two are wanted. */
static void tile(const struct dvsm_fixed_gemm *job, const struct requantise *how,
		 const struct columns *columns, size_t rows, size_t row, size_t col,
		 struct strip *strip, size_t at)
{
	const int8_t *w = job->panels + col * job->depth;
	__m128i sums[BYTE_ROWS][VECTORS];
	_Alignas(16) int32_t done[BYTE_ROWS][DVSM_FIXED_PANEL];

	DVSM_UNROLL
	for (int i = 0; i < BYTE_ROWS; i++) {
		DVSM_UNROLL
		for (size_t j = 0; j < VECTORS; j++)
			sums[i][j] = _mm_setzero_si128();
	}
	for (size_t d = 0; d < job->depth; d += CHUNK) {
		const size_t count = job->depth - d < CHUNK ? job->depth - d : CHUNK;
		struct row_bytes a[BYTE_ROWS];

		if (job->depth > CHUNK)
			prepare(job, row, at, rows, d, count, strip);
		a[0] = strip->rows[at];
		a[1] = strip->rows[at + rows - 1];
		DVSM_UNROLL
		for (int i = 0; i < BYTE_ROWS; i++) {
			DVSM_UNROLL
			for (size_t j = 0; j < VECTORS; j++)
				sums[i][j] = _mm_add_epi32(sums[i][j], _mm_set1_epi32(a[i].begin));
		}
		dot_bytes(a, w + d * DVSM_FIXED_PANEL, count / 4, sums);
	}
	DVSM_UNROLL
	for (int i = 0; i < BYTE_ROWS; i++) {
		DVSM_UNROLL
		for (size_t j = 0; j < VECTORS; j++)
			_mm_store_si128((__m128i *)(done[i] + 4 * j), sums[i][j]);
	}
	for (size_t i = 0; i < rows; i++)
		finish(job, how, columns, row + i, col, done[i]);
}

void dvsm_fixed_gemm_sse4(const struct dvsm_fixed_gemm *job)
{
	const struct requantise how = requantise_prepare(job);
	const size_t step = strip_rows(job);
	struct strip strip;

	for (size_t row = 0; row < job->rows; row += step) {
		const size_t rows = job->rows - row < step ? job->rows - row : step;

		if (job->depth <= CHUNK)
			prepare(job, row, 0, rows, 0, job->depth, &strip);
		for (size_t col = 0; col < job->cols; col += DVSM_FIXED_PANEL) {
			const struct columns columns = load_columns(job, col);

			for (size_t i = 0; i < rows; i += BYTE_ROWS)
				tile(job, &how, &columns, rows - i < BYTE_ROWS ? 1 : BYTE_ROWS,
				     row + i, col, &strip, i);
		}
	}
}

/* ---- attention ---- */

#include "kernels/fixed_query.inc.h"

/* Two queries with a tile of keys. */
static void score_pair(const struct query *queries, const int8_t *k, size_t key_width, size_t count,
		       size_t first)
{
	const struct row_bytes rows[BYTE_ROWS] = {queries[0].q, queries[1].q};

	for (size_t at = 0; at < count; at += DVSM_FIXED_PANEL) {
		__m128i sums[BYTE_ROWS][VECTORS];

		DVSM_UNROLL
		for (int i = 0; i < BYTE_ROWS; i++) {
			DVSM_UNROLL
			for (size_t j = 0; j < VECTORS; j++)
				sums[i][j] = _mm_set1_epi32(rows[i].begin);
		}
		dot_bytes(rows, k + at * key_width, key_width / 4, sums);
		DVSM_UNROLL
		for (int i = 0; i < BYTE_ROWS; i++) {
			const __m128i shift = _mm_cvtsi32_si128(queries[i].shift);
			__m128i *words = (__m128i *)(queries[i].scores + first + at);

			_mm_store_si128(words, _mm_packs_epi32(_mm_sra_epi32(sums[i][0], shift),
							       _mm_sra_epi32(sums[i][1], shift)));
			_mm_store_si128(words + 1,
					_mm_packs_epi32(_mm_sra_epi32(sums[i][2], shift),
							_mm_sra_epi32(sums[i][3], shift)));
		}
	}
}

static void score(const struct query *queries, const int8_t *k, size_t key_width, size_t count,
		  size_t first)
{
	for (int i = 0; i < QUERIES; i += BYTE_ROWS)
		score_pair(queries + i, k, key_width, count, first);
}

/* Those of eight words whose key is below count. */
static inline __m128i word_lanes(size_t count)
{
	return _mm_cmpgt_epi16(_mm_set1_epi16((int16_t)(count < 8 ? count : 8)),
			       _mm_setr_epi16(0, 1, 2, 3, 4, 5, 6, 7));
}

static int16_t largest_score(const struct query *query, size_t count, size_t first)
{
	const __m128i least = _mm_set1_epi16(INT16_MIN);
	const int16_t *scores = query->scores + first;
	__m128i most = least;

	for (size_t key = 0; key < count; key += 8)
		most = _mm_max_epi16(
			most,
			_mm_blendv_epi8(least, _mm_load_si128((const __m128i *)(scores + key)),
					word_lanes(count - key)));

	/* The least of unsigned words is what SSE4.1 finds at once. */
	most = _mm_minpos_epu16(_mm_xor_si128(most, _mm_set1_epi16(INT16_MAX)));
	return (int16_t)(_mm_extract_epi16(most, 0) ^ INT16_MAX);
}

/* Words shifted to the right by 0..65535 each: products with powers of two, looked up. */
static inline __m128i shift_words(__m128i words, __m128i by)
{
	const __m128i lower =
		_mm_setr_epi8(0, 0, 0, 0, 0, 0, 0, 0, 0, (char)128, 64, 32, 16, 8, 4, 2);
	const __m128i upper =
		_mm_setr_epi8(0, (char)128, 64, 32, 16, 8, 4, 2, 1, 0, 0, 0, 0, 0, 0, 0);
	const __m128i none = _mm_cmpeq_epi16(by, _mm_setzero_si128());
	/* From 16 on the byte's first bit is set, and pshufb gives 0. */
	__m128i at = _mm_adds_epu8(_mm_min_epu16(by, _mm_set1_epi16(16)), _mm_set1_epi16(0x70));
	__m128i power = _mm_or_si128(_mm_shuffle_epi8(lower, at),
				     _mm_slli_epi16(_mm_shuffle_epi8(upper, at), 8));

	return _mm_blendv_epi8(_mm_mulhi_epu16(words, power), words, none);
}

/* dvsm_fixed_exp2() of eight numbers. */
static inline __m128i exp2_lanes(__m128i x, __m128i left, __m128i right)
{
	const __m128i zero = _mm_setzero_si128();
	__m128i whole = _mm_avg_epu16(_mm_srl_epi16(x, right), zero);
	__m128i t = _mm_sll_epi16(x, left), r = _mm_set1_epi16(DVSM_FIXED_EXP2_C);

	r = _mm_sub_epi16(_mm_set1_epi16(DVSM_FIXED_EXP2_B), _mm_mulhrs_epi16(t, r));
	r = _mm_sub_epi16(_mm_set1_epi16(DVSM_FIXED_EXP2_A), _mm_mulhrs_epi16(t, r));
	r = _mm_sub_epi16(_mm_set1_epi16((int16_t)DVSM_FIXED_EXP2_ONE), _mm_mulhrs_epi16(t, r));
	return _mm_avg_epu16(shift_words(r, whole), zero);
}

/* Words to weights, 8 keys at a time, 0 behind the last up to whole vectors; in every four of them
 * the even ones come first. */
static void weigh(struct query *query, size_t count, size_t first)
{
	const __m128i order = _mm_setr_epi8(0, 1, 4, 5, 2, 3, 6, 7, 8, 9, 12, 13, 10, 11, 14, 15);
	const __m128i top = _mm_set1_epi16(query->top);
	const __m128i factor = _mm_set1_epi16((int16_t)query->slope.factor);
	const __m128i left = _mm_cvtsi32_si128(16 - query->slope.fraction);
	const __m128i right = _mm_cvtsi32_si128(query->slope.fraction - 1);
	__m128i sums = _mm_setzero_si128();
	int32_t parts[4];

	for (size_t key = 0; key < count; key += 8) {
		const __m128i *scores = (const __m128i *)(query->scores + first + key);
		__m128i way = _mm_sub_epi16(top, _mm_load_si128(scores));
		__m128i p = exp2_lanes(_mm_mulhi_epu16(way, factor), left, right);

		if (count - key < 8)
			p = _mm_and_si128(p, word_lanes(count - key));
		sums = _mm_add_epi32(sums, _mm_madd_epi16(p, _mm_set1_epi16(1)));
		_mm_store_si128((__m128i *)(query->weights + key), _mm_shuffle_epi8(p, order));
	}
	_mm_storeu_si128((__m128i *)parts, sums);
	for (int i = 0; i < 4; i++)
		query->sum += parts[i];
}

/* Sums of two queries' weights times values of four keys and more, sixteen channels. */
DVSM_INLINE void dot_words(const struct query *queries, const int8_t *v, size_t step_bytes,
			   size_t steps, __m128i sums[BYTE_ROWS][VECTORS])
{
	for (size_t step = 0; step < steps; step++, v += step_bytes) {
		__m128i x[BYTE_ROWS], y[BYTE_ROWS];

		DVSM_UNROLL
		for (int i = 0; i < BYTE_ROWS; i++) {
			x[i] = broadcast(queries[i].weights + 4 * step);
			y[i] = broadcast(queries[i].weights + 4 * step + 2);
		}
		DVSM_UNROLL
		for (size_t j = 0; j < VECTORS; j++) {
			__m128i bytes = _mm_load_si128((const __m128i *)(v + 16 * j));
			__m128i even = _mm_srai_epi16(_mm_slli_epi16(bytes, 8), 8);
			__m128i odd = _mm_srai_epi16(bytes, 8);

			DVSM_UNROLL
			for (int i = 0; i < BYTE_ROWS; i++) {
				__m128i four = _mm_add_epi32(_mm_madd_epi16(x[i], even),
							     _mm_madd_epi16(y[i], odd));

				sums[i][j] = _mm_add_epi32(sums[i][j], four);
			}
		}
	}
}

/* 256 o + o_low += weights times values; over a tile the sums fit 32 bits. */
static void mix(const struct query *queries, const int8_t *v, size_t head_width, size_t count)
{
	const __m128i last = _mm_set1_epi32(255);

	for (size_t d = 0; d < head_width; d += DVSM_FIXED_PANEL) {
		for (int first = 0; first < QUERIES; first += BYTE_ROWS) {
			__m128i sums[BYTE_ROWS][VECTORS];

			DVSM_UNROLL
			for (int i = 0; i < BYTE_ROWS; i++) {
				DVSM_UNROLL
				for (size_t j = 0; j < VECTORS; j++)
					sums[i][j] = _mm_setzero_si128();
			}
			dot_words(queries + first, v + 4 * d, 4 * head_width, (count + 3) / 4,
				  sums);
			for (int i = 0; i < BYTE_ROWS; i++) {
				__m128i *o = (__m128i *)(queries[first + i].o + d);
				__m128i *o_low = (__m128i *)(queries[first + i].o_low + d);

				for (size_t j = 0; j < VECTORS; j++) {
					__m128i upper = _mm_srai_epi32(sums[i][j], 8);
					__m128i lower = _mm_and_si128(sums[i][j], last);

					o[j] = _mm_add_epi32(o[j], upper);
					o_low[j] = _mm_add_epi32(o_low[j], lower);
				}
			}
		}
	}
}

/* o / sum, in the output's units. */
static void write_out(const struct dvsm_fixed_attention *job, const struct query *query,
		      int16_t *out)
{
	const struct dvsm_fixed_quotient quotient = dvsm_fixed_divide((uint64_t)query->sum);

	for (size_t d = 0; d < job->dim; d++) {
		const struct dvsm_fixed_scale scale = job->v_scale[d];
		int shift = dvsm_fixed_clamp(DVSM_FIXED_QUOTIENT_BITS - scale.exponent, 1, 62);
		int64_t o = 256 * (int64_t)query->o[d] + query->o_low[d];
		int64_t product =
			(int64_t)dvsm_fixed_lift(o, quotient) * (quotient.inverse * scale.mantissa);

		out[d] = dvsm_fixed_saturate(job->v_mean[d] + dvsm_fixed_round(product, shift));
	}
}

#include "kernels/fixed_group.inc.h"

void dvsm_fixed_attention_sse4(const struct dvsm_fixed_attention *job)
{
	attention(job);
}
