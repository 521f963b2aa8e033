/*
 * A row of bytes for pmaddubsw, which multiplies unsigned by signed bytes: for the fixed-point
 * kernels of SSE4.1 and AVX2. Private.
 *
 * The sizes of the row meet the columns, whose bits are flipped where the row is negative. To flip
 * is to negate and take 1 off, so that each negative number of the row leaves its size missing, in
 * every column: a sum begins with them. Two products fit 16 bits, for a column has no -128.
 */
#ifndef DVSM_KERNELS_FIXED_SIGNS_H
#define DVSM_KERNELS_FIXED_SIGNS_H

#include <tmmintrin.h>

#include "kernels/fixed_math.h"

struct row_bytes {
	const uint8_t *steps; /* of four numbers: their signs (0 or 255), then their sizes */
	int32_t begin;
};

/** Room that a row of `count` bytes needs beside them. */
#define ROW_ROOM(count) (2 * (count))

/** `count`, a multiple of 16, bytes of a row. */
static inline struct row_bytes row_prepare(const int8_t *bytes, size_t count, uint8_t *room)
{
	const __m128i zero = _mm_setzero_si128();
	__m128i missing = zero;

	for (size_t i = 0; i < count; i += 16) {
		__m128i a = _mm_loadu_si128((const __m128i *)(bytes + i));
		__m128i sizes = _mm_abs_epi8(a), signs = _mm_cmpgt_epi8(zero, a);
		__m128i *to = (__m128i *)(room + 2 * i);

		missing = _mm_add_epi64(missing, _mm_sad_epu8(_mm_and_si128(sizes, signs), zero));
		_mm_storeu_si128(to, _mm_unpacklo_epi32(signs, sizes));
		_mm_storeu_si128(to + 1, _mm_unpackhi_epi32(signs, sizes));
	}
	missing = _mm_add_epi64(missing, _mm_unpackhi_epi64(missing, missing));
	return (struct row_bytes){room, _mm_cvtsi128_si32(missing)};
}

#endif
