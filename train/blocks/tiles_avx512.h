/* A 32 x 32 block of a product by AVX512-BF16 (tiles.h): the sums wait in the first-level cache. */
#pragma once

#include <cpuid.h>
#include <immintrin.h>
#include <stdbool.h>
#include <stdint.h>
#include <string.h>

static _Thread_local struct {
	_Alignas(64) float sums[32][32];
} block;

static inline void tiles_configure(void)
{
}

static inline void tiles_release(void)
{
}

/* The processor multiplies bfloat16 in AVX-512, and the system keeps the registers. */
static inline bool tiles_supported(void)
{
	unsigned a, b, c, d;
	return __builtin_cpu_supports("avx512bw") && __builtin_cpu_supports("avx512dq") &&
	       __builtin_cpu_supports("avx512vl") && __get_cpuid_count(7, 1, &a, &b, &c, &d) &&
	       (a >> 5 & 1);
}

static inline void tiles_zero(void)
{
	memset(block.sums, 0, sizeof(block.sums));
}

static inline void tiles_load(const float *c, long stride)
{
	for (int i = 0; i < 32; i++) {
		memcpy(block.sums[i], (const char *)c + i * stride, sizeof(block.sums[i]));
	}
}

static inline void tiles_store(float *c, long stride)
{
	for (int i = 0; i < 32; i++) {
		memcpy((char *)c + i * stride, block.sums[i], sizeof(block.sums[i]));
	}
}

/* The pair of values at p, in every lane. */
static inline __m512bh tiles_pair(const char *p)
{
	int word;
	memcpy(&word, p, sizeof(word));
	return (__m512bh)_mm512_set1_epi32(word);
}

/* Eight rows of the block: 16 registers of sums, so that the multipliers never wait for one. */
static inline void tiles_multiply_rows(float sums[8][32], const char *a, long stride, long advance,
				       const uint16_t *panel, int steps)
{
	enum { ROWS = 8, PAIRS = 16 };
	__m512 left[ROWS], right[ROWS];
#pragma GCC unroll 8
	for (int i = 0; i < ROWS; i++) {
		left[i] = _mm512_load_ps(sums[i]);
		right[i] = _mm512_load_ps(sums[i] + 16);
	}
	for (int s = 0; s < steps; s++, a += advance, panel += 1024) {
		for (int k = 0; k < PAIRS; k++) {
			__m512bh b0 = (__m512bh)_mm512_loadu_si512(panel + 32 * k);
			__m512bh b1 = (__m512bh)_mm512_loadu_si512(panel + 512 + 32 * k);
#pragma GCC unroll 8
			for (int i = 0; i < ROWS; i++) {
				__m512bh pair = tiles_pair(a + i * stride + 4 * k);
				left[i] = _mm512_dpbf16_ps(left[i], pair, b0);
				right[i] = _mm512_dpbf16_ps(right[i], pair, b1);
			}
		}
	}
#pragma GCC unroll 8
	for (int i = 0; i < ROWS; i++) {
		_mm512_store_ps(sums[i], left[i]);
		_mm512_store_ps(sums[i] + 16, right[i]);
	}
}

/*
 * Add `steps` products of 32 x 32 to the sums. Rows 0-15 of the left factor start at a0, rows 16-31
 * at a1, `stride` bytes apart; the next step's lie `advance` bytes on. The right factor is a packed
 * panel: two tiles a step.
 */
static inline void tiles_multiply(const void *a0, const void *a1, long stride, long advance,
				  const uint16_t *panel, int steps)
{
	const char *first = a0, *second = a1;
	tiles_multiply_rows(block.sums, first, stride, advance, panel, steps);
	tiles_multiply_rows(block.sums + 8, first + 8 * stride, stride, advance, panel, steps);
	tiles_multiply_rows(block.sums + 16, second, stride, advance, panel, steps);
	tiles_multiply_rows(block.sums + 24, second + 8 * stride, stride, advance, panel, steps);
}
