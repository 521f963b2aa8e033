/*
 * A 32 x 32 block of a product by AVX-512 (tiles.h), the sums waiting in the first-level cache: by
 * AVX512-BF16 where the build has it, else by float32 products of the same bfloat16 values.
 */
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

/* The processor has the AVX-512 of this build, and the system keeps the registers. */
static inline bool tiles_supported(void)
{
	bool supported = __builtin_cpu_supports("avx512bw") && __builtin_cpu_supports("avx512dq") &&
			 __builtin_cpu_supports("avx512vl");
#ifdef __AVX512BF16__
	unsigned a, b, c, d;
	supported = supported && __get_cpuid_count(7, 1, &a, &b, &c, &d) && (a >> 5 & 1);
#endif
	return supported;
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

enum { TILE_ROWS = 8, TILE_PAIRS = 16 }; /* rows multiplied at a time; inner pairs of a step */

#ifdef __AVX512BF16__

/* The pair of values at p, in every lane. */
static inline __m512bh tiles_pair(const char *p)
{
	int word;
	memcpy(&word, p, sizeof(word));
	return (__m512bh)_mm512_set1_epi32(word);
}

/* One step of TILE_ROWS rows: left and right hold the sums of columns 0-15 and 16-31. */
static inline __attribute__((always_inline)) void tiles_step(__m512 left[TILE_ROWS],
							     __m512 right[TILE_ROWS], const char *a,
							     long stride, const uint16_t *panel)
{
	for (int k = 0; k < TILE_PAIRS; k++) {
		__m512bh b0 = (__m512bh)_mm512_loadu_si512(panel + 32 * k);
		__m512bh b1 = (__m512bh)_mm512_loadu_si512(panel + 512 + 32 * k);
#pragma GCC unroll 8
		for (int i = 0; i < TILE_ROWS; i++) {
			__m512bh pair = tiles_pair(a + i * stride + 4 * k);
			left[i] = _mm512_dpbf16_ps(left[i], pair, b0);
			right[i] = _mm512_dpbf16_ps(right[i], pair, b1);
		}
	}
}

#else

/* The first and the second bfloat16 of each word, as float32. */
static inline __m512 tiles_first(__m512i words)
{
	return _mm512_castsi512_ps(_mm512_slli_epi32(words, 16));
}

static inline __m512 tiles_second(__m512i words)
{
	return _mm512_castsi512_ps(_mm512_and_si512(words, _mm512_set1_epi32(-0x10000)));
}

/* One step of TILE_ROWS rows: left and right hold the sums of columns 0-15 and 16-31. */
static inline __attribute__((always_inline)) void tiles_step(__m512 left[TILE_ROWS],
							     __m512 right[TILE_ROWS], const char *a,
							     long stride, const uint16_t *panel)
{
	_Alignas(64) float first[TILE_ROWS][TILE_PAIRS], second[TILE_ROWS][TILE_PAIRS];
#pragma GCC unroll 8
	for (int i = 0; i < TILE_ROWS; i++) {
		__m512i words = _mm512_loadu_si512(a + i * stride);
		_mm512_store_ps(first[i], tiles_first(words));
		_mm512_store_ps(second[i], tiles_second(words));
	}
	for (int k = 0; k < TILE_PAIRS; k++) {
		__m512i b0 = _mm512_loadu_si512(panel + 32 * k);
		__m512i b1 = _mm512_loadu_si512(panel + 512 + 32 * k);
		__m512 b00 = tiles_first(b0), b01 = tiles_second(b0);
		__m512 b10 = tiles_first(b1), b11 = tiles_second(b1);
#pragma GCC unroll 8
		for (int i = 0; i < TILE_ROWS; i++) {
			__m512 a0 = _mm512_set1_ps(first[i][k]);
			left[i] = _mm512_fmadd_ps(a0, b00, left[i]);
			right[i] = _mm512_fmadd_ps(a0, b10, right[i]);
		}
#pragma GCC unroll 8
		for (int i = 0; i < TILE_ROWS; i++) {
			__m512 a1 = _mm512_set1_ps(second[i][k]);
			left[i] = _mm512_fmadd_ps(a1, b01, left[i]);
			right[i] = _mm512_fmadd_ps(a1, b11, right[i]);
		}
	}
}

#endif

/* TILE_ROWS rows of the block: 16 registers of sums, so that the multipliers never wait for one. */
static inline void tiles_multiply_rows(float sums[TILE_ROWS][32], const char *a, long stride,
				       long advance, const uint16_t *panel, int steps)
{
	__m512 left[TILE_ROWS], right[TILE_ROWS];
#pragma GCC unroll 8
	for (int i = 0; i < TILE_ROWS; i++) {
		left[i] = _mm512_load_ps(sums[i]);
		right[i] = _mm512_load_ps(sums[i] + 16);
	}
	for (int s = 0; s < steps; s++, a += advance, panel += 1024) {
		tiles_step(left, right, a, stride, panel);
	}
#pragma GCC unroll 8
	for (int i = 0; i < TILE_ROWS; i++) {
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
