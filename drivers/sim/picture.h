/* One picture in pieces that any processor can work on side by side: tiles get what their rays may
 * meet, every pixel its first ray, then those that differ from a neighbour get more. */
#ifndef DIO_SIM_PICTURE_H
#define DIO_SIM_PICTURE_H

#include "lens.h"
#include "shade.h"

enum { SIM_TILE = 8 };

/* Rectangle of pixels, x1 and y1 excluded. */
struct tile {
	uint32_t x0, y0, x1, y1;
	struct prim_set met;       /* what its rays may meet */
	struct neighbourhood near; /* what may shade what they meet */
};

/* What all pixels of one picture share. */
struct picture {
	const struct dio_sim_scene *scene;
	const struct dio_sim_camera *camera;
	uint32_t samples;
	float pixel_angle;
	float *rgb;                /* [height][width][3] linear */
	uint16_t *surface;         /* [height][width] what the centre ray met, see trace.h */
	struct response *response; /* [height][width] of the centre ray */
	uint8_t *refine;           /* [height][width] REFINE_ bits */
	struct tile *tiles;        /* [picture_tiles()] */
};

DIO_SIM_FN uint32_t picture_tiles_across(const struct dio_sim_camera *camera)
{
	return (camera->width + SIM_TILE - 1) / SIM_TILE;
}

DIO_SIM_FN uint32_t picture_tiles(const struct dio_sim_camera *camera)
{
	return picture_tiles_across(camera) * ((camera->height + SIM_TILE - 1) / SIM_TILE);
}

DIO_SIM_FN void picture_init(struct picture *p, const struct dio_sim_scene *scene,
			     const struct dio_sim_camera *camera, uint32_t samples)
{
	p->scene = scene;
	p->camera = camera;
	p->samples = samples < 1 ? 1 : samples > 8 ? 8 : samples;
	p->pixel_angle = (float)(1 / camera->fx);
}

/* What a tile may show: all that the cone around it touches. */
DIO_SIM_FN struct prim_set tile_prims(const struct picture *p, const struct tile *t)
{
	const struct dio_sim_camera *cam = p->camera;
	struct lens_point mid =
		lens_at(cam, 0.5 * (t->x0 + t->x1 - 1.0), 0.5 * (t->y0 + t->y1 - 1.0));
	struct ray axis = lens_ray(cam, mid.x, mid.y);
	struct beam cone;
	float widest = 1, slope;

	for (int i = 0; i < 4; i++) {
		struct lens_point q = lens_at(cam, i & 1 ? t->x1 - 0.5 : t->x0 - 0.5,
					      i & 2 ? t->y1 - 0.5 : t->y0 - 0.5);

		widest = minf(widest, v3_dot(axis.along, lens_ray(cam, q.x, q.y).along));
	}
	/* A tenth more for the bend of a distorted edge. */
	slope = 1.1f * sqrtf(maxf(1 - widest * widest, 0)) / maxf(widest, 0.1f) + 1e-4f;
	cone = beam_of(axis.from, axis.along, SIM_FAR, 0, slope);
	return set_of_beam(p->scene, &cone);
}

/* Place of a tile and what its rays may meet. */
DIO_SIM_FN void tile_begin(const struct picture *p, uint32_t index, struct tile *t)
{
	uint32_t across = picture_tiles_across(p->camera);

	t->x0 = index % across * SIM_TILE;
	t->y0 = index / across * SIM_TILE;
	t->x1 = t->x0 + SIM_TILE < p->camera->width ? t->x0 + SIM_TILE : p->camera->width;
	t->y1 = t->y0 + SIM_TILE < p->camera->height ? t->y0 + SIM_TILE : p->camera->height;
	t->met = tile_prims(p, t);
}

/* The ray through a pixel's centre and what it meets. */
DIO_SIM_FN void pixel_meet(const struct picture *p, const struct tile *t, uint32_t x, uint32_t y,
			   struct ray *ray, struct scene_hit *hit)
{
	struct lens_point q = lens_at(p->camera, x, y);

	*ray = lens_ray(p->camera, q.x, q.y);
	trace_nearest(p->scene, ray, &t->met, hit);
}

/* What may shade the points that a tile's rays met: all of them, in any order. The region is a
 * little generous, for rays beside the centres'. */
