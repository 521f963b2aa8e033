/*
 * Template: exponential, GELU and sigmoid of a vector. Included once by each tier, after its
 * vec_<tier>.h.
 *
 * All polynomials are minimax fits of the relative error (Lawson's iteration, in double); the
 * stated errors are those of the polynomial, before float rounding.
 */

/* Whole 2^n stay normal numbers: anything below 2^-126 counts as 2^-126. */
#define EXP2_LOWEST  (-126.0f)
#define EXP2_HIGHEST 126.0f

/* 2^x; relative error 2e-9 of the polynomial on [-1/2, 1/2], about one unit in the last place in
 * all. */
static inline vf exp2_vf(vf x)
{
	x = vf_min(vf_max(x, vf_set(EXP2_LOWEST)), vf_set(EXP2_HIGHEST));

	vf whole = vf_round(x);
	vf f = vf_sub(x, whole);
	vf p = vf_set(0.00015345807598654416f);

	p = vf_fma(p, f, vf_set(0.001339993118149041f));
	p = vf_fma(p, f, vf_set(0.009618488973500022f));
	p = vf_fma(p, f, vf_set(0.05550328777083007f));
	p = vf_fma(p, f, vf_set(0.2402264689048268f));
	p = vf_fma(p, f, vf_set(0.6931472057371939f));
	p = vf_fma(p, f, vf_set(1.000000000554186f));
	return vf_scale(p, whole);
}

/* 2^x; relative error 7.5e-5: four bits below what bfloat16 keeps. */
static inline vf exp2_short_vf(vf x)
{
	x = vf_min(vf_max(x, vf_set(EXP2_LOWEST)), vf_set(EXP2_HIGHEST));

	vf whole = vf_round(x);
	vf f = vf_sub(x, whole);
	vf p = vf_set(0.05517167f);

	p = vf_fma(p, f, vf_set(0.24261113f));
	p = vf_fma(p, f, vf_set(0.69326099f));
	p = vf_fma(p, f, vf_set(0.99992807f));
	return vf_scale(p, whole);
}

#define LOG2_E 1.4426950408889634f

/*
 * x Phi(x). The tail h = Phi(-|x|) = erfc(z) / 2 with z = |x| / sqrt 2 is exp(-z^2) times erfcx(z)
 * / 2, which is a tame polynomial in t = 1 / (1 + 0.4 z), here shifted to s in [-1, 1] for z in
 * 0..10.5 (relative error 3.3e-8). Multiplying the tail, never 1 + erf, keeps the relative accuracy
 * of negative x: 9e-7 down to -4, 8e-6 down to -12.
 */
static inline vf gelu_vf(vf x)
{
	vf a = vf_abs(x);
	vf t = vf_div(vf_set(1.0f), vf_fma(a, vf_set(0.282842712474619f), vf_set(1.0f)));
	vf s = vf_fma(t, vf_set(2.4761904761904763f), vf_set(-1.476190476190476f));
	vf p = vf_set(0.5f * 8.649327545343938e-06f);

	p = vf_fma(p, s, vf_set(0.5f * 5.610133388634006e-05f));
	p = vf_fma(p, s, vf_set(0.5f * -9.386937542933843e-05f));
	p = vf_fma(p, s, vf_set(0.5f * -0.0009680066780910607f));
	p = vf_fma(p, s, vf_set(0.5f * 0.00013379844269939184f));
	p = vf_fma(p, s, vf_set(0.5f * 0.017916259740352828f));
	p = vf_fma(p, s, vf_set(0.5f * 0.08262149298596008f));
	p = vf_fma(p, s, vf_set(0.5f * 0.2171937566004771f));
	p = vf_fma(p, s, vf_set(0.5f * 0.39058399448658865f));
	p = vf_fma(p, s, vf_set(0.5f * 0.2925478563964595f));

	vf xh = vf_mul(x, vf_mul(p, exp2_vf(vf_mul(vf_mul(x, x), vf_set(-0.5f * LOG2_E)))));

	return vf_if_negative(x, xh, vf_sub(x, xh));
}

/*
 * The same for a result that keeps 8 bits: x (1/2 + x q(x^2)), with x held within +-4.5 in the
 * brackets, where q makes them exactly 0 and 1. Absolute error 5.2e-5 of negative x, relative error
 * 2.1e-4 of positive x and of |x| < 1; what the next product sums is rounded by more.
 */
#define GELU_END 4.5f

static inline vf gelu_short_vf(vf x)
{
	vf low = vf_max(x, vf_set(-GELU_END)), b = vf_min(low, vf_set(GELU_END));
	vf u = vf_mul(b, b);
	vf q = vf_set(3.00000857e-11f);

	q = vf_fma(q, u, vf_set(-3.28391381e-09f));
	q = vf_fma(q, u, vf_set(1.5802577e-07f));
	q = vf_fma(q, u, vf_set(-4.43168574e-06f));
	q = vf_fma(q, u, vf_set(8.12097278e-05f));
	q = vf_fma(q, u, vf_set(-0.00103625341f));
	q = vf_fma(q, u, vf_set(0.00958065409f));
	q = vf_fma(q, u, vf_set(-0.0659772679f));
	q = vf_fma(q, u, vf_set(0.398708582f));
	return vf_mul(low, vf_fma(b, q, vf_set(0.5f)));
}

static inline vf colour_vf(vf y, bool sigmoid)
{
	if (!sigmoid)
		return vf_fma(y, vf_set(0.5f), vf_set(0.5f));

	vf e = exp2_vf(vf_mul(y, vf_set(-LOG2_E)));

	return vf_div(vf_set(1.0f), vf_add(vf_set(1.0f), e));
}

static void to_colour(float *y, size_t count, bool sigmoid)
{
	size_t i = 0;

	for (; i + VF_LANES <= count; i += VF_LANES)
		vf_store(y + i, colour_vf(vf_load(y + i), sigmoid));
	if (i < count)
		vf_store_part(y + i, colour_vf(vf_load_part(y + i, count - i), sigmoid), count - i);
}
