/* Several rays against one shape: see ../shape.h, whose every step this takes for each lane. */
#ifndef DIO_SIM_WIDE_SHAPE_H
#define DIO_SIM_WIDE_SHAPE_H

#include "../shape.h"
#include "lanes.h"

struct wide_ray {
	struct w3 from, along;
	float spread;
};

/* The nearest surface so far: how far, which part of a shape. */
struct wide_near {
	wf t;
	wu part;
};

static inline struct w3 wide_at(const struct wide_ray *r, wf t)
{
	return w3_mad(r->from, r->along, t);
}

static inline wf wide_value_noise(struct w3 p, uint32_t seed)
{
	const uint32_t nx = 0x9e3779b1u, ny = 0x85ebca77u, nz = 0xc2b2ae3du;
	wu x = wf_floor_int(p.x), y = wf_floor_int(p.y), z = wf_floor_int(p.z);
	wf fx = p.x - wf_from(x), fy = p.y - wf_from(y), fz = p.z - wf_from(z), v[8];
	wu hx = x * wu_of(nx), hy = y * wu_of(ny), hz = z * wu_of(nz);

	seed *= 0x27d4eb2fu;
	fx = fx * fx * (wf_of(3) - wf_of(2) * fx);
	fy = fy * fy * (wf_of(3) - wf_of(2) * fy);
	fz = fz * fz * (wf_of(3) - wf_of(2) * fz);
	for (uint32_t i = 0; i < 8; i++) {
		wu h = (hx + wu_of(i & 1 ? nx : 0)) ^ (hy + wu_of(i & 2 ? ny : 0)) ^
		       (hz + wu_of(i & 4 ? nz : 0)) ^ wu_of(seed);

		h = (h ^ h >> 15) * wu_of(0x2c1b3c6du);
		v[i] = wf_from(h >> 8) * wf_of(1.0f / 16777216);
	}
	for (int i = 0; i < 4; i++)
		v[i] = wf_mix(v[2 * i], v[2 * i + 1], fx);
	return wf_mix(wf_mix(v[0], v[1], fy), wf_mix(v[2], v[3], fy), fz);
}

static inline wf wide_unit_from(wu h)
{
	return wf_from(h >> 8) * wf_of(1.0f / 16777216);
}

static inline wu wide_hash(wu x)
{
	x ^= x >> 16;
	x *= wu_of(0x7feb352du);
	x ^= x >> 15;
	x *= wu_of(0x846ca68bu);
	return x ^ (x >> 16);
}

static inline wu wide_hash_cell(wu x, wu y, uint32_t z, uint32_t seed)
{
	wu h = (x * wu_of(0x9e3779b1u)) ^ (y * wu_of(0x85ebca77u)) ^
	       wu_of((z * 0xc2b2ae3du) ^ seed);

	h = (h ^ (h >> 15)) * wu_of(0x2c1b3c6du);
	h = (h ^ (h >> 13)) * wu_of(0x297a2d39u);
	return h ^ (h >> 16);
}

static inline wf wide_value_noise2(wf px, wf py, uint32_t seed)
{
	wu x = wf_floor_int(px), y = wf_floor_int(py), one = wu_of(1);
	wf fx = px - wf_from(x), fy = py - wf_from(y);
	wf a = wide_unit_from(wide_hash_cell(x, y, 0, seed));
	wf b = wide_unit_from(wide_hash_cell(x + one, y, 0, seed));
	wf c = wide_unit_from(wide_hash_cell(x, y + one, 0, seed));
	wf d = wide_unit_from(wide_hash_cell(x + one, y + one, 0, seed));

	fx = fx * fx * (wf_of(3) - wf_of(2) * fx);
	fy = fy * fy * (wf_of(3) - wf_of(2) * fy);
	return wf_mix(wf_mix(a, b, fx), wf_mix(c, d, fx), fy);
}

/* Lanes of `m` whose `t` lies before the nearest so far take it. */
static inline wm near_take(struct wide_near *n, wm m, wf t, uint32_t part)
{
	m = wm_less(wm_less(m, wf_le(t, wf_of(0))), wf_ge(t, n->t));
	n->t = wf_choose(m, t, n->t);
	n->part = wu_choose(m, wu_of(part), n->part);
	return m;
}

static inline void wide_slab(wf from, wf along, float half, wf *near_t, wf *far_t)
{
	wf tiny = wf_of(1e-12f);
	wf inv = wf_of(1) / wf_choose(wf_lt(wf_abs(along), tiny), tiny, along);
	wf a = (wf_of(-half) - from) * inv, b = (wf_of(half) - from) * inv;

	*near_t = wf_min(a, b);
	*far_t = wf_max(a, b);
}