DIO_SIM_FN void tile_look_round(const struct picture *p, struct tile *t,
				const struct scene_hit *hits, uint32_t count)
{
	struct v3 lo = v3(SIM_FAR, SIM_FAR, SIM_FAR), hi = v3_scale(lo, -1), room;

	for (uint32_t i = 0; i < count; i++) {
		struct v3 q = hits[i].point;

		if (!hits[i].material)
			continue;
		lo = v3(minf(lo.x, q.x), minf(lo.y, q.y), minf(lo.z, q.z));
		hi = v3(maxf(hi.x, q.x), maxf(hi.y, q.y), maxf(hi.z, q.z));
	}
	if (lo.x > hi.x) /* nothing but sky */
		lo = hi = v3(0, 0, 0);
	room = v3_scale(v3_sub(hi, lo), 0.1f);
	room = v3_add(room, v3(1e-4f, 1e-4f, 1e-4f));
	t->near = neighbourhood_of(p->scene, v3_sub(lo, room), v3_add(hi, room));
}

DIO_SIM_FN void store(float *to, struct v3 c)
{
	to[0] = c.x;
	to[1] = c.y;
	to[2] = c.z;
}

/* The light that a pixel's first ray brings. */
DIO_SIM_FN void pixel_light(const struct picture *p, const struct tile *t, uint32_t x, uint32_t y,
			    const struct ray *ray, struct scene_hit *hit)
{
	size_t i = (size_t)y * p->camera->width + x;

	store(p->rgb + 3 * i, light_from(p->scene, ray, hit, p->pixel_angle, SIM_LAMP_ALL, &t->near,
					 &p->response[i]));
	p->surface[i] = (uint16_t)hit->id;
}

/* Why one ray is not enough for a pixel. */
enum {
	REFINE_OUTLINE = 1, /* a neighbour shows another surface */
	REFINE_LIGHT = 2,   /* the same surface changes: a shadow's edge, a reflection */
	REFINE_PRINT = 4,   /* the same surface in the same light changes: its texture */
};

/* A step in one channel that the eye or a corner detector would notice. */
DIO_SIM_FN bool values_differ(float a, float b)
{
	float u = minf(a, 1), v = minf(b, 1);

	return absf(u - v) > 0.03f + 0.12f * maxf(u, v);
}

/* Of two neighbours: REFINE_ bits. Those at a corner are asked about outlines only: other steps
 * between them show beside one of the two as well. */
DIO_SIM_FN uint8_t step_between(const struct picture *p, size_t i, size_t j, bool differ)
{
	uint8_t lamps = p->response[i].lamps;

	if (p->surface[i] != p->surface[j])
		return REFINE_OUTLINE;
	if (!differ)
		return 0;
	return lamps == p->response[j].lamps && lamps != SIM_LAMPS_UNTOLD ? REFINE_PRINT
									  : REFINE_LIGHT;
}

DIO_SIM_FN bool pixels_differ(const struct picture *p, size_t i, size_t j)
{
	const float *a = p->rgb + 3 * i, *b = p->rgb + 3 * j;

	return values_differ(a[0], b[0]) || values_differ(a[1], b[1]) || values_differ(a[2], b[2]);
}

/* REFINE_ bits of a pixel, from its eight neighbours. */
DIO_SIM_FN uint8_t pixel_steps(const struct picture *p, uint32_t x, uint32_t y)
{
	uint32_t w = p->camera->width, h = p->camera->height;
	size_t i = (size_t)y * w + x;
	uint8_t why = 0;

	for (uint32_t k = 0; k < 9; k++) {
		uint32_t u = x + k % 3 - 1, v = y + k / 3 - 1; /* wraps below 0, past the sides */
		size_t j = (size_t)v * w + u;

		if (k != 4 && u < w && v < h)
			why |= step_between(p, i, j, k % 2 && pixels_differ(p, i, j));
	}
	return why;
}

/* What a pixel and its neighbours show: nearly all that rays within the pixel can meet. */
enum { AROUND_MAX = 9 };

struct around {
	struct prim_set prims;
	uint32_t count;
	uint16_t surface[AROUND_MAX];
	size_t shown_by[AROUND_MAX]; /* a pixel, its own if possible */
	bool known[AROUND_MAX];
	struct v3 colour[AROUND_MAX]; /* where known */
};

