/* SHA-256 by the SHA extensions of x86 (Intel SDM, SHA256RNDS2, SHA256MSG1, SHA256MSG2). */
#include <cpuid.h>
#include <immintrin.h>

#include "files/sha256_compress.h"

/* Four rounds with the words `w` of the schedule. */
static void four_rounds(__m128i *abef, __m128i *cdgh, __m128i w, const uint32_t *constants)
{
	__m128i sum = _mm_add_epi32(w, _mm_loadu_si128((const __m128i *)(const void *)constants));
	*cdgh = _mm_sha256rnds2_epu32(*cdgh, *abef, sum);
	*abef = _mm_sha256rnds2_epu32(*abef, *cdgh, _mm_shuffle_epi32(sum, 0x0e));
}

/* The next four words of the schedule from the sixteen before them, oldest first. */
static __m128i next_words(__m128i w0, __m128i w1, __m128i w2, __m128i w3)
{
	__m128i sum = _mm_add_epi32(_mm_sha256msg1_epu32(w0, w1), _mm_alignr_epi8(w3, w2, 4));
	return _mm_sha256msg2_epu32(sum, w3);
}

static void compress(uint32_t state[8], const unsigned char *blocks, size_t count)
{
	const __m128i swap = _mm_set_epi64x(0x0c0d0e0f08090a0b, 0x0405060700010203);
	/* The instructions want the state as ABEF and CDGH. */
	__m128i *place = (__m128i *)(void *)state;
	__m128i cdab = _mm_shuffle_epi32(_mm_loadu_si128(place), 0xb1);
	__m128i efgh = _mm_shuffle_epi32(_mm_loadu_si128(place + 1), 0x1b);
	__m128i abef = _mm_alignr_epi8(cdab, efgh, 8);
	__m128i cdgh = _mm_blend_epi16(efgh, cdab, 0xf0);

	for (; count > 0; count--, blocks += 64) {
		const __m128i *words = (const __m128i *)(const void *)blocks;
		__m128i abef_before = abef, cdgh_before = cdgh, w[4];
		for (int i = 0; i < 4; i++) {
			w[i] = _mm_shuffle_epi8(_mm_loadu_si128(words + i), swap);
			four_rounds(&abef, &cdgh, w[i], dvsm_sha256_constants + 4 * i);
		}
		for (int round = 16; round < 64; round += 4) {
			__m128i next = next_words(w[0], w[1], w[2], w[3]);
			w[0] = w[1];
			w[1] = w[2];
			w[2] = w[3];
			w[3] = next;
			four_rounds(&abef, &cdgh, next, dvsm_sha256_constants + round);
		}
		abef = _mm_add_epi32(abef, abef_before);
		cdgh = _mm_add_epi32(cdgh, cdgh_before);
	}

	__m128i feba = _mm_shuffle_epi32(abef, 0x1b);
	__m128i dchg = _mm_shuffle_epi32(cdgh, 0xb1);
	_mm_storeu_si128(place, _mm_blend_epi16(feba, dchg, 0xf0));
	_mm_storeu_si128(place + 1, _mm_alignr_epi8(dchg, feba, 8));
}

dvsm_sha256_compress_fn *dvsm_sha256_find_hardware(void)
{
	/* SSE registers alone are used: whatever runs x86-64 saves them. */
	unsigned eax, ebx, ecx, edx;
	if (!__get_cpuid(1, &eax, &ebx, &ecx, &edx) || !(ecx & bit_SSSE3) || !(ecx & bit_SSE4_1))
		return NULL;
	if (!__get_cpuid_count(7, 0, &eax, &ebx, &ecx, &edx) || !(ebx & bit_SHA))
		return NULL;
	return compress;
}
