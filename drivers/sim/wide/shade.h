/* Light on several points: see ../shade.h, whose every step this takes for each lane. */
#ifndef DIO_SIM_WIDE_SHADE_H
#define DIO_SIM_WIDE_SHADE_H

#include "lamp.h"

struct wide_finish {
	struct w3 albedo, tint;
	wf specular, emission, clear;
	wu gloss_log2;
	wm reflects;
};

struct wide_response {
	struct w3 gain, plus;
	wu lamps;
};

/* What may shade the points of a tile, and which things dim its ambient light. */
struct nearby {
	const struct neighbourhood *near;
	uint32_t count;
	uint8_t thing[SIM_MAX_THINGS];
};

/* `near` NULL: the points lie anywhere. */
static struct nearby nearby_of(const struct dio_sim_scene *s, const struct neighbourhood *near)
{
	struct nearby n;
	struct v3 mid, half;
	float breadth;

	n.near = near;
	n.count = 0;
	if (!near) {
		for (uint32_t i = 0; i < s->thing_count; i++)
			n.thing[n.count++] = (uint8_t)i;
		return n;
	}
	mid = v3_scale(v3_add(near->lo, near->hi), 0.5f);
	half = v3_sub(near->hi, mid);
	breadth = 1.01f * sqrtf(v3_dot(half, half)) + 1e-4f;
	for (uint32_t i = 0; i < s->thing_count && near->ambient; i++) {
		struct v3 d = v3_sub(v3(s->mid_x[i], s->mid_y[i], s->mid_z[i]), mid);
		float apart = maxf(sqrtf(v3_dot(d, d)) - breadth, 0);

		if (s->occluder2[i] > SIM_FAINT_SHADE * apart * apart && s->occluder2[i] > 0)
			n.thing[n.count++] = (uint8_t)i;
	}
	return n;
}

static struct w3 wide_sky_colour(const struct dio_sim_scene *s, struct w3 d)
{
	struct w3 c, cloudy;
	wf far, n;

	if (s->surround == SURROUND_PLAIN)
		return w3_of(s->sky[0]);
	c = w3_mix(w3_of(s->sky[0]), w3_of(s->sky[1]), wf_smooth_step(-0.1f, 0.8f, d.z));
	if (!(s->clouds > 0) || !wm_any(wf_gt(d.z, wf_of(0.02f))))
		return c;
	far = wf_of(1.2f) / (d.z + wf_of(0.15f));
	n = wide_fractal_noise(w3(d.x * far, d.y * far, wf_of(0.5f)), wf_of(0.02f) * far, 4,
			       (uint32_t)s->seed);
	cloudy = w3_mix(c, w3_of(s->sky[2]),
			wf_of(s->clouds) * wf_smooth_step(0.45f, 0.75f, n) *
				wf_smooth_step(0.02f, 0.2f, d.z));
	return w3_choose(wf_gt(d.z, wf_of(0.02f)), cloudy, c);
}

static inline const struct material *material_of(const struct dio_sim_scene *s, uint32_t owner)
{
	return owner < SIM_MAX_PRIMS  ? &s->prim[owner].material
	       : owner < OWNER_GROUND ? &s->wall[owner - OWNER_WALL]
				      : &s->ground;
}

/* Lanes of `m` show the printed board. */
static void finish_paper(const struct dio_sim_scene *s, const struct wide_hit *hit, wf pixel, wm m,
			 struct wide_finish *f)
{
	float x[LANES], y[LANES], width[LANES], shown[LANES] = {0};
	wf zero = wf_of(0), v;

	wf_store(x, hit->point.x);
	wf_store(y, hit->point.y);
	wf_store(width, pixel);
	for (uint32_t left = wm_bits(m); left; left &= left - 1) {
		uint32_t i = lowest_bit(left);
		float white = board_white(&s->board, x[i], y[i], width[i]);

		shown[i] = mixf(SIM_PAPER_INK, SIM_PAPER_WHITE, white);
	}
	v = wf_load(shown);
	f->albedo = w3_choose(m, w3(v, v, v), f->albedo);
	f->tint = w3_choose(m, w3(zero, zero, zero), f->tint);
	f->specular = wf_choose(m, zero, f->specular);
	f->emission = wf_choose(m, zero, f->emission);
	f->clear = wf_choose(m, zero, f->clear);
	f->gloss_log2 = wu_choose(m, wu_of(0), f->gloss_log2);
	f->reflects = wm_less(f->reflects, m);
}

