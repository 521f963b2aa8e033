/* Template: numbers are float32. Included once by each f32_<tier>.c, after math.inc.h. */

typedef float number;

#define NUMBER_IS_FLOAT true

/* Rows of a weight panel. */
#define PANEL_DEPTH(depth) (depth)

static inline void num_store(number *p, vf a)
{
	vf_store(p, a);
}

static inline void num_store_part(number *p, vf a, size_t n)
{
	vf_store_part(p, a, n);
}

/* `count` numbers as floats: where they are, or in `room`. */
static inline const float *num_floats(const number *p, size_t count, float *room)
{
	(void)count;
	(void)room;
	return p;
}

/* What is left of a float once it has been a number. */
static inline vf num_round(vf a)
{
	return a;
}

static inline vf num_exp2(vf x)
{
	return exp2_vf(x);
}

static inline vf num_gelu(vf x)
{
	return gelu_vf(x);
}
