/* Primitives and things with their bounds. */
#include "build.h"

#define SIM_HUGE 1e9f

struct rotation sim_turned(float yaw)
{
	float c = cos_turns(yaw), s = sin_turns(yaw);
	struct rotation r = {{c, -s, 0, s, c, 0, 0, 0, 1}};

	return r;
}

static struct rotation compose(const struct rotation *a, const struct rotation *b)
{
	struct rotation r;

	for (int i = 0; i < 3; i++)
		for (int j = 0; j < 3; j++)
			r.m[3 * i + j] = a->m[3 * i] * b->m[j] + a->m[3 * i + 1] * b->m[3 + j] +
					 a->m[3 * i + 2] * b->m[6 + j];
	return r;
}

struct rotation sim_tumbled(float yaw, float pitch, float roll)
{
	float cp = cos_turns(pitch), sp = sin_turns(pitch), cr = cos_turns(roll),
	      sr = sin_turns(roll);
	struct rotation z = sim_turned(yaw), y = {{cp, 0, sp, 0, 1, 0, -sp, 0, cp}},
			x = {{1, 0, 0, 0, cr, -sr, 0, sr, cr}}, yx = compose(&y, &x);

	return compose(&z, &yx);
}

/* Half sides of the box that holds a primitive in its own frame. */
static struct v3 reach_of(const struct prim *p)
{
	struct v3 h = p->half;
	float r;

	switch (p->shape) {
	case SHAPE_CYLINDER:
	case SHAPE_CUP:
		return v3(h.x, h.x, h.z);
	case SHAPE_FRUSTUM:
		r = maxf(h.x, p->extra);
		return v3(r, r, h.z);
	case SHAPE_TORUS:
	case SHAPE_ARC:
		return v3(h.x + h.y, h.x + h.y, h.y);
	case SHAPE_PEBBLE:
		return v3_scale(h, 1 + 1.7f * p->extra);
	default:
		return h;
	}
}

/* Radius of the sphere about its centre that holds it, a little generous. */
static float bound_of(const struct prim *p)
{
	struct v3 h = p->reach;

	switch (p->shape) {
	case SHAPE_ELLIPSOID:
	case SHAPE_PEBBLE:
		return 1.002f * maxf(h.x, maxf(h.y, h.z));
	case SHAPE_CYLINDER:
	case SHAPE_CUP:
	case SHAPE_FRUSTUM:
		return 1.002f * sqrtf(h.x * h.x + h.z * h.z);
	case SHAPE_TORUS:
	case SHAPE_ARC:
		return 1.002f * h.x;
	default:
		return 1.002f * sqrtf(v3_dot(h, h));
	}
}

/* Box along the axes of the world, a little generous. */
static void world_box(const struct prim *p, struct v3 *lo, struct v3 *hi)
{
	struct v3 h = v3_scale(p->reach, 1.002f), e;
	const float *m = p->rot.m;

	e.x = absf(m[0]) * h.x + absf(m[1]) * h.y + absf(m[2]) * h.z;
	e.y = absf(m[3]) * h.x + absf(m[4]) * h.y + absf(m[5]) * h.z;
	e.z = absf(m[6]) * h.x + absf(m[7]) * h.y + absf(m[8]) * h.z;
	*lo = v3_sub(p->centre, e);
	*hi = v3_add(p->centre, e);
}

bool sim_thing_begin(struct builder *b, struct dio_sim_scene *scene, struct rng *rng,
		     struct v3 origin, struct rotation turn)
{
	b->scene = scene;
	b->rng = rng;
	b->origin = origin;
	b->turn = turn;
	b->first = scene->prim_count;
	return scene->thing_count < SIM_MAX_THINGS && scene->prim_count < SIM_MAX_PRIMS;
}

static void set_bit(uint64_t *words, uint32_t bit)
{
	words[bit / 64] |= 1ull << (bit % 64);
}

