/* Procedural textures. Every one is filtered: `width` is the size of a pixel on the surface in
 * texture units; edges soften over it and detail finer than it fades into its mean, so a picture
 * is close to right with one ray a pixel and does not crawl between views. */
#ifndef DIO_SIM_TEXTURE_H
#define DIO_SIM_TEXTURE_H

#include "noise.h"
#include "photo.h"
#include "scene.h"

/* Place on a surface: solid coordinates and an unrolled sheet, both in metres. */
struct place {
	struct v3 solid;
	struct v2 sheet;
	float width;
};

/* Step from 0 to 1 at x = 0, box-filtered. */
DIO_SIM_FN float soft_edge(float x, float width)
{
	return saturate(x / (width + 1e-9f) + 0.5f);
}

/* Weight of detail of period 1 seen through a filter of `width`. */
DIO_SIM_FN float detail(float width)
{
	return 1 - smooth_step(0.35f, 1.0f, width);
}

/* Box-filtered square wave of period 1: 1 on [0, duty). */
DIO_SIM_FN float square_wave(float x, float duty, float width)
{
	float f = fract(x), on;

	/* Distance to the middle of the lit part, the short way round. */
	f = absf(f - 0.5f * duty);
	f = minf(f, 1 - f);
	on = soft_edge(0.5f * duty - f, width);
	return mixf(duty, on, detail(width));
}

/* Several octaves in [0, 1], mean 0.5; octaves too fine or too faint to show are left out. */
DIO_SIM_FN float fractal_noise(struct v3 p, float width, int octaves, uint32_t seed)
{
	float sum = 0.5f, gain = 0.55f;

	for (int i = 0; i < octaves; i++) {
		float w = gain * detail(0.7f * width);

		if (w <= 0.03f)
			break;
		sum += w * (value_noise(p, seed + (uint32_t)i) - 0.5f);
		p = v3(p.y * 2.03f + 7.1f, p.z * 2.03f + 1.7f, p.x * 2.03f + 3.3f);
		width *= 2.03f;
		gain *= 0.55f;
	}
	return saturate(sum);
}

/* Three colours along [0, 1]. */
DIO_SIM_FN struct v3 ramp(const struct material *m, float t)
{
	return t < 0.5f ? v3_mix(m->colour[0], m->colour[1], 2 * t)
			: v3_mix(m->colour[1], m->colour[2], 2 * t - 1);
}

DIO_SIM_FN struct v3 tex_checks(const struct material *m, struct v2 s, float width)
{
	float a = square_wave(0.5f * s.x, 0.5f, 0.5f * width);
	float b = square_wave(0.5f * s.y, 0.5f, 0.5f * width);

	return v3_mix(m->colour[0], m->colour[1], a * b + (1 - a) * (1 - b));
}

DIO_SIM_FN struct v3 tex_stripes(const struct material *m, struct v2 s, float width)
{
	float duty = 0.2f + 0.6f * unit_from(hash_u32(m->seed));
	struct v3 c = v3_mix(m->colour[0], m->colour[1], square_wave(s.x, duty, width));

	/* A thin line beside the broad one, on some. */
	if (m->seed & 1)
		c = v3_mix(c, m->colour[2], square_wave(s.x + 0.1f, 0.12f, width));
	if (m->seed & 2) /* tartan */
		c = v3_mix(c, v3_mix(m->colour[1], m->colour[2], square_wave(s.y, duty, width)),
			   0.5f);
	return c;
}

DIO_SIM_FN struct v3 tex_blotches(const struct material *m, struct v3 p, float width)
{
	float n = fractal_noise(p, width, 2, m->seed), w = 2.5f * width;
	struct v3 c = v3_mix(m->colour[0], m->colour[1], soft_edge(n - 0.44f, w + 0.02f));

	return v3_mix(c, m->colour[2], soft_edge(n - 0.6f, w + 0.02f));
}