/* Finish of what lanes of `lanes` hit; their places must hold the filter's width. */
static void wide_surface_finish(const struct dio_sim_scene *s, const struct wide_hit *hit, wf pixel,
				wm lanes, struct wide_finish *f)
{
	wf zero = wf_of(0);
	wm paper = wm_none(), m;

	f->albedo = f->tint = w3(zero, zero, zero);
	f->specular = f->emission = f->clear = zero;
	f->gloss_log2 = wu_of(0);
	f->reflects = wm_none();
	if (s->paper_half_x > 0) {
		paper = wm_and(wf_lt(wf_abs(hit->point.z), wf_of(1e-4f)),
			       wf_gt(hit->normal.z, wf_of(0.99f)));
		paper = wm_and(paper, wf_lt(wf_abs(hit->point.x), wf_of(s->paper_half_x)));
		paper = wm_and(paper, wf_lt(wf_abs(hit->point.y), wf_of(s->paper_half_y)));
		paper = wm_and(paper, lanes);
		finish_paper(s, hit, pixel, paper, f);
	}
	for (uint32_t left = wm_bits(wm_less(lanes, paper)); left;) {
		const struct material *mat = material_of(s, next_owner(hit->owner, &left, &m));
		struct w3 c = wide_texture_colour(mat, &s->photos, &hit->place, m);

		f->albedo = w3_choose(m, c, f->albedo);
		f->tint = w3_choose(m, w3_of(mat->tint), f->tint);
		f->specular = wf_choose(m, wf_of(mat->specular), f->specular);
		f->emission = wf_choose(m, wf_of(mat->emission), f->emission);
		f->clear = wf_choose(m, wf_of(mat->clear), f->clear);
		f->gloss_log2 = wu_choose(m, wu_of(mat->gloss_log2), f->gloss_log2);
		if (mat->reflects)
			f->reflects = wm_or(f->reflects, m);
	}
}

static wf wide_ambient_open(const struct dio_sim_scene *s, const struct nearby *near, struct w3 p,
			    struct w3 n)
{
	wf open = wf_of(1), zero = wf_of(0), one = open;

	for (uint32_t k = 0; k < near->count; k++) {
		uint32_t i = near->thing[k];
		wf x = wf_of(s->mid_x[i]) - p.x, y = wf_of(s->mid_y[i]) - p.y,
		   z = wf_of(s->mid_z[i]) - p.z;
		wf dd = x * x + y * y + z * z + wf_of(1e-9f);
		wf toward = n.x * x + n.y * y + n.z * z;
		wf share = wf_min(wf_of(s->occluder2[i]) / dd, one) - wf_of(SIM_FAINT_SHADE);

		open *= one - wf_of(0.8f) * wf_max(share, zero) *
				      wf_clamp(toward / wf_sqrt(dd), zero, one);
	}
	return open;
}

static wf wide_highlight(struct w3 n, struct w3 half, const struct wide_finish *f)
{
	wf h = wf_max(w3_dot(n, half), wf_of(0)), power = wf_of(1);
	uint32_t gloss[LANES], most = 0;

	wu_store(gloss, f->gloss_log2);
	for (uint32_t i = 0; i < LANES; i++)
		most = gloss[i] > most ? gloss[i] : most;
	for (uint32_t i = 0; i < most; i++) {
		wm more = wf_lt(wf_of((float)i), wf_from(f->gloss_log2));

		h = wf_choose(more, h * h, h);
		power = wf_choose(more, power + power, power);
	}
	return f->specular * h * (power + wf_of(8)) * wf_of(0.08f);
}

/* What the surfaces of `lanes` send along their rays; lanes of `held` lie in the region of `near`,
 * the others anywhere. */
