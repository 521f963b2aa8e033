/* Small vector algebra and the elementary functions the tracer needs.
 * Only exactly rounded operations (+ - * / sqrt) and our own polynomials are used, so a picture
 * has the same bits with every compiler and C library. Plain enough for nvcc too. */
#ifndef DIO_SIM_VEC_H
#define DIO_SIM_VEC_H

#include <math.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

/* nvcc reads the source once for the CPU and once for the GPU. */
#ifdef __CUDACC__
#define DIO_SIM_FN __host__ __device__ static inline
#else
#define DIO_SIM_FN static inline
#endif
#ifdef __CUDA_ARCH__
#define DIO_SIM_CONST static __device__ const
#else
#define DIO_SIM_CONST static const
#endif

#define SIM_PI 3.14159265f

struct v3 {
	float x, y, z;
};

struct v2 {
	float x, y;
};

DIO_SIM_FN struct v3 v3(float x, float y, float z)
{
	struct v3 r;

	r.x = x;
	r.y = y;
	r.z = z;
	return r;
}

DIO_SIM_FN struct v2 v2(float x, float y)
{
	struct v2 r;

	r.x = x;
	r.y = y;
	return r;
}

DIO_SIM_FN struct v3 v3_add(struct v3 a, struct v3 b)
{
	return v3(a.x + b.x, a.y + b.y, a.z + b.z);
}

DIO_SIM_FN struct v3 v3_sub(struct v3 a, struct v3 b)
{
	return v3(a.x - b.x, a.y - b.y, a.z - b.z);
}

DIO_SIM_FN struct v3 v3_mul(struct v3 a, struct v3 b)
{
	return v3(a.x * b.x, a.y * b.y, a.z * b.z);
}

DIO_SIM_FN struct v3 v3_scale(struct v3 a, float s)
{
	return v3(a.x * s, a.y * s, a.z * s);
}

/* a + b * s */
DIO_SIM_FN struct v3 v3_mad(struct v3 a, struct v3 b, float s)
{
	return v3(a.x + b.x * s, a.y + b.y * s, a.z + b.z * s);
}

DIO_SIM_FN struct v3 v3_mix(struct v3 a, struct v3 b, float t)
{
	return v3(a.x + (b.x - a.x) * t, a.y + (b.y - a.y) * t, a.z + (b.z - a.z) * t);
}

DIO_SIM_FN float v3_dot(struct v3 a, struct v3 b)
{
	return a.x * b.x + a.y * b.y + a.z * b.z;
}

DIO_SIM_FN struct v3 v3_cross(struct v3 a, struct v3 b)
{
	return v3(a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x);
}

DIO_SIM_FN struct v3 v3_unit(struct v3 a)
{
	return v3_scale(a, 1 / sqrtf(v3_dot(a, a) + 1e-30f));
}

DIO_SIM_FN float clampf(float x, float lo, float hi)
{
	return x < lo ? lo : x > hi ? hi : x;
}

DIO_SIM_FN float saturate(float x)
{
	return clampf(x, 0, 1);
}

DIO_SIM_FN float minf(float a, float b)
{
	return a < b ? a : b;
}

DIO_SIM_FN float maxf(float a, float b)
{
	return a > b ? a : b;
}

DIO_SIM_FN float absf(float a)
{
	return fabsf(a);
}

DIO_SIM_FN float mixf(float a, float b, float t)
{
	return a + (b - a) * t;
}

/* 0 below lo, 1 above hi, smooth between. */
DIO_SIM_FN float smooth_step(float lo, float hi, float x)
{
	float t = saturate((x - lo) / (hi - lo));

	return t * t * (3 - 2 * t);
}

/* floorf() is a library call where the instruction set has no rounding instruction. */
DIO_SIM_FN int32_t floor_int(float x)
{
	int32_t i = (int32_t)clampf(x, -1e9f, 1e9f);

	return i - (x < (float)i);
}

DIO_SIM_FN float fract(float x)
{
	return x - (float)floor_int(x);
}

/* sin(2 pi x), |error| < 2e-4: odd polynomial on a quarter turn. */
DIO_SIM_FN float sin_turns(float x)
{
	float f = fract(x);
	float q = f < 0.25f ? f : f < 0.75f ? 0.5f - f : f - 1;
	float s = q * q;

	return q * (6.28318531f + s * (-41.3416822f + s * (81.5921097f + s * -74.6130600f)));
}

DIO_SIM_FN float cos_turns(float x)
{
	return sin_turns(x + 0.25f);
}

/* atan2(y, x) in turns, [-0.5, 0.5], |error| < 2e-5. */
DIO_SIM_FN float atan2_turns(float y, float x)
{
	float ax = absf(x), ay = absf(y), big = maxf(ax, ay);
	float r = big > 0 ? minf(ax, ay) / big : 0;
	float s = r * r;
	float a =
		r * (0.15913370f +
		     s * (-0.05256880f + s * (0.02867033f + s * (-0.01354934f + s * 0.00331601f))));

	if (ay > ax)
		a = 0.25f - a;
	if (x < 0)
		a = 0.5f - a;
	return y < 0 ? -a : a;
}

/* Linear light to the sRGB curve and back, both within 0.003. */
DIO_SIM_FN float srgb_encode(float x)
{
	float least = maxf(x, 0), s1 = sqrtf(least), s2 = sqrtf(s1), s3 = sqrtf(s2);
	float curve =
		0.662002687f * s1 + 0.684122060f * s2 - 0.323583601f * s3 - 0.0225411470f * least;

	return x <= 0.0031308f ? 12.92f * least : minf(curve, 1);
}

DIO_SIM_FN float srgb_decode(float x)
{
	return x * (x * (x * 0.305306011f + 0.682171111f) + 0.012522878f);
}

/* Orthonormal basis, row-major: columns are the axes of the inner frame seen from the outer. */
struct rotation {
	float m[9];
};

DIO_SIM_FN struct v3 rotate(const struct rotation *r, struct v3 a)
{
	return v3(r->m[0] * a.x + r->m[1] * a.y + r->m[2] * a.z,
		  r->m[3] * a.x + r->m[4] * a.y + r->m[5] * a.z,
		  r->m[6] * a.x + r->m[7] * a.y + r->m[8] * a.z);
}

DIO_SIM_FN struct v3 rotate_back(const struct rotation *r, struct v3 a)
{
	return v3(r->m[0] * a.x + r->m[3] * a.y + r->m[6] * a.z,
		  r->m[1] * a.x + r->m[4] * a.y + r->m[7] * a.z,
		  r->m[2] * a.x + r->m[5] * a.y + r->m[8] * a.z);
}

#endif