struct prim *sim_add_turned(struct builder *b, enum shape shape, struct v3 centre, struct v3 half,
			    float extra, struct rotation turn, const struct material *material)
{
	struct v3 lo, hi;
	struct prim *p;

	if (b->scene->prim_count >= SIM_MAX_PRIMS)
		return NULL;
	p = &b->scene->prim[b->scene->prim_count++];
	p->shape = shape;
	p->centre = v3_add(b->origin, rotate(&b->turn, centre));
	p->half = half;
	p->extra = extra;
	p->inv = v3(1 / half.x, 1 / half.y, 1 / half.z);
	p->turn_cos = cos_turns(extra);
	p->turn_sin = sin_turns(extra);
	p->solid = SOLID_BOX;
	p->cut = CUT_DIP;
	p->wave = 0;
	p->caution = 1;
	p->rot = compose(&b->turn, &turn);
	p->material = *material;
	p->reach = reach_of(p);
	p->round = shape == SHAPE_PEBBLE || shape == SHAPE_ROCK;
	p->bound = bound_of(p);
	world_box(p, &lo, &hi);
	b->scene->bound[b->scene->prim_count - 1].centre = p->centre;
	b->scene->bound[b->scene->prim_count - 1].radius = p->bound;
	b->scene->bound[b->scene->prim_count - 1].top = hi.z;
	if (material->clear > 0)
		set_bit(b->scene->clear, b->scene->prim_count - 1);
	return p;
}

/* Steepest slope of value noise: a step of 1 under the smoothing curve, on each axis. */
#define NOISE_SLOPE 1.5f

struct prim *sim_add_rock(struct builder *b, struct v3 centre, struct v3 half, float depth,
			  float wave, const struct material *material)
{
	struct prim *p = sim_add(b, SHAPE_ROCK, centre, half, depth, material);

	if (!p)
		return NULL;
	p->wave = wave;
	p->caution = 1 / (1 + depth * wave * NOISE_SLOPE);
	return p;
}

struct prim *sim_add_relief(struct builder *b, struct v3 centre, struct v3 half, float depth,
			    float hills, struct rotation turn, const struct material *material)
{
	struct prim *p = sim_add_turned(b, SHAPE_RELIEF, centre, half, depth, turn, material);
	float slope;

	if (!p)
		return NULL;
	p->wave = hills / maxf(half.x, half.y);
	slope = 2 * depth * half.z * p->wave * NOISE_SLOPE;
	p->caution = 1 / sqrtf(1 + slope * slope);
	return p;
}

struct prim *sim_add_carved(struct builder *b, enum solid solid, enum cut cut, struct v3 centre,
			    struct v3 half, float size, const struct material *material)
{
	struct prim *p = sim_add(b, SHAPE_CARVED, centre, half, size, material);

	if (!p)
		return NULL;
	p->solid = solid;
	p->cut = cut;
	return p;
}

struct prim *sim_add(struct builder *b, enum shape shape, struct v3 centre, struct v3 half,
		     float extra, const struct material *material)
{
	return sim_add_turned(b, shape, centre, half, extra, sim_turned(0), material);
}

void sim_thing_end(struct builder *b, bool casts_ambient)
{
	struct dio_sim_scene *s = b->scene;
	uint32_t count = s->prim_count - b->first, i = s->thing_count;
	struct v3 lo = v3(SIM_HUGE, SIM_HUGE, SIM_HUGE), hi = v3_scale(lo, -1), side;
	float ball;

	if (!count)
		return;
	for (uint32_t k = b->first; k < s->prim_count; k++) {
		struct v3 a, c;

		world_box(&s->prim[k], &a, &c);
		lo = v3(minf(lo.x, a.x), minf(lo.y, a.y), minf(lo.z, a.z));
		hi = v3(maxf(hi.x, c.x), maxf(hi.y, c.y), maxf(hi.z, c.z));
	}
	side = v3_sub(hi, lo);
	s->thing[i].first = b->first;
	s->thing[i].count = count;
	s->lo_x[i] = lo.x;
	s->lo_y[i] = lo.y;
	s->lo_z[i] = lo.z;
	s->hi_x[i] = hi.x;
	s->hi_y[i] = hi.y;
	s->hi_z[i] = hi.z;
	s->mid_x[i] = 0.5f * (lo.x + hi.x);
	s->mid_y[i] = 0.5f * (lo.y + hi.y);
	s->mid_z[i] = 0.5f * (lo.z + hi.z);
	s->radius[i] = 0.5f * sqrtf(v3_dot(side, side));
	/* A ball between the largest inside the box and the sphere around it. */
	ball = 0.25f * minf(side.x, minf(side.y, side.z)) + 0.3f * s->radius[i];
	s->occluder2[i] = casts_ambient ? ball * ball : 0;
	s->thing_count++;
}
