/* Smooth noise on a lattice, in [0, 1], period 2^32. */
#ifndef DIO_SIM_NOISE_H
#define DIO_SIM_NOISE_H

#include "rng.h"

DIO_SIM_FN float value_noise(struct v3 p, uint32_t seed)
{
	int32_t x = floor_int(p.x), y = floor_int(p.y), z = floor_int(p.z);
	float fx = p.x - (float)x, fy = p.y - (float)y, fz = p.z - (float)z;
	/* Lighter than hash_cell(), called for eight corners; its upper bits are mixed enough. */
	uint32_t hx[2] = {(uint32_t)x * 0x9e3779b1u, (uint32_t)x * 0x9e3779b1u + 0x9e3779b1u};
	uint32_t hy[2] = {(uint32_t)y * 0x85ebca77u, (uint32_t)y * 0x85ebca77u + 0x85ebca77u};
	uint32_t hz[2] = {(uint32_t)z * 0xc2b2ae3du, (uint32_t)z * 0xc2b2ae3du + 0xc2b2ae3du};
	float v[8];

	seed *= 0x27d4eb2fu;
	fx = fx * fx * (3 - 2 * fx);
	fy = fy * fy * (3 - 2 * fy);
	fz = fz * fz * (3 - 2 * fz);
	for (int i = 0; i < 8; i++) {
		uint32_t h = hx[i & 1] ^ hy[i >> 1 & 1] ^ hz[i >> 2] ^ seed;

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
