#include "bench/peak_loops.h"

#include "dvsm/engine.h"

#if defined(__x86_64__)

#include <immintrin.h>

#define TARGET(features) __attribute__((target(features)))

/* x = x a + b with a + b = 1 stays near 1: no overflow, no slow tiny numbers. */
#define FACTOR 0.999f
#define ADDEND 0.001f

/* Twelve independent chains that the compiler keeps in registers; `step` advances one. */
#define CHAINS(type, start, step, add, store)                                                      \
	type c0 = (start), c1 = c0, c2 = c0, c3 = c0, c4 = c0, c5 = c0;                            \
	type c6 = c0, c7 = c0, c8 = c0, c9 = c0, c10 = c0, c11 = c0;                               \
                                                                                                   \
	DIO_PEAK_HIDE(c1);                                                                         \
	DIO_PEAK_HIDE(c2);                                                                         \
	DIO_PEAK_HIDE(c3);                                                                         \
	DIO_PEAK_HIDE(c4);                                                                         \
	DIO_PEAK_HIDE(c5);                                                                         \
	DIO_PEAK_HIDE(c6);                                                                         \
	DIO_PEAK_HIDE(c7);                                                                         \
	DIO_PEAK_HIDE(c8);                                                                         \
	DIO_PEAK_HIDE(c9);                                                                         \
	DIO_PEAK_HIDE(c10);                                                                        \
	DIO_PEAK_HIDE(c11);                                                                        \
	for (uint64_t i = 0; i < turns; i++) {                                                     \
		c0 = step(c0), c1 = step(c1), c2 = step(c2), c3 = step(c3);                        \
		c4 = step(c4), c5 = step(c5), c6 = step(c6), c7 = step(c7);                        \
		c8 = step(c8), c9 = step(c9), c10 = step(c10), c11 = step(c11);                    \
	}                                                                                          \
	c0 = add(add(add(c0, c1), add(c2, c3)), add(add(c4, c5), add(c6, c7)));                    \
	store(sink, add(c0, add(add(c8, c9), add(c10, c11))))

#define STORE_FLOAT(sink, value)   (*(sink) = _mm_cvtss_f32(value))
#define STORE_FLOAT8(sink, value)  (*(sink) = _mm256_cvtss_f32(value))
#define STORE_FLOAT16(sink, value) (*(sink) = _mm512_cvtss_f32(value))
#define STORE_INT4(sink, value)    (*(sink) = (float)_mm_cvtsi128_si32(value))
#define STORE_INT8(sink, value)    (*(sink) = (float)_mm_cvtsi128_si32(_mm256_castsi256_si128(value)))
#define STORE_INT16(sink, value)   (*(sink) = (float)_mm_cvtsi128_si32(_mm512_castsi512_si128(value)))

static void run_sse2(uint64_t turns, float *sink)
{
	const __m128 a = _mm_set1_ps(FACTOR), b = _mm_set1_ps(ADDEND);

#define STEP(c) _mm_add_ps(_mm_mul_ps(c, a), b)
	CHAINS(__m128, _mm_set1_ps(*sink), STEP, _mm_add_ps, STORE_FLOAT);
#undef STEP
}

TARGET("avx2,fma") static void run_avx2(uint64_t turns, float *sink)
{
	const __m256 a = _mm256_set1_ps(FACTOR), b = _mm256_set1_ps(ADDEND);

#define STEP(c) _mm256_fmadd_ps(c, a, b)
	CHAINS(__m256, _mm256_set1_ps(*sink), STEP, _mm256_add_ps, STORE_FLOAT8);
#undef STEP
}

TARGET("avx512f") static void run_avx512(uint64_t turns, float *sink)
{
	const __m512 a = _mm512_set1_ps(FACTOR), b = _mm512_set1_ps(ADDEND);

#define STEP(c) _mm512_fmadd_ps(c, a, b)
	CHAINS(__m512, _mm512_set1_ps(*sink), STEP, _mm512_add_ps, STORE_FLOAT16);
#undef STEP
}

/* Bytes times bytes in pairs, pairs in fours: three instructions where there is no VNNI. Written
 * out, for compilers would take the products, always the same, out of the loop. */
TARGET("sse4.1") static inline __m128i step_sse4_int8(__m128i c, __m128i a, __m128i b, __m128i one)
{
	__m128i products = a;

	__asm__ volatile("pmaddubsw %2, %1\n\t"
			 "pmaddwd %3, %1\n\t"
			 "paddd %1, %0"
			 : "+x"(c), "+x"(products)
			 : "x"(b), "x"(one));
	return c;
}

