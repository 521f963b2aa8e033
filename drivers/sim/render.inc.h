/* One picture by one thread, tile by tile. Compiled once for each kind of processor; SIM_RENDER
 * names the function that comes of it. Every operation is rounded alike, so the pictures have the
 * same bits. */
#include "render.h"

#include <stdlib.h>
#include <string.h>

#include "picture.h"

#ifdef SIM_WIDE
#include "wide/picture.h"
#else

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

static void second_pass(const struct picture *p, const struct tile *t)
{
	for (uint32_t y = t->y0; y < t->y1; y++)
		for (uint32_t x = t->x0; x < t->x1; x++)
			if (p->refine[(size_t)y * p->camera->width + x])
				pixel_refine(p, t, x, y);
}

#endif

/* Which of `count` pixels differ from those `apart` pixels on. */
static void compare_pixels(const float *rgb, size_t apart, size_t count, uint8_t *differ)
{
	enum { PIECE = 64 };
	uint8_t values[3 * PIECE];

	for (size_t i = 0; i < count; i += PIECE, rgb += 3 * PIECE) {
		size_t n = count - i < PIECE ? count - i : PIECE;

		for (size_t k = 0; k < 3 * n; k++) /* without branches: vectors */
			values[k] = values_differ(rgb[k], rgb[3 * apart + k]);
		for (size_t k = 0; k < n; k++)
			differ[i + k] = values[3 * k] | values[3 * k + 1] | values[3 * k + 2];
	}
}

/* Both of a pair of neighbours get the bits of the step between them. */
static void mark_pair(const struct picture *p, size_t i, size_t j, bool differ)
{
	uint8_t why = step_between(p, i, j, differ);

	p->refine[i] |= why;
	p->refine[j] |= why;
}

/* pixel_steps() of every pixel, with each pair looked at once. `differ` is room for two rows. */
static void mark_steps(const struct picture *p, uint8_t *differ)
{
	size_t w = p->camera->width, h = p->camera->height;

	memset(p->refine, 0, w * h);
	for (size_t y = 0; y < h; y++) {
		size_t row = y * w, below = y + 1 < h ? w : 0;
		uint8_t *down = differ + w;

		compare_pixels(p->rgb + 3 * row, 1, w - 1, differ);
		compare_pixels(p->rgb + 3 * row, below, below, down);
		for (size_t x = 0; x < w; x++) {
			if (x + 1 < w)
				mark_pair(p, row + x, row + x + 1, differ[x]);
			if (!below)
				continue;
			mark_pair(p, row + x, row + w + x, down[x]);
			if (x > 0)
				mark_pair(p, row + x, row + w + x - 1, false);
			if (x + 1 < w)
				mark_pair(p, row + x, row + w + x + 1, false);
		}
	}
}

bool SIM_RENDER(const struct dio_sim_scene *scene, const struct dio_sim_camera *camera,
		uint32_t samples, float *rgb)
{
	size_t pixels = (size_t)camera->width * camera->height;
	uint32_t tiles = picture_tiles(camera);
	struct picture p;
	uint8_t *differ;
	bool ok;

	picture_init(&p, scene, camera, samples);
	p.rgb = rgb;
	p.tiles = malloc(tiles * sizeof(*p.tiles));
	p.surface = malloc(pixels * sizeof(*p.surface));
	p.response = malloc(pixels * sizeof(*p.response));
	p.refine = malloc(pixels * sizeof(*p.refine));
	differ = malloc(2 * (size_t)camera->width);
	ok = p.tiles && p.surface && p.response && p.refine && differ;
	if (ok) {
		for (uint32_t i = 0; i < tiles; i++)
			first_pass(&p, i);
		if (p.samples > 1) {
			mark_steps(&p, differ);
			for (uint32_t i = 0; i < tiles; i++)
				second_pass(&p, &p.tiles[i]);
		}
	}
	free(p.tiles);
	free(p.surface);
	free(p.response);
	free(p.refine);
	free(differ);
	return ok;
}
