/* Random numbers: a stream for building scenes, hashes for textures and sensor noise. */
#ifndef DIO_SIM_RNG_H
#define DIO_SIM_RNG_H

#include "vec.h"

/* Well-mixed 32-bit permutation (constants: C. Wellons, "hash-prospector", lowbias32). */
DIO_SIM_FN uint32_t hash_u32(uint32_t x)
{
	x ^= x >> 16;
	x *= 0x7feb352du;
	x ^= x >> 15;
	x *= 0x846ca68bu;
	return x ^ (x >> 16);
}

DIO_SIM_FN uint32_t hash_cell(int32_t x, int32_t y, int32_t z, uint32_t seed)
{
	uint32_t h = (uint32_t)x * 0x9e3779b1u ^ (uint32_t)y * 0x85ebca77u ^
		     (uint32_t)z * 0xc2b2ae3du ^ seed;

	h = (h ^ (h >> 15)) * 0x2c1b3c6du;
	h = (h ^ (h >> 13)) * 0x297a2d39u;
	return h ^ (h >> 16);
}

/* [0, 1) from the upper 24 bits. */
DIO_SIM_FN float unit_from(uint32_t h)
{
	return (float)(h >> 8) * (1.0f / 16777216);
}

/* PCG32 (O'Neill 2014), one stream. */
struct rng {
	uint64_t state;
};

DIO_SIM_FN uint32_t rng_u32(struct rng *r)
{
	uint64_t s = r->state;
	uint32_t x = (uint32_t)(((s >> 18) ^ s) >> 27), rot = (uint32_t)(s >> 59);

	r->state = s * 6364136223846793005ull + 1442695040888963407ull;
	return (x >> rot) | (x << ((32 - rot) & 31));
}

DIO_SIM_FN struct rng rng_seeded(uint64_t seed)
{
	struct rng r;

	/* splitmix64 finaliser: neighbouring seeds must give unrelated streams. */
	seed += 0x9e3779b97f4a7c15ull;
	seed = (seed ^ (seed >> 30)) * 0xbf58476d1ce4e5b9ull;
	seed = (seed ^ (seed >> 27)) * 0x94d049bb133111ebull;
	r.state = seed ^ (seed >> 31);
	rng_u32(&r);
	return r;
}

DIO_SIM_FN float rng_unit(struct rng *r)
{
	return unit_from(rng_u32(r));
}

DIO_SIM_FN float rng_in(struct rng *r, float lo, float hi)
{
	return lo + (hi - lo) * rng_unit(r);
}

/* Throws within one list of arguments come in no fixed order: every compiler would build another
 * scene. These make several in order. */
DIO_SIM_FN struct v3 rng_box(struct rng *r, struct v3 lo, struct v3 hi)
{
	struct v3 p;

	p.x = rng_in(r, lo.x, hi.x);
	p.y = rng_in(r, lo.y, hi.y);
	p.z = rng_in(r, lo.z, hi.z);
	return p;
}

/* Within a box about the origin. */
DIO_SIM_FN struct v3 rng_about(struct rng *r, float x, float y, float z)
{
	return rng_box(r, v3(-x, -y, -z), v3(x, y, z));
}

DIO_SIM_FN uint32_t rng_below(struct rng *r, uint32_t n)
{
	return (uint32_t)(((uint64_t)rng_u32(r) * n) >> 32);
}

DIO_SIM_FN bool rng_chance(struct rng *r, float p)
{
	return rng_unit(r) < p;
}

#endif
