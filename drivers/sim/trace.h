/* Ray against scene. */
#ifndef DIO_SIM_TRACE_H
#define DIO_SIM_TRACE_H

#include "shape.h"
#include "texture.h"

/* What a ray met, enough to shade it. */
struct scene_hit {
	float t;
	struct v3 point, normal;
	const struct material *material; /* NULL: the sky */
	struct place place;
	uint32_t id; /* tells surfaces apart */
};

enum {
	SIM_ID_SKY = 0,
	SIM_ID_GROUND = 1,
	SIM_ID_WALL = 2,
	SIM_ID_PRIM = 8,
};

/* Some of the scene's primitives, one bit each. */
struct prim_set {
	uint64_t word[SIM_SET_WORDS];
};

DIO_SIM_FN struct prim_set set_of_none(void)
{
	struct prim_set set;

	for (int i = 0; i < SIM_SET_WORDS; i++)
		set.word[i] = 0;
	return set;
}

DIO_SIM_FN void set_add(struct prim_set *set, uint32_t prim)
{
	set->word[prim / 64] |= 1ull << (prim % 64);
}

DIO_SIM_FN void set_remove(struct prim_set *set, uint32_t prim)
{
	set->word[prim / 64] &= ~(1ull << (prim % 64));
}

DIO_SIM_FN bool set_is_empty(const struct prim_set *set)
{
	uint64_t any = 0;

	for (int i = 0; i < SIM_SET_WORDS; i++)
		any |= set->word[i];
	return !any;
}

DIO_SIM_FN uint32_t lowest_bit(uint64_t word)
{
#ifdef __CUDA_ARCH__
	return (uint32_t)__ffsll((long long)word) - 1;
#else
	return (uint32_t)__builtin_ctzll(word);
#endif
}

/* A ray with some breadth: `breadth` at its tip, growing by `slope` along its way. */
struct beam {
	struct v3 from, along;
	float limit, breadth, slope;
	float floor_z; /* it meets nothing that ends below: see beam_of() */
};

DIO_SIM_FN struct beam beam_of(struct v3 from, struct v3 along, float limit, float breadth,
			       float slope)
{
	struct beam b;

	b.from = from;
	b.along = along;
	b.limit = limit;
	b.breadth = breadth;
	b.slope = slope;
	/* A beam that only rises leaves all that lies below its tip, most often the table. */
	b.floor_z = along.z > slope ? from.z - breadth : -SIM_FAR;
	return b;
}

/* May the beam meet a sphere? Never says no wrongly. */
DIO_SIM_FN bool beam_meets(const struct beam *b, struct v3 centre, float radius)
{
	struct v3 c = v3_sub(centre, b->from);
	float along = clampf(v3_dot(c, b->along), 0, b->limit);
	float reach = radius + b->breadth + b->slope * (along + radius);

	c = v3_mad(c, b->along, -along);
	return v3_dot(c, c) <= reach * reach;
}

DIO_SIM_FN bool beam_meets_bound(const struct beam *b, const struct bound *p)
{
	return p->top >= b->floor_z && beam_meets(b, p->centre, p->radius);
}

/* All primitives that the beam may meet. */
DIO_SIM_FN struct prim_set set_of_beam(const struct dio_sim_scene *s, const struct beam *b)
{
	struct prim_set set = set_of_none();
	uint8_t met[SIM_MAX_THINGS];

	for (uint32_t i = 0; i < s->thing_count; i++) /* without branches: vectors */
		met[i] = beam_meets(b, v3(s->mid_x[i], s->mid_y[i], s->mid_z[i]), s->radius[i]);
	for (uint32_t i = 0; i < s->thing_count; i++) {
		const struct thing *t = &s->thing[i];

		if (!met[i])
			continue;
		for (uint32_t k = t->first; k < t->first + t->count; k++)
			if (beam_meets_bound(b, &s->bound[k]))
				set_add(&set, k);
	}
	return set;
}

