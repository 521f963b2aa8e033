/*
 * Template: GELU by looking up, for AVX-512 beside AMX. Included before number_bf16.inc.h.
 *
 * x Phi(x) = max(x, 0) - a Phi(-a), a = |x|. Phi(-a) is one of 32 parabolas, of which number i
 * reaches half a seventh to both sides of i / 7: fits of the least maximum error (of a Phi(-a)
 * but for the first), by Lawson's iteration in double. From 4.5 on a counts as 4.5. Absolute error
 * 1.6e-5, relative error 1.5e-5 of |x| < 1.
 *
 * While tiles multiply, products and sums of floats find one port of the processor's alone, and
 * shuffles another: this takes six of the former, where gelu_short_vf() takes fourteen.
 */
#define GELU_PARABOLAS 32
#define GELU_END_PLACE 4.4999f /* rounds to the last parabola */

static const float gelu_constant[GELU_PARABOLAS] = {
	0.500000775f,  0.500154197f,   0.501368701f,  0.504312038f,   0.508966744f,  0.514504433f,
	0.519359648f,  0.521507442f,   0.518712342f,  0.50917536f,    0.491636515f,  0.465718597f,
	0.431964755f,  0.391741365f,   0.34701699f,   0.300071239f,   0.253193736f,  0.208424732f,
	0.167371973f,  0.131118f,      0.100212842f,  0.0747340769f,  0.0543890819f, 0.0386342071f,
	0.0267899446f, 0.0181377791f,  0.0119917011f, 0.00774340238f, 0.0048843259f, 0.00300998008f,
	0.001812467f,  0.00106655224f,
};

static const float gelu_slope[GELU_PARABOLAS] = {
	-0.399132788f,    -0.402691871f,    -0.413978368f,   -0.430492938f,   -0.449189633f,
	-0.466522336f,    -0.478996813f,    -0.483733594f,   -0.478615761f,   -0.462992638f,
	-0.437208623f,    -0.402691156f,    -0.361617804f,   -0.3165676f,     -0.270172685f,
	-0.224822015f,    -0.182451904f,    -0.144435078f,   -0.111562766f,   -0.0840999335f,
	-0.0618879683f,   -0.0444683246f,   -0.0312049389f,  -0.0213900562f,  -0.0143251307f,
	-0.00937474426f,  -0.00599604566f,  -0.00374869653f, -0.00229121489f, -0.00136923278f,
	-0.000800140551f, -0.000457278249f,
};

static const float gelu_square[GELU_PARABOLAS] = {
	0.00711659156f,  0.0281619579f,   0.054627616f,    0.0778698251f,   0.0966762677f,
	0.110252418f,    0.118269861f,    0.120881446f,    0.118538789f,    0.112138823f,
	0.102660395f,    0.0911656767f,   0.0786686912f,   0.0660529584f,   0.0540196113f,
	0.0430660918f,   0.0334912352f,   0.0254198723f,   0.0188389383f,   0.0136377662f,
	0.00964654051f,  0.00666897465f,  0.00450720033f,  0.00297853467f,  0.00192496541f,
	0.00121684361f,  0.000752484193f, 0.000455263973f, 0.000269512704f, 0.000156130249f,
	8.85165355e-05f, 4.91162355e-05f,
};

static inline vf gelu_look_up(const float table[GELU_PARABOLAS], __m512i at)
{
	return _mm512_permutex2var_ps(vf_load(table), at, vf_load(table + GELU_PARABOLAS / 2));
}

static inline vf gelu_lookup_vf(vf x)
{
	vf a = vf_min(vf_abs(x), vf_set(GELU_END_PLACE));
	/* 2^23 more: the nearest whole number is in the lowest bits. */
	__m512i at = _mm512_castps_si512(vf_fma(a, vf_set(7.0f), vf_set(8388608.0f)));
	vf q = vf_fma(gelu_look_up(gelu_square, at), a, gelu_look_up(gelu_slope, at));

	q = vf_fma(q, a, gelu_look_up(gelu_constant, at));
	return _mm512_fnmadd_ps(a, q, vf_max(x, vf_set(0.0f)));
}
