/* Values of several rays side by side: a wf holds a float of each, a wm a yes or no of each.
 * Every function gives each lane the bits that its namesake in vec.h gives a single value. */
#ifndef DIO_SIM_WIDE_LANES_H
#define DIO_SIM_WIDE_LANES_H

#include <immintrin.h>

#include "../vec.h"

#ifdef __AVX512F__

enum { LANES = 16 };

typedef __m512 wf;
typedef uint32_t wu __attribute__((vector_size(64)));
typedef __mmask16 wm;

static inline wf wf_of(float x)
{
	return _mm512_set1_ps(x);
}

static inline wf wf_load(const float *from)
{
	return _mm512_loadu_ps(from);
}

static inline void wf_store(float *to, wf a)
{
	_mm512_storeu_ps(to, a);
}

static inline wf wf_min(wf a, wf b)
{
	return _mm512_min_ps(a, b);
}

static inline wf wf_max(wf a, wf b)
{
	return _mm512_max_ps(a, b);
}

static inline wf wf_abs(wf a)
{
	return _mm512_abs_ps(a);
}

static inline wf wf_sqrt(wf a)
{
	return _mm512_sqrt_ps(a);
}

static inline wf wf_choose(wm m, wf yes, wf no)
{
	return _mm512_mask_blend_ps(m, no, yes);
}

static inline wm wf_lt(wf a, wf b)
{
	return _mm512_cmp_ps_mask(a, b, _CMP_LT_OQ);
}

static inline wm wf_le(wf a, wf b)
{
	return _mm512_cmp_ps_mask(a, b, _CMP_LE_OQ);
}

static inline wm wf_eq(wf a, wf b)
{
	return _mm512_cmp_ps_mask(a, b, _CMP_EQ_OQ);
}

static inline wu wu_of(uint32_t x)
{
	return (wu)_mm512_set1_epi32((int)x);
}

static inline wu wu_choose(wm m, wu yes, wu no)
{
	return (wu)_mm512_mask_blend_epi32(m, (__m512i)no, (__m512i)yes);
}

static inline wm wu_eq(wu a, wu b)
{
	return _mm512_cmpeq_epi32_mask((__m512i)a, (__m512i)b);
}

static inline wu wu_load(const uint32_t *from)
{
	return (wu)_mm512_loadu_si512(from);
}

static inline void wu_store(uint32_t *to, wu a)
{
	_mm512_storeu_si512(to, (__m512i)a);
}

/* Whole numbers below 2^31, or with a sign. */
static inline wf wf_from(wu a)
{
	return _mm512_cvtepi32_ps((__m512i)a);
}

static inline wu wu_truncated(wf a)
{
	return (wu)_mm512_cvttps_epi32(a);
}

static inline wm wm_not(wm a)
{
	return (wm)~a;
}

static inline wm wm_and(wm a, wm b)
{
	return a & b;
}

static inline wm wm_or(wm a, wm b)
{
	return a | b;
}

static inline uint32_t wm_bits(wm a)
{
	return a;
}

static inline wm wm_of_bits(uint32_t bits)
{
	return (wm)bits;
}

static inline float wf_least(wf a)
{
	return _mm512_reduce_min_ps(a);
}

static inline float wf_greatest(wf a)
{
	return _mm512_reduce_max_ps(a);
}

#else

enum { LANES = 8 };

typedef __m256 wf;
typedef uint32_t wu __attribute__((vector_size(32)));

/* All ones or all zeros in each lane. */
typedef struct {
	__m256 lanes;
} wm;

static inline wm wm_of(__m256 lanes)
{
	wm m;

	m.lanes = lanes;
	return m;
}

static inline wf wf_of(float x)
{
	return _mm256_set1_ps(x);
}

static inline wf wf_load(const float *from)
{
	return _mm256_loadu_ps(from);
}

static inline void wf_store(float *to, wf a)
{
	_mm256_storeu_ps(to, a);
}

static inline wf wf_min(wf a, wf b)
{
	return _mm256_min_ps(a, b);
}

static inline wf wf_max(wf a, wf b)
{
	return _mm256_max_ps(a, b);
}

static inline wf wf_abs(wf a)
{
	return _mm256_andnot_ps(_mm256_set1_ps(-0.0f), a);
}

static inline wf wf_sqrt(wf a)
{
	return _mm256_sqrt_ps(a);
}

static inline wf wf_choose(wm m, wf yes, wf no)
{
	return _mm256_blendv_ps(no, yes, m.lanes);
}

