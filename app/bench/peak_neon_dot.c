#include "bench/peak_loops.h"

#include "dvsm/engine.h"

/* Built with the flags of all three extensions; each loop runs where its own is there. */
#if defined(__aarch64__)

#include <arm_neon.h>

#define LOOP(name, type, step)                                                                     \
	static void name(uint64_t turns, float *sink)                                              \
	{                                                                                          \
		const int8x16_t a = vdupq_n_s8((int8_t)*sink), b = vdupq_n_s8(3);                  \
		type c[DIO_PEAK_CHAINS];                                                           \
                                                                                                   \
		for (int k = 0; k < DIO_PEAK_CHAINS; k++) {                                        \
			c[k] = (type){0};                                                          \
			DIO_PEAK_HIDE(c[k]);                                                       \
		}                                                                                  \
		for (uint64_t i = 0; i < turns; i++)                                               \
			for (int k = 0; k < DIO_PEAK_CHAINS; k++)                                  \
				c[k] = step;                                                       \
		for (int k = 1; k < DIO_PEAK_CHAINS; k++)                                          \
			c[0] = c[0] + c[k];                                                        \
		*sink = (float)c[0][0];                                                            \
	}

LOOP(run_sdot, int32x4_t, vdotq_s32(c[k], a, b))
LOOP(run_smmla, int32x4_t, vmmlaq_s32(c[k], a, b))
LOOP(run_bfmmla, float32x4_t,
     vbfmmlaq_f32(c[k], vreinterpretq_bf16_s8(a), vreinterpretq_bf16_s8(b)))

#define OPERATIONS(products) (2ull * (products)*DIO_PEAK_CHAINS)

const struct dio_peak_loop dio_peak_loops_neon_dot[] = {
	{"sdot", DIO_UNIT_INT8, DVSM_CPU_NEON_DOTPROD, OPERATIONS(16), run_sdot},
	{"smmla", DIO_UNIT_INT8, DVSM_CPU_NEON_I8MM, OPERATIONS(32), run_smmla},
	{"bfmmla", DIO_UNIT_BF16, DVSM_CPU_NEON_BF16, OPERATIONS(16), run_bfmmla},
	{0},
};

#else

const struct dio_peak_loop dio_peak_loops_neon_dot[] = {{0}};

#endif
