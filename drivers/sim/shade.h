/* Light on a surface: lamps with soft shadows, ambient light with occlusion, highlights and one
 * mirrored bounce. All colours linear. */
#ifndef DIO_SIM_SHADE_H
#define DIO_SIM_SHADE_H

#include "board.h"
#include "trace.h"

#define SIM_PAPER_WHITE 0.80f
#define SIM_PAPER_INK	0.035f

/* How a surface answers to light at one point. */
struct finish {
	struct v3 albedo;
	float specular, emission;
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
		f.specular = f.emission = 0;
		f.gloss_log2 = 0;
		f.reflects = false;
		return f;
	}
	f.albedo = texture_colour(m, &hit->place);
	f.specular = m->specular;
	f.emission = m->emission;
	f.gloss_log2 = m->gloss_log2;
	f.reflects = m->reflects;
	return f;
}

/* Share of the sky that the things around leave open: each counts as a ball (Quilez, "sphere
 * ambient occlusion": cosine times the ball's share of the hemisphere). */
DIO_SIM_FN float ambient_open(const struct dio_sim_scene *s, struct v3 p, struct v3 n)
{
	float open = 1;

	for (uint32_t i = 0; i < s->thing_count; i++) {
		struct v3 v = v3(s->bound_x[i] - p.x, s->bound_y[i] - p.y, s->bound_z[i] - p.z);
		float dd = v3_dot(v, v) + 1e-9f, r = s->occluder_r[i], rr = r * r;
		float cosine = v3_dot(n, v) / sqrtf(dd);

		open *= 1 - 0.8f * saturate(cosine) * minf(rr / dd, 1);
	}
	return open;
}

/* Share of the lamp seen. The places on its disc turn from pixel to pixel in a 2 x 2 pattern. */
DIO_SIM_FN float lamp_seen(const struct dio_sim_scene *s, struct v3 from, struct v3 to, float limit,
			   float size, uint32_t dither, bool rough)
{
	static const float place_x[8] = {0.35f, -0.71f, 0.35f, -0.21f, -0.43f, 0.84f, -0.16f, 0.1f};
	static const float place_y[8] = {0.1f, 0.43f, -0.84f, -0.35f, 0.22f, 0.38f, 0.92f, 0.5f};
	uint64_t mask = things_touched(s, from, to, limit, size);
	struct ray r;
	struct v3 u, v;
	uint32_t seen = 0;

	if (!mask)
		return 1;
	r.from = from;
	r.along = to;
	if (rough || size < 0.004f)
		return trace_blocked(s, &r, mask, limit) ? 0 : 1;
	u = v3_unit(v3_cross(to, absf(to.z) < 0.9f ? v3(0, 0, 1) : v3(1, 0, 0)));
	v = v3_cross(to, u);
	for (uint32_t i = 0; i < 4; i++) {
		uint32_t k = (2 * i + (dither & 1)) & 7;
		float x = size * place_x[k], y = size * (dither & 2 ? -place_y[k] : place_y[k]);

		r.along = v3_unit(v3_mad(v3_mad(to, u, x), v, y));
		seen += !trace_blocked(s, &r, mask, limit);
	}
	return 0.25f * (float)seen;
}

DIO_SIM_FN float highlight(struct v3 n, struct v3 half, const struct finish *f)
{
	float h = maxf(v3_dot(n, half), 0);

	for (uint32_t i = 0; i < f->gloss_log2; i++)
		h *= h;
	return f->specular * h * ((float)(1u << f->gloss_log2) + 8) * 0.08f;
}

