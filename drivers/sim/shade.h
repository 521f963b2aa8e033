/* Light on a surface: lamps with soft shadows, ambient light with occlusion, highlights and one
 * mirrored bounce. All colours linear. */
#ifndef DIO_SIM_SHADE_H
#define DIO_SIM_SHADE_H

#include "board.h"
#include "trace.h"

#define SIM_PAPER_WHITE 0.80f
#define SIM_PAPER_INK   0.035f

/* How a surface answers to light at one point. */
struct finish {
	struct v3 albedo;
	float specular, emission;
	float clear; /* share of light that goes straight through, and its colour */
	struct v3 tint;
	uint32_t gloss_log2;
	bool reflects;
};

DIO_SIM_FN struct v3 sky_colour(const struct dio_sim_scene *s, struct v3 d)
{
	struct v3 c;

	if (s->surround == SURROUND_PLAIN)
		return s->sky[0];
	c = v3_mix(s->sky[0], s->sky[1], smooth_step(-0.1f, 0.8f, d.z));
	if (s->clouds > 0 && d.z > 0.02f) {
		float far = 1.2f / (d.z + 0.15f);
		float n = fractal_noise(v3(d.x * far, d.y * far, 0.5f), 0.02f * far, 4,
					(uint32_t)s->seed);

		c = v3_mix(c, s->sky[2],
			   s->clouds * smooth_step(0.45f, 0.75f, n) *
				   smooth_step(0.02f, 0.2f, d.z));
	}
	return c;
}

DIO_SIM_FN struct finish surface_finish(const struct dio_sim_scene *s, const struct scene_hit *hit,
					float pixel)
{
	const struct material *m = hit->material;
	struct finish f;

	if (s->paper_half_x > 0 && absf(hit->point.z) < 1e-4f && hit->normal.z > 0.99f &&
	    absf(hit->point.x) < s->paper_half_x && absf(hit->point.y) < s->paper_half_y) {
		float white = board_white(&s->board, hit->point.x, hit->point.y, pixel);
		float v = mixf(SIM_PAPER_INK, SIM_PAPER_WHITE, white);

		f.albedo = v3(v, v, v);
		f.specular = f.emission = f.clear = 0;
		f.tint = v3(0, 0, 0);
		f.gloss_log2 = 0;
		f.reflects = false;
		return f;
	}
	f.albedo = texture_colour(m, &s->photos, &hit->place);
	f.clear = m->clear;
	f.tint = m->tint;
	f.specular = m->specular;
	f.emission = m->emission;
	f.gloss_log2 = m->gloss_log2;
	f.reflects = m->reflects;
	return f;
}

/* What may shade the points of a small region: found once for a tile, used by its pixels. Functions
 * that take one accept NULL for a point that lies anywhere. */
struct neighbourhood {
	struct v3 lo, hi;                     /* the region */
	bool ambient;                         /* may anything keep ambient light off? */
	struct prim_set lamp[SIM_MAX_LIGHTS]; /* what may stand before each lamp */
};

/* A ball's shade ends where it would keep off less than this share of the light. */
#define SIM_FAINT_SHADE 0.01f

DIO_SIM_FN struct neighbourhood neighbourhood_of(const struct dio_sim_scene *s, struct v3 lo,
						 struct v3 hi)
{
	struct v3 mid = v3_scale(v3_add(lo, hi), 0.5f), half = v3_sub(hi, mid);
	float breadth = 1.01f * sqrtf(v3_dot(half, half)) + 1e-4f;
	struct neighbourhood n;

