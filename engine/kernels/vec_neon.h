/* Four floats: Advanced SIMD of aarch64. The words that the f32_*.inc.h templates are written in.
 */
#ifndef DVSM_KERNELS_VEC_NEON_H
#define DVSM_KERNELS_VEC_NEON_H

#include <arm_neon.h>

#include "kernels/bf16.h"
#include <stddef.h>

#define VF_LANES 4

typedef float32x4_t vf;

static inline vf vf_load(const float *p)
{
	return vld1q_f32(p);
}

static inline void vf_store(float *p, vf a)
{
	vst1q_f32(p, a);
}

/** The first n lanes, n < VF_LANES; loads fill the rest with 0. */
static inline vf vf_load_part(const float *p, size_t n)
{
	float lanes[VF_LANES] = {0};

	for (size_t i = 0; i < n; i++)
		lanes[i] = p[i];
	return vld1q_f32(lanes);
}

static inline void vf_store_part(float *p, vf a, size_t n)
{
	float lanes[VF_LANES];

	vst1q_f32(lanes, a);
	for (size_t i = 0; i < n; i++)
		p[i] = lanes[i];
}

static inline vf vf_set(float x)
{
	return vdupq_n_f32(x);
}

static inline vf vf_add(vf a, vf b)
{
	return vaddq_f32(a, b);
}

static inline vf vf_sub(vf a, vf b)
{
	return vsubq_f32(a, b);
}

static inline vf vf_mul(vf a, vf b)
{
	return vmulq_f32(a, b);
}

static inline vf vf_div(vf a, vf b)
{
	return vdivq_f32(a, b);
}

static inline vf vf_max(vf a, vf b)
{
	return vmaxq_f32(a, b);
}

static inline vf vf_min(vf a, vf b)
{
	return vminq_f32(a, b);
}

/** a b + c, rounded once. */
static inline vf vf_fma(vf a, vf b, vf c)
{
	return vfmaq_f32(c, a, b);
}

static inline vf vf_abs(vf a)
{
	return vabsq_f32(a);
}

static inline vf vf_round(vf a)
{
	return vrndnq_f32(a);
}

/** a 2^n for whole n in -126..127 and a in [0.5, 2). */
static inline vf vf_scale(vf a, vf n)
{
	int32x4_t exponent = vshlq_n_s32(vcvtq_s32_f32(n), 23);

	return vreinterpretq_f32_s32(vaddq_s32(vreinterpretq_s32_f32(a), exponent));
}

/** Lanes of a where x < 0, of b elsewhere. */
static inline vf vf_if_negative(vf x, vf a, vf b)
{
	return vbslq_f32(vcltzq_f32(x), a, b);
}

static inline float vf_sum(vf a)
{
	return vaddvq_f32(a);
}

/** out[j][i] = in[i][j] for a 4 x 4 block, strides in floats. */
static inline void vf_transpose4(const float *in, size_t in_stride, float *out, size_t out_stride)
{
	float32x4x2_t ab = vtrnq_f32(vld1q_f32(in), vld1q_f32(in + in_stride));
	float32x4x2_t cd = vtrnq_f32(vld1q_f32(in + 2 * in_stride), vld1q_f32(in + 3 * in_stride));

	vst1q_f32(out, vcombine_f32(vget_low_f32(ab.val[0]), vget_low_f32(cd.val[0])));
	vst1q_f32(out + out_stride, vcombine_f32(vget_low_f32(ab.val[1]), vget_low_f32(cd.val[1])));
	vst1q_f32(out + 2 * out_stride,
		  vcombine_f32(vget_high_f32(ab.val[0]), vget_high_f32(cd.val[0])));
	vst1q_f32(out + 3 * out_stride,
		  vcombine_f32(vget_high_f32(ab.val[1]), vget_high_f32(cd.val[1])));
}

static inline vf vf_load_bf16(const dvsm_bf16 *p)
{
	return vreinterpretq_f32_u32(vshll_n_u16(vld1_u16(p), 16));
}

/** Two bfloat16 a lane: the first of each, and the second. */
static inline void vf_load_pairs(const dvsm_bf16 *p, vf *even, vf *odd)
{
	uint32x4_t pairs = vreinterpretq_u32_u16(vld1q_u16(p));

	*even = vreinterpretq_f32_u32(vshlq_n_u32(pairs, 16));
	*odd = vreinterpretq_f32_u32(vandq_u32(pairs, vdupq_n_u32(0xffff0000u)));
}

/* Lanes rounded to bfloat16, which is their upper half; the lower is what it was. */
static inline uint32x4_t vf_bits_bf16(vf a)
{
	uint32x4_t bits = vreinterpretq_u32_f32(a);
	uint32x4_t tie = vandq_u32(vshrq_n_u32(bits, 16), vdupq_n_u32(1));

	return vaddq_u32(bits, vaddq_u32(tie, vdupq_n_u32(0x7fff)));
}

static inline void vf_store_bf16(dvsm_bf16 *p, vf a)
{
	vst1_u16(p, vshrn_n_u32(vf_bits_bf16(a), 16));
}

/** To the nearest bfloat16, ties to even. */
static inline vf vf_round_bf16(vf a)
{
	return vreinterpretq_f32_u32(vandq_u32(vf_bits_bf16(a), vdupq_n_u32(0xffff0000u)));
}

#endif
