/* Ray against shape. Rays come in the shape's own frame; directions keep their length under the
 * rotation, so a distance along the inner ray is one along the outer.
 * Simple shapes are solved; the others are distance fields walked inside their bounding box. */
#ifndef DIO_SIM_SHAPE_H
#define DIO_SIM_SHAPE_H

#include "noise.h"
#include "scene.h"

#define SIM_FAR 1e8f

struct ray {
	struct v3 from, along; /* unit */
	float spread; /* nothing smaller than this share of the way needs to be told apart */
};

DIO_SIM_FN struct ray ray_of(struct v3 from, struct v3 along, float spread)
{
	struct ray r;

	r.from = from;
	r.along = along;
	r.spread = spread;
	return r;
}

/* Which side of a shape a ray met, enough to find the normal there once it is known to be the
 * nearest hit: most hits are not, and shadows need none. */
enum shape_part {
	PART_X, /* the box's side across x, y or z that faces the ray */
	PART_Y,
	PART_Z,
	PART_TOP,
	PART_BOTTOM,
	PART_ROUND, /* the curved side */
	PART_INNER, /* of a cup */
};

struct surface_hit {
	float t;
	enum shape_part part;
};

DIO_SIM_FN struct v3 ray_at(const struct ray *r, float t)
{
	return v3_mad(r->from, r->along, t);
}

/* Distances to a slab -half..half; a ray within its plane gets huge ones of the right sign. */
DIO_SIM_FN void slab(float from, float along, float half, float *near_t, float *far_t)
{
	float inv = 1 / (absf(along) < 1e-12f ? 1e-12f : along);
	float a = (-half - from) * inv, b = (half - from) * inv;

	*near_t = minf(a, b);
	*far_t = maxf(a, b);
}

DIO_SIM_FN bool hit_box(const struct ray *r, struct v3 half, struct surface_hit *hit)
{
	float nx, ny, nz, fx, fy, fz, t, out;

	slab(r->from.x, r->along.x, half.x, &nx, &fx);
	slab(r->from.y, r->along.y, half.y, &ny, &fy);
	slab(r->from.z, r->along.z, half.z, &nz, &fz);
	t = maxf(nx, maxf(ny, nz));
	out = minf(fx, minf(fy, fz));
	if (t > out || t <= 0 || t >= hit->t)
		return false;
	hit->t = t;
	hit->part = t == nx ? PART_X : t == ny ? PART_Y : PART_Z;
	return true;
}

DIO_SIM_FN bool hit_ellipsoid(const struct ray *r, struct v3 inv, struct surface_hit *hit)
{
	struct v3 o = v3_mul(r->from, inv), d = v3_mul(r->along, inv);
	float a = v3_dot(d, d), b = v3_dot(o, d), q = b * b - a * (v3_dot(o, o) - 1), t;

	if (q <= 0)
		return false;
	t = (-b - sqrtf(q)) / a;
	if (t <= 0 || t >= hit->t)
		return false;
	hit->t = t;
	hit->part = PART_ROUND;
	return true;
}

/* Flat end at height z, between two radii. */
DIO_SIM_FN bool hit_ring(const struct ray *r, float z, float inner, float outer,
			 enum shape_part part, struct surface_hit *hit)
{
	float t, x, y, rr;

	if (absf(r->along.z) < 1e-12f)
		return false;
	t = (z - r->from.z) / r->along.z;
	if (t <= 0 || t >= hit->t)
		return false;
	x = r->from.x + t * r->along.x;
	y = r->from.y + t * r->along.y;
	rr = x * x + y * y;
	if (rr > outer * outer || rr < inner * inner)
		return false;
	hit->t = t;
	hit->part = part;
	return true;
}

/* Mantle of a cone whose radius is r0 at z = -h and r1 at z = h (equal: a cylinder), seen from
 * outside (`inside` false) or inside. */
DIO_SIM_FN bool hit_mantle(const struct ray *r, float r0, float r1, float h, bool inside,
			   struct surface_hit *hit)
{
	float k = (r1 - r0) / (2 * h), m = 0.5f * (r0 + r1);
	struct v3 o = r->from, d = r->along;
	float ro = m + k * o.z, rd = k * d.z;
	float a = d.x * d.x + d.y * d.y - rd * rd;
	float b = o.x * d.x + o.y * d.y - ro * rd;
	float q = b * b - a * (o.x * o.x + o.y * o.y - ro * ro), root, t, z;