	n.lo = lo;
	n.hi = hi;
	n.ambient = false;
	for (uint32_t i = 0; i < s->thing_count; i++) {
		float x = s->mid_x[i] - mid.x, y = s->mid_y[i] - mid.y, z = s->mid_z[i] - mid.z;
		float apart = maxf(sqrtf(x * x + y * y + z * z) - breadth, 0);

		if (s->occluder2[i] > SIM_FAINT_SHADE * apart * apart && s->occluder2[i] > 0)
			n.ambient = true;
	}
	for (uint32_t i = 0; i < s->light_count; i++) {
		const struct light *l = &s->light[i];
		struct v3 v = l->directional ? l->at : v3_sub(l->at, mid);
		float far = sqrtf(v3_dot(v, v));
		struct beam beam;

		if (l->directional)
			beam = beam_of(mid, l->at, SIM_FAR, breadth, l->size);
		else
			beam = beam_of(mid, v3_scale(v, 1 / far), far, breadth, l->size / far);
		/* Rays to a lamp nearby are not parallel: the hull of region and lamp is as wide as
		 * the wider of the two, which breadth + slope covers, but it may dip. */
		if (!l->directional && v.z < 2 * breadth)
			beam.floor_z = -SIM_FAR;
		n.lamp[i] = set_of_beam(s, &beam);
		set_remove_clear(s, &n.lamp[i]);
	}
	return n;
}

DIO_SIM_FN bool neighbourhood_holds(const struct neighbourhood *n, struct v3 p)
{
	return p.x >= n->lo.x && p.y >= n->lo.y && p.z >= n->lo.z && p.x <= n->hi.x &&
	       p.y <= n->hi.y && p.z <= n->hi.z;
}

/* Share of the sky that the things around leave open: each counts as a ball (Quilez, "sphere
 * ambient occlusion": cosine times the ball's share of the hemisphere). */
DIO_SIM_FN float ambient_open(const struct dio_sim_scene *s, struct v3 p, struct v3 n)
{
	float open = 1, left[SIM_MAX_THINGS];

	for (uint32_t i = 0; i < s->thing_count; i++) { /* without branches: vectors */
		float x = s->mid_x[i] - p.x, y = s->mid_y[i] - p.y, z = s->mid_z[i] - p.z;
		float dd = x * x + y * y + z * z + 1e-9f, toward = n.x * x + n.y * y + n.z * z;
		float share = minf(s->occluder2[i] / dd, 1) - SIM_FAINT_SHADE;

		left[i] = 1 - 0.8f * maxf(share, 0) * clampf(toward / sqrtf(dd), 0, 1);
	}
	for (uint32_t i = 0; i < s->thing_count; i++)
		open *= left[i];
	return open;
}

/* Which points of a lamp a ray asks about: the only ray of a pixel about four; one of several
 * about two, turned by `turn` sixteenths so that the others ask about other points; or about the
 * centre alone. */
enum {
	SIM_LAMP_TURNS = 4,
	SIM_LAMP_ALL = 254,
	SIM_LAMP_CENTRE = 255,
};

/* A lamp below this size (tangent of its angular radius) throws a half-shadow so narrow that two
 * points which agree speak for all. */
#define SIM_NARROW_LAMP 0.04f

/* Share of the lamp seen from a point of a surface, behind what stands `before` it (NULL:
 * anything): whole quarters. */
