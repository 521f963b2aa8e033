/*
 * Template: fixed-point attention of AVX2 and AVX-VNNI: four queries pass over the keys together.
 *
 * The sum of p v over a tile of keys fits 32 bits, so the weights need no planes. Over all keys it
 * does not: its upper bits and its last 8 are summed up apart.
 */
#include "kernels/fixed_avx2.h"

#define QUERIES WORD_ROWS

#include "kernels/fixed_query.inc.h"

static void score(const struct query *queries, const int8_t *k, size_t key_width, size_t count,
		  size_t first)
{
	struct row_bytes rows[QUERIES];

	for (int i = 0; i < QUERIES; i++)
		rows[i] = queries[i].q;
	for (size_t at = 0; at < count; at += DVSM_FIXED_PANEL) {
		__m256i sums[QUERIES][2];

		DVSM_UNROLL
		for (int i = 0; i < QUERIES; i++)
			sums[i][0] = sums[i][1] = row_begin(&rows[i]);
		dot_bytes(QUERIES, rows, k + at * key_width, key_width / 4, sums);
		DVSM_UNROLL
		for (int i = 0; i < QUERIES; i++) {
			const __m128i shift = _mm_cvtsi32_si128(queries[i].shift);
			__m256i words = _mm256_packs_epi32(_mm256_sra_epi32(sums[i][0], shift),
							   _mm256_sra_epi32(sums[i][1], shift));

			_mm256_store_si256((__m256i *)(queries[i].scores + first + at),
					   _mm256_permute4x64_epi64(words, 0xd8));
		}
	}
}

/* Those of sixteen words whose key is below count. */
static inline __m256i word_lanes(size_t count)
{
	const __m256i lanes =
		_mm256_setr_epi16(0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15);

	return _mm256_cmpgt_epi16(_mm256_set1_epi16((int16_t)(count < 16 ? count : 16)), lanes);
}

static int16_t largest_score(const struct query *query, size_t count, size_t first)
{
	const __m256i least = _mm256_set1_epi16(INT16_MIN);
	const int16_t *scores = query->scores + first;
	__m256i most = least;
	int16_t parts[16], largest;

	for (size_t key = 0; key < count; key += 16)
		most = _mm256_max_epi16(
			most, _mm256_blendv_epi8(least,
						 _mm256_load_si256((const __m256i *)(scores + key)),
						 word_lanes(count - key)));
	_mm256_storeu_si256((__m256i *)parts, most);
	largest = parts[0];
	for (int i = 1; i < 16; i++)
		largest = parts[i] > largest ? parts[i] : largest;
	return largest;
}

/* dvsm_fixed_exp2() of sixteen numbers. */
static inline __m256i exp2_lanes(__m256i x, __m128i left, __m128i right)
{
	__m256i whole = _mm256_avg_epu16(_mm256_srl_epi16(x, right), _mm256_setzero_si256());
	__m256i t = _mm256_sll_epi16(x, left), r = _mm256_set1_epi16(DVSM_FIXED_EXP2_C);

	r = _mm256_sub_epi16(_mm256_set1_epi16(DVSM_FIXED_EXP2_B), _mm256_mulhrs_epi16(t, r));
	r = _mm256_sub_epi16(_mm256_set1_epi16(DVSM_FIXED_EXP2_A), _mm256_mulhrs_epi16(t, r));
	r = _mm256_sub_epi16(_mm256_set1_epi16((int16_t)DVSM_FIXED_EXP2_ONE),
			     _mm256_mulhrs_epi16(t, r));

	/* AVX2 has no shift a word: one for the even words, one for the odd. */
	__m256i low = _mm256_set1_epi32(0xffff);
	__m256i even = _mm256_srlv_epi32(_mm256_and_si256(r, low), _mm256_and_si256(whole, low));
	__m256i odd = _mm256_srlv_epi32(r, _mm256_srli_epi32(whole, 16));

	return _mm256_avg_epu16(_mm256_blend_epi16(even, odd, 0xaa), _mm256_setzero_si256());
}

