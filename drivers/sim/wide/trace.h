/* Several rays against the scene: see ../trace.h, whose every step this takes for each lane. */
#ifndef DIO_SIM_WIDE_TRACE_H
#define DIO_SIM_WIDE_TRACE_H

#include "../trace.h"
#include "texture.h"

/* Whose surface a ray met: a primitive's number, or one of these. */
enum {
	OWNER_WALL = SIM_MAX_PRIMS,
	OWNER_GROUND = OWNER_WALL + 6,
	OWNER_SKY,
};

struct wide_hit {
	wf t;
	struct w3 point, normal;
	struct wide_place place;
	wu owner, id;
	wm met; /* not the sky */
};

/* Primitives that some lanes may meet: which lanes, one bit each. */
struct candidates {
	uint32_t count;
	uint32_t lanes[SIM_MAX_PRIMS];
	uint8_t prim[SIM_MAX_PRIMS];
};

static inline void candidate_add(struct candidates *c, uint32_t prim, uint32_t lanes)
{
	c->prim[c->count] = (uint8_t)prim;
	c->lanes[c->count] = lanes;
	c->count += lanes != 0;
}

static inline void candidates_of_set(const struct prim_set *set, struct candidates *c)
{
	c->count = 0;
	for (uint32_t w = 0; w < SIM_SET_WORDS; w++)
		for (uint64_t left = set->word[w]; left; left &= left - 1)
			candidate_add(c, 64 * w + lowest_bit(left), ALL_LANES);
}

struct wide_beam {
	struct w3 from, along;
	wf limit, slope;
	wf floor_z;
};

/* Beams without breadth at their tips. */
static inline struct wide_beam wide_beam_of(struct w3 from, struct w3 along, wf limit, wf slope)
{
	struct wide_beam b;

	b.from = from;
	b.along = along;
	b.limit = limit;
	b.slope = slope;
	b.floor_z = wf_choose(wf_gt(along.z, slope), from.z, wf_of(-SIM_FAR));
	return b;
}

static inline wm wide_beam_meets(const struct wide_beam *b, struct v3 centre, float radius)
{
	struct w3 c = w3_sub(w3_of(centre), b->from);
	wf along = wf_clamp(w3_dot(c, b->along), wf_of(0), b->limit), wide = wf_of(radius);
	wf reach = wide + b->slope * (along + wide);

	c = w3_mad(c, b->along, -along);
	return wf_le(w3_dot(c, c), reach * reach);
}

static inline wm wide_beam_meets_bound(const struct wide_beam *b, const struct bound *p)
{
	return wm_and(wf_ge(wf_of(p->top), b->floor_z), wide_beam_meets(b, p->centre, p->radius));
}

/* All primitives that the beams of `lanes` may meet. */
static void add_of_beam(const struct dio_sim_scene *s, const struct wide_beam *b, wm lanes,
			struct candidates *c)
{
	for (uint32_t i = 0; i < s->thing_count; i++) {
		const struct thing *t = &s->thing[i];
		struct v3 mid = v3(s->mid_x[i], s->mid_y[i], s->mid_z[i]);
		wm met = wm_and(lanes, wide_beam_meets(b, mid, s->radius[i]));

		if (!wm_any(met))
			continue;
		for (uint32_t k = t->first; k < t->first + t->count; k++)
			candidate_add(c, k,
				      wm_bits(wm_and(met, wide_beam_meets_bound(b, &s->bound[k]))));
	}
}

/* Those of a set that the beams of `lanes` may meet; `straight` lanes take all of it. */
static void add_within_beam(const struct dio_sim_scene *s, const struct prim_set *of,
			    const struct wide_beam *b, wm lanes, wm straight, struct candidates *c)
{
	for (uint32_t w = 0; w < SIM_SET_WORDS; w++) {
		for (uint64_t left = of->word[w]; left; left &= left - 1) {
			uint32_t k = 64 * w + lowest_bit(left);
			wm met = wm_or(straight, wide_beam_meets_bound(b, &s->bound[k]));

			candidate_add(c, k, wm_bits(wm_and(lanes, met)));
		}
	}
}

