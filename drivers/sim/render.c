/* One picture: a ray through every pixel, more where neighbours differ. */
#include "render.h"

#include <stdlib.h>

#include "lens.h"
#include "shade.h"

enum { TILE = 8 };

/* Rectangle of pixels, x1 and y1 excluded. */
struct tile {
	uint32_t x0, y0, x1, y1;
	struct prim_set met;	   /* what its rays may meet */
	struct neighbourhood near; /* what may shade what they meet */
};

/* What all pixels of one picture share. */
struct picture {
	const struct dio_sim_scene *scene;
	const struct dio_sim_camera *camera;
	uint32_t samples;
	float pixel_angle;
	float *rgb;	   /* [height][width][3] linear */
	uint16_t *surface; /* [height][width] what the centre ray met, see trace.h */
	uint8_t *refine;   /* [height][width] REFINE_ bits */
	struct neighbourhood anywhere;
	struct tile *tiles;
	size_t tile_count;
};

/* What a tile may show: all that the cone around it touches. */
static struct prim_set tile_prims(const struct picture *p, const struct tile *t)
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

static void store(float *to, struct v3 c)
{
	to[0] = c.x;
	to[1] = c.y;
	to[2] = c.z;
}

/* Region that holds the points met, a little generous for rays beside the centres'. */
static struct neighbourhood tile_neighbourhood(const struct picture *p,
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
	return neighbourhood_of(p->scene, v3_sub(lo, room), v3_add(hi, room));
}

/* One ray through the centre of every pixel of a tile. */
static void first_pass(const struct picture *p, struct tile *t)
{
	struct scene_hit hits[TILE * TILE];
	struct ray rays[TILE * TILE];
	uint32_t n = 0;

	t->met = tile_prims(p, t);
	for (uint32_t y = t->y0; y < t->y1; y++) {
		for (uint32_t x = t->x0; x < t->x1; x++, n++) {
			struct lens_point q = lens_at(p->camera, x, y);

			rays[n] = lens_ray(p->camera, q.x, q.y);
			trace_nearest(p->scene, &rays[n], &t->met, &hits[n]);
		}
	}
	t->near = tile_neighbourhood(p, hits, n);
	n = 0;
	for (uint32_t y = t->y0; y < t->y1; y++) {
		for (uint32_t x = t->x0; x < t->x1; x++, n++) {
			size_t i = (size_t)y * p->camera->width + x;

			store(p->rgb + 3 * i, light_from(p->scene, &rays[n], &hits[n],
							 p->pixel_angle, 0, &t->near));
			p->surface[i] = (uint16_t)hits[n].id;
		}
	}
}

/* Why one ray is not enough for a pixel. */
enum {
	REFINE_OUTLINE = 1, /* a neighbour shows another surface */
	REFINE_INSIDE = 2,  /* the same surface changes: a shadow's edge, print */
};

/* A step that the eye or a corner detector would notice. */
static bool differs(const float *a, const float *b)
{
	for (int c = 0; c < 3; c++) {
		float u = minf(a[c], 1), v = minf(b[c], 1);

		if (absf(u - v) > 0.03f + 0.12f * maxf(u, v))
			return true;
	}
	return false;
}

/* Mark the pixels that differ from one of their eight neighbours. */
static void mark_steps(const struct picture *p)
{
	uint32_t w = p->camera->width, h = p->camera->height;

	for (uint32_t y = 0; y < h; y++) {
		for (uint32_t x = 0; x < w; x++) {
			size_t i = (size_t)y * w + x;
			/* Half of the neighbours; the others look at this pixel themselves. */
			const size_t next[4] = {i + 1, i + w - 1, i + w, i + w + 1};
			const bool there[4] = {x + 1 < w, y + 1 < h && x > 0, y + 1 < h,
					       y + 1 < h && x + 1 < w};

			for (int k = 0; k < 4; k++) {
				size_t j = next[k];
				uint8_t why = 0;

				if (!there[k])
					continue;
				if (p->surface[i] != p->surface[j])
					why = REFINE_OUTLINE;
				else if (differs(p->rgb + 3 * i, p->rgb + 3 * j))
					why = REFINE_INSIDE;
				p->refine[i] |= why;
				p->refine[j] |= why;
			}
		}
	}
}

/* Colours of the surfaces that a pixel on an outline shows; each is worked out once. */
enum { PALETTE_SIZE = 4 };

struct palette {
	uint32_t count;
	uint16_t surface[PALETTE_SIZE];
	struct v3 colour[PALETTE_SIZE];
};

