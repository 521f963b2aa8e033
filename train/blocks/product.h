/* Products of bfloat16 matrices whose right factor is packed (vector.h). Sizes are multiples of 32.
 */
#pragma once

#include <stdbool.h>

#include "tiles.h"
#include "vector.h"

static inline void to_bf16_block(const float *tile, uint16_t *out, int ldo)
{
	for (int i = 0; i < 32; i++) {
		store_bf16(out + (size_t)i * ldo, _mm512_load_ps(tile + i * 32),
			   _mm512_load_ps(tile + i * 32 + 16));
	}
}

/*
 * out[rows][cols] (bf16) = a[rows][inner] b; b packed, its panels `inner_total` long. 32 rows of a
 * stay in the first-level cache, b streams past them.
 */
static inline void product_bf16(const uint16_t *a, int lda, const uint16_t *b, int inner_total,
				int rows, int cols, int inner, uint16_t *out, int ldo)
{
	_Alignas(64) float tiles[2][32 * 32]; /* one is converted while the next is multiplied */
	for (int r = 0; r < rows; r += 32) {
		const uint16_t *upper = a + (size_t)r * lda, *lower = upper + (size_t)16 * lda;
		uint16_t *to = out + (size_t)r * ldo;
		for (int c = 0; c <= cols; c += 32) {
			if (c < cols) {
				tiles_zero();
				tiles_multiply(upper, lower, (long)lda * 2, 64,
					       b + (size_t)c * inner_total, inner / 32);
			}
			if (c > 0) {
				to_bf16_block(tiles[c / 32 % 2 ^ 1], to + c - 32, ldo);
			}
			if (c < cols) {
				tiles_store(tiles[c / 32 % 2], 32 * 4);
			}
		}
	}
}

/* out[rows][cols] (float, += where `add`) = a b, as above. */
static inline void product(const uint16_t *a, int lda, const uint16_t *b, int inner_total, int rows,
			   int cols, int inner, float *out, int ldo, bool add)
{
	for (int r = 0; r < rows; r += 32) {
		const uint16_t *upper = a + (size_t)r * lda, *lower = upper + (size_t)16 * lda;
		for (int c = 0; c < cols; c += 32) {
			float *to = out + (size_t)r * ldo + c;
			if (add) {
				tiles_load(to, (long)ldo * 4);
			} else {
				tiles_zero();
			}
			tiles_multiply(upper, lower, (long)lda * 2, 64, b + (size_t)c * inner_total,
				       inner / 32);
			tiles_store(to, (long)ldo * 4);
		}
	}
}

/* out[rows][cols] (bf16) = a^T b, a transposed and b paired over their `inner` rows. */
static inline void product_transposed_bf16(const uint16_t *a, const uint16_t *b, int inner,
					   int rows, int cols, uint16_t *out)
{
	_Alignas(64) float tile[32 * 32];
	for (int r = 0; r < rows; r += 32) {
		const uint16_t *upper = a + (size_t)r * inner, *lower = upper + (size_t)16 * inner;
		for (int c = 0; c < cols; c += 32) {
			tiles_zero();
			tiles_multiply(upper, lower, 64, 1024, b + (size_t)c * inner, inner / 32);
			tiles_store(tile, 32 * 4);
			to_bf16_block(tile, out + (size_t)r * cols + c, cols);
		}
	}
}