static inline wm wf_lt(wf a, wf b)
{
	return wm_of(_mm256_cmp_ps(a, b, _CMP_LT_OQ));
}

static inline wm wf_le(wf a, wf b)
{
	return wm_of(_mm256_cmp_ps(a, b, _CMP_LE_OQ));
}

static inline wm wf_eq(wf a, wf b)
{
	return wm_of(_mm256_cmp_ps(a, b, _CMP_EQ_OQ));
}

static inline wu wu_of(uint32_t x)
{
	return (wu)_mm256_set1_epi32((int)x);
}

static inline wu wu_choose(wm m, wu yes, wu no)
{
	return (wu)_mm256_blendv_ps((__m256)no, (__m256)yes, m.lanes);
}

static inline wm wu_eq(wu a, wu b)
{
	return wm_of((__m256)_mm256_cmpeq_epi32((__m256i)a, (__m256i)b));
}

static inline wu wu_load(const uint32_t *from)
{
	return (wu)_mm256_loadu_si256((const __m256i *)from);
}

static inline void wu_store(uint32_t *to, wu a)
{
	_mm256_storeu_si256((__m256i *)to, (__m256i)a);
}

/* Whole numbers below 2^31, or with a sign. */
static inline wf wf_from(wu a)
{
	return _mm256_cvtepi32_ps((__m256i)a);
}

static inline wu wu_truncated(wf a)
{
	return (wu)_mm256_cvttps_epi32(a);
}

static inline wm wm_not(wm a)
{
	return wm_of(_mm256_xor_ps(a.lanes, (__m256)_mm256_set1_epi32(-1)));
}

static inline wm wm_and(wm a, wm b)
{
	return wm_of(_mm256_and_ps(a.lanes, b.lanes));
}

static inline wm wm_or(wm a, wm b)
{
	return wm_of(_mm256_or_ps(a.lanes, b.lanes));
}

static inline uint32_t wm_bits(wm a)
{
	return (uint32_t)_mm256_movemask_ps(a.lanes);
}

static inline wm wm_of_bits(uint32_t bits)
{
	const __m256i place = _mm256_setr_epi32(1, 2, 4, 8, 16, 32, 64, 128);
	__m256i own = _mm256_and_si256(_mm256_set1_epi32((int)bits), place);

	return wm_of((__m256)_mm256_cmpeq_epi32(own, place));
}

static inline float wf_least(wf a)
{
	float v[LANES];

	wf_store(v, a);
	for (int i = 1; i < LANES; i++)
		v[0] = minf(v[0], v[i]);
	return v[0];
}

static inline float wf_greatest(wf a)
{
	float v[LANES];

	wf_store(v, a);
	for (int i = 1; i < LANES; i++)
		v[0] = maxf(v[0], v[i]);
	return v[0];
}

#endif

enum { ALL_LANES = (1 << LANES) - 1 };

static inline wm wm_all(void)
{
	return wm_of_bits(ALL_LANES);
}

static inline wm wm_none(void)
{
	return wm_of_bits(0);
}

static inline bool wm_any(wm a)
{
	return wm_bits(a) != 0;
}

static inline wm wm_less(wm a, wm taken)
{
	return wm_and(a, wm_not(taken));
}

static inline wm wm_if(bool yes)
{
	return wm_of_bits(yes ? ALL_LANES : 0);
}

static inline wm wf_gt(wf a, wf b)
{
	return wf_lt(b, a);
}

static inline wm wf_ge(wf a, wf b)
{
	return wf_le(b, a);
}

/* Any of the bits? */
static inline wm wu_has(wu a, uint32_t bits)
{
	return wm_not(wu_eq(a & wu_of(bits), wu_of(0)));
}

static inline wf wf_clamp(wf x, wf lo, wf hi)
{
	return wf_min(hi, wf_max(lo, x));
}

static inline wf wf_saturate(wf x)
{
	return wf_clamp(x, wf_of(0), wf_of(1));
}

static inline wf wf_mix(wf a, wf b, wf t)
{
	return a + (b - a) * t;
}

static inline wf wf_smooth_step(float lo, float hi, wf x)
{
	wf t = wf_saturate((x - wf_of(lo)) / wf_of(hi - lo));

	return t * t * (wf_of(3) - wf_of(2) * t);
}

static inline wu wf_floor_int(wf x)
{
	wu i = wu_truncated(wf_clamp(x, wf_of(-1e9f), wf_of(1e9f)));

	return wu_choose(wf_lt(x, wf_from(i)), i - wu_of(1), i);
}