/* `rough`: as seen in a mirror, hard shadows are good enough. */
DIO_SIM_FN struct v3 shade_surface(const struct dio_sim_scene *s, const struct ray *r,
				   const struct scene_hit *hit, const struct finish *f,
				   uint32_t dither, bool rough)
{
	struct v3 p = v3_mad(hit->point, hit->normal, 1e-4f + 1e-4f * hit->t), n = hit->normal, sum;

	sum = v3_mix(s->ambient_down, s->ambient_up, 0.5f + 0.5f * n.z);
	sum = v3_mul(v3_scale(sum, ambient_open(s, hit->point, n)), f->albedo);
	for (uint32_t i = 0; i < s->light_count; i++) {
		const struct light *light = &s->light[i];
		struct v3 to = light->at;
		float limit = SIM_FAR, power = 1, size = light->size, cosine;

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
		power *= lamp_seen(s, p, to, limit, size, dither, rough);
		if (power > 0) {
			struct v3 half = v3_unit(v3_sub(to, r->along));
			float shine = f->specular > 0 ? highlight(n, half, f) : 0;
			struct v3 back = v3_scale(f->albedo, cosine);

			back = v3_add(back, v3(shine, shine, shine));
			sum = v3_add(sum, v3_mul(v3_scale(light->colour, power), back));
		}
	}
	return v3_mad(sum, f->albedo, f->emission);
}

/* Pixel size on the surface: between the narrow and the drawn-out side of its footprint. */
DIO_SIM_FN float footprint(const struct ray *r, const struct scene_hit *hit, float pixel_angle)
{
	float cosine = absf(v3_dot(r->along, hit->normal));

	return pixel_angle * hit->t / sqrtf(maxf(cosine, 0.1f));
}

/* What a mirror shows. */
DIO_SIM_FN struct v3 mirrored(const struct dio_sim_scene *s, const struct ray *r,
			      const struct scene_hit *hit, float pixel_angle)
{
	struct scene_hit far;
	struct finish f;
	struct ray m;

	m.along = v3_mad(r->along, hit->normal, -2 * v3_dot(r->along, hit->normal));
	m.from = v3_mad(hit->point, hit->normal, 1e-4f + 1e-4f * hit->t);
	trace_nearest(s, &m, things_touched(s, m.from, m.along, SIM_FAR, 0), &far);
	if (!far.material)
		return sky_colour(s, m.along);
	/* The mirror may be curved, so what it shows is filtered more. */
	far.place.width = 3 * pixel_angle * (hit->t + far.t);
	f = surface_finish(s, &far, far.place.width);
	return shade_surface(s, &m, &far, &f, 0, true);
}

DIO_SIM_FN struct v3 fade_to_horizon(const struct dio_sim_scene *s, const struct ray *r,
				     const struct scene_hit *hit, struct v3 c)
{
	float far = hit->t / (30 * s->extent);

	if (hit->id != SIM_ID_GROUND || s->surround == SURROUND_ROOM)
		return c;
	far *= far;
	return v3_mix(c, sky_colour(s, v3(r->along.x, r->along.y, 0)), far / (1 + far));
}

/* Light arriving along a ray; `mask`: things it may meet; `pixel_angle`: its spread. */
DIO_SIM_FN struct v3 trace_light(const struct dio_sim_scene *s, const struct ray *r, uint64_t mask,
				 float pixel_angle, uint32_t dither, uint32_t *id)
{
	struct scene_hit hit;
	struct finish f;
	struct v3 c;

	trace_nearest(s, r, mask, &hit);
	*id = hit.id;
	if (!hit.material)
		return sky_colour(s, r->along);
	hit.place.width = footprint(r, &hit, pixel_angle);
	f = surface_finish(s, &hit, pixel_angle * hit.t);
	c = shade_surface(s, r, &hit, &f, dither, false);
	if (f.specular > 0) {
		float away = 1 - saturate(-v3_dot(r->along, hit.normal)), a2 = away * away;
		float fresnel =
			f.specular + (1 - f.specular) * a2 * a2 * away * (float)f.gloss_log2 * 0.1f;
		struct v3 shown;

		if (f.reflects)
			shown = mirrored(s, r, &hit, pixel_angle);
		else
			shown = v3_mix(s->ambient_down, s->ambient_up,
				       saturate(0.5f + hit.normal.z));
		c = v3_mix(c, shown, minf(fresnel, 1));
	}
	return fade_to_horizon(s, r, &hit, c);
}

#endif