	if (q <= 0 || absf(a) < 1e-12f)
		return false;
	root = sqrtf(q);
	t = inside == (a > 0) ? (-b + root) / a : (-b - root) / a;
	z = o.z + t * d.z;
	if (t <= 0 || t >= hit->t || absf(z) > h || ro + t * rd < 0)
		return false;
	hit->t = t;
	hit->part = inside ? PART_INNER : PART_ROUND;
	return true;
}

DIO_SIM_FN bool hit_frustum(const struct ray *r, float r0, float r1, float h,
			    struct surface_hit *hit)
{
	bool any = hit_mantle(r, r0, r1, h, false, hit);

	if (r->along.z < 0)
		any |= hit_ring(r, h, 0, r1, PART_TOP, hit);
	else
		any |= hit_ring(r, -h, 0, r0, PART_BOTTOM, hit);
	return any;
}

DIO_SIM_FN bool hit_cup(const struct ray *r, float radius, float wall, float h,
			struct surface_hit *hit)
{
	float inner = radius - wall;
	bool any = hit_mantle(r, radius, radius, h, false, hit);

	any |= hit_mantle(r, inner, inner, h, true, hit);
	if (r->along.z < 0) {
		any |= hit_ring(r, h, inner, radius, PART_TOP, hit);
		any |= hit_ring(r, -h + wall, 0, inner, PART_TOP, hit);
	} else {
		any |= hit_ring(r, -h, 0, radius, PART_BOTTOM, hit);
	}
	return any;
}

DIO_SIM_FN float field_round_box(struct v3 p, struct v3 half, float radius)
{
	float x = absf(p.x) - half.x + radius, y = absf(p.y) - half.y + radius,
	      z = absf(p.z) - half.z + radius;
	struct v3 out = v3(maxf(x, 0), maxf(y, 0), maxf(z, 0));

	return sqrtf(v3_dot(out, out)) + minf(maxf(x, maxf(y, z)), 0) - radius;
}

DIO_SIM_FN float field_torus(struct v3 p, float ring, float tube)
{
	float a = sqrtf(p.x * p.x + p.y * p.y) - ring;

	return sqrtf(a * a + p.z * p.z) - tube;
}

/* Bent rod with round ends, symmetric about +x; c and s are cosine and sine of half the angle it
 * spans. The tube thins towards its ends like a banana. */
DIO_SIM_FN float field_arc(struct v3 p, float ring, float tube, float c, float s)
{
	float y = absf(p.y), across = p.x * s - y * c;

	if (across < 0) { /* beyond the end: distance to the end point */
		struct v3 e = v3(p.x - ring * c, y - ring * s, p.z);

		return sqrtf(v3_dot(e, e)) - 0.55f * tube;
	}
	y = y / (absf(p.x) + y + 1e-9f); /* 0 in the middle of the arc */
	return field_torus(p, ring, tube * (1 - 0.45f * saturate(y * y)));
}

/* Not a true distance: first order from the ellipsoid's own gradient, and cautious. */
DIO_SIM_FN float field_pebble(struct v3 p, struct v3 inv, float depth)
{
	struct v3 q = v3_mul(p, inv), g = v3_mul(q, inv);
	float k = sqrtf(v3_dot(q, q)), slope = sqrtf(v3_dot(g, g));
	float bump = sin_turns(q.x * 0.55f + depth) * sin_turns(q.y * 0.6f + 3 * depth) +
		     0.6f * sin_turns(q.z * 0.7f + q.x * 0.3f);

	return (k - 1 + depth * bump) * k / (slope + 1e-9f) * (1 - 1.5f * depth);
}

/* Distance to an ellipsoid to first order; never too long outside. */
DIO_SIM_FN float field_ball(struct v3 p, struct v3 inv)
{
	struct v3 q = v3_mul(p, inv), g = v3_mul(q, inv);
	float k = sqrtf(v3_dot(q, q));

	return 0.9f * (k - 1) * k / (sqrtf(v3_dot(g, g)) + 1e-9f);
}