static inline wm wide_hit_box(const struct wide_ray *r, struct v3 half, wm m, struct wide_near *n)
{
	wf nx, ny, nz, fx, fy, fz, t, out;

	wide_slab(r->from.x, r->along.x, half.x, &nx, &fx);
	wide_slab(r->from.y, r->along.y, half.y, &ny, &fy);
	wide_slab(r->from.z, r->along.z, half.z, &nz, &fz);
	t = wf_max(nx, wf_max(ny, nz));
	out = wf_min(fx, wf_min(fy, fz));
	m = near_take(n, wm_less(m, wf_gt(t, out)), t, PART_Z);
	n->part = wu_choose(wm_and(m, wf_eq(t, ny)), wu_of(PART_Y), n->part);
	n->part = wu_choose(wm_and(m, wf_eq(t, nx)), wu_of(PART_X), n->part);
	return m;
}

static inline wm wide_hit_ellipsoid(const struct wide_ray *r, struct v3 inv, wm m,
				    struct wide_near *n)
{
	struct w3 o = w3_mul(r->from, w3_of(inv)), d = w3_mul(r->along, w3_of(inv));
	wf a = w3_dot(d, d), b = w3_dot(o, d), q = b * b - a * (w3_dot(o, o) - wf_of(1));

	m = wm_less(m, wf_le(q, wf_of(0)));
	return near_take(n, m, (-b - wf_sqrt(q)) / a, PART_ROUND);
}

static inline wm wide_hit_ring(const struct wide_ray *r, float z, float inner, float outer,
			       uint32_t part, wm m, struct wide_near *n)
{
	wf t = (wf_of(z) - r->from.z) / r->along.z;
	wf x = r->from.x + t * r->along.x, y = r->from.y + t * r->along.y;
	wf rr = x * x + y * y;

	m = wm_less(m, wf_lt(wf_abs(r->along.z), wf_of(1e-12f)));
	m = wm_less(m, wf_gt(rr, wf_of(outer * outer)));
	return near_take(n, wm_less(m, wf_lt(rr, wf_of(inner * inner))), t, part);
}

static inline wm wide_hit_mantle(const struct wide_ray *r, float r0, float r1, float h, bool inside,
				 wm m, struct wide_near *n)
{
	float k = (r1 - r0) / (2 * h), mid = 0.5f * (r0 + r1);
	struct w3 o = r->from, d = r->along;
	wf zero = wf_of(0), ro = wf_of(mid) + wf_of(k) * o.z, rd = wf_of(k) * d.z;
	wf a = d.x * d.x + d.y * d.y - rd * rd;
	wf b = o.x * d.x + o.y * d.y - ro * rd;
	wf q = b * b - a * (o.x * o.x + o.y * o.y - ro * ro), root = wf_sqrt(q), t, z;
	wm plus = inside ? wf_gt(a, zero) : wm_not(wf_gt(a, zero));

	t = (-b + wf_choose(plus, root, -root)) / a;
	z = o.z + t * d.z;
	m = wm_less(m, wm_or(wf_le(q, zero), wf_lt(wf_abs(a), wf_of(1e-12f))));
	m = wm_less(m, wm_or(wf_gt(wf_abs(z), wf_of(h)), wf_lt(ro + t * rd, zero)));
	return near_take(n, m, t, inside ? PART_INNER : PART_ROUND);
}

static inline wm wide_hit_frustum(const struct wide_ray *r, float r0, float r1, float h, wm m,
				  struct wide_near *n)
{
	wm down = wf_lt(r->along.z, wf_of(0));
	wm any = wide_hit_mantle(r, r0, r1, h, false, m, n);

	any = wm_or(any, wide_hit_ring(r, h, 0, r1, PART_TOP, wm_and(m, down), n));
	return wm_or(any, wide_hit_ring(r, -h, 0, r0, PART_BOTTOM, wm_less(m, down), n));
}

static inline wm wide_hit_cup(const struct wide_ray *r, float radius, float wall, float h, wm m,
			      struct wide_near *n)
{
	float inner = radius - wall;
	wm down = wf_lt(r->along.z, wf_of(0)), falls = wm_and(m, down);
	wm any = wide_hit_mantle(r, radius, radius, h, false, m, n);

	any = wm_or(any, wide_hit_mantle(r, inner, inner, h, true, m, n));
	any = wm_or(any, wide_hit_ring(r, h, inner, radius, PART_TOP, falls, n));
	any = wm_or(any, wide_hit_ring(r, -h + wall, 0, inner, PART_TOP, falls, n));
	return wm_or(any, wide_hit_ring(r, -h, 0, radius, PART_BOTTOM, wm_less(m, down), n));
}