/* Those of a set that the beam may meet. */
DIO_SIM_FN struct prim_set set_within_beam(const struct dio_sim_scene *s, const struct prim_set *of,
					   const struct beam *b)
{
	struct prim_set set = set_of_none();

	for (uint32_t w = 0; w < SIM_SET_WORDS; w++) {
		for (uint64_t left = of->word[w]; left; left &= left - 1) {
			uint32_t k = lowest_bit(left);

			if (beam_meets_bound(b, &s->bound[64 * w + k]))
				set.word[w] |= 1ull << k;
		}
	}
	return set;
}

DIO_SIM_FN struct prim_set set_of_clear(const struct dio_sim_scene *s)
{
	struct prim_set set;

	for (int i = 0; i < SIM_SET_WORDS; i++)
		set.word[i] = s->clear[i];
	return set;
}

DIO_SIM_FN void set_remove_clear(const struct dio_sim_scene *s, struct prim_set *set)
{
	for (int i = 0; i < SIM_SET_WORDS; i++)
		set->word[i] &= ~s->clear[i];
}

/* Take out the primitive that a surface belongs to where no ray that leaves the surface meets it
 * again: nothing round shades itself. */
DIO_SIM_FN void set_remove_own(const struct dio_sim_scene *s, uint32_t surface,
			       struct prim_set *set)
{
	uint32_t prim = (surface - SIM_ID_PRIM) / 4;

	if (surface < SIM_ID_PRIM)
		return;
	switch (s->prim[prim].shape) {
	case SHAPE_BOX:
	case SHAPE_ELLIPSOID:
	case SHAPE_CYLINDER:
	case SHAPE_FRUSTUM:
	case SHAPE_ROUND_BOX:
	case SHAPE_PEBBLE: /* nearly */
	case SHAPE_ROCK:
		set_remove(set, prim);
		break;
	default:
		break;
	}
}

DIO_SIM_FN bool ray_meets_bound(const struct ray *r, const struct bound *p, float limit)
{
	struct v3 c = v3_sub(p->centre, r->from);
	float along = v3_dot(c, r->along);

	return along > -p->radius && along - p->radius < limit &&
	       v3_dot(c, c) - along * along < p->radius * p->radius;
}

/* Unrolled coordinates in metres for textures that lie on a sheet. */
DIO_SIM_FN struct v2 prim_sheet(const struct prim *p, struct v3 q, struct v3 n)
{
	struct v3 a = v3(absf(n.x), absf(n.y), absf(n.z));

	switch (p->shape) {
	case SHAPE_CYLINDER:
	case SHAPE_FRUSTUM:
	case SHAPE_CUP:
		if (a.z > 0.9f)
			return v2(q.x, q.y);
		return v2(atan2_turns(q.y, q.x) * 2 * SIM_PI * p->half.x, -q.z);
	case SHAPE_ELLIPSOID:
	case SHAPE_PEBBLE:
	case SHAPE_ROCK:
		return v2(atan2_turns(q.y, q.x) * 2 * SIM_PI * p->half.x, -q.z * 1.3f);
	case SHAPE_TORUS:
	case SHAPE_ARC: {
		float ring = sqrtf(q.x * q.x + q.y * q.y) - p->half.x;

		return v2(atan2_turns(q.y, q.x) * 2 * SIM_PI * p->half.x,
			  atan2_turns(q.z, ring) * 2 * SIM_PI * p->half.y);
	}
	default:
		if (a.z >= a.x && a.z >= a.y)
			return v2(q.x, q.y * (n.z > 0 ? -1 : 1));
		if (a.x >= a.y)
			return v2(q.y * (n.x > 0 ? 1 : -1), -q.z);
		return v2(q.x * (n.y > 0 ? -1 : 1), -q.z);
	}
}

DIO_SIM_FN void finish_prim_hit(const struct prim *p, uint32_t index, const struct ray *r,
				const struct surface_hit *h, struct scene_hit *hit)
{
	struct v3 q, n;

	hit->point = ray_at(r, h->t);
	q = rotate_back(&p->rot, v3_sub(hit->point, p->centre));
	n = prim_normal(p, h->part, q, rotate_back(&p->rot, r->along));
	hit->t = h->t;
	hit->normal = rotate(&p->rot, n);
	hit->material = &p->material;
	hit->place.solid = q;
	hit->place.sheet = prim_sheet(p, q, n);
	/* Faces of a box count as surfaces of their own. */
	hit->id = SIM_ID_PRIM + 4 * index;
	if (p->shape == SHAPE_BOX)
		hit->id += 1 + (uint32_t)h->part;
}