static inline bool shades_itself(const struct prim *p)
{
	switch (p->shape) {
	case SHAPE_BOX:
	case SHAPE_ELLIPSOID:
	case SHAPE_CYLINDER:
	case SHAPE_FRUSTUM:
	case SHAPE_ROUND_BOX:
	case SHAPE_PEBBLE:
	case SHAPE_ROCK:
		return false;
	default:
		return true;
	}
}

/* No candidate is left that lies on the surface a ray leaves and cannot be met from there. */
static void remove_own(const struct dio_sim_scene *s, wu owner, struct candidates *c)
{
	uint32_t count = c->count;

	c->count = 0;
	for (uint32_t i = 0; i < count; i++) {
		uint32_t k = c->prim[i], lanes = c->lanes[i];

		if (!shades_itself(&s->prim[k]))
			lanes &= ~wm_bits(wu_eq(owner, wu_of(k)));
		candidate_add(c, k, lanes);
	}
}

static inline bool lets_light_through(const struct dio_sim_scene *s, uint32_t prim)
{
	return s->clear[prim / 64] >> (prim % 64) & 1;
}

static void remove_clear(const struct dio_sim_scene *s, struct candidates *c)
{
	uint32_t count = c->count;

	c->count = 0;
	for (uint32_t i = 0; i < count; i++)
		candidate_add(c, c->prim[i], lets_light_through(s, c->prim[i]) ? 0 : c->lanes[i]);
}

static inline wm wide_meets_bound(const struct wide_ray *r, const struct bound *p, wf limit)
{
	struct w3 c = w3_sub(w3_of(p->centre), r->from);
	wf along = w3_dot(c, r->along), radius = wf_of(p->radius);
	wf apart = w3_dot(c, c) - along * along;

	return wm_and(wf_lt(apart, radius * radius),
		      wm_and(wf_gt(along, -radius), wf_lt(along - radius, limit)));
}

static inline struct w2 wide_prim_sheet(const struct prim *p, struct w3 q, struct w3 n)
{
	struct w3 a = w3(wf_abs(n.x), wf_abs(n.y), wf_abs(n.z));
	wf zero = wf_of(0), one = wf_of(1), minus = wf_of(-1), turn, ring;
	wm top, side;

	switch (p->shape) {
	case SHAPE_CYLINDER:
	case SHAPE_FRUSTUM:
	case SHAPE_CUP:
		top = wf_gt(a.z, wf_of(0.9f));
		turn = wf_atan2_turns(q.y, q.x) * wf_of(2) * wf_of(SIM_PI) * wf_of(p->half.x);
		return w2(wf_choose(top, q.x, turn), wf_choose(top, q.y, -q.z));
	case SHAPE_ELLIPSOID:
	case SHAPE_PEBBLE:
	case SHAPE_ROCK:
		turn = wf_atan2_turns(q.y, q.x) * wf_of(2) * wf_of(SIM_PI) * wf_of(p->half.x);
		return w2(turn, -q.z * wf_of(1.3f));
	case SHAPE_TORUS:
	case SHAPE_ARC:
		ring = wf_sqrt(q.x * q.x + q.y * q.y) - wf_of(p->half.x);
		turn = wf_atan2_turns(q.y, q.x) * wf_of(2) * wf_of(SIM_PI) * wf_of(p->half.x);
		return w2(turn,
			  wf_atan2_turns(q.z, ring) * wf_of(2) * wf_of(SIM_PI) * wf_of(p->half.y));
	default:
		top = wm_and(wf_ge(a.z, a.x), wf_ge(a.z, a.y));
		side = wf_ge(a.x, a.y);
		return w2(wf_choose(top, q.x,
				    wf_choose(side, q.y * wf_choose(wf_gt(n.x, zero), one, minus),
					      q.x * wf_choose(wf_gt(n.y, zero), minus, one))),
			  wf_choose(top, q.y * wf_choose(wf_gt(n.z, zero), minus, one), -q.z));
	}
}