TARGET("sse4.1") static void run_sse4_int8(uint64_t turns, float *sink)
{
	const __m128i a = _mm_set1_epi8((char)*sink), b = _mm_set1_epi8(3);
	const __m128i one = _mm_set1_epi16(1);

#define STEP(c) step_sse4_int8(c, a, b, one)
	CHAINS(__m128i, a, STEP, _mm_add_epi32, STORE_INT4);
#undef STEP
}

TARGET("avx2") static inline __m256i step_avx2_int8(__m256i c, __m256i a, __m256i b, __m256i one)
{
	__m256i products;

	__asm__ volatile("vpmaddubsw %3, %2, %1\n\t"
			 "vpmaddwd %4, %1, %1\n\t"
			 "vpaddd %1, %0, %0"
			 : "+x"(c), "=&x"(products)
			 : "x"(a), "x"(b), "x"(one));
	return c;
}

TARGET("avx2") static void run_avx2_int8(uint64_t turns, float *sink)
{
	const __m256i a = _mm256_set1_epi8((char)*sink), b = _mm256_set1_epi8(3);
	const __m256i one = _mm256_set1_epi16(1);

#define STEP(c) step_avx2_int8(c, a, b, one)
	CHAINS(__m256i, a, STEP, _mm256_add_epi32, STORE_INT8);
#undef STEP
}

TARGET("avx2,avxvnni") static void run_avxvnni(uint64_t turns, float *sink)
{
	const __m256i a = _mm256_set1_epi8((char)*sink), b = _mm256_set1_epi8(3);

#define STEP(c) _mm256_dpbusd_avx_epi32(c, a, b)
	CHAINS(__m256i, a, STEP, _mm256_add_epi32, STORE_INT8);
#undef STEP
}

TARGET("avx512f,avx512bw,avx512vnni") static void run_vnni(uint64_t turns, float *sink)
{
	const __m512i a = _mm512_set1_epi8((char)*sink), b = _mm512_set1_epi8(3);

#define STEP(c) _mm512_dpbusd_epi32(c, a, b)
	CHAINS(__m512i, a, STEP, _mm512_add_epi32, STORE_INT16);
#undef STEP
}

TARGET("avx512f,avx512bf16") static void run_bf16(uint64_t turns, float *sink)
{
	const __m512 tiny = _mm512_set1_ps(1e-6f);
	const __m512bh a = _mm512_cvtne2ps_pbh(tiny, tiny), b = a;

#define STEP(c) _mm512_dpbf16_ps(c, a, b)
	CHAINS(__m512, _mm512_set1_ps(*sink), STEP, _mm512_add_ps, STORE_FLOAT16);
#undef STEP
}

/* Two operations a lane; every chain counts. */
#define OPERATIONS(lanes) (2ull * (lanes)*DIO_PEAK_CHAINS)

const struct dio_peak_loop dio_peak_loops_x86[] = {
	{"mulps + addps", DIO_UNIT_F32, DVSM_CPU_SSE2, OPERATIONS(4), run_sse2},
	{"vfmadd ymm", DIO_UNIT_F32, DVSM_CPU_AVX2, OPERATIONS(8), run_avx2},
	{"vfmadd zmm", DIO_UNIT_F32, DVSM_CPU_AVX512, OPERATIONS(16), run_avx512},
	{"pmaddubsw + pmaddwd", DIO_UNIT_INT8, DVSM_CPU_SSE4, OPERATIONS(16), run_sse4_int8},
	{"vpmaddubsw + vpmaddwd", DIO_UNIT_INT8, DVSM_CPU_AVX2, OPERATIONS(32), run_avx2_int8},
	{"vpdpbusd ymm", DIO_UNIT_INT8, DVSM_CPU_AVX_VNNI, OPERATIONS(32), run_avxvnni},
	{"vpdpbusd zmm", DIO_UNIT_INT8, DVSM_CPU_VNNI, OPERATIONS(64), run_vnni},
	{"vdpbf16ps zmm", DIO_UNIT_BF16, DVSM_CPU_AVX512_BF16, OPERATIONS(32), run_bf16},
	{0},
};

#else

const struct dio_peak_loop dio_peak_loops_x86[] = {{0}};

#endif