static inline wf wide_field_round_box(struct w3 p, struct v3 half, float radius)
{
	wf zero = wf_of(0), r = wf_of(radius);
	wf x = wf_abs(p.x) - wf_of(half.x) + r, y = wf_abs(p.y) - wf_of(half.y) + r,
	   z = wf_abs(p.z) - wf_of(half.z) + r;
	struct w3 out = w3(wf_max(x, zero), wf_max(y, zero), wf_max(z, zero));

	return wf_sqrt(w3_dot(out, out)) + wf_min(wf_max(x, wf_max(y, z)), zero) - r;
}

static inline wf wide_field_torus(struct w3 p, float ring, wf tube)
{
	wf a = wf_sqrt(p.x * p.x + p.y * p.y) - wf_of(ring);

	return wf_sqrt(a * a + p.z * p.z) - tube;
}

static inline wf wide_field_arc(struct w3 p, float ring, float tube, float c, float s)
{
	wf y = wf_abs(p.y), across = p.x * wf_of(s) - y * wf_of(c), end, bent;
	struct w3 e = w3(p.x - wf_of(ring * c), y - wf_of(ring * s), p.z);

	end = wf_sqrt(w3_dot(e, e)) - wf_of(0.55f * tube);
	y = y / (wf_abs(p.x) + y + wf_of(1e-9f));
	bent = wide_field_torus(p, ring,
				wf_of(tube) * (wf_of(1) - wf_of(0.45f) * wf_saturate(y * y)));
	return wf_choose(wf_lt(across, wf_of(0)), end, bent);
}

static inline wf wide_field_pebble(struct w3 p, struct v3 inv, float depth)
{
	struct w3 q = w3_mul(p, w3_of(inv)), g = w3_mul(q, w3_of(inv));
	wf k = wf_sqrt(w3_dot(q, q)), slope = wf_sqrt(w3_dot(g, g));
	wf bump = wf_sin_turns(q.x * wf_of(0.55f) + wf_of(depth)) *
			  wf_sin_turns(q.y * wf_of(0.6f) + wf_of(3 * depth)) +
		  wf_of(0.6f) * wf_sin_turns(q.z * wf_of(0.7f) + q.x * wf_of(0.3f));

	return (k - wf_of(1) + wf_of(depth) * bump) * k / (slope + wf_of(1e-9f)) *
	       wf_of(1 - 1.5f * depth);
}

static inline wf wide_field_ball(struct w3 p, struct v3 inv)
{
	struct w3 q = w3_mul(p, w3_of(inv)), g = w3_mul(q, w3_of(inv));
	wf k = wf_sqrt(w3_dot(q, q));

	return wf_of(0.9f) * (k - wf_of(1)) * k / (wf_sqrt(w3_dot(g, g)) + wf_of(1e-9f));
}

static inline wf wide_field_drum(struct w3 p, float radius, float h)
{
	wf r = wf_sqrt(p.x * p.x + p.y * p.y) - wf_of(radius), z = wf_abs(p.z) - wf_of(h);
	wf out_r = wf_max(r, wf_of(0)), out_z = wf_max(z, wf_of(0));

	return wf_sqrt(out_r * out_r + out_z * out_z) + wf_min(wf_max(r, z), wf_of(0));
}

static inline wf wide_field_rock(const struct prim *s, struct w3 p)
{
	struct w3 q = w3_mul(p, w3_of(s->inv)), g = w3_mul(q, w3_of(s->inv));
	wf k = wf_sqrt(w3_dot(q, q)), slope = wf_sqrt(w3_dot(g, g));
	wf dent = wide_value_noise(w3_scale(q, wf_of(s->wave)), s->material.seed);

	dent += wf_of(0.4f) *
		wide_value_noise(w3_scale(q, wf_of(2.3f * s->wave)), s->material.seed + 1);
	return (k - wf_of(1) + wf_of(s->extra) * dent) * k / (slope + wf_of(1e-9f)) *
	       wf_of(s->caution);
}

