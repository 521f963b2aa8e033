/* Colours and materials as they are found in the world: mostly muted, some vivid. */
#include "build.h"

struct v3 sim_hsv(float hue, float saturation, float value)
{
	float h = 6 * fract(hue), c = value * saturation, m = value - c;
	float x = c * (1 - absf(h - 2 * (float)floor_int(h / 2) - 1));
	struct v3 rgb = h < 1   ? v3(c, x, 0)
			: h < 2 ? v3(x, c, 0)
			: h < 3 ? v3(0, c, x)
			: h < 4 ? v3(0, x, c)
			: h < 5 ? v3(x, 0, c)
				: v3(c, 0, x);

	return v3(srgb_decode(rgb.x + m), srgb_decode(rgb.y + m), srgb_decode(rgb.z + m));
}

struct v3 sim_hsv_in(struct rng *r, struct v3 lo, struct v3 hi)
{
	struct v3 c = rng_box(r, lo, hi);

	return sim_hsv(c.x, c.y, c.z);
}

struct v3 sim_colour_wood(struct rng *r)
{
	return sim_hsv_in(r, v3(0.04f, 0.25f, 0.25f), v3(0.12f, 0.7f, 0.85f));
}

struct v3 sim_colour_neutral(struct rng *r)
{

	return sim_hsv_in(r, v3(0, 0, 0.12f), v3(1, 0.12f, 0.95f));
}

struct v3 sim_colour_vivid(struct rng *r)
{
	return sim_hsv_in(r, v3(0, 0.55f, 0.35f), v3(1, 0.95f, 0.95f));
}

struct v3 sim_colour_any(struct rng *r)
{
	float kind = rng_unit(r);

	if (kind < 0.25f)
		return sim_colour_neutral(r);
	if (kind < 0.45f)
		return sim_colour_wood(r);
	if (kind < 0.60f) /* near white, near black */
		return rng_chance(r, 0.6f) ? sim_hsv_in(r, v3(0, 0, 0.8f), v3(1, 0.1f, 0.95f))
					   : sim_hsv_in(r, v3(0, 0, 0.06f), v3(1, 0.1f, 0.2f));
	if (kind < 0.75f) /* muted */
		return sim_hsv_in(r, v3(0, 0.15f, 0.25f), v3(1, 0.5f, 0.8f));
	if (kind < 0.82f) /* leaves */
		return sim_hsv_in(r, v3(0.2f, 0.3f, 0.2f), v3(0.38f, 0.8f, 0.65f));
	return sim_colour_vivid(r);
}

/* A second colour that goes with the first: the same hue lighter or darker, or a contrast. */
static struct v3 companion(struct rng *r, struct v3 c)
{
	float kind = rng_unit(r), k;

	if (kind < 0.45f) {
		k = rng_chance(r, 0.5f) ? rng_in(r, 0.3f, 0.75f) : rng_in(r, 1.2f, 2.2f);
		return v3(minf(c.x * k, 0.9f), minf(c.y * k, 0.9f), minf(c.z * k, 0.9f));
	}
	if (kind < 0.6f)
		return v3_mix(c, sim_colour_neutral(r), 0.7f);
	return sim_colour_any(r);
}

struct material sim_material_plain(struct v3 colour)
{
	struct material m = {.texture = TEX_PLAIN, .scale = 1, .turn_cos = 1};

	for (int i = 0; i < 4; i++)
		m.colour[i] = colour;
	return m;
}

static void finish_surface(struct rng *r, struct material *m)
{
	float kind = rng_unit(r);

	if (kind < 0.6f)
		return;
	m->specular = rng_in(r, 0.02f, 0.08f);
	m->gloss_log2 = 3 + rng_below(r, 6);
	if (kind > 0.9f) {
		m->reflects = true;
		m->gloss_log2 = 9;
	}
	if (kind > 0.97f) /* metal and mirrors */
		m->specular = rng_in(r, 0.3f, 0.9f);
}

struct material sim_material_glass(struct rng *r)
{
	struct v3 body = rng_chance(r, 0.3f) ? sim_colour_any(r) : v3(0.85f, 0.9f, 0.9f);
	struct material m = sim_material_plain(body);

	m.tint = rng_chance(r, 0.55f) ? sim_hsv_in(r, v3(0, 0, 0.9f), v3(1, 0.1f, 1))
				      : sim_hsv_in(r, v3(0, 0.2f, 0.7f), v3(1, 0.75f, 1));
	/* Thick and smoked glass hides more; some is frosted by dust. */
	m.clear = rng_in(r, 0.55f, 0.93f);
	m.specular = rng_in(r, 0.03f, 0.07f);
	m.gloss_log2 = 8;
	m.reflects = rng_chance(r, 0.6f);
	return m;
}

struct material sim_material(struct rng *r, enum texture_kind texture, float period_m)
{
	struct material m = {.texture = texture};
	float turn = rng_chance(r, 0.6f) ? 0.25f * (float)rng_below(r, 4) : rng_unit(r);

