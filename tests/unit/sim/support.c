#include "support.h"

#include <math.h>

struct dio_sim_camera test_camera(bool distorted)
{
	struct dio_sim_camera c = {
		.width = 640,
		.height = 480,
		.fx = 600,
		.fy = 604,
		.cx = 322.5,
		.cy = 236.25,
	};

	if (distorted) {
		c.dist[0] = -0.22;
		c.dist[1] = 0.06;
		c.dist[2] = 0.0015;
		c.dist[3] = -0.001;
		c.dist[4] = 0.004;
	}
	return c;
}

struct dio_sim_scene *test_scene(uint64_t seed, uint32_t cols, uint32_t rows, bool legacy)
{
	struct dio_sim_scene_options o = {
		.seed = seed,
		.kind = DIO_SIM_TABLE,
		.board = {.cols = cols, .rows = rows, .square_m = 0.0285, .marker_m = 0.0171},
		.clear_board = true,
	};

	o.board.legacy = legacy;
	return dio_sim_scene_create(&o);
}

struct pixel test_project(const struct dio_sim_camera *camera, double x, double y, double z)
{
	const double *m = camera->world_from_camera, *k = camera->dist;
	double dx = x - m[3], dy = y - m[7], dz = z - m[11];
	double cx = m[0] * dx + m[4] * dy + m[8] * dz;
	double cy = m[1] * dx + m[5] * dy + m[9] * dz;
	double cz = m[2] * dx + m[6] * dy + m[10] * dz;
	double a = cx / cz, b = cy / cz, r2 = a * a + b * b;
	double radial = 1 + k[0] * r2 + k[1] * r2 * r2 + k[4] * r2 * r2 * r2;
	struct pixel p;

	p.u = camera->fx * (a * radial + 2 * k[2] * a * b + k[3] * (r2 + 2 * a * a)) + camera->cx;
	p.v = camera->fy * (b * radial + k[2] * (r2 + 2 * b * b) + 2 * k[3] * a * b) + camera->cy;
	return p;
}

static double to_linear(double s)
{
	return s <= 0.04045 ? s / 12.92 : pow((s + 0.055) / 1.055, 2.4);
}

double test_light_at(const float *rgb, const struct dio_sim_camera *camera, struct pixel p)
{
	double u = fmin(fmax(p.u, 0), camera->width - 1.001);
	double v = fmin(fmax(p.v, 0), camera->height - 1.001);
	size_t x = (size_t)u, y = (size_t)v, w = camera->width;
	double fx = u - (double)x, fy = v - (double)y, value[4];

	for (size_t i = 0; i < 4; i++)
		value[i] = to_linear(rgb[3 * ((y + i / 2) * w + x + i % 2) + 1]);
	return (value[0] * (1 - fx) + value[1] * fx) * (1 - fy) +
	       (value[2] * (1 - fx) + value[3] * fx) * fy;
}

uint64_t test_hash(const void *bytes, size_t count)
{
	const uint8_t *b = bytes;
	uint64_t h = 0xcbf29ce484222325ull;

	for (size_t i = 0; i < count; i++)
		h = (h ^ b[i]) * 0x100000001b3ull;
	return h;
}