static inline wf wide_field_relief(const struct prim *s, struct w3 p)
{
	wf x = p.x * wf_of(s->wave), y = p.y * wf_of(s->wave);
	wf box = wide_field_round_box(p, s->half, 0), dip, hills;
	wm far = wf_gt(box, wf_of(0.5f * s->half.z));

	if (wm_bits(far) == ALL_LANES)
		return box;
	dip = wf_of(0.7f) * wide_value_noise2(x, y, s->material.seed) +
	      wf_of(0.3f) *
		      wide_value_noise2(wf_of(2.7f) * x, wf_of(2.7f) * y, s->material.seed + 1);
	hills = wf_max(box, (p.z - wf_of(s->half.z) * (wf_of(1) - wf_of(2 * s->extra) * dip)) *
				    wf_of(s->caution));
	return wf_choose(far, box, hills);
}

static inline wf wide_field_cut(const struct prim *s, struct w3 p)
{
	wf ax = wf_abs(p.x), ay = wf_abs(p.y), pitch = wf_of(3 * s->extra);
	struct w3 q = w3(p.x, p.y, p.z - wf_of(s->half.z));

	switch (s->cut) {
	case CUT_DIP:
		break;
	case CUT_BORE:
		q.z = wf_of(0);
		break;
	case CUT_SLOT:
		return wf_max(ay - wf_of(s->extra), -p.z);
	case CUT_CORNERS:
		q.x = ax - wf_of(s->half.x);
		q.y = ay - wf_of(s->half.y);
		break;
	case CUT_FLUTES:
		q = w3((wf_fract(p.x / pitch) - wf_of(0.5f)) * pitch, ay - wf_of(s->half.y),
		       wf_of(0));
		break;
	}
	return wf_sqrt(w3_dot(q, q)) - wf_of(s->extra);
}

static inline wf wide_field_carved(const struct prim *s, struct w3 p)
{
	wf solid = s->solid == SOLID_BOX    ? wide_field_round_box(p, s->half, 0.06f * s->half.z)
		   : s->solid == SOLID_BALL ? wide_field_ball(p, s->inv)
					    : wide_field_drum(p, s->half.x, s->half.z);

	return wf_max(solid, -wide_field_cut(s, p));
}

static inline wf wide_field_of(const struct prim *s, struct w3 p)
{
	switch (s->shape) {
	case SHAPE_TORUS:
		return wide_field_torus(p, s->half.x, wf_of(s->half.y));
	case SHAPE_ARC:
		return wide_field_arc(p, s->half.x, s->half.y, s->turn_cos, s->turn_sin);
	case SHAPE_PEBBLE:
		return wide_field_pebble(p, s->inv, s->extra);
	case SHAPE_ROCK:
		return wide_field_rock(s, p);
	case SHAPE_RELIEF:
		return wide_field_relief(s, p);
	case SHAPE_CARVED:
		return wide_field_carved(s, p);
	default:
		return wide_field_round_box(p, s->half, s->extra);
	}
}

static inline wm wide_clip_to_ball(const struct prim *s, const struct wide_ray *r, wf *t, wf *out)
{
	struct w3 inv = w3_of(v3(1 / s->reach.x, 1 / s->reach.y, 1 / s->reach.z));
	struct w3 o = w3_mul(r->from, inv), d = w3_mul(r->along, inv);
	wf a = w3_dot(d, d), b = w3_dot(o, d), q = b * b - a * (w3_dot(o, o) - wf_of(1));
	wf root = wf_sqrt(q);

	*t = wf_max(*t, (-b - root) / a);
	*out = wf_min(*out, (-b + root) / a);
	return wm_less(wf_lt(*t, *out), wf_le(q, wf_of(0)));
}

static inline wm wide_hit_field(const struct prim *s, const struct wide_ray *r, wm m,
				struct wide_near *n)
{
	wf nx, ny, nz, fx, fy, fz, t, out, tiny, d = wf_of(0);
	wm walks;

	wide_slab(r->from.x, r->along.x, s->reach.x, &nx, &fx);
	wide_slab(r->from.y, r->along.y, s->reach.y, &ny, &fy);
	wide_slab(r->from.z, r->along.z, s->reach.z, &nz, &fz);
	t = wf_max(wf_max(nx, wf_of(0)), wf_max(ny, nz));
	out = wf_min(wf_min(fx, n->t), wf_min(fy, fz));
	m = wm_less(m, wf_ge(t, out));
	if (s->round && wm_any(m))
		m = wm_and(m, wide_clip_to_ball(s, r, &t, &out));
	if (!wm_any(m))
		return m;
	tiny = wf_clamp(wf_of(0.1f * r->spread) * t, wf_of(s->bound * 1e-3f),
			wf_of(s->bound * 8e-3f));
	walks = wm_and(m, wf_lt(t, out));
	for (int step = 0; wm_any(walks); step++) {
		d = wf_choose(walks, wide_field_of(s, wide_at(r, t)), d);
		walks = step == SIM_WALK_STEPS ? wm_none() : wm_less(walks, wf_lt(d, tiny));
		t = wf_choose(walks, t + (d + tiny), t);
		walks = wm_and(walks, wf_lt(t, out));
	}
	m = wm_less(m, wm_or(wf_ge(t, out), wf_le(t, wf_of(0))));
	m = wm_less(m, wf_gt(d, wf_of(4) * tiny));
	n->part = wu_choose(m, wu_of(PART_ROUND), n->part);
	n->t = wf_choose(m, t, n->t);
	return m;
}