DIO_SIM_FN struct v3 tex_marble(const struct material *m, struct v3 p, float width)
{
	float n = fractal_noise(p, width, 4, m->seed);
	float vein = absf(sin_turns(0.35f * p.x + 0.2f * p.y + 1.6f * n));

	vein = mixf(0.35f, 1 - sqrtf(vein), detail(width));
	return v3_mix(v3_mix(m->colour[0], m->colour[1], n), m->colour[2], vein);
}

DIO_SIM_FN struct v3 tex_wood(const struct material *m, struct v3 p, float width)
{
	/* Rings about an axis outside of the board, stretched along the grain, cut in planks. */
	float plank = (float)floor_int(p.y * 0.45f);
	struct v3 q = v3(0.12f * p.x + plank * 3.7f, p.y + 0.5f * plank, p.z + 1.3f);
	float wobble = value_noise(q, m->seed);
	float ring = fract(2.2f * (absf(q.y - 1.7f * plank) * 0.3f + q.z * 0.4f) + 1.5f * wobble);
	float grain = fractal_noise(v3(0.4f * p.x, 6 * p.y, 6 * p.z), 5 * width, 2, m->seed + 9);
	float shade = mixf(0.5f, ring * (2 - ring) * 0.8f, detail(2 * width));
	struct v3 c = ramp(m, saturate(0.55f * shade + 0.6f * (grain - 0.2f)));
	float tone = unit_from(hash_cell((int32_t)plank, 0, 0, m->seed));

	if (m->seed & 1) {
		float gap = fract(p.y * 0.45f);

		gap = square_wave(gap - 0.985f, 0.03f, 0.45f * width);
		c = v3_scale(c, (0.75f + 0.5f * tone) * (1 - 0.7f * gap));
	}
	return c;
}

/* Stones: every cell its tone, joints between. */
DIO_SIM_FN struct v3 tex_cells(const struct material *m, struct v2 s, float width)
{
	int32_t cx = floor_int(s.x), cy = floor_int(s.y);
	float near1 = 9, near2 = 9, tone, joint;
	uint32_t who = 0;

	for (int i = 0; i < 9; i++) {
		int32_t x = cx + i % 3 - 1, y = cy + i / 3 - 1;
		uint32_t h = hash_cell(x, y, 1, m->seed);
		float dx = (float)x + 0.1f + 0.8f * (float)(h & 0xffff) / 65536 - s.x;
		float dy = (float)y + 0.1f + 0.8f * (float)(h >> 16) / 65536 - s.y;
		float d = dx * dx + dy * dy;

		if (d < near1) {
			near2 = near1;
			near1 = d;
			who = h;
		} else if (d < near2) {
			near2 = d;
		}
	}
	tone = mixf(0.5f, unit_from(hash_u32(who)), detail(width));
	joint = sqrtf(near2) - sqrtf(near1) - 0.06f;
	joint = mixf(0.8f, soft_edge(joint, width + 0.04f), detail(width));
	return v3_mix(m->colour[3], ramp(m, tone), joint);
}

/* Running bond or square tiles with joints. */
DIO_SIM_FN struct v3 tex_tiles(const struct material *m, struct v2 s, float width)
{
	float aspect = m->seed & 1 ? 2.4f : 1,
	      gap = 0.02f + 0.06f * (float)(m->seed >> 4 & 15) / 15;
	float y = s.y * aspect;
	int32_t row = floor_int(y);
	float x = s.x + (m->seed & 2 ? 0.5f * (float)(row & 1) : 0);
	float gx = square_wave(x + 0.5f * gap, gap, width);
	float gy = square_wave(y + 0.5f * gap * aspect, gap * aspect, width * aspect);
	float tone = unit_from(hash_cell(floor_int(x), row, 2, m->seed));
	float spread = m->seed & 8 ? 1.0f : 0.3f;

	tone = mixf(0.5f, tone, spread * detail(width));
	return v3_mix(ramp(m, tone), m->colour[3], gx + gy - gx * gy);
}