DIO_SIM_FN void hit_walls(const struct dio_sim_scene *s, const struct ray *r, struct scene_hit *hit)
{
	const float from[3] = {r->from.x, r->from.y, r->from.z};
	const float along[3] = {r->along.x, r->along.y, r->along.z};
	const float lo[3] = {s->room_lo.x, s->room_lo.y, s->room_lo.z};
	const float hi[3] = {s->room_hi.x, s->room_hi.y, s->room_hi.z};
	float best = SIM_FAR, inward;
	int axis = 2;

	for (int i = 0; i < 3; i++) {
		float d = absf(along[i]) < 1e-12f ? 1e-12f : along[i];
		float t = ((d > 0 ? hi[i] : lo[i]) - from[i]) / d;

		if (t < best) {
			best = t;
			axis = i;
		}
	}
	if (best <= 0 || best >= hit->t)
		return;
	hit->t = best;
	hit->point = ray_at(r, best);
	inward = along[axis] > 0 ? -1 : 1;
	hit->normal = v3(axis == 0 ? inward : 0, axis == 1 ? inward : 0, axis == 2 ? inward : 0);
	hit->material = &s->wall[2 * axis + (along[axis] > 0)];
	hit->place.solid = hit->point;
	hit->place.sheet = axis == 2   ? v2(hit->point.x, hit->point.y)
			   : axis == 1 ? v2(hit->point.x, -hit->point.z)
				       : v2(hit->point.y, -hit->point.z);
	hit->id = SIM_ID_WALL + (uint32_t)(2 * axis + (along[axis] > 0));
}

DIO_SIM_FN void hit_ground(const struct dio_sim_scene *s, const struct ray *r,
			   struct scene_hit *hit)
{
	float t;

	if (!s->has_ground || r->along.z > -1e-6f)
		return;
	t = (s->ground_z - r->from.z) / r->along.z;
	if (t <= 0 || t >= hit->t)
		return;
	hit->t = t;
	hit->point = ray_at(r, t);
	hit->normal = v3(0, 0, 1);
	hit->material = &s->ground;
	hit->place.solid = hit->point;
	hit->place.sheet = v2(hit->point.x, -hit->point.y);
	hit->id = SIM_ID_GROUND;
}

/* Nearest surface among the primitives of a set and the surroundings. */
DIO_SIM_FN void trace_nearest(const struct dio_sim_scene *s, const struct ray *r,
			      const struct prim_set *set, struct scene_hit *hit)
{
	struct surface_hit h;
	uint32_t best = SIM_MAX_PRIMS;

	hit->t = SIM_FAR;
	hit->material = NULL;
	hit->id = SIM_ID_SKY;
	if (s->surround == SURROUND_ROOM)
		hit_walls(s, r, hit);
	hit_ground(s, r, hit);
	h.t = hit->t;
	h.part = PART_TOP;
	for (uint32_t w = 0; w < SIM_SET_WORDS; w++) {
		for (uint64_t left = set->word[w]; left; left &= left - 1) {
			uint32_t k = 64 * w + lowest_bit(left);

			if (ray_meets_bound(r, &s->bound[k], h.t) && hit_prim(&s->prim[k], r, &h))
				best = k;
		}
	}
	if (best < SIM_MAX_PRIMS)
		finish_prim_hit(&s->prim[best], best, r, &h, hit);
}

/* Is anything of a set in the way before `limit`? */
DIO_SIM_FN bool trace_blocked(const struct dio_sim_scene *s, const struct ray *r,
			      const struct prim_set *set, float limit)
{
	struct surface_hit h;

	h.t = limit;
	for (uint32_t w = 0; w < SIM_SET_WORDS; w++) {
		for (uint64_t left = set->word[w]; left; left &= left - 1) {
			uint32_t k = 64 * w + lowest_bit(left);

			if (ray_meets_bound(r, &s->bound[k], limit) && hit_prim(&s->prim[k], r, &h))
				return true;
		}
	}
	return false;
}

#endif