DIO_SIM_FN float lamp_seen(const struct dio_sim_scene *s, struct v3 from, struct v3 to, float limit,
			   float size, float spread, uint32_t surface, uint32_t turn,
			   const struct prim_set *before)
{
	const float turn_cos[SIM_LAMP_TURNS] = {0.7f, 0.647f, 0.495f, 0.268f};
	const float turn_sin[SIM_LAMP_TURNS] = {0.0f, 0.268f, 0.495f, 0.647f};
	bool sharp = size < 0.004f || turn == SIM_LAMP_CENTRE;
	uint32_t seen = 0, step;
	struct prim_set set;
	struct v3 u, v;
	struct ray r;
	float c, d;

	if (before && set_is_empty(before))
		return 1;
	r = ray_of(from, to, spread);
	if (before && sharp) {
		set = *before;
	} else {
		struct beam beam = beam_of(from, to, limit, 0, sharp ? 0 : size);

		set = before ? set_within_beam(s, before, &beam) : set_of_beam(s, &beam);
	}
	set_remove_own(s, surface, &set);
	set_remove_clear(s, &set);
	if (set_is_empty(&set))
		return 1;
	if (sharp)
		return trace_blocked(s, &r, &set, limit) ? 0 : 1;
	step = turn == SIM_LAMP_ALL ? 0 : turn % SIM_LAMP_TURNS;
	c = size * turn_cos[step];
	d = size * turn_sin[step];
	u = v3_unit(v3_cross(to, absf(to.z) < 0.9f ? v3(0, 0, 1) : v3(1, 0, 0)));
	v = v3_cross(to, u);
	for (uint32_t i = 0; i < 4; i++) {
		/* Opposite points first, then one between them. */
		float x = i == 0 ? c : i == 1 ? -c : i == 2 ? -d : d;
		float y = i == 0 ? d : i == 1 ? -d : i == 2 ? c : -c;

		if (i == 2 && turn != SIM_LAMP_ALL)
			return 0.5f * (float)seen;
		if (i == 2 && size < SIM_NARROW_LAMP && seen % 2 == 0)
			return seen ? 1 : 0;
		if (i == 3 && seen % 3 == 0) /* speak for the fourth */
			return seen ? 1 : 0;
		r.along = v3_unit(v3_mad(v3_mad(to, u, x), v, y));
		seen += !trace_blocked(s, &r, &set, limit);
	}
	return 0.25f * (float)seen;
}

/* Does clear glass stand before the lamp? Its shadow has one edge only. */
DIO_SIM_FN bool lamp_behind_glass(const struct dio_sim_scene *s, struct v3 from, struct v3 to,
				  float limit, float spread, uint32_t surface)
{
	struct prim_set set = set_of_clear(s);
	struct ray r = ray_of(from, to, spread);

	set_remove_own(s, surface, &set);
	return !set_is_empty(&set) && trace_blocked(s, &r, &set, limit);
}

/* Share of a lamp's light that clear glass lets by. */
#define SIM_GLASS_SHADOW 0.6f

DIO_SIM_FN float highlight(struct v3 n, struct v3 half, const struct finish *f)
{
	float h = maxf(v3_dot(n, half), 0);

	for (uint32_t i = 0; i < f->gloss_log2; i++)
		h *= h;
	return f->specular * h * ((float)(1u << f->gloss_log2) + 8) * 0.08f;
}

/* What a surface sends along a ray, whatever its texture: albedo * gain + plus. */
struct response {
	struct v3 gain, plus;
	uint8_t lamps; /* quarters seen of each lamp, to the base of 5: other figures, another
			* shadow */
};

/* For the sky and reflections, whose steps are neither shadow nor texture. */
#define SIM_LAMPS_UNTOLD 255

DIO_SIM_FN struct v3 response_to(const struct response *r, struct v3 albedo)
{
	return v3_add(v3_mul(r->gain, albedo), r->plus);
}

/* `turn`: what to ask of the lamps, see lamp_seen(). */
DIO_SIM_FN struct response surface_response(const struct dio_sim_scene *s, const struct ray *r,
					    const struct scene_hit *hit, const struct finish *f,
					    uint32_t turn, const struct neighbourhood *near)
{
	struct v3 p = v3_mad(hit->point, hit->normal, 1e-4f + 1e-4f * hit->t), n = hit->normal;
	struct prim_set glass = set_of_clear(s);
	bool glassy = !set_is_empty(&glass), untold = false;
	uint32_t place = 1, shown = 0;
	struct response out;
	float open = near && !near->ambient ? 1 : ambient_open(s, hit->point, n);

	out.gain = v3_mix(s->ambient_down, s->ambient_up, 0.5f + 0.5f * n.z);
	out.gain = v3_scale(out.gain, open);
	out.plus = v3(0, 0, 0);
	for (uint32_t i = 0; i < s->light_count; i++, place *= 5) {
		const struct light *light = &s->light[i];
		struct v3 to = light->at;
		float limit = SIM_FAR, power = 1, size = light->size, cosine, seen;

		if (!light->directional) {
			struct v3 v = v3_sub(light->at, p);
			float dd = v3_dot(v, v);

			limit = sqrtf(dd);
			to = v3_scale(v, 1 / limit);
			power = 1 / (dd + 0.01f);
			size /= limit;
		}
		cosine = v3_dot(n, to);
		if (cosine <= 0)
			continue;
		seen = lamp_seen(s, p, to, limit, size, r->spread, hit->id, turn,
				 near ? &near->lamp[i] : NULL);
		if (seen <= 0)
			continue;
		shown += place * (uint32_t)(4 * seen);
		power *= seen;
		if (glassy && lamp_behind_glass(s, p, to, limit, r->spread, hit->id)) {
			power *= SIM_GLASS_SHADOW;
			untold = true;
		}
		out.gain = v3_mad(out.gain, light->colour, power * cosine);
		if (f->specular > 0) {
			struct v3 half = v3_unit(v3_sub(to, r->along));

			out.plus = v3_mad(out.plus, light->colour, power * highlight(n, half, f));
		}
	}
	out.gain = v3_add(out.gain, v3(f->emission, f->emission, f->emission));
	out.lamps = (uint8_t)(untold ? SIM_LAMPS_UNTOLD : shown);
	return out;
}

