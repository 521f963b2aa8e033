/* What the x86 tiers share: a 4 x 4 transpose in the low lanes. */
#ifndef DVSM_KERNELS_VEC_SSE_H
#define DVSM_KERNELS_VEC_SSE_H

#include <stddef.h>
#include <xmmintrin.h>

/** out[j][i] = in[i][j] for a 4 x 4 block, strides in floats. */
static inline void vf_transpose4(const float *in, size_t in_stride, float *out, size_t out_stride)
{
	__m128 a = _mm_loadu_ps(in), b = _mm_loadu_ps(in + in_stride);
	__m128 c = _mm_loadu_ps(in + 2 * in_stride), d = _mm_loadu_ps(in + 3 * in_stride);

	_MM_TRANSPOSE4_PS(a, b, c, d);
	_mm_storeu_ps(out, a);
	_mm_storeu_ps(out + out_stride, b);
	_mm_storeu_ps(out + 2 * out_stride, c);
	_mm_storeu_ps(out + 3 * out_stride, d);
}

#endif
