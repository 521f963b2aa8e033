/* One picture: a ray through every pixel, more where neighbours differ. */
#include "render.h"

#include <stdlib.h>
#include <string.h>

#include "lens.h"
#include "shade.h"

enum { TILE = 8 };

/* What all pixels of one picture share. */
struct picture {
	const struct dio_sim_scene *scene;
	const struct dio_sim_camera *camera;
	uint32_t samples;
	float pixel_angle;
	float *rgb;   /* [height][width][3] linear */
	uint16_t *id; /* [height][width] surface seen by the centre ray */
};

/* Things that a tile may show: those whose bounding sphere meets the cone around it. */
static uint64_t tile_things(const struct picture *p, uint32_t x0, uint32_t y0, uint32_t x1,
			    uint32_t y1)
{
	const struct dio_sim_camera *cam = p->camera;
	struct lens_point mid = lens_at(cam, 0.5 * (x0 + x1 - 1.0), 0.5 * (y0 + y1 - 1.0));
	struct ray axis = lens_ray(cam, mid.x, mid.y);
	float widest = 1;

	for (int i = 0; i < 4; i++) {
		struct lens_point q =
			lens_at(cam, i & 1 ? x1 - 0.5 : x0 - 0.5, i & 2 ? y1 - 0.5 : y0 - 0.5);
		float c = v3_dot(axis.along, lens_ray(cam, q.x, q.y).along);

		widest = minf(widest, c);
	}
	/* A tenth more for the bend of a distorted edge. */
	return things_touched(p->scene, axis.from, axis.along, SIM_FAR,
			      1.1f * sqrtf(maxf(1 - widest * widest, 0)) / maxf(widest, 0.1f));
}

static uint32_t dither_of(uint32_t x, uint32_t y)
{
	return (x & 1) | (y & 1) << 1;
}

static void store(float *to, struct v3 c)
{
	to[0] = c.x;
	to[1] = c.y;
	to[2] = c.z;
}

static void first_pass(const struct picture *p, uint32_t x0, uint32_t y0, uint32_t x1, uint32_t y1)
{
	uint64_t mask = tile_things(p, x0, y0, x1, y1);

	for (uint32_t y = y0; y < y1; y++) {
		for (uint32_t x = x0; x < x1; x++) {
			size_t i = (size_t)y * p->camera->width + x;
			struct lens_point q = lens_at(p->camera, x, y);
			struct ray r = lens_ray(p->camera, q.x, q.y);
			uint32_t id;

			store(p->rgb + 3 * i, trace_light(p->scene, &r, mask, p->pixel_angle,
							  dither_of(x, y), &id));
			p->id[i] = (uint16_t)id;
		}
	}
}

/* Steps that the eye or a corner detector would notice, judged on the encoded curve. */
static bool differs(const float *a, const float *b)
{
	for (int k = 0; k < 3; k++) {
		float u = minf(a[k], 1), v = minf(b[k], 1);

		if (absf(u - v) > 0.03f + 0.12f * maxf(u, v))
			return true;
	}
	return false;
}

static bool needs_more(const struct picture *p, uint32_t x, uint32_t y)
{
	uint32_t w = p->camera->width, h = p->camera->height;
	uint32_t left = x > 0 ? x - 1 : x, right = x + 1 < w ? x + 1 : x;
	uint32_t up = y > 0 ? y - 1 : y, down = y + 1 < h ? y + 1 : y;
	size_t i = (size_t)y * w + x;

	for (uint32_t v = up; v <= down; v++) {
		for (uint32_t u = left; u <= right; u++) {
			size_t k = (size_t)v * w + u;

			if (p->id[k] != p->id[i] || differs(p->rgb + 3 * k, p->rgb + 3 * i))
				return true;
		}
	}
	return false;
}

/* Mean over a grid of samples x samples rays. */
static struct v3 sample_pixel(const struct picture *p, uint32_t x, uint32_t y, uint64_t mask)
{
	struct lens_point q = lens_at(p->camera, x, y);
	uint32_t n = p->samples;
	struct v3 sum = v3(0, 0, 0);

	for (uint32_t k = 0; k < n * n; k++) {
		double du = (k % n + 0.5) / n - 0.5, dv = (k / n + 0.5) / n - 0.5;
		struct ray r = lens_ray(p->camera, q.x + q.dx_du * du + q.dx_dv * dv,
					q.y + q.dy_du * du + q.dy_dv * dv);
		uint32_t id;
		struct v3 c = trace_light(p->scene, &r, mask, p->pixel_angle / (float)n,
					  dither_of(x, y) ^ (k & 3), &id);

		/* A glint must not outweigh the rest of the pixel: the sensor clips later. */
		sum = v3_add(sum, v3(minf(c.x, 2), minf(c.y, 2), minf(c.z, 2)));
	}
	return v3_scale(sum, 1 / (float)(n * n));
}

/* Refined colours go to `fine` so that every decision sees first-pass neighbours only. */
static void second_pass(const struct picture *p, float *fine)
{
	uint32_t w = p->camera->width, h = p->camera->height;

	for (uint32_t y0 = 0; y0 < h; y0 += TILE) {
		for (uint32_t x0 = 0; x0 < w; x0 += TILE) {
			uint32_t x1 = x0 + TILE < w ? x0 + TILE : w;
			uint32_t y1 = y0 + TILE < h ? y0 + TILE : h;
			uint64_t mask = tile_things(p, x0, y0, x1, y1);

			for (uint32_t y = y0; y < y1; y++) {
				for (uint32_t x = x0; x < x1; x++) {
					size_t i = (size_t)y * w + x;

					if (needs_more(p, x, y))
						store(fine + 3 * i, sample_pixel(p, x, y, mask));
				}
			}
		}
	}
}

bool sim_render_linear(const struct dio_sim_scene *scene, const struct dio_sim_camera *camera,
		       uint32_t samples, float *rgb)
{
	uint32_t w = camera->width, h = camera->height;
	size_t pixels = (size_t)w * h;
	struct picture p;

	p.scene = scene;
	p.camera = camera;
	p.samples = samples < 1 ? 1 : samples > 8 ? 8 : samples;
	p.pixel_angle = (float)(1 / camera->fx);
	p.rgb = p.samples > 1 ? malloc(pixels * 3 * sizeof(float)) : rgb;
	p.id = malloc(pixels * sizeof(uint16_t));
	if (!p.rgb || !p.id) {
		if (p.rgb != rgb)
			free(p.rgb);
		free(p.id);
		return false;
	}
	for (uint32_t y = 0; y < h; y += TILE)
		for (uint32_t x = 0; x < w; x += TILE)
			first_pass(&p, x, y, x + TILE < w ? x + TILE : w,
				   y + TILE < h ? y + TILE : h);
	if (p.rgb != rgb) {
		memcpy(rgb, p.rgb, pixels * 3 * sizeof(float));
		second_pass(&p, rgb);
		free(p.rgb);
	}
	free(p.id);
	return true;
}