/* Pixel size on the surface: between the narrow and the drawn-out side of its footprint. */
DIO_SIM_FN float footprint(const struct ray *r, const struct scene_hit *hit, float pixel_angle)
{
	float cosine = absf(v3_dot(r->along, hit->normal));

	return pixel_angle * hit->t / sqrtf(maxf(cosine, 0.1f));
}

/* Finish of what a ray of some spread hit. */
DIO_SIM_FN struct finish hit_finish(const struct dio_sim_scene *s, const struct ray *r,
				    struct scene_hit *hit, float pixel_angle)
{
	hit->place.width = footprint(r, hit, pixel_angle);
	return surface_finish(s, hit, pixel_angle * hit->t);
}

/* What a mirror shows. */
DIO_SIM_FN struct v3 mirrored(const struct dio_sim_scene *s, const struct ray *r,
			      const struct scene_hit *hit, float pixel_angle)
{
	struct response back;
	struct scene_hit far;
	struct finish f;
	struct prim_set met;
	struct beam beam;
	struct ray m;

	m.along = v3_mad(r->along, hit->normal, -2 * v3_dot(r->along, hit->normal));
	m.from = v3_mad(hit->point, hit->normal, 1e-4f + 1e-4f * hit->t);
	m.spread = r->spread;
	beam = beam_of(m.from, m.along, SIM_FAR, 0, 0);
	met = set_of_beam(s, &beam);
	set_remove_own(s, hit->id, &met);
	trace_nearest(s, &m, &met, &far);
	if (!far.material)
		return sky_colour(s, m.along);
	/* The mirror may be curved, so what it shows is filtered more. */
	far.place.width = 3 * pixel_angle * (hit->t + far.t);
	f = surface_finish(s, &far, far.place.width);
	back = surface_response(s, &m, &far, &f, SIM_LAMP_CENTRE, NULL);
	return response_to(&back, f.albedo);
}

/* How many layers of glass a ray goes through before the next counts as the last. */
enum { SIM_GLASS_LAYERS = 3 };