DIO_SIM_FN void around_add(const struct picture *p, struct around *a, size_t pixel)
{
	uint16_t surface = p->surface[pixel];

	for (uint32_t i = 0; i < a->count; i++)
		if (a->surface[i] == surface)
			return;
	a->surface[a->count] = surface;
	a->shown_by[a->count] = pixel;
	a->known[a->count++] = false;
	if (surface >= SIM_ID_PRIM)
		set_add(&a->prims, (surface - SIM_ID_PRIM) / 4u);
}

DIO_SIM_FN void look_around(const struct picture *p, uint32_t x, uint32_t y, struct around *a)
{
	size_t width = p->camera->width, here = y * width + x;
	uint32_t x0 = x > 0 ? x - 1 : 0, x1 = x + 1 < width ? x + 1 : x;
	uint32_t y0 = y > 0 ? y - 1 : 0, y1 = y + 1 < p->camera->height ? y + 1 : y;

	a->prims = set_of_none();
	a->count = 0;
	around_add(p, a, here);
	if (!(p->refine[here] & REFINE_OUTLINE)) /* one surface all around */
		return;
	for (uint32_t v = y0; v <= y1; v++)
		for (uint32_t u = x0; u <= x1; u++)
			around_add(p, a, v * width + u);
}

/* Light along one of a pixel's rays: worked out anew where shadows or reflections change, else
 * in the light that the neighbour's ray met on the same surface. */
DIO_SIM_FN struct v3 sample_light(const struct picture *p, const struct tile *t,
				  const struct ray *r, uint32_t turn, uint8_t refine,
				  struct around *a)
{
	float pixel_angle = p->pixel_angle / (float)p->samples;
	const struct neighbourhood *near = &t->near;
	struct response response;
	struct scene_hit hit;
	struct finish f;
	uint32_t i = 0;
	struct v3 c;

	trace_nearest(p->scene, r, &a->prims, &hit);
	while (i < a->count && a->surface[i] != (uint16_t)hit.id)
		i++;
	if (refine & REFINE_LIGHT || i == a->count || !hit.material) {
		if (hit.material && !neighbourhood_holds(near, hit.point))
			near = NULL;
		c = light_from(p->scene, r, &hit, pixel_angle, turn, near, &response);
	} else if (a->known[i] && !(refine & REFINE_PRINT)) {
		return a->colour[i];
	} else {
		f = hit_finish(p->scene, r, &hit, pixel_angle);
		c = response_to(&p->response[a->shown_by[i]], f.albedo);
	}
	/* A glint must not outweigh the rest of the pixel: the sensor clips later. */
	c = v3(minf(c.x, 2), minf(c.y, 2), minf(c.z, 2));
	if (i < a->count) {
		a->colour[i] = c;
		a->known[i] = true;
	}
	return c;
}

/* A pixel that differs from a neighbour: the mean over a grid of samples x samples rays. */
DIO_SIM_FN void pixel_refine(const struct picture *p, const struct tile *t, uint32_t x, uint32_t y)
{
	struct lens_point q = lens_at(p->camera, x, y);
	size_t i = (size_t)y * p->camera->width + x;
	uint32_t n = p->samples, taken = 0;
	/* Textures are filtered already: every second place will do. */
	bool half = p->refine[i] == REFINE_PRINT;
	struct v3 sum = v3(0, 0, 0);
	struct around around;

	look_around(p, x, y, &around);
	around.colour[0] = v3(p->rgb[3 * i], p->rgb[3 * i + 1], p->rgb[3 * i + 2]);
	around.known[0] = true;
	for (uint32_t k = 0; k < n * n; k++) {
		double du = (k % n + 0.5) / n - 0.5, dv = (k / n + 0.5) / n - 0.5;
		struct ray r;

		if (half && (k % n + k / n) % 2)
			continue;
		taken++;
		r = lens_ray(p->camera, q.x + q.dx_du * du + q.dx_dv * dv,
			     q.y + q.dy_du * du + q.dy_dv * dv);

		sum = v3_add(sum, sample_light(p, t, &r, k, p->refine[i], &around));
	}
	store(p->rgb + 3 * i, v3_scale(sum, 1 / (float)taken));
}

#endif