/* Lanes of `m` that met primitive k. */
static void wide_finish_prim(const struct prim *p, uint32_t k, const struct wide_ray *r,
			     const struct wide_near *near, wm m, struct wide_hit *hit)
{
	struct w3 q = w3_rotate_back(&p->rot, w3_sub(hit->point, w3_of(p->centre)));
	struct w3 n = wide_prim_normal(p, near->part, q, w3_rotate_back(&p->rot, r->along));
	struct w2 sheet = wide_prim_sheet(p, q, n);
	wu id = wu_of(SIM_ID_PRIM + 4 * k);

	hit->normal = w3_choose(m, w3_rotate(&p->rot, n), hit->normal);
	hit->place.solid = w3_choose(m, q, hit->place.solid);
	hit->place.sheet.x = wf_choose(m, sheet.x, hit->place.sheet.x);
	hit->place.sheet.y = wf_choose(m, sheet.y, hit->place.sheet.y);
	if (p->shape == SHAPE_BOX)
		id += wu_of(1) + near->part;
	hit->id = wu_choose(m, id, hit->id);
}

static void wide_hit_walls(const struct dio_sim_scene *s, const struct wide_ray *r,
			   struct wide_near *near, struct wide_hit *hit)
{
	const wf from[3] = {r->from.x, r->from.y, r->from.z};
	const wf along[3] = {r->along.x, r->along.y, r->along.z};
	const float lo[3] = {s->room_lo.x, s->room_lo.y, s->room_lo.z};
	const float hi[3] = {s->room_hi.x, s->room_hi.y, s->room_hi.z};
	wf best = wf_of(SIM_FAR), zero = wf_of(0), tiny = wf_of(1e-12f);
	wu wall = wu_of(4);
	wm met;

	for (uint32_t i = 0; i < 3; i++) {
		wf d = wf_choose(wf_lt(wf_abs(along[i]), tiny), tiny, along[i]);
		wf end = wf_choose(wf_gt(d, zero), wf_of(hi[i]), wf_of(lo[i]));
		wf t = (end - from[i]) / d;

		met = wf_lt(t, best);
		best = wf_choose(met, t, best);
		wall = wu_choose(met,
				 wu_choose(wf_gt(along[i], zero), wu_of(2 * i + 1), wu_of(2 * i)),
				 wall);
	}
	met = wm_not(wm_or(wf_le(best, zero), wf_ge(best, near->t)));
	near->t = wf_choose(met, best, near->t);
	hit->owner = wu_choose(met, wall + wu_of(OWNER_WALL), hit->owner);
}

static void wide_hit_ground(const struct dio_sim_scene *s, const struct wide_ray *r,
			    struct wide_near *near, struct wide_hit *hit)
{
	wf t = (wf_of(s->ground_z) - r->from.z) / r->along.z;
	wm met = wm_not(wf_gt(r->along.z, wf_of(-1e-6f)));

	met = wm_less(wm_less(met, wf_le(t, wf_of(0))), wf_ge(t, near->t));
	near->t = wf_choose(met, t, near->t);
	hit->owner = wu_choose(met, wu_of(OWNER_GROUND), hit->owner);
}

/* Normal, place and number of lanes of `m` that met a wall. */
static void wide_finish_wall(const struct wide_ray *r, uint32_t wall, wm m, struct wide_hit *hit)
{
	const wf *p = &hit->point.x;
	uint32_t axis = wall / 2;
	wf along = axis == 0 ? r->along.x : axis == 1 ? r->along.y : r->along.z;
	wf inward = wf_choose(wf_gt(along, wf_of(0)), wf_of(-1), wf_of(1)), zero = wf_of(0);
	struct w3 n =
		w3(axis == 0 ? inward : zero, axis == 1 ? inward : zero, axis == 2 ? inward : zero);

	hit->normal = w3_choose(m, n, hit->normal);
	hit->place.solid = w3_choose(m, hit->point, hit->place.solid);
	hit->place.sheet.x = wf_choose(m, axis == 0 ? p[1] : p[0], hit->place.sheet.x);
	hit->place.sheet.y = wf_choose(m, axis == 2 ? p[1] : -p[2], hit->place.sheet.y);
	hit->id = wu_choose(m, wu_of(SIM_ID_WALL + wall), hit->id);
}

