/* SHA-256 by the Armv8 cryptographic extension (Arm ARM, SHA256H, SHA256SU0, SHA256SU1). */
#include <arm_neon.h>
#include <sys/auxv.h>

#include "files/sha256_compress.h"

/* asm/hwcap.h's, which not every libc brings along. */
#define CPU_HAS_SHA2 (1ul << 6)

/* Four rounds with the words `w` of the schedule. */
static void four_rounds(uint32x4_t *abcd, uint32x4_t *efgh, uint32x4_t w, const uint32_t *constants)
{
	uint32x4_t sum = vaddq_u32(w, vld1q_u32(constants));
	uint32x4_t before = *abcd;
	*abcd = vsha256hq_u32(*abcd, *efgh, sum);
	*efgh = vsha256h2q_u32(*efgh, before, sum);
}

static void compress(uint32_t state[8], const unsigned char *blocks, size_t count)
{
	uint32x4_t abcd = vld1q_u32(state), efgh = vld1q_u32(state + 4);
	for (; count > 0; count--, blocks += 64) {
		uint32x4_t abcd_before = abcd, efgh_before = efgh, w[4];
		for (int i = 0; i < 4; i++) {
			w[i] = vreinterpretq_u32_u8(vrev32q_u8(vld1q_u8(blocks + 16 * i)));
			four_rounds(&abcd, &efgh, w[i], dvsm_sha256_constants + 4 * i);
		}
		for (int round = 16; round < 64; round += 4) {
			uint32x4_t next = vsha256su1q_u32(vsha256su0q_u32(w[0], w[1]), w[2], w[3]);
			w[0] = w[1];
			w[1] = w[2];
			w[2] = w[3];
			w[3] = next;
			four_rounds(&abcd, &efgh, next, dvsm_sha256_constants + round);
		}
		abcd = vaddq_u32(abcd, abcd_before);
		efgh = vaddq_u32(efgh, efgh_before);
	}
	vst1q_u32(state, abcd);
	vst1q_u32(state + 4, efgh);
}

dvsm_sha256_compress_fn *dvsm_sha256_find_hardware(void)
{
	return getauxval(AT_HWCAP) & CPU_HAS_SHA2 ? compress : NULL;
}
