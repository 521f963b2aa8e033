/* One picture by one thread, tile by tile. Compiled once for each kind of processor; SIM_RENDER
 * names the function that comes of it. Every operation is rounded alike, so the pictures have the
 * same bits. */
#include "render.h"

#include <stdlib.h>

#include "picture.h"

/* One ray through the centre of every pixel of a tile. */
static void first_pass(const struct picture *p, uint32_t index)
{
	struct scene_hit hits[SIM_TILE * SIM_TILE];
	struct ray rays[SIM_TILE * SIM_TILE];
	struct tile *t = &p->tiles[index];
	uint32_t n = 0;

	tile_begin(p, index, t);
	for (uint32_t y = t->y0; y < t->y1; y++)
		for (uint32_t x = t->x0; x < t->x1; x++, n++)
			pixel_meet(p, t, x, y, &rays[n], &hits[n]);
	tile_look_round(p, t, hits, n);
	n = 0;
	for (uint32_t y = t->y0; y < t->y1; y++)
		for (uint32_t x = t->x0; x < t->x1; x++, n++)
			pixel_light(p, t, x, y, &rays[n], &hits[n]);
}

static void mark_steps(const struct picture *p)
{
	for (uint32_t y = 0; y < p->camera->height; y++)
		for (uint32_t x = 0; x < p->camera->width; x++)
			p->refine[(size_t)y * p->camera->width + x] = pixel_steps(p, x, y);
}

static void second_pass(const struct picture *p, const struct tile *t)
{
	for (uint32_t y = t->y0; y < t->y1; y++)
		for (uint32_t x = t->x0; x < t->x1; x++)
			if (p->refine[(size_t)y * p->camera->width + x])
				pixel_refine(p, t, x, y);
}

bool SIM_RENDER(const struct dio_sim_scene *scene, const struct dio_sim_camera *camera,
		uint32_t samples, float *rgb)
{
	size_t pixels = (size_t)camera->width * camera->height;
	uint32_t tiles = picture_tiles(camera);
	struct picture p;
	bool ok;

	picture_init(&p, scene, camera, samples);
	p.rgb = rgb;
	p.tiles = malloc(tiles * sizeof(*p.tiles));
	p.surface = malloc(pixels * sizeof(*p.surface));
	p.response = malloc(pixels * sizeof(*p.response));
	p.refine = malloc(pixels * sizeof(*p.refine));
	ok = p.tiles && p.surface && p.response && p.refine;
	if (ok) {
		for (uint32_t i = 0; i < tiles; i++)
			first_pass(&p, i);
		if (p.samples > 1) {
			mark_steps(&p);
			for (uint32_t i = 0; i < tiles; i++)
				second_pass(&p, &p.tiles[i]);
		}
	}
	free(p.tiles);
	free(p.surface);
	free(p.response);
	free(p.refine);
	return ok;
}