static void wide_finish_ground(wm m, struct wide_hit *hit)
{
	wf zero = wf_of(0);

	hit->normal = w3_choose(m, w3(zero, zero, wf_of(1)), hit->normal);
	hit->place.solid = w3_choose(m, hit->point, hit->place.solid);
	hit->place.sheet.x = wf_choose(m, hit->point.x, hit->place.sheet.x);
	hit->place.sheet.y = wf_choose(m, -hit->point.y, hit->place.sheet.y);
	hit->id = wu_choose(m, wu_of(SIM_ID_GROUND), hit->id);
}

/* The first of `left` lanes has an owner: take out all lanes that share it. */
static inline uint32_t next_owner(wu owner, uint32_t *left, wm *sharing)
{
	uint32_t owners[LANES], k;

	wu_store(owners, owner);
	k = owners[lowest_bit(*left)];
	*sharing = wm_and(wm_of_bits(*left), wu_eq(owner, wu_of(k)));
	*left &= ~wm_bits(*sharing);
	return k;
}

/* Nearest surfaces among the candidates and the surroundings, for `lanes`. */
static void wide_trace_nearest(const struct dio_sim_scene *s, const struct wide_ray *r,
			       const struct candidates *c, wm lanes, struct wide_hit *hit)
{
	struct wide_near near = {wf_of(SIM_FAR), wu_of(PART_TOP)};
	struct w3 zero = w3_of(v3(0, 0, 0));

	hit->owner = wu_of(OWNER_SKY);
	if (s->surround == SURROUND_ROOM)
		wide_hit_walls(s, r, &near, hit);
	if (s->has_ground)
		wide_hit_ground(s, r, &near, hit);
	for (uint32_t i = 0; i < c->count; i++) {
		uint32_t k = c->prim[i];
		wm m = wm_and(wm_of_bits(c->lanes[i]), lanes);

		m = wm_and(m, wide_meets_bound(r, &s->bound[k], near.t));
		if (!wm_any(m))
			continue;
		m = wide_hit_prim(&s->prim[k], r, m, &near);
		hit->owner = wu_choose(m, wu_of(k), hit->owner);
	}
	hit->t = near.t;
	hit->point = wide_at(r, near.t);
	hit->normal = hit->place.solid = zero;
	hit->place.sheet = w2(zero.x, zero.x);
	hit->id = wu_of(SIM_ID_SKY);
	hit->met = wm_less(lanes, wu_eq(hit->owner, wu_of(OWNER_SKY)));
	for (uint32_t left = wm_bits(hit->met); left;) {
		uint32_t k = next_owner(hit->owner, &left, &lanes);

		if (k < SIM_MAX_PRIMS)
			wide_finish_prim(&s->prim[k], k, r, &near, lanes, hit);
		else if (k < OWNER_GROUND)
			wide_finish_wall(r, k - OWNER_WALL, lanes, hit);
		else
			wide_finish_ground(lanes, hit);
	}
}

/* Lanes that meet any of the candidates before `limit`. */
static wm wide_trace_blocked(const struct dio_sim_scene *s, const struct wide_ray *r,
			     const struct candidates *c, wm lanes, wf limit)
{
	wm blocked = wm_none();

	for (uint32_t i = 0; i < c->count && wm_any(lanes); i++) {
		const struct bound *bound = &s->bound[c->prim[i]];
		struct wide_near near = {limit, wu_of(0)};
		wm m = wm_and(lanes, wm_of_bits(c->lanes[i]));

		if (!wm_any(m))
			continue;
		m = wm_and(m, wide_meets_bound(r, bound, limit));
		if (!wm_any(m))
			continue;
		m = wide_hit_prim(&s->prim[c->prim[i]], r, m, &near);
		blocked = wm_or(blocked, m);
		lanes = wm_less(lanes, m);
	}
	return blocked;
}

#endif
