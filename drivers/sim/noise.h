/* Smooth noise on a lattice, in [0, 1], period 2^32. */
#ifndef DIO_SIM_NOISE_H
#define DIO_SIM_NOISE_H

#include "rng.h"

DIO_SIM_FN float value_noise(struct v3 p, uint32_t seed)
{
	int32_t x = floor_int(p.x), y = floor_int(p.y), z = floor_int(p.z);
	float fx = p.x - (float)x, fy = p.y - (float)y, fz = p.z - (float)z;
	/* The eight corners: steps of the cell's number along each axis, times a factor of its own.
	 * Lighter than hash_cell(); the upper bits are mixed enough. */
	const uint32_t nx = 0x9e3779b1u, ny = 0x85ebca77u, nz = 0xc2b2ae3du;
	const uint32_t sx[8] = {0, nx, 0, nx, 0, nx, 0, nx}, sy[8] = {0, 0, ny, ny, 0, 0, ny, ny};
	const uint32_t sz[8] = {0, 0, 0, 0, nz, nz, nz, nz};
	uint32_t hx = (uint32_t)x * nx, hy = (uint32_t)y * ny, hz = (uint32_t)z * nz;
	float v[8];

	seed *= 0x27d4eb2fu;
	fx = fx * fx * (3 - 2 * fx);
	fy = fy * fy * (3 - 2 * fy);
	fz = fz * fz * (3 - 2 * fz);
	for (int i = 0; i < 8; i++) {
		uint32_t h = (hx + sx[i]) ^ (hy + sy[i]) ^ (hz + sz[i]) ^ seed;

		v[i] = unit_from((h ^ h >> 15) * 0x2c1b3c6du);
	}
	for (int i = 0; i < 4; i++)
		v[i] = mixf(v[2 * i], v[2 * i + 1], fx);
	return mixf(mixf(v[0], v[1], fy), mixf(v[2], v[3], fy), fz);
}

DIO_SIM_FN float value_noise2(float px, float py, uint32_t seed)
{
	int32_t x = floor_int(px), y = floor_int(py);
	float fx = px - (float)x, fy = py - (float)y;
	float a = unit_from(hash_cell(x, y, 0, seed)), b = unit_from(hash_cell(x + 1, y, 0, seed));
	float c = unit_from(hash_cell(x, y + 1, 0, seed));
	float d = unit_from(hash_cell(x + 1, y + 1, 0, seed));

	fx = fx * fx * (3 - 2 * fx);
	fy = fy * fy * (3 - 2 * fy);
	return mixf(mixf(a, b, fx), mixf(c, d, fx), fy);
}

#endif