static struct v3 sample_light(const struct picture *p, const struct tile *t, const struct ray *r,
			      uint32_t turn, struct palette *known)
{
	const struct neighbourhood *near = &t->near;
	struct scene_hit hit;
	struct v3 c;

	trace_nearest(p->scene, r, &t->met, &hit);
	for (uint32_t i = 0; known && i < known->count; i++)
		if (known->surface[i] == (uint16_t)hit.id)
			return known->colour[i];
	if (hit.material && !neighbourhood_holds(near, hit.point))
		near = &p->anywhere;
	c = light_from(p->scene, r, &hit, p->pixel_angle / (float)p->samples, turn, near);
	/* A glint must not outweigh the rest of the pixel: the sensor clips later. */
	c = v3(minf(c.x, 2), minf(c.y, 2), minf(c.z, 2));
	if (known && known->count < PALETTE_SIZE) {
		known->surface[known->count] = (uint16_t)hit.id;
		known->colour[known->count++] = c;
	}
	return c;
}

/* Mean over a grid of samples x samples rays. */
static struct v3 sample_pixel(const struct picture *p, const struct tile *t, uint32_t x, uint32_t y)
{
	struct lens_point q = lens_at(p->camera, x, y);
	size_t i = (size_t)y * p->camera->width + x;
	bool outline_only = p->refine[i] == REFINE_OUTLINE;
	uint32_t n = p->samples;
	struct v3 sum = v3(0, 0, 0);
	struct palette known;

	known.count = 1;
	known.surface[0] = p->surface[i];
	known.colour[0] =
		v3(minf(p->rgb[3 * i], 2), minf(p->rgb[3 * i + 1], 2), minf(p->rgb[3 * i + 2], 2));
	for (uint32_t k = 0; k < n * n; k++) {
		double du = (k % n + 0.5) / n - 0.5, dv = (k / n + 0.5) / n - 0.5;
		struct ray r = lens_ray(p->camera, q.x + q.dx_du * du + q.dx_dv * dv,
					q.y + q.dy_du * du + q.dy_dv * dv);

		sum = v3_add(sum, sample_light(p, t, &r, k, outline_only ? &known : NULL));
	}
	return v3_scale(sum, 1 / (float)(n * n));
}

static void second_pass(const struct picture *p, const struct tile *t)
{
	for (uint32_t y = t->y0; y < t->y1; y++) {
		for (uint32_t x = t->x0; x < t->x1; x++) {
			size_t i = (size_t)y * p->camera->width + x;

			if (p->refine[i])
				store(p->rgb + 3 * i, sample_pixel(p, t, x, y));
		}
	}
}

static void cut_tiles(struct picture *p)
{
	uint32_t w = p->camera->width, h = p->camera->height;
	struct tile *t = p->tiles;

	for (uint32_t y = 0; y < h; y += TILE) {
		for (uint32_t x = 0; x < w; x += TILE, t++) {
			t->x0 = x;
			t->y0 = y;
			t->x1 = x + TILE < w ? x + TILE : w;
			t->y1 = y + TILE < h ? y + TILE : h;
		}
	}
}

bool sim_render_linear(const struct dio_sim_scene *scene, const struct dio_sim_camera *camera,
		       uint32_t samples, float *rgb)
{
	size_t across = (camera->width + TILE - 1) / TILE,
	       down = (camera->height + TILE - 1) / TILE;
	size_t pixels = (size_t)camera->width * camera->height;
	struct picture p;
	bool ok;

	p.scene = scene;
	p.camera = camera;
	p.samples = samples < 1 ? 1 : samples > 8 ? 8 : samples;
	p.pixel_angle = (float)(1 / camera->fx);
	p.rgb = rgb;
	p.anywhere = neighbourhood_anywhere(scene);
	p.tile_count = across * down;
	p.tiles = calloc(p.tile_count, sizeof(*p.tiles));
	p.surface = malloc(pixels * sizeof(*p.surface));
	p.refine = calloc(pixels, sizeof(*p.refine));
	ok = p.tiles && p.surface && p.refine;
	if (ok) {
		cut_tiles(&p);
		for (size_t i = 0; i < p.tile_count; i++)
			first_pass(&p, &p.tiles[i]);
		if (p.samples > 1) {
			mark_steps(&p);
			for (size_t i = 0; i < p.tile_count; i++)
				second_pass(&p, &p.tiles[i]);
		}
	}
	free(p.tiles);
	free(p.surface);
	free(p.refine);
	return ok;
}