	m.seed = rng_u32(r);
	m.scale = 1 / period_m;
	m.turn_cos = cos_turns(turn);
	m.turn_sin = sin_turns(turn);
	m.grime = rng_chance(r, 0.5f) ? rng_in(r, 0, 0.35f) : 0;
	if (texture == TEX_WOOD) {
		m.colour[0] = sim_colour_wood(r);
		m.colour[1] = v3_scale(m.colour[0], rng_in(r, 0.55f, 0.9f));
		m.colour[2] = v3_scale(m.colour[0], rng_in(r, 0.35f, 0.8f));
		m.colour[3] = v3_scale(m.colour[0], 0.3f);
	} else {
		m.colour[0] = sim_colour_any(r);
		for (int i = 1; i < 4; i++)
			m.colour[i] = companion(r, m.colour[i - 1]);
	}
	if (texture == TEX_FACADE || texture == TEX_PRINT || texture == TEX_PICTURE) {
		m.turn_cos = 1;
		m.turn_sin = 0;
	}
	finish_surface(r, &m);
	return m;
}

struct material sim_material_any(struct rng *r, float size_m)
{
	static const uint8_t kinds[] = {
		TEX_PLAIN,    TEX_PLAIN, TEX_PLAIN, TEX_PLAIN,   TEX_CHECKS,
		TEX_STRIPES,  TEX_NOISE, TEX_NOISE, TEX_NOISE,   TEX_BLOTCHES,
		TEX_MARBLE,   TEX_WOOD,  TEX_WOOD,  TEX_CELLS,   TEX_TILES,
		TEX_DOTS,     TEX_PRINT, TEX_PRINT, TEX_PRINT,   TEX_PRINT,
		TEX_GRADIENT, TEX_WEAVE, TEX_MOTIF, TEX_PICTURE, TEX_PICTURE,
	};
	enum texture_kind kind = kinds[rng_below(r, sizeof(kinds))];
	float period = size_m * rng_in(r, 0.15f, 0.7f);

	if (kind == TEX_PRINT)
		period = size_m * rng_in(r, 0.1f, 0.3f);
	if (kind == TEX_PLAIN)
		period = size_m;
	return sim_material(r, kind, period);
}

struct material sim_material_floor(struct rng *r, float size_m)
{
	static const uint8_t kinds[] = {
		TEX_WOOD,     TEX_WOOD,   TEX_WOOD,  TEX_WOOD,  TEX_PLAIN,   TEX_PLAIN, TEX_PLAIN,
		TEX_NOISE,    TEX_NOISE,  TEX_TILES, TEX_TILES, TEX_CELLS,   TEX_WEAVE, TEX_MARBLE,
		TEX_BLOTCHES, TEX_CHECKS, TEX_MOTIF, TEX_DOTS,  TEX_STRIPES,
	};
	enum texture_kind kind = kinds[rng_below(r, sizeof(kinds))];
	struct material m = sim_material(r, kind, size_m * rng_in(r, 0.05f, 0.35f));

	/* Floors are calmer than what stands on them, and seldom of a strong colour. */
	for (int i = 0; i < 4; i++) {
		float grey = (m.colour[i].x + m.colour[i].y + m.colour[i].z) / 3;

		m.colour[i] = v3_mix(m.colour[i], v3(grey, grey, grey),
				     m.texture == TEX_WOOD ? 0.1f : 0.55f);
		m.colour[i] = v3_mix(m.colour[i], m.colour[0], 0.4f);
	}
	m.grime = maxf(m.grime, 0.08f);
	return m;
}

struct material sim_material_wall(struct rng *r, float size_m)
{
	static const uint8_t kinds[] = {
		TEX_PLAIN, TEX_PLAIN, TEX_PLAIN, TEX_PLAIN,   TEX_NOISE, TEX_MOTIF,
		TEX_TILES, TEX_TILES, TEX_WOOD,  TEX_STRIPES, TEX_CELLS,
	};
	enum texture_kind kind = kinds[rng_below(r, sizeof(kinds))];
	struct material m = sim_material(r, kind, size_m * rng_in(r, 0.05f, 0.2f));

	if (m.texture == TEX_PLAIN && rng_chance(r, 0.7f)) {
		m.colour[0] = sim_hsv_in(r, v3(0, 0, 0.6f), v3(1, 0.15f, 0.92f));
		m.specular = 0;
		m.reflects = false;
	}
	for (int i = 0; i < 4; i++) {
		float grey = (m.colour[i].x + m.colour[i].y + m.colour[i].z) / 3;

		m.colour[i] = v3_mix(m.colour[i], v3(grey, grey, grey), 0.4f);
		m.colour[i] = v3_mix(m.colour[i], m.colour[0], 0.35f);
	}
	m.grime = maxf(m.grime, 0.08f);
	return m;
}