DIO_SIM_FN float field_drum(struct v3 p, float radius, float h)
{
	float r = sqrtf(p.x * p.x + p.y * p.y) - radius, z = absf(p.z) - h;
	float out_r = maxf(r, 0), out_z = maxf(z, 0);

	return sqrtf(out_r * out_r + out_z * out_z) + minf(maxf(r, z), 0);
}

/* Dents go inwards, so the ellipsoid's box holds it. */
DIO_SIM_FN float field_rock(const struct prim *s, struct v3 p)
{
	struct v3 q = v3_mul(p, s->inv), g = v3_mul(q, s->inv);
	float k = sqrtf(v3_dot(q, q)), slope = sqrtf(v3_dot(g, g));
	float dent = value_noise(v3_scale(q, s->wave), s->material.seed);

	dent += 0.4f * value_noise(v3_scale(q, 2.3f * s->wave), s->material.seed + 1);
	return (k - 1 + s->extra * dent) * k / (slope + 1e-9f) * s->caution;
}

/* Hills of two sizes under the top of a box. */
DIO_SIM_FN float field_relief(const struct prim *s, struct v3 p)
{
	float x = p.x * s->wave, y = p.y * s->wave, box = field_round_box(p, s->half, 0), dip;

	/* The landscape cannot be felt far from it. */
	if (box > 0.5f * s->half.z)
		return box;
	dip = 0.7f * value_noise2(x, y, s->material.seed) +
	      0.3f * value_noise2(2.7f * x, 2.7f * y, s->material.seed + 1);
	return maxf(box, (p.z - s->half.z * (1 - 2 * s->extra * dip)) * s->caution);
}

/* Negative inside of what a cut takes away. */
DIO_SIM_FN float field_cut(const struct prim *s, struct v3 p)
{
	float ax = absf(p.x), ay = absf(p.y), pitch = 3 * s->extra, x;
	struct v3 q = v3(p.x, p.y, p.z - s->half.z);

	switch (s->cut) {
	case CUT_DIP:
		break;
	case CUT_BORE:
		q.z = 0;
		break;
	case CUT_SLOT:
		return maxf(ay - s->extra, -p.z);
	case CUT_CORNERS:
		q.x = ax - s->half.x;
		q.y = ay - s->half.y;
		break;
	case CUT_FLUTES:
		x = fract(p.x / pitch) - 0.5f;
		q = v3(x * pitch, ay - s->half.y, 0);
		break;
	}
	return sqrtf(v3_dot(q, q)) - s->extra;
}

DIO_SIM_FN float field_carved(const struct prim *s, struct v3 p)
{
	float solid = s->solid == SOLID_BOX    ? field_round_box(p, s->half, 0.06f * s->half.z)
		      : s->solid == SOLID_BALL ? field_ball(p, s->inv)
					       : field_drum(p, s->half.x, s->half.z);

	return maxf(solid, -field_cut(s, p));
}

DIO_SIM_FN float field_of(const struct prim *s, struct v3 p)
{
	switch (s->shape) {
	case SHAPE_TORUS:
		return field_torus(p, s->half.x, s->half.y);
	case SHAPE_ARC:
		return field_arc(p, s->half.x, s->half.y, s->turn_cos, s->turn_sin);
	case SHAPE_PEBBLE:
		return field_pebble(p, s->inv, s->extra);
	case SHAPE_ROCK:
		return field_rock(s, p);
	case SHAPE_RELIEF:
		return field_relief(s, p);
	case SHAPE_CARVED:
		return field_carved(s, p);
	default:
		return field_round_box(p, s->half, s->extra);
	}
}

/* The part of a ray within the ellipsoid that the reach of a round shape spans. */
DIO_SIM_FN bool clip_to_ball(const struct prim *s, const struct ray *r, float *t, float *out)
{
	struct v3 inv = v3(1 / s->reach.x, 1 / s->reach.y, 1 / s->reach.z);
	struct v3 o = v3_mul(r->from, inv), d = v3_mul(r->along, inv);
	float a = v3_dot(d, d), b = v3_dot(o, d), q = b * b - a * (v3_dot(o, o) - 1), root;

	if (q <= 0)
		return false;
	root = sqrtf(q);
	*t = maxf(*t, (-b - root) / a);
	*out = minf(*out, (-b + root) / a);
	return *t < *out;
}

/* After so many steps a walk has no hope: it goes along the surface. */
enum { SIM_WALK_STEPS = 48 };

