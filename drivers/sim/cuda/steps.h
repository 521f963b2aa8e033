/* The steps of drawing a picture, each for one thread of a block. The kernels run them on the GPU;
 * the CPU can walk through the same ones. */
#ifndef DIO_SIM_CUDA_STEPS_H
#define DIO_SIM_CUDA_STEPS_H

#include <cuda_runtime.h>
#include <math.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

extern "C" {
#include "develop.h"
#include "jpeg.h"
#include "picture.h"
#include "sensor.h"
#include "shoot.h"
}

/* One picture and its buffers; lies in the memory of whoever draws it. */
struct shot {
	struct picture picture;
	struct dio_sim_camera camera;
	struct dio_sim_sensor sensor;
	float gain;     /* automatic exposure of the scene */
	float *across;  /* [height][width][3] blurred along the rows */
	uint8_t *bytes; /* where the picture goes: one of the two is NULL */
	float *floats;
};

enum { TILE_THREADS = SIM_TILE * SIM_TILE };

/* What the threads of a tile share. */
struct tile_block {
	struct tile tile;
	struct ray ray[TILE_THREADS];
	struct scene_hit hit[TILE_THREADS];
};

/* The first rays of a tile, in phases; all threads end one before any begins the next. */
enum { FIRST_PHASES = 4 };

/* Pixel of a thread; false when it lies beyond the picture. */
DIO_SIM_FN bool pixel_of(const struct tile *t, uint32_t thread, uint32_t *x, uint32_t *y)
{
	*x = t->x0 + thread % SIM_TILE;
	*y = t->y0 + thread / SIM_TILE;
	return *x < t->x1 && *y < t->y1;
}

DIO_SIM_FN void first_phase(const struct picture *p, struct tile_block *block, uint32_t phase,
			    uint32_t tile, uint32_t thread)
{
	struct tile *t = &block->tile;
	uint32_t x, y;

	switch (phase) {
	case 0:
		if (thread == 0)
			tile_begin(p, tile, t);
		break;
	case 1:
		block->hit[thread].material = NULL;
		if (pixel_of(t, thread, &x, &y))
			pixel_meet(p, t, x, y, &block->ray[thread], &block->hit[thread]);
		break;
	case 2:
		if (thread == 0) {
			tile_look_round(p, t, block->hit, TILE_THREADS);
			p->tiles[tile] = *t;
		}
		break;
	default:
		if (pixel_of(t, thread, &x, &y))
			pixel_light(p, t, x, y, &block->ray[thread], &block->hit[thread]);
		break;
	}
}

DIO_SIM_FN void mark_step(const struct picture *p, uint32_t tile, uint32_t thread)
{
	uint32_t x, y;

	if (pixel_of(&p->tiles[tile], thread, &x, &y))
		p->refine[(size_t)y * p->camera->width + x] = pixel_steps(p, x, y);
}

DIO_SIM_FN void refine_step(const struct picture *p, uint32_t tile, uint32_t thread)
{
	const struct tile *t = &p->tiles[tile];
	uint32_t x, y;

	if (pixel_of(t, thread, &x, &y) && p->refine[(size_t)y * p->camera->width + x])
		pixel_refine(p, t, x, y);
}

/* One pixel blurred along a line of `length` pixels, `stride` values apart, at place `at`. */
DIO_SIM_FN struct v3 blurred(const struct blur *b, const float *line, size_t stride,
			     uint32_t length, uint32_t at)
{
	float sum[3] = {0, 0, 0};

	for (int32_t k = -b->reach; k <= b->reach; k++) {
		int32_t i = (int32_t)at + k, last = (int32_t)length - 1;
		const float *from = line + (size_t)(i < 0 ? 0 : i > last ? last : i) * stride;

		for (int c = 0; c < 3; c++)
			sum[c] += b->weight[k + b->reach] * from[c];
	}
	return v3(sum[0], sum[1], sum[2]);
}

DIO_SIM_FN void across_step(const struct shot *s, uint32_t pixel)
{
	uint32_t w = s->camera.width, x = pixel % w, y = pixel / w;
	struct blur b = blur_of(s->sensor.blur_px);

	if (y < s->camera.height)
		store(s->across + 3 * (size_t)pixel,
		      blurred(&b, s->picture.rgb + 3 * (size_t)y * w, 3, w, x));
}

/* Blur down, expose, encode, noise. */
DIO_SIM_FN void develop_step(const struct shot *s, uint32_t pixel)
{
	uint32_t w = s->camera.width, h = s->camera.height, x = pixel % w, y = pixel / w;
	struct exposure e = exposure_of(&s->sensor, &s->camera, s->gain);
	float *to = s->picture.rgb + 3 * (size_t)pixel, light[3], share;
	struct blur b = blur_of(s->sensor.blur_px);

	if (y >= h)
		return;
	store(light, blurred(&b, s->across + 3 * (size_t)x, 3 * (size_t)w, h, y));
	share = exposure_share(&e, x, y);
	for (uint32_t c = 0; c < 3; c++) {
		to[c] = developed(light[c] * (e.gain[c] * share));
		if (sensor_is_noisy(&s->sensor))
			to[c] = noisy(&s->sensor, 3 * pixel + c, to[c]);
	}
}

DIO_SIM_FN uint32_t squares_across(const struct dio_sim_camera *camera)
{
	return (camera->width + SIM_JPEG_SQUARE - 1) / SIM_JPEG_SQUARE;
}

DIO_SIM_FN uint32_t squares(const struct dio_sim_camera *camera)
{
	return squares_across(camera) * ((camera->height + SIM_JPEG_SQUARE - 1) / SIM_JPEG_SQUARE);
}

DIO_SIM_FN void compress_step(const struct shot *s, uint32_t square)
{
	uint32_t across = squares_across(&s->camera);

	if (s->sensor.jpeg_quality > 0 && square < squares(&s->camera))
		jpeg_square(s->picture.rgb, s->camera.width, s->camera.height,
			    square % across * SIM_JPEG_SQUARE, square / across * SIM_JPEG_SQUARE,
			    s->sensor.jpeg_quality);
}

/* Value number `i` to where it was asked for. */
DIO_SIM_FN void deliver_step(const struct shot *s, uint32_t i)
{
	if (i >= 3 * s->camera.width * s->camera.height)
		return;
	if (s->bytes)
		s->bytes[i] = quantised(s->picture.rgb[i]);
	else
		s->floats[i] = s->picture.rgb[i];
}

#endif
