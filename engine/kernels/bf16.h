/* bfloat16: the upper half of a float32. Private to the engine. */
#ifndef DVSM_KERNELS_BF16_H
#define DVSM_KERNELS_BF16_H

#include <stdint.h>
#include <string.h>

typedef uint16_t dvsm_bf16;

static inline float dvsm_bf16_widen(dvsm_bf16 number)
{
	uint32_t bits = (uint32_t)number << 16;
	float x;

	memcpy(&x, &bits, sizeof(x));
	return x;
}

/** Rounded to nearest, ties to even, for numbers (a NaN may become infinity). */
static inline dvsm_bf16 dvsm_bf16_round(float x)
{
	uint32_t bits;

	memcpy(&bits, &x, sizeof(bits));
	return (dvsm_bf16)((bits + 0x7fff + (bits >> 16 & 1)) >> 16);
}

#endif
