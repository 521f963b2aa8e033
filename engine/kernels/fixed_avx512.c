/* The fixed-point kernels for AVX-512 F, BW, DQ, VL beside the products: norms and packing. */
#include "kernels/fixed_avx512_lanes.h"
#include "kernels/fixed_tiers.h"
#include "kernels/tier.h"

/* Numbers that become 64 bytes of a row. */
#define GROUP 64u

#define ALL_LANES (~(__mmask64)0)

/* The first n of 64 lanes. */
static inline __mmask64 first_bytes(size_t n)
{
	return n >= GROUP ? ALL_LANES : ((__mmask64)1 << n) - 1;
}

static inline __m512i load_s32(const int32_t *p, __mmask16 lanes)
{
	return lanes == 0xffff ? _mm512_loadu_si512(p) : _mm512_maskz_loadu_epi32(lanes, p);
}

/* Products of numbers of 16 bits in 32-bit lanes; b's upper halves are 0. */
static inline __m512i multiply_words(__m512i a, __m512i b)
{
	return _mm512_madd_epi16(a, b);
}

/* As multiply_words() takes its second numbers. */
static inline __m512i load_words(const int16_t *p, __mmask16 lanes)
{
	return _mm512_cvtepu16_epi32(lanes == 0xffff ? _mm256_loadu_si256((const __m256i *)p)
						     : _mm256_maskz_loadu_epi16(lanes, p));
}

/* 64 numbers of 16 bits, or zeros where there are fewer. */
struct pair {
	__m512i a, b;
};

static inline struct pair load_pair(const int16_t *x, __mmask64 lanes)
{
	if (lanes == ALL_LANES)
		return (struct pair){_mm512_loadu_si512(x), _mm512_loadu_si512(x + 32)};
	return (struct pair){_mm512_maskz_loadu_epi16((__mmask32)lanes, x),
			     _mm512_maskz_loadu_epi16((__mmask32)(lanes >> 32), x + 32)};
}

/* The next 64 of `left` numbers. */
static inline struct pair load_up_to(const int16_t *x, size_t left)
{
	return left >= GROUP ? load_pair(x, ALL_LANES) : load_pair(x, first_bytes(left));
}

static inline size_t count_from(size_t first, size_t all, size_t most)
{
	return all - first < most ? all - first : most;
}

/* 2^s / 2, or 0 for s = 0: what R(a, s) adds before it shifts. */
static inline __m512i half_of(__m512i s)
{
	return _mm512_srli_epi32(_mm512_sllv_epi32(_mm512_set1_epi32(1), s), 1);
}

static inline __m512i positive(__m512i a)
{
	return _mm512_max_epi32(a, _mm512_setzero_si512());
}

static inline __m512i negative(__m512i a)
{
	return _mm512_sub_epi32(_mm512_setzero_si512(), a);
}

/* The larger of low's and of high's distance from 0, where that lies between or a side has none. */
static inline __m512i larger_size(__m512i low, __m512i high)
{
	return _mm512_max_epi32(negative(low), high);
}

#include "kernels/fixed_avx512_norm.inc.h"
#include "kernels/fixed_avx512_pack.inc.h"
#include "kernels/fixed_avx512_words.inc.h"

const struct dvsm_fixed_kernels dvsm_fixed_kernels_avx512 = {
	.cpu = DVSM_CPU_AVX512,
	.name = "avx512",
	.norm = norm,
	.quantise = quantise,
	.split = split,
	.queries = queries,
	.keys = keys,
	.range = range,
	.pack_keys = pack_keys,
	.pack_values = pack_values,
};
