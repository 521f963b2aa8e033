/*
 * Template: numbers are bfloat16. Included once by each bf16_<tier>.c, after math.inc.h. What is
 * rounded to 8 bits next needs no better exponential than 2^-13. A tier with a GELU of its own
 * defines BF16_GELU.
 */
#ifndef BF16_GELU
#define BF16_GELU gelu_short_vf
#endif

typedef dvsm_bf16 number;

#define NUMBER_IS_FLOAT false

/* Rows of a weight panel. */
#define PANEL_DEPTH(depth) dvsm_bf16_depth(depth)

static inline void num_store(number *p, vf a)
{
	vf_store_bf16(p, a);
}

static inline void num_store_part(number *p, vf a, size_t n)
{
	number lanes[VF_LANES];

	vf_store_bf16(lanes, a);
	memcpy(p, lanes, n * sizeof(*p));
}

/* `count` numbers as floats, in `room`. */
static inline const float *num_floats(const number *p, size_t count, float *room)
{
	size_t i = 0;

	for (; i + VF_LANES <= count; i += VF_LANES)
		vf_store(room + i, vf_load_bf16(p + i));
	for (; i < count; i++)
		room[i] = dvsm_bf16_widen(p[i]);
	return room;
}

/* What is left of a float once it has been a number. */
static inline vf num_round(vf a)
{
	return vf_round_bf16(a);
}

static inline vf num_exp2(vf x)
{
	return exp2_short_vf(x);
}

static inline vf num_gelu(vf x)
{
	return BF16_GELU(x);
}