/* Light that comes straight through a clear surface from behind it. */
DIO_SIM_FN struct v3 seen_through(const struct dio_sim_scene *s, const struct ray *r,
				  const struct scene_hit *hit, const struct finish *glass,
				  float pixel_angle)
{
	struct v3 sum = v3(0, 0, 0), pass = v3_scale(glass->tint, glass->clear);
	struct ray on = *r;
	float way = hit->t;

	for (int layer = 0; layer < SIM_GLASS_LAYERS; layer++) {
		struct response back;
		struct scene_hit far;
		struct prim_set met;
		struct finish f;
		struct beam beam;
		float solid;

		way += 1e-4f + 1e-4f * hit->t;
		on.from = v3_mad(r->from, r->along, way);
		beam = beam_of(on.from, on.along, SIM_FAR, 0, 0);
		met = set_of_beam(s, &beam);
		trace_nearest(s, &on, &met, &far);
		if (!far.material)
			return v3_add(sum, v3_mul(pass, sky_colour(s, on.along)));
		way += far.t;
		f = hit_finish(s, &on, &far, pixel_angle * way / maxf(far.t, 1e-4f));
		back = surface_response(s, &on, &far, &f, SIM_LAMP_CENTRE, NULL);
		solid = layer + 1 < SIM_GLASS_LAYERS ? 1 - f.clear : 1;
		sum = v3_add(sum, v3_mul(pass, v3_scale(response_to(&back, f.albedo), solid)));
		if (solid >= 1)
			break;
		pass = v3_mul(pass, v3_scale(f.tint, f.clear));
	}
	return sum;
}

DIO_SIM_FN void add_passing(const struct dio_sim_scene *s, const struct ray *r,
			    const struct scene_hit *hit, const struct finish *f, float pixel_angle,
			    struct response *out)
{
	out->gain = v3_scale(out->gain, 1 - f->clear);
	out->plus = v3_add(out->plus, seen_through(s, r, hit, f, pixel_angle));
	out->lamps = SIM_LAMPS_UNTOLD;
}

/* Part of what a surface sends is lost, `shown` takes its place. */
DIO_SIM_FN void response_veil(struct response *r, struct v3 shown, float share)
{
	r->gain = v3_scale(r->gain, 1 - share);
	r->plus = v3_mix(r->plus, shown, share);
}

/* An image in gloss fainter than this does not show. */
#define SIM_FAINT_MIRROR 0.05f

/* Gloss: the surroundings, sharp or as one mean colour. */
DIO_SIM_FN void add_reflection(const struct dio_sim_scene *s, const struct ray *r,
			       const struct scene_hit *hit, const struct finish *f,
			       float pixel_angle, struct response *out)
{
	float away = 1 - saturate(-v3_dot(r->along, hit->normal)), a2 = away * away;
	float fresnel =
		f->specular + (1 - f->specular) * a2 * a2 * away * (float)f->gloss_log2 * 0.1f;
	struct v3 shown;

	if (f->reflects && fresnel > SIM_FAINT_MIRROR) {
		shown = mirrored(s, r, hit, pixel_angle);
		out->lamps = SIM_LAMPS_UNTOLD;
	} else {
		shown = v3_mix(s->ambient_down, s->ambient_up, saturate(0.5f + hit->normal.z));
	}
	response_veil(out, shown, minf(fresnel, 1));
}

DIO_SIM_FN void fade_to_horizon(const struct dio_sim_scene *s, const struct ray *r,
				const struct scene_hit *hit, struct response *out)
{
	float far = hit->t / (30 * s->extent);

	if (hit->id != SIM_ID_GROUND || s->surround == SURROUND_ROOM)
		return;
	far *= far;
	response_veil(out, sky_colour(s, v3(r->along.x, r->along.y, 0)), far / (1 + far));
}

/* Light arriving along a ray from what it hit; `pixel_angle` is the ray's spread. */
DIO_SIM_FN struct v3 light_from(const struct dio_sim_scene *s, const struct ray *r,
				struct scene_hit *hit, float pixel_angle, uint32_t turn,
				const struct neighbourhood *near, struct response *out)
{
	struct finish f;

	if (!hit->material) {
		out->gain = v3(0, 0, 0);
		out->plus = sky_colour(s, r->along);
		out->lamps = SIM_LAMPS_UNTOLD;
		return out->plus;
	}
	f = hit_finish(s, r, hit, pixel_angle);
	*out = surface_response(s, r, hit, &f, turn, near);
	if (f.clear > 0)
		add_passing(s, r, hit, &f, pixel_angle, out);
	if (f.specular > 0)
		add_reflection(s, r, hit, &f, pixel_angle, out);
	fade_to_horizon(s, r, hit, out);
	return response_to(out, f.albedo);
}

#endif
