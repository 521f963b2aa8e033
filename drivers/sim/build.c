/* Primitives and things with their bounds. */
#include "build.h"

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

/* Radius of the sphere about its centre that holds a primitive, a little generous. */
static float bound_of(const struct prim *p)
{
	struct v3 h = p->half;
	float r;

	switch (p->shape) {
	case SHAPE_ELLIPSOID:
		r = maxf(h.x, maxf(h.y, h.z));
		break;
	case SHAPE_CYLINDER:
	case SHAPE_CUP:
		r = sqrtf(h.x * h.x + h.z * h.z);
		break;
	case SHAPE_FRUSTUM:
		r = maxf(h.x, p->extra);
		r = sqrtf(r * r + h.z * h.z);
		break;
	case SHAPE_TORUS:
	case SHAPE_ARC:
		r = h.x + h.y;
		break;
	case SHAPE_PEBBLE:
		r = maxf(h.x, maxf(h.y, h.z)) * (1 + 1.7f * p->extra);
		break;
	default:
		r = sqrtf(v3_dot(h, h));
		break;
	}
	return 1.002f * r;
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

struct prim *sim_add_turned(struct builder *b, enum shape shape, struct v3 centre, struct v3 half,
			    float extra, struct rotation turn, const struct material *material)
{
	struct prim *p;

	if (b->scene->prim_count >= SIM_MAX_PRIMS)
		return NULL;
	p = &b->scene->prim[b->scene->prim_count++];
	p->shape = shape;
	p->centre = v3_add(b->origin, rotate(&b->turn, centre));
	p->half = half;
	p->extra = extra;
	p->rot = compose(&b->turn, &turn);
	p->material = *material;
	p->bound = bound_of(p);
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
	struct v3 mid = v3(0, 0, 0);
	float weight = 0, radius = 0, volume = 0;

	if (!count)
		return;
	for (uint32_t k = b->first; k < s->prim_count; k++) {
		mid = v3_mad(mid, s->prim[k].centre, s->prim[k].bound);
		weight += s->prim[k].bound;
	}
	mid = v3_scale(mid, 1 / weight);
	for (uint32_t k = b->first; k < s->prim_count; k++) {
		struct v3 d = v3_sub(s->prim[k].centre, mid);

		radius = maxf(radius, sqrtf(v3_dot(d, d)) + s->prim[k].bound);
		volume = maxf(volume, s->prim[k].bound);
	}
	s->thing[i].first = b->first;
	s->thing[i].count = count;
	s->bound_x[i] = mid.x;
	s->bound_y[i] = mid.y;
	s->bound_z[i] = mid.z;
	s->bound_r[i] = radius;
	/* Shapes fill roughly this much of their bounding sphere. */
	s->occluder_r[i] = casts_ambient ? 0.62f * mixf(radius, volume, 0.5f) : 0;
	s->thing_count++;
}