DIO_SIM_FN struct v3 tex_dots(const struct material *m, struct v2 s, float width)
{
	float y = s.y * 1.1547f;
	int32_t row = floor_int(y);
	float x = s.x + 0.5f * (float)(row & 1);
	float dx = fract(x) - 0.5f, dy = (fract(y) - 0.5f) * 0.866f;
	float r = 0.15f + 0.25f * (float)(m->seed & 255) / 255;
	float d = r - sqrtf(dx * dx + dy * dy), on = soft_edge(d, width);

	on = mixf(3.1f * r * r, on, detail(width));
	return v3_mix(m->colour[0],
		      m->seed & 256 ? ramp(m, unit_from(hash_cell(floor_int(x), row, 3, m->seed)))
				    : m->colour[1],
		      on);
}

/* One made-up letter from bars and bows in the unit square; ink in [0, 1]. */
DIO_SIM_FN float glyph(float x, float y, uint32_t h, float width)
{
	const float pen = 0.09f;
	float lx = absf(x - 0.24f), rx = absf(x - 0.76f), near = 1, m;
	bool upper = y < 0.5f;

	if (x < 0.1f || x > 0.9f || y < 0.06f || y > 0.94f)
		return 0;
	if (h & 1 || (upper ? h & 2 : h & 4))
		near = minf(near, lx);
	if (upper ? h & 8 : h & 16)
		near = minf(near, rx);
	if (x > 0.15f && x < 0.85f) {
		if (h & 32)
			near = minf(near, absf(y - 0.16f));
		if (h & 64)
			near = minf(near, absf(y - 0.5f));
		if (h & 128)
			near = minf(near, absf(y - 0.84f));
		m = 0.24f + 0.52f * (h & 512 ? y : 1 - y);
		if (h & 256)
			near = minf(near, 0.9f * absf(x - m));
	}
	return soft_edge(pen - near, width);
}

/* A printed page or packet: words of letters in lines, headings, boxes and bars of colour. */
DIO_SIM_FN struct v3 tex_print(const struct material *m, struct v2 s, float width)
{
	/* Blocks of 6 x 4 lines: body text, a headline, or a box of colour. */
	int32_t bx = floor_int(s.x / 6), by = floor_int(s.y / 4);
	uint32_t block = hash_cell(bx, by, 4, m->seed);
	float line_height = block & 3 ? 0.5f : 1.6f;
	float u = s.x / (0.62f * line_height), v = s.y / line_height;
	float y = fract(v), ink, w = width / line_height;
	int32_t column = floor_int(u), row = floor_int(v);
	uint32_t letter = hash_cell(column, row, 5, m->seed);
	struct v3 paper = m->colour[0], c;
	bool word_gap = (letter >> 20) % 6 == 0;

	if ((block >> 4 & 7) == 0)
		paper = m->colour[2];
	if ((block >> 4 & 7) == 1 && (block >> 8 & 1))
		paper = m->colour[3];
	y = (y - 0.12f) / 0.7f;
	ink = word_gap || y < 0 || y > 1 ? 0 : glyph(fract(u), y, letter, 1.3f * w);
	ink = mixf(word_gap ? 0.05f : 0.22f, ink, detail(2.5f * w));
	if ((block >> 12 & 3) == 0)
		ink = 0;
	c = v3_mix(paper, (block >> 4 & 7) == 0 ? m->colour[0] : m->colour[1], ink);
	return c;
}