static inline wf wf_fract(wf x)
{
	return x - wf_from(wf_floor_int(x));
}

static inline wf wf_sin_turns(wf x)
{
	wf f = wf_fract(x), q, s;

	q = wf_choose(wf_lt(f, wf_of(0.75f)), wf_of(0.5f) - f, f - wf_of(1));
	q = wf_choose(wf_lt(f, wf_of(0.25f)), f, q);
	s = q * q;
	return q * (wf_of(6.28318531f) +
		    s * (wf_of(-41.3416822f) + s * (wf_of(81.5921097f) + s * wf_of(-74.6130600f))));
}

static inline wf wf_atan2_turns(wf y, wf x)
{
	wf ax = wf_abs(x), ay = wf_abs(y), big = wf_max(ax, ay), zero = wf_of(0);
	wf r = wf_choose(wf_gt(big, zero), wf_min(ax, ay) / big, zero), s = r * r;
	wf a = r * (wf_of(0.15913370f) +
		    s * (wf_of(-0.05256880f) +
			 s * (wf_of(0.02867033f) +
			      s * (wf_of(-0.01354934f) + s * wf_of(0.00331601f)))));

	a = wf_choose(wf_gt(ay, ax), wf_of(0.25f) - a, a);
	a = wf_choose(wf_lt(x, zero), wf_of(0.5f) - a, a);
	return wf_choose(wf_lt(y, zero), -a, a);
}

struct w3 {
	wf x, y, z;
};

static inline struct w3 w3(wf x, wf y, wf z)
{
	struct w3 r;

	r.x = x;
	r.y = y;
	r.z = z;
	return r;
}

static inline struct w3 w3_of(struct v3 a)
{
	return w3(wf_of(a.x), wf_of(a.y), wf_of(a.z));
}

static inline struct w3 w3_add(struct w3 a, struct w3 b)
{
	return w3(a.x + b.x, a.y + b.y, a.z + b.z);
}

static inline struct w3 w3_sub(struct w3 a, struct w3 b)
{
	return w3(a.x - b.x, a.y - b.y, a.z - b.z);
}

static inline struct w3 w3_mul(struct w3 a, struct w3 b)
{
	return w3(a.x * b.x, a.y * b.y, a.z * b.z);
}

static inline struct w3 w3_scale(struct w3 a, wf s)
{
	return w3(a.x * s, a.y * s, a.z * s);
}

static inline struct w3 w3_mad(struct w3 a, struct w3 b, wf s)
{
	return w3(a.x + b.x * s, a.y + b.y * s, a.z + b.z * s);
}

static inline struct w3 w3_mix(struct w3 a, struct w3 b, wf t)
{
	return w3(wf_mix(a.x, b.x, t), wf_mix(a.y, b.y, t), wf_mix(a.z, b.z, t));
}

static inline wf w3_dot(struct w3 a, struct w3 b)
{
	return a.x * b.x + a.y * b.y + a.z * b.z;
}

static inline struct w3 w3_cross(struct w3 a, struct w3 b)
{
	return w3(a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x);
}

static inline struct w3 w3_unit(struct w3 a)
{
	return w3_scale(a, wf_of(1) / wf_sqrt(w3_dot(a, a) + wf_of(1e-30f)));
}

static inline struct w3 w3_choose(wm m, struct w3 yes, struct w3 no)
{
	return w3(wf_choose(m, yes.x, no.x), wf_choose(m, yes.y, no.y), wf_choose(m, yes.z, no.z));
}

static inline struct w3 w3_rotate(const struct rotation *r, struct w3 a)
{
	const float *m = r->m;

	return w3(wf_of(m[0]) * a.x + wf_of(m[1]) * a.y + wf_of(m[2]) * a.z,
		  wf_of(m[3]) * a.x + wf_of(m[4]) * a.y + wf_of(m[5]) * a.z,
		  wf_of(m[6]) * a.x + wf_of(m[7]) * a.y + wf_of(m[8]) * a.z);
}

static inline struct w3 w3_rotate_back(const struct rotation *r, struct w3 a)
{
	const float *m = r->m;

	return w3(wf_of(m[0]) * a.x + wf_of(m[3]) * a.y + wf_of(m[6]) * a.z,
		  wf_of(m[1]) * a.x + wf_of(m[4]) * a.y + wf_of(m[7]) * a.z,
		  wf_of(m[2]) * a.x + wf_of(m[5]) * a.y + wf_of(m[8]) * a.z);
}

#endif