DIO_SIM_FN bool hit_field(const struct prim *s, const struct ray *r, struct surface_hit *hit)
{
	float nx, ny, nz, fx, fy, fz, t, out, d = 0, tiny;

	slab(r->from.x, r->along.x, s->reach.x, &nx, &fx);
	slab(r->from.y, r->along.y, s->reach.y, &ny, &fy);
	slab(r->from.z, r->along.z, s->reach.z, &nz, &fz);
	t = maxf(maxf(nx, 0), maxf(ny, nz));
	out = minf(minf(fx, hit->t), minf(fy, fz));
	if (t >= out || (s->round && !clip_to_ball(s, r, &t, &out)))
		return false;
	tiny = clampf(0.1f * r->spread * t, s->bound * 1e-3f, s->bound * 8e-3f);
	for (int step = 0; t < out; step++) {
		d = field_of(s, ray_at(r, t));
		if (d < tiny || step == SIM_WALK_STEPS)
			break;
		t += d + tiny; /* lets rays along the surface go */
	}
	if (t >= out || t <= 0 || d > 4 * tiny)
		return false;
	hit->part = PART_ROUND;
	hit->t = t;
	return true;
}

/* Gradient over the corners of a tetrahedron: four values instead of six. */
DIO_SIM_FN struct v3 field_normal(const struct prim *s, struct v3 p)
{
	float e = s->bound * 2e-3f;
	float a = field_of(s, v3(p.x + e, p.y - e, p.z - e));
	float b = field_of(s, v3(p.x - e, p.y + e, p.z - e));
	float c = field_of(s, v3(p.x - e, p.y - e, p.z + e));
	float d = field_of(s, v3(p.x + e, p.y + e, p.z + e));

	return v3_unit(v3(a - c - b + d, -a - c + b + d, -a + c - b + d));
}

/* Mantle of hit_mantle() at a point on it. */
DIO_SIM_FN struct v3 mantle_normal(struct v3 p, float r0, float r1, float h)
{
	float k = (r1 - r0) / (2 * h);

	return v3_unit(v3(p.x, p.y, -k * (0.5f * (r0 + r1) + k * p.z)));
}

/* Normal at `p`, met by a ray along `along`; all in the shape's frame. */
DIO_SIM_FN struct v3 prim_normal(const struct prim *s, enum shape_part part, struct v3 p,
				 struct v3 along)
{
	switch (part) {
	case PART_X:
		return v3(along.x > 0 ? -1 : 1, 0, 0);
	case PART_Y:
		return v3(0, along.y > 0 ? -1 : 1, 0);
	case PART_Z:
		return v3(0, 0, along.z > 0 ? -1 : 1);
	case PART_TOP:
		return v3(0, 0, 1);
	case PART_BOTTOM:
		return v3(0, 0, -1);
	case PART_INNER:
		return v3_unit(v3(-p.x, -p.y, 0));
	default:
		break;
	}
	switch (s->shape) {
	case SHAPE_ELLIPSOID:
		return v3_unit(v3_mul(v3_mul(p, s->inv), s->inv));
	case SHAPE_FRUSTUM:
		return mantle_normal(p, s->half.x, s->extra, s->half.z);
	case SHAPE_CYLINDER:
	case SHAPE_CUP:
		return v3_unit(v3(p.x, p.y, 0));
	default:
		return field_normal(s, p);
	}
}

/* Nearest hit closer than hit->t from outside. */
DIO_SIM_FN bool hit_prim(const struct prim *s, const struct ray *world, struct surface_hit *hit)
{
	struct ray r = ray_of(rotate_back(&s->rot, v3_sub(world->from, s->centre)),
			      rotate_back(&s->rot, world->along), world->spread);

	switch (s->shape) {
	case SHAPE_BOX:
		return hit_box(&r, s->half, hit);
	case SHAPE_ELLIPSOID:
		return hit_ellipsoid(&r, s->inv, hit);
	case SHAPE_CYLINDER:
		return hit_frustum(&r, s->half.x, s->half.x, s->half.z, hit);
	case SHAPE_FRUSTUM:
		return hit_frustum(&r, s->half.x, s->extra, s->half.z, hit);
	case SHAPE_CUP:
		return hit_cup(&r, s->half.x, s->extra, s->half.z, hit);
	default:
		return hit_field(s, &r, hit);
	}
}

#endif