static void wide_surface_response(const struct dio_sim_scene *s, const struct wide_ray *r,
				  const struct wide_hit *hit, const struct wide_finish *f,
				  const struct asking *asking, const struct nearby *near, wm held,
				  wm lanes, struct wide_response *out)
{
	struct prim_set glass = set_of_clear(s);
	wf lift = wf_of(1e-4f) + wf_of(1e-4f) * hit->t, zero = wf_of(0), open;
	struct w3 p = w3_mad(hit->point, hit->normal, lift), n = hit->normal;
	bool glassy = !set_is_empty(&glass);
	wm shines = wf_gt(f->specular, zero), untold = wm_none();
	struct nearby all;
	uint32_t place = 1;

	if (!near || wm_any(wm_less(lanes, held))) {
		all = nearby_of(s, NULL);
		open = wide_ambient_open(s, &all, hit->point, n);
	} else {
		open = wide_ambient_open(s, near, hit->point, n);
	}
	out->gain = w3_mix(w3_of(s->ambient_down), w3_of(s->ambient_up),
			   wf_of(0.5f) + wf_of(0.5f) * n.z);
	out->gain = w3_scale(out->gain, open);
	out->plus = w3(zero, zero, zero);
	out->lamps = wu_of(0);
	for (uint32_t i = 0; i < s->light_count; i++, place *= 5) {
		const struct light *light = &s->light[i];
		struct w3 colour = w3_of(light->colour);
		struct lamp_rays l = {.from = p, .spread = r->spread, .owner = hit->owner};
		wf power = wf_of(1), cosine, seen;
		wm lit, dim;

		l.to = w3_of(light->at);
		l.limit = wf_of(SIM_FAR);
		l.size = wf_of(light->size);
		l.before = near ? &near->near->lamp[i] : NULL;
		l.held = held;
		if (!light->directional) {
			struct w3 v = w3_sub(l.to, p);
			wf dd = w3_dot(v, v);

			l.limit = wf_sqrt(dd);
			l.to = w3_scale(v, wf_of(1) / l.limit);
			power = wf_of(1) / (dd + wf_of(0.01f));
			l.size = l.size / l.limit;
		}
		cosine = w3_dot(n, l.to);
		lit = wm_less(lanes, wf_le(cosine, zero));
		if (!wm_any(lit))
			continue;
		seen = wide_lamp_seen(s, &l, asking, lit);
		lit = wm_less(lit, wf_le(seen, zero));
		out->lamps +=
			wu_choose(lit, wu_truncated(wf_of(4) * seen), wu_of(0)) * wu_of(place);
		power *= seen;
		if (glassy && wm_any(lit)) {
			dim = wide_lamp_behind_glass(s, &l, lit);
			power = wf_choose(dim, power * wf_of(SIM_GLASS_SHADOW), power);
			untold = wm_or(untold, dim);
		}
		out->gain = w3_choose(lit, w3_mad(out->gain, colour, power * cosine), out->gain);
		dim = wm_and(lit, shines);
		if (wm_any(dim)) {
			struct w3 half = w3_unit(w3_sub(l.to, r->along));
			wf glint = power * wide_highlight(n, half, f);

			out->plus = w3_choose(dim, w3_mad(out->plus, colour, glint), out->plus);
		}
	}
	out->gain = w3_add(out->gain, w3(f->emission, f->emission, f->emission));
	out->lamps = wu_choose(untold, wu_of(SIM_LAMPS_UNTOLD), out->lamps);
}

static inline struct w3 wide_response_to(const struct wide_response *r, struct w3 albedo)
{
	return w3_add(w3_mul(r->gain, albedo), r->plus);
}

static void wide_hit_finish(const struct dio_sim_scene *s, const struct wide_ray *r,
			    struct wide_hit *hit, wf pixel_angle, wm lanes, struct wide_finish *f)
{
	wf cosine = wf_abs(w3_dot(r->along, hit->normal));

	hit->place.width = pixel_angle * hit->t / wf_sqrt(wf_max(cosine, wf_of(0.1f)));
	wide_surface_finish(s, hit, pixel_angle * hit->t, lanes, f);
}