static inline struct w3 wide_field_normal(const struct prim *s, struct w3 p)
{
	wf e = wf_of(s->bound * 2e-3f);
	wf a = wide_field_of(s, w3(p.x + e, p.y - e, p.z - e));
	wf b = wide_field_of(s, w3(p.x - e, p.y + e, p.z - e));
	wf c = wide_field_of(s, w3(p.x - e, p.y - e, p.z + e));
	wf d = wide_field_of(s, w3(p.x + e, p.y + e, p.z + e));

	return w3_unit(w3(a - c - b + d, -a - c + b + d, -a + c - b + d));
}

/* Normal on the round part, or the whole of a shape that is walked. */
static inline struct w3 wide_round_normal(const struct prim *s, struct w3 p)
{
	struct w3 inv = w3_of(s->inv);
	float k;

	switch (s->shape) {
	case SHAPE_ELLIPSOID:
		return w3_unit(w3_mul(w3_mul(p, inv), inv));
	case SHAPE_FRUSTUM:
		k = (s->extra - s->half.x) / (2 * s->half.z);
		return w3_unit(
			w3(p.x, p.y,
			   wf_of(-k) * (wf_of(0.5f * (s->half.x + s->extra)) + wf_of(k) * p.z)));
	case SHAPE_CYLINDER:
	case SHAPE_CUP:
		return w3_unit(w3(p.x, p.y, wf_of(0)));
	default:
		return wide_field_normal(s, p);
	}
}

static inline struct w3 wide_prim_normal(const struct prim *s, wu part, struct w3 p,
					 struct w3 along)
{
	wf zero = wf_of(0), one = wf_of(1), minus = wf_of(-1);
	struct w3 n;
	wm x, y, z;

	if (s->shape == SHAPE_BOX) {
		x = wu_eq(part, wu_of(PART_X));
		y = wu_eq(part, wu_of(PART_Y));
		z = wm_not(wm_or(x, y));
		return w3(wf_choose(x, wf_choose(wf_gt(along.x, zero), minus, one), zero),
			  wf_choose(y, wf_choose(wf_gt(along.y, zero), minus, one), zero),
			  wf_choose(z, wf_choose(wf_gt(along.z, zero), minus, one), zero));
	}
	n = wide_round_normal(s, p);
	if (s->shape != SHAPE_CYLINDER && s->shape != SHAPE_FRUSTUM && s->shape != SHAPE_CUP)
		return n;
	if (s->shape == SHAPE_CUP)
		n = w3_choose(wu_eq(part, wu_of(PART_INNER)), w3_unit(w3(-p.x, -p.y, zero)), n);
	n = w3_choose(wu_eq(part, wu_of(PART_TOP)), w3(zero, zero, one), n);
	return w3_choose(wu_eq(part, wu_of(PART_BOTTOM)), w3(zero, zero, minus), n);
}

/* Lanes of `m` that meet the shape before their nearest so far, which then is this. */
static inline wm wide_hit_prim(const struct prim *s, const struct wide_ray *world, wm m,
			       struct wide_near *n)
{
	struct wide_ray r;

	r.from = w3_rotate_back(&s->rot, w3_sub(world->from, w3_of(s->centre)));
	r.along = w3_rotate_back(&s->rot, world->along);
	r.spread = world->spread;
	switch (s->shape) {
	case SHAPE_BOX:
		return wide_hit_box(&r, s->half, m, n);
	case SHAPE_ELLIPSOID:
		return wide_hit_ellipsoid(&r, s->inv, m, n);
	case SHAPE_CYLINDER:
		return wide_hit_frustum(&r, s->half.x, s->half.x, s->half.z, m, n);
	case SHAPE_FRUSTUM:
		return wide_hit_frustum(&r, s->half.x, s->extra, s->half.z, m, n);
	case SHAPE_CUP:
		return wide_hit_cup(&r, s->half.x, s->extra, s->half.z, m, n);
	default:
		return wide_hit_field(s, &r, m, n);
	}
}

#endif