/* House front: windows with frames and sills in a grid, floors told apart by a ledge. */
DIO_SIM_FN struct v3 tex_facade(const struct material *m, struct v2 s, float width)
{
	float x = fract(s.x) - 0.5f, y = fract(s.y) - 0.5f, ax = absf(x), ay = absf(y);
	float half_w = 0.16f + 0.14f * (float)(m->seed & 15) / 15;
	float half_h = 0.22f + 0.14f * (float)(m->seed >> 4 & 15) / 15;
	float d = minf(half_w - ax, half_h - ay);
	uint32_t h = hash_cell(floor_int(s.x), floor_int(s.y), 6, m->seed);
	float glass, frame, bars, keep = detail(width);
	struct v3 wall = m->colour[0], pane = v3_mix(m->colour[2], m->colour[3], unit_from(h)), c;

	if (m->seed & 256) { /* brickwork */
		struct material brick = *m;

		brick.colour[1] = v3_scale(wall, 0.8f);
		brick.colour[2] = v3_scale(wall, 1.15f);
		brick.colour[3] = v3_scale(wall, 0.6f);
		brick.seed |= 3;
		wall = tex_tiles(&brick, v2(6 * s.x, 6 * s.y), 6 * width);
	}
	frame = soft_edge(d + 0.05f, width);
	glass = soft_edge(d, width);
	bars = soft_edge(0.015f - minf(ax, absf(y + 0.3f * half_h)), width);
	glass *= 1 - 0.8f * bars;
	c = v3_mix(wall, m->colour[1], frame * keep);
	c = v3_mix(c, pane, glass * keep + (1 - keep) * 3 * half_w * half_h);
	c = v3_mix(c, m->colour[1], 0.8f * keep * soft_edge(0.02f - absf(ay - 0.48f), width));
	return c;
}

DIO_SIM_FN struct v3 tex_weave(const struct material *m, struct v2 s, float width)
{
	float a = sin_turns(s.x), b = sin_turns(s.y), keep = detail(width);
	float over = square_wave(s.x + (float)(floor_int(s.y) & 1) * 0.5f, 0.5f, width);
	float shade = mixf(0.72f, 0.55f + 0.45f * absf(over > 0.5f ? b : a), keep);

	return v3_scale(v3_mix(m->colour[0], m->colour[1], over), shade * 1.35f);
}

/* Wallpaper and wrapping: a flower, leaf or star in some cells of a jittered grid. */
DIO_SIM_FN struct v3 tex_motif(const struct material *m, struct v2 s, float width)
{
	int32_t cx = floor_int(s.x), cy = floor_int(s.y);
	uint32_t h = hash_cell(cx, cy, 7, m->seed);
	float x = s.x - (float)cx - 0.5f + 0.2f * ((float)(h & 255) / 255 - 0.5f);
	float y = s.y - (float)cy - 0.5f + 0.2f * ((float)(h >> 8 & 255) / 255 - 0.5f);
	float r = sqrtf(x * x + y * y), petals = (float)(3 + (m->seed & 3)), keep = detail(width);
	float a = atan2_turns(y, x) + unit_from(hash_u32(h));
	float rim = 0.3f + 0.09f * sin_turns(petals * a);
	struct v3 c = m->colour[0];

	if (h >> 16 & 1) {
		c = v3_mix(c, m->colour[2], keep * soft_edge(rim - r, width));
		c = v3_mix(c, m->colour[1], keep * soft_edge(0.6f * rim - r, width + 0.05f));
		c = v3_mix(c, m->colour[3], keep * soft_edge(0.09f - r, width));
	} else { /* a leafy curl */
		float bend = absf(x + 0.12f * sin_turns(1.3f * y + a)) - 0.035f;

		c = v3_mix(c, m->colour[3], keep * soft_edge(-maxf(bend, absf(y) - 0.36f), width));
	}
	return c;
}