/* What rays that begin anywhere meet, and how it looks, for lanes of `lanes`. */
static struct w3 wide_mirrored(const struct dio_sim_scene *s, const struct wide_ray *r,
			       const struct wide_hit *hit, wf pixel_angle, wm lanes)
{
	const struct asking centre = {.centre = true};
	wf twice = wf_of(-2) * w3_dot(r->along, hit->normal), zero = wf_of(0);
	struct candidates c = {.count = 0};
	struct wide_response back;
	struct wide_beam beam;
	struct wide_finish f;
	struct wide_hit far;
	struct wide_ray m;
	struct w3 shown;

	m.along = w3_mad(r->along, hit->normal, twice);
	m.from = w3_mad(hit->point, hit->normal, wf_of(1e-4f) + wf_of(1e-4f) * hit->t);
	m.spread = r->spread;
	beam = wide_beam_of(m.from, m.along, wf_of(SIM_FAR), zero);
	add_of_beam(s, &beam, lanes, &c);
	remove_own(s, hit->owner, &c);
	wide_trace_nearest(s, &m, &c, lanes, &far);
	far.place.width = wf_of(3) * pixel_angle * (hit->t + far.t);
	wide_surface_finish(s, &far, far.place.width, far.met, &f);
	wide_surface_response(s, &m, &far, &f, &centre, NULL, wm_none(), far.met, &back);
	shown = wide_response_to(&back, f.albedo);
	if (wm_any(wm_less(lanes, far.met)))
		shown = w3_choose(far.met, shown, wide_sky_colour(s, m.along));
	return shown;
}

/* Light that comes straight through the clear surfaces of `lanes`. */
static struct w3 wide_seen_through(const struct dio_sim_scene *s, const struct wide_ray *r,
				   const struct wide_hit *hit, const struct wide_finish *glass,
				   wf pixel_angle, wm lanes)
{
	const struct asking centre = {.centre = true};
	wf zero = wf_of(0), one = wf_of(1), way = hit->t, solid;
	struct w3 sum = w3(zero, zero, zero), pass = w3_scale(glass->tint, glass->clear), more;
	struct wide_ray on = *r;

	for (int layer = 0; layer < SIM_GLASS_LAYERS && wm_any(lanes); layer++) {
		struct candidates c = {.count = 0};
		struct wide_response back;
		struct wide_finish f;
		struct wide_beam beam;
		struct wide_hit far;
		wm open;

		way += wf_of(1e-4f) + wf_of(1e-4f) * hit->t;
		on.from = w3_mad(r->from, r->along, way);
		beam = wide_beam_of(on.from, on.along, wf_of(SIM_FAR), zero);
		add_of_beam(s, &beam, lanes, &c);
		wide_trace_nearest(s, &on, &c, lanes, &far);
		open = wm_less(lanes, far.met);
		if (wm_any(open)) {
			more = w3_add(sum, w3_mul(pass, wide_sky_colour(s, on.along)));
			sum = w3_choose(open, more, sum);
		}
		lanes = far.met;
		way += far.t;
		wide_hit_finish(s, &on, &far, pixel_angle * way / wf_max(far.t, wf_of(1e-4f)),
				lanes, &f);
		wide_surface_response(s, &on, &far, &f, &centre, NULL, wm_none(), lanes, &back);
		solid = one - (layer + 1 < SIM_GLASS_LAYERS ? f.clear : zero);
		more = w3_scale(wide_response_to(&back, f.albedo), solid);
		sum = w3_choose(lanes, w3_add(sum, w3_mul(pass, more)), sum);
		lanes = wm_less(lanes, wf_ge(solid, one));
		pass = w3_mul(pass, w3_scale(f.tint, f.clear));
	}
	return sum;
}

static void wide_response_veil(struct wide_response *r, struct w3 shown, wf share, wm lanes)
{
	r->gain = w3_choose(lanes, w3_scale(r->gain, wf_of(1) - share), r->gain);
	r->plus = w3_choose(lanes, w3_mix(r->plus, shown, share), r->plus);
}

