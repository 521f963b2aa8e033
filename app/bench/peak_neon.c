#include "bench/peak_loops.h"

#include "dvsm/engine.h"

#if defined(__aarch64__)

#include <arm_neon.h>

static void run_f32(uint64_t turns, float *sink)
{
	const float32x4_t a = vdupq_n_f32(0.999f), b = vdupq_n_f32(0.001f);
	float32x4_t c[DIO_PEAK_CHAINS];

	for (int k = 0; k < DIO_PEAK_CHAINS; k++) {
		c[k] = vdupq_n_f32(*sink);
		DIO_PEAK_HIDE(c[k]);
	}
	for (uint64_t i = 0; i < turns; i++)
		for (int k = 0; k < DIO_PEAK_CHAINS; k++)
			c[k] = vfmaq_f32(b, c[k], a);
	for (int k = 1; k < DIO_PEAK_CHAINS; k++)
		c[0] = vaddq_f32(c[0], c[k]);
	*sink = vgetq_lane_f32(c[0], 0);
}

/* Eight products into 16 bits, added in pairs into 32: two instructions where there is no sdot. */
static void run_int8(uint64_t turns, float *sink)
{
	const int8x8_t a = vdup_n_s8((int8_t)*sink), b = vdup_n_s8(3);
	int32x4_t c[DIO_PEAK_CHAINS];

	for (int k = 0; k < DIO_PEAK_CHAINS; k++)
		c[k] = vdupq_n_s32(k);
	for (uint64_t i = 0; i < turns; i++)
		for (int k = 0; k < DIO_PEAK_CHAINS; k++)
			c[k] = vpadalq_s16(
				c[k],
				vmull_s8(veor_s8(a, vreinterpret_s8_s32(vget_low_s32(c[k]))), b));
	for (int k = 1; k < DIO_PEAK_CHAINS; k++)
		c[0] = vaddq_s32(c[0], c[k]);
	*sink = (float)vgetq_lane_s32(c[0], 0);
}

const struct dio_peak_loop dio_peak_loops_neon[] = {
	{"fmla", DIO_UNIT_F32, DVSM_CPU_NEON, 2ull * 4 * DIO_PEAK_CHAINS, run_f32},
	{"smull + sadalp", DIO_UNIT_INT8, DVSM_CPU_NEON, 2ull * 8 * DIO_PEAK_CHAINS, run_int8},
	{0},
};

#else

const struct dio_peak_loop dio_peak_loops_neon[] = {{0}};

#endif