/* Stands for photographs and posters: sky over ground, overlapping shapes, swirls. */
DIO_SIM_FN struct v3 tex_picture(const struct material *m, struct v2 s, float width)
{
	struct v3 p = v3(s.x, s.y, 0.37f), c;
	float warp = value_noise2(s.x * 1.3f, s.y * 1.3f, m->seed) - 0.5f;

	c = ramp(m, saturate(0.5f + 0.5f * sin_turns(0.22f * s.y + 0.5f * warp)));
	for (uint32_t i = 0; i < 4; i++) {
		uint32_t h = hash_u32(m->seed + 77 * i);
		float u = s.x * 0.7f - 2 * unit_from(h),
		      v = s.y * 0.7f - 2 * unit_from(hash_u32(h));
		float x = fract(u) - 0.5f + 0.3f * warp, y = fract(v) - 0.5f;
		float d = 0.12f + 0.25f * unit_from(h ^ 0x5555u);

		d -= h & 1 ? sqrtf(x * x + y * y) : maxf(absf(x), absf(y) * 1.6f);
		if (h & 2)
			d = absf(fract(d * 5) - 0.5f) * 0.2f * (d > 0 ? 1 : -1);
		c = v3_mix(c, m->colour[(i + (h >> 3)) & 3], 0.85f * soft_edge(d, 0.7f * width));
	}
	return v3_scale(c, 0.6f + 0.8f * fractal_noise(v3_scale(p, 3), 3 * width, 3, m->seed));
}

/* A photograph, another part of another one for every seed. */
DIO_SIM_FN struct v3 tex_photo(const struct material *m, const struct sim_photos *photos,
			       struct v2 s, float width)
{
	uint32_t h = hash_u32(m->seed);

	return photo_colour(photos, h % photos->count, s.x + 2 * unit_from(hash_u32(h)),
			    s.y + 2 * unit_from(hash_u32(h + 1)), width);
}

/* Colour of the material, linear. */
DIO_SIM_FN struct v3 texture_colour(const struct material *m, const struct sim_photos *photos,
				    const struct place *at)
{
	float width = at->width * m->scale;
	struct v3 p = v3_scale(at->solid, m->scale), c;
	struct v2 s = v2(m->scale * (m->turn_cos * at->sheet.x - m->turn_sin * at->sheet.y),
			 m->scale * (m->turn_sin * at->sheet.x + m->turn_cos * at->sheet.y));

	switch (m->texture) {
	case TEX_CHECKS:
		c = tex_checks(m, s, width);
		break;
	case TEX_STRIPES:
		c = tex_stripes(m, s, width);
		break;
	case TEX_NOISE:
		c = ramp(m, saturate(1.8f * fractal_noise(p, width, 4, m->seed) - 0.4f));
		break;
	case TEX_BLOTCHES:
		c = tex_blotches(m, p, width);
		break;
	case TEX_MARBLE:
		c = tex_marble(m, p, width);
		break;
	case TEX_WOOD:
		c = tex_wood(m, v3(s.x, s.y, p.z), width);
		break;
	case TEX_CELLS:
		c = tex_cells(m, s, width);
		break;
	case TEX_TILES:
		c = tex_tiles(m, s, width);
		break;
	case TEX_DOTS:
		c = tex_dots(m, s, width);
		break;
	case TEX_PRINT:
		c = tex_print(m, s, width);
		break;
	case TEX_GRADIENT:
		c = ramp(m, saturate(0.5f + 0.5f * sin_turns(0.25f * (p.z + 0.3f * p.x))));
		break;
	case TEX_FACADE:
		c = tex_facade(m, s, width);
		break;
	case TEX_WEAVE:
		c = tex_weave(m, s, width);
		break;
	case TEX_MOTIF:
		c = tex_motif(m, s, width);
		break;
	case TEX_PICTURE:
		c = tex_picture(m, s, width);
		break;
	case TEX_PHOTO:
		c = tex_photo(m, photos, s, width);
		break;
	default:
		c = m->colour[0];
		break;
	}
	if (m->grime > 0) {
		float n = fractal_noise(v3_scale(at->solid, 9), 9 * at->width,
					m->grime > 0.15f ? 2 : 1, m->seed + 31);

		c = v3_scale(c, 1 + m->grime * 2 * (n - 0.5f));
	}
	return c;
}

#endif