static void wide_add_passing(const struct dio_sim_scene *s, const struct wide_ray *r,
			     const struct wide_hit *hit, const struct wide_finish *f,
			     wf pixel_angle, wm lanes, struct wide_response *out)
{
	struct w3 through = wide_seen_through(s, r, hit, f, pixel_angle, lanes);

	out->gain = w3_choose(lanes, w3_scale(out->gain, wf_of(1) - f->clear), out->gain);
	out->plus = w3_choose(lanes, w3_add(out->plus, through), out->plus);
	out->lamps = wu_choose(lanes, wu_of(SIM_LAMPS_UNTOLD), out->lamps);
}

static void wide_add_reflection(const struct dio_sim_scene *s, const struct wide_ray *r,
				const struct wide_hit *hit, const struct wide_finish *f,
				wf pixel_angle, wm lanes, struct wide_response *out)
{
	wf one = wf_of(1), half = wf_of(0.5f);
	wf away = one - wf_saturate(-w3_dot(r->along, hit->normal)), a2 = away * away;
	wf fresnel = f->specular +
		     (one - f->specular) * a2 * a2 * away * wf_from(f->gloss_log2) * wf_of(0.1f);
	struct w3 shown = w3_mix(w3_of(s->ambient_down), w3_of(s->ambient_up),
				 wf_saturate(half + hit->normal.z));
	wm sharp = wm_and(wm_and(lanes, f->reflects), wf_gt(fresnel, wf_of(SIM_FAINT_MIRROR)));

	if (wm_any(sharp)) {
		shown = w3_choose(sharp, wide_mirrored(s, r, hit, pixel_angle, sharp), shown);
		out->lamps = wu_choose(sharp, wu_of(SIM_LAMPS_UNTOLD), out->lamps);
	}
	wide_response_veil(out, shown, wf_min(fresnel, one), lanes);
}

static void wide_fade_to_horizon(const struct dio_sim_scene *s, const struct wide_ray *r,
				 const struct wide_hit *hit, struct wide_response *out)
{
	wm ground = wu_eq(hit->id, wu_of(SIM_ID_GROUND));
	wf far = hit->t / wf_of(30 * s->extent);

	if (s->surround == SURROUND_ROOM || !wm_any(ground))
		return;
	far *= far;
	wide_response_veil(out, wide_sky_colour(s, w3(r->along.x, r->along.y, wf_of(0))),
			   far / (wf_of(1) + far), ground);
}

/* Light arriving along the rays of `lanes` from what they hit. */
static struct w3 wide_light_from(const struct dio_sim_scene *s, const struct wide_ray *r,
				 struct wide_hit *hit, float pixel_angle,
				 const struct asking *asking, const struct nearby *near, wm held,
				 wm lanes, struct wide_response *out)
{
	wf zero = wf_of(0), angle = wf_of(pixel_angle);
	wm met = wm_and(lanes, hit->met), sky = wm_less(lanes, hit->met), m;
	struct wide_finish f = {.specular = zero};
	struct w3 light;

	if (wm_any(met)) {
		wide_hit_finish(s, r, hit, angle, met, &f);
		wide_surface_response(s, r, hit, &f, asking, near, held, met, out);
		m = wm_and(met, wf_gt(f.clear, zero));
		if (wm_any(m))
			wide_add_passing(s, r, hit, &f, angle, m, out);
		m = wm_and(met, wf_gt(f.specular, zero));
		if (wm_any(m))
			wide_add_reflection(s, r, hit, &f, angle, m, out);
		wide_fade_to_horizon(s, r, hit, out);
		light = wide_response_to(out, f.albedo);
	} else {
		light = w3(zero, zero, zero);
		out->gain = out->plus = light;
		out->lamps = wu_of(0);
	}
	if (wm_any(sky)) {
		out->gain = w3_choose(sky, w3(zero, zero, zero), out->gain);
		out->plus = w3_choose(sky, wide_sky_colour(s, r->along), out->plus);
		out->lamps = wu_choose(sky, wu_of(SIM_LAMPS_UNTOLD), out->lamps);
		light = w3_choose(sky, out->plus, light);
	}
	return light;
}

#endif