/* Words to weights, 16 keys at a time, 0 behind the last up to whole vectors. */
static void weigh(struct query *query, size_t count, size_t first)
{
	const __m256i top = _mm256_set1_epi16(query->top);
	const __m256i factor = _mm256_set1_epi16((int16_t)query->slope.factor);
	const __m256i ones = _mm256_set1_epi16(1);
	const __m128i left = _mm_cvtsi32_si128(16 - query->slope.fraction);
	const __m128i right = _mm_cvtsi32_si128(query->slope.fraction - 1);
	__m256i sums = _mm256_setzero_si256();

	for (size_t key = 0; key < count; key += 16) {
		const int16_t *scores = query->scores + first + key;
		__m256i way = _mm256_sub_epi16(top, _mm256_load_si256((const __m256i *)scores));
		__m256i p = exp2_lanes(_mm256_mulhi_epu16(way, factor), left, right);

		if (count - key < 16)
			p = _mm256_and_si256(p, word_lanes(count - key));
		sums = _mm256_add_epi32(sums, _mm256_madd_epi16(p, ones));
		_mm256_store_si256((__m256i *)(query->weights + key), order_words(p));
	}

	int32_t parts[8];

	_mm256_storeu_si256((__m256i *)parts, sums);
	for (int i = 0; i < 8; i++)
		query->sum += parts[i];
}

/* 256 o + o_low += weights times values */
static void mix(const struct query *queries, const int8_t *v, size_t head_width, size_t count)
{
	const int16_t *const words[QUERIES] = {queries[0].weights, queries[1].weights,
					       queries[2].weights, queries[3].weights};
	const __m256i last = _mm256_set1_epi32(255);

	for (size_t d = 0; d < head_width; d += 16) {
		__m256i sums[QUERIES][2];

		DVSM_UNROLL
		for (int i = 0; i < QUERIES; i++)
			sums[i][0] = sums[i][1] = _mm256_setzero_si256();
		dot_words(QUERIES, words, v + 4 * d, 4 * head_width, (count + 3) / 4, sums);
		DVSM_UNROLL
		for (int i = 0; i < QUERIES; i++) {
			DVSM_UNROLL
			for (int j = 0; j < 2; j++) {
				const size_t at = d + 8 * (size_t)j;
				__m256i *o = (__m256i *)(queries[i].o + at);
				__m256i *o_low = (__m256i *)(queries[i].o_low + at);
				__m256i upper = _mm256_srai_epi32(sums[i][j], 8);
				__m256i lower = _mm256_and_si256(sums[i][j], last);

				_mm256_store_si256(o,
						   _mm256_add_epi32(_mm256_load_si256(o), upper));
				_mm256_store_si256(
					o_low, _mm256_add_epi32(_mm256_load_si256(o_low), lower));
			}
		}
	}
}

/* dvsm_fixed_lift() of 256 o + o_low in eight lanes, o_low not negative. */
static inline __m256i lift(__m256i o, __m256i o_low, int up)
{
	if (up >= 0)
		return _mm256_sll_epi32(_mm256_add_epi32(_mm256_slli_epi32(o, 8), o_low),
					_mm_cvtsi32_si128(up));

	const __m256i factor = _mm256_set1_epi32(256), down = _mm256_set1_epi64x(-up);
	const __m256i low = _mm256_set1_epi64x(0xffffffff);
	__m256i even = _mm256_mul_epi32(o, factor);
	__m256i odd = _mm256_mul_epi32(_mm256_srli_epi64(o, 32), factor);

	even = round_wide(_mm256_add_epi64(even, _mm256_and_si256(o_low, low)), down);
	odd = round_wide(_mm256_add_epi64(odd, _mm256_srli_epi64(o_low, 32)), down);
	return _mm256_blend_epi32(even, _mm256_slli_epi64(odd, 32), 0xaa);
}

/* o / sum, in the output's units. */
static void write_out(const struct dvsm_fixed_attention *job, const struct query *query,
		      int16_t *out)
{
	const struct dvsm_fixed_quotient quotient = dvsm_fixed_divide((uint64_t)query->sum);

	for (size_t d = 0; d < job->dim; d += 8) {
		const size_t count = job->dim - d < 8 ? job->dim - d : 8;
		struct dvsm_fixed_scale scales[8] = {{0}};
		__m256i o, scale, shift, r;

		memcpy(scales, job->v_scale + d, count * sizeof(scales[0]));
		scale = _mm256_loadu_si256((const __m256i *)scales);
		shift = _mm256_sub_epi32(_mm256_set1_epi32(DVSM_FIXED_QUOTIENT_BITS),
					 _mm256_srai_epi32(scale, 16));
		o = lift(_mm256_load_si256((const __m256i *)(query->o + d)),
			 _mm256_load_si256((const __m256i *)(query->o_low + d)), quotient.up);
		r = round_products(
			o,
			_mm256_mullo_epi32(_mm256_set1_epi32(quotient.inverse),
					   _mm256_and_si256(scale, _mm256_set1_epi32(0x7fff))),
			clamp_lanes(shift, 1, 62), 1 << 30);
		r = _mm256_add_epi32(r, load_s16(job->v_mean + d, count));
		store_s16(out + d, r, count);
	}
}

#include "kernels/fixed_group.inc.h"
