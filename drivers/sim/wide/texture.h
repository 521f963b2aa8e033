/* Textures of one material at several places: see ../texture.h, whose every step this takes for
 * each lane. */
#ifndef DIO_SIM_WIDE_TEXTURE_H
#define DIO_SIM_WIDE_TEXTURE_H

#include "../texture.h"
#include "shape.h"

struct w2 {
	wf x, y;
};

struct wide_place {
	struct w3 solid;
	struct w2 sheet;
	wf width;
};

static inline struct w2 w2(wf x, wf y)
{
	struct w2 r;

	r.x = x;
	r.y = y;
	return r;
}

static inline wf wide_soft_edge(wf x, wf width)
{
	return wf_saturate(x / (width + wf_of(1e-9f)) + wf_of(0.5f));
}

static inline wf wide_detail(wf width)
{
	return wf_of(1) - wf_smooth_step(0.35f, 1.0f, width);
}

static inline wf wide_square_wave(wf x, wf duty, wf width)
{
	wf f = wf_fract(x), on, half = wf_of(0.5f) * duty;

	f = wf_abs(f - half);
	f = wf_min(f, wf_of(1) - f);
	on = wide_soft_edge(half - f, width);
	return wf_mix(duty, on, wide_detail(width));
}

static inline wf wide_fractal_noise(struct w3 p, wf width, int octaves, uint32_t seed)
{
	wf sum = wf_of(0.5f), rise = wf_of(2.03f);
	wm shows = wm_all();
	float gain = 0.55f;

	for (int i = 0; i < octaves; i++) {
		wf w = wf_of(gain) * wide_detail(wf_of(0.7f) * width), more;

		shows = wm_less(shows, wf_le(w, wf_of(0.03f)));
		if (!wm_any(shows))
			break;
		more = sum + w * (wide_value_noise(p, seed + (uint32_t)i) - wf_of(0.5f));
		sum = wf_choose(shows, more, sum);
		p = w3(p.y * rise + wf_of(7.1f), p.z * rise + wf_of(1.7f),
		       p.x * rise + wf_of(3.3f));
		width *= rise;
		gain *= 0.55f;
	}
	return wf_saturate(sum);
}

static inline struct w3 wide_colour(const struct material *m, int i)
{
	return w3_of(m->colour[i]);
}

static inline struct w3 wide_ramp(const struct material *m, wf t)
{
	wf twice = wf_of(2) * t;
	struct w3 mid = wide_colour(m, 1);

	return w3_choose(wf_lt(t, wf_of(0.5f)), w3_mix(wide_colour(m, 0), mid, twice),
			 w3_mix(mid, wide_colour(m, 2), twice - wf_of(1)));
}

static inline struct w3 wide_tex_checks(const struct material *m, struct w2 s, wf width)
{
	wf half = wf_of(0.5f), one = wf_of(1);
	wf a = wide_square_wave(half * s.x, half, half * width);
	wf b = wide_square_wave(half * s.y, half, half * width);

	return w3_mix(wide_colour(m, 0), wide_colour(m, 1), a * b + (one - a) * (one - b));
}

static inline struct w3 wide_tex_stripes(const struct material *m, struct w2 s, wf width)
{
	wf duty = wf_of(0.2f + 0.6f * unit_from(hash_u32(m->seed)));
	struct w3 c =
		w3_mix(wide_colour(m, 0), wide_colour(m, 1), wide_square_wave(s.x, duty, width));

	if (m->seed & 1)
		c = w3_mix(c, wide_colour(m, 2),
			   wide_square_wave(s.x + wf_of(0.1f), wf_of(0.12f), width));
	if (m->seed & 2)
		c = w3_mix(c,
			   w3_mix(wide_colour(m, 1), wide_colour(m, 2),
				  wide_square_wave(s.y, duty, width)),
			   wf_of(0.5f));
	return c;
}

static inline struct w3 wide_tex_blotches(const struct material *m, struct w3 p, wf width)
{
	wf n = wide_fractal_noise(p, width, 2, m->seed), w = wf_of(2.5f) * width + wf_of(0.02f);
	struct w3 c =
		w3_mix(wide_colour(m, 0), wide_colour(m, 1), wide_soft_edge(n - wf_of(0.44f), w));

	return w3_mix(c, wide_colour(m, 2), wide_soft_edge(n - wf_of(0.6f), w));
}

static inline struct w3 wide_tex_marble(const struct material *m, struct w3 p, wf width)
{
	wf n = wide_fractal_noise(p, width, 4, m->seed);
	wf vein = wf_abs(wf_sin_turns(wf_of(0.35f) * p.x + wf_of(0.2f) * p.y + wf_of(1.6f) * n));

	vein = wf_mix(wf_of(0.35f), wf_of(1) - wf_sqrt(vein), wide_detail(width));
	return w3_mix(w3_mix(wide_colour(m, 0), wide_colour(m, 1), n), wide_colour(m, 2), vein);
}

static inline struct w3 wide_tex_wood(const struct material *m, struct w3 p, wf width)
{

	wf plank = wf_from(wf_floor_int(p.y * wf_of(0.45f)));
	struct w3 q = w3(wf_of(0.12f) * p.x + plank * wf_of(3.7f), p.y + wf_of(0.5f) * plank,
			 p.z + wf_of(1.3f));
	wf wobble = wide_value_noise(q, m->seed);
	wf ring = wf_fract(wf_of(2.2f) * (wf_abs(q.y - wf_of(1.7f) * plank) * wf_of(0.3f) +
					  q.z * wf_of(0.4f)) +
			   wf_of(1.5f) * wobble);
	wf grain = wide_fractal_noise(w3(wf_of(0.4f) * p.x, wf_of(6) * p.y, wf_of(6) * p.z),
				      wf_of(5) * width, 2, m->seed + 9);
	wf shade = wf_mix(wf_of(0.5f), ring * (wf_of(2) - ring) * wf_of(0.8f),
			  wide_detail(wf_of(2) * width));
	struct w3 c = wide_ramp(
		m, wf_saturate(wf_of(0.55f) * shade + wf_of(0.6f) * (grain - wf_of(0.2f))));
	wf tone, gap;

	if (m->seed & 1) {
		tone = wide_unit_from(wide_hash_cell(wu_truncated(plank), wu_of(0), 0, m->seed));
		gap = wf_fract(p.y * wf_of(0.45f));
		gap = wide_square_wave(gap - wf_of(0.985f), wf_of(0.03f), wf_of(0.45f) * width);
		c = w3_scale(c,
			     (wf_of(0.75f) + wf_of(0.5f) * tone) * (wf_of(1) - wf_of(0.7f) * gap));
	}
	return c;
}

static inline struct w3 wide_tex_cells(const struct material *m, struct w2 s, wf width)
{
	wu cx = wf_floor_int(s.x), cy = wf_floor_int(s.y), who = wu_of(0);
	wf near1 = wf_of(9), near2 = near1, tone, joint;

	for (uint32_t i = 0; i < 9; i++) {
		wu x = cx + wu_of(i % 3 - 1), y = cy + wu_of(i / 3 - 1);
		wu h = wide_hash_cell(x, y, 1, m->seed);
		wf dx = wf_from(x) + wf_of(0.1f) +
			wf_of(0.8f) * wf_from(h & wu_of(0xffff)) / wf_of(65536) - s.x;
		wf dy = wf_from(y) + wf_of(0.1f) + wf_of(0.8f) * wf_from(h >> 16) / wf_of(65536) -
			s.y;
		wf d = dx * dx + dy * dy;
		wm first = wf_lt(d, near1), second = wm_less(wf_lt(d, near2), first);

		near2 = wf_choose(first, near1, wf_choose(second, d, near2));
		near1 = wf_choose(first, d, near1);
		who = wu_choose(first, h, who);
	}
	tone = wf_mix(wf_of(0.5f), wide_unit_from(wide_hash(who)), wide_detail(width));
	joint = wf_sqrt(near2) - wf_sqrt(near1) - wf_of(0.06f);
	joint = wf_mix(wf_of(0.8f), wide_soft_edge(joint, width + wf_of(0.04f)),
		       wide_detail(width));
	return w3_mix(wide_colour(m, 3), wide_ramp(m, tone), joint);
}

static inline struct w3 wide_tex_tiles(const struct material *m, struct w2 s, wf width)
{
	float aspect = m->seed & 1 ? 2.4f : 1;
	float gap = 0.02f + 0.06f * (float)(m->seed >> 4 & 15) / 15;
	float spread = m->seed & 8 ? 1.0f : 0.3f;
	wf y = s.y * wf_of(aspect), x = s.x, gx, gy, tone;
	wu row = wf_floor_int(y);

	x += wf_of(m->seed & 2 ? 0.5f : 0) * wf_from(row & wu_of(1));
	gx = wide_square_wave(x + wf_of(0.5f * gap), wf_of(gap), width);
	gy = wide_square_wave(y + wf_of(0.5f * gap * aspect), wf_of(gap * aspect),
			      width * wf_of(aspect));
	tone = wide_unit_from(wide_hash_cell(wf_floor_int(x), row, 2, m->seed));
	tone = wf_mix(wf_of(0.5f), tone, wf_of(spread) * wide_detail(width));
	return w3_mix(wide_ramp(m, tone), wide_colour(m, 3), gx + gy - gx * gy);
}

static inline struct w3 wide_tex_dots(const struct material *m, struct w2 s, wf width)
{
	wf y = s.y * wf_of(1.1547f), x, dx, dy, d, on;
	float r = 0.15f + 0.25f * (float)(m->seed & 255) / 255;
	wu row = wf_floor_int(y);
	struct w3 dot = wide_colour(m, 1);

	x = s.x + wf_of(0.5f) * wf_from(row & wu_of(1));
	dx = wf_fract(x) - wf_of(0.5f);
	dy = (wf_fract(y) - wf_of(0.5f)) * wf_of(0.866f);
	d = wf_of(r) - wf_sqrt(dx * dx + dy * dy);
	on = wide_soft_edge(d, width);
	on = wf_mix(wf_of(3.1f * r * r), on, wide_detail(width));
	if (m->seed & 256)
		dot = wide_ramp(m,
				wide_unit_from(wide_hash_cell(wf_floor_int(x), row, 3, m->seed)));
	return w3_mix(wide_colour(m, 0), dot, on);
}

/* A stroke: lanes of `m` may come nearer to it. */
static inline wf stroke(wf near, wm m, wf way)
{
	return wf_choose(m, wf_min(near, way), near);
}

static inline wf wide_glyph(wf x, wf y, wu h, wf width)
{
	wf near = wf_of(1), bow;
	wm upper = wf_lt(y, wf_of(0.5f)), inner, out, left, right;

	out = wm_or(wm_or(wf_lt(x, wf_of(0.1f)), wf_gt(x, wf_of(0.9f))),
		    wm_or(wf_lt(y, wf_of(0.06f)), wf_gt(y, wf_of(0.94f))));
	left = wm_or(wm_and(upper, wu_has(h, 2)), wm_less(wu_has(h, 4), upper));
	right = wm_or(wm_and(upper, wu_has(h, 8)), wm_less(wu_has(h, 16), upper));
	near = stroke(near, wm_or(wu_has(h, 1), left), wf_abs(x - wf_of(0.24f)));
	near = stroke(near, right, wf_abs(x - wf_of(0.76f)));
	inner = wm_and(wf_gt(x, wf_of(0.15f)), wf_lt(x, wf_of(0.85f)));
	near = stroke(near, wm_and(inner, wu_has(h, 32)), wf_abs(y - wf_of(0.16f)));
	near = stroke(near, wm_and(inner, wu_has(h, 64)), wf_abs(y - wf_of(0.5f)));
	near = stroke(near, wm_and(inner, wu_has(h, 128)), wf_abs(y - wf_of(0.84f)));
	bow = wf_of(0.24f) + wf_of(0.52f) * wf_choose(wu_has(h, 512), y, wf_of(1) - y);
	near = stroke(near, wm_and(inner, wu_has(h, 256)), wf_of(0.9f) * wf_abs(x - bow));
	return wf_choose(out, wf_of(0), wide_soft_edge(wf_of(0.09f) - near, width));
}

static inline struct w3 wide_tex_print(const struct material *m, struct w2 s, wf width)
{
	wu bx = wf_floor_int(s.x / wf_of(6)), by = wf_floor_int(s.y / wf_of(4)), zero = wu_of(0);
	wu block = wide_hash_cell(bx, by, 4, m->seed), tag = block >> 4 & wu_of(7), letter, sixth;
	wf line_height = wf_choose(wu_has(block, 3), wf_of(0.5f), wf_of(1.6f));
	wf u = s.x / (wf_of(0.62f) * line_height), v = s.y / line_height;
	wf y = wf_fract(v), ink, w = width / line_height, none = wf_of(0);
	struct w3 paper = wide_colour(m, 0), pen;
	wm heading = wu_eq(tag, zero), word_gap, blank;

	letter = wide_hash_cell(wf_floor_int(u), wf_floor_int(v), 5, m->seed);
	sixth = (letter >> 20) * wu_of(43691) >> 18; /* of a number of twelve bits */
	word_gap = wu_eq(letter >> 20, sixth * wu_of(6));
	pen = w3_choose(heading, wide_colour(m, 0), wide_colour(m, 1));
	paper = w3_choose(heading, wide_colour(m, 2), paper);
	paper = w3_choose(wm_and(wu_eq(tag, wu_of(1)), wu_has(block, 256)), wide_colour(m, 3),
			  paper);
	y = (y - wf_of(0.12f)) / wf_of(0.7f);
	blank = wm_or(word_gap, wm_or(wf_lt(y, none), wf_gt(y, wf_of(1))));
	ink = wide_glyph(wf_fract(u), y, letter, wf_of(1.3f) * w);
	ink = wf_choose(blank, none, ink);
	ink = wf_mix(wf_choose(word_gap, wf_of(0.05f), wf_of(0.22f)), ink,
		     wide_detail(wf_of(2.5f) * w));
	ink = wf_choose(wu_has(block, 3u << 12), ink, none);
	return w3_mix(paper, pen, ink);
}

static inline struct w3 wide_tex_facade(const struct material *m, struct w2 s, wf width)
{
	wf x = wf_fract(s.x) - wf_of(0.5f), y = wf_fract(s.y) - wf_of(0.5f);
	wf ax = wf_abs(x), ay = wf_abs(y), d, glass, frame, bars, keep = wide_detail(width);
	float half_w = 0.16f + 0.14f * (float)(m->seed & 15) / 15;
	float half_h = 0.22f + 0.14f * (float)(m->seed >> 4 & 15) / 15;
	wu h = wide_hash_cell(wf_floor_int(s.x), wf_floor_int(s.y), 6, m->seed);
	struct w3 wall = wide_colour(m, 0), c;
	struct w3 pane = w3_mix(wide_colour(m, 2), wide_colour(m, 3), wide_unit_from(h));

	d = wf_min(wf_of(half_w) - ax, wf_of(half_h) - ay);
	if (m->seed & 256) { /* brickwork */
		struct material brick = *m;

		brick.colour[1] = v3_scale(m->colour[0], 0.8f);
		brick.colour[2] = v3_scale(m->colour[0], 1.15f);
		brick.colour[3] = v3_scale(m->colour[0], 0.6f);
		brick.seed |= 3;
		wall = wide_tex_tiles(&brick, w2(wf_of(6) * s.x, wf_of(6) * s.y), wf_of(6) * width);
	}
	frame = wide_soft_edge(d + wf_of(0.05f), width);
	glass = wide_soft_edge(d, width);
	bars = wide_soft_edge(wf_of(0.015f) - wf_min(ax, wf_abs(y + wf_of(0.3f * half_h))), width);
	glass *= wf_of(1) - wf_of(0.8f) * bars;
	c = w3_mix(wall, wide_colour(m, 1), frame * keep);
	c = w3_mix(c, pane,
		   glass * keep + (wf_of(1) - keep) * wf_of(3) * wf_of(half_w) * wf_of(half_h));
	return w3_mix(c, wide_colour(m, 1),
		      wf_of(0.8f) * keep *
			      wide_soft_edge(wf_of(0.02f) - wf_abs(ay - wf_of(0.48f)), width));
}

static inline struct w3 wide_tex_weave(const struct material *m, struct w2 s, wf width)
{
	wf a = wf_sin_turns(s.x), b = wf_sin_turns(s.y), keep = wide_detail(width);
	wf odd = wf_from(wf_floor_int(s.y) & wu_of(1));
	wf over = wide_square_wave(s.x + odd * wf_of(0.5f), wf_of(0.5f), width);
	wf thread = wf_choose(wf_gt(over, wf_of(0.5f)), b, a);
	wf shade = wf_mix(wf_of(0.72f), wf_of(0.55f) + wf_of(0.45f) * wf_abs(thread), keep);

	return w3_scale(w3_mix(wide_colour(m, 0), wide_colour(m, 1), over), shade * wf_of(1.35f));
}

static inline struct w3 wide_tex_motif(const struct material *m, struct w2 s, wf width)
{
	wu cx = wf_floor_int(s.x), cy = wf_floor_int(s.y), byte = wu_of(255);
	wu h = wide_hash_cell(cx, cy, 7, m->seed);
	wf half = wf_of(0.5f), fifth = wf_of(0.2f), full = wf_of(255);
	wf x = s.x - wf_from(cx) - half + fifth * (wf_from(h & byte) / full - half);
	wf y = s.y - wf_from(cy) - half + fifth * (wf_from(h >> 8 & byte) / full - half);
	wf r = wf_sqrt(x * x + y * y), keep = wide_detail(width);
	wf a = wf_atan2_turns(y, x) + wide_unit_from(wide_hash(h));
	wf rim = wf_of(0.3f) + wf_of(0.09f) * wf_sin_turns(wf_of((float)(3 + (m->seed & 3))) * a);
	wf bend = wf_abs(x + wf_of(0.12f) * wf_sin_turns(wf_of(1.3f) * y + a)) - wf_of(0.035f);
	struct w3 c = wide_colour(m, 0), curl;

	curl = w3_mix(c, wide_colour(m, 3),
		      keep * wide_soft_edge(-wf_max(bend, wf_abs(y) - wf_of(0.36f)), width));
	c = w3_mix(c, wide_colour(m, 2), keep * wide_soft_edge(rim - r, width));
	c = w3_mix(c, wide_colour(m, 1),
		   keep * wide_soft_edge(wf_of(0.6f) * rim - r, width + wf_of(0.05f)));
	c = w3_mix(c, wide_colour(m, 3), keep * wide_soft_edge(wf_of(0.09f) - r, width));
	return w3_choose(wu_has(h, 1u << 16), c, curl);
}

static inline struct w3 wide_tex_picture(const struct material *m, struct w2 s, wf width)
{
	struct w3 p = w3(s.x, s.y, wf_of(0.37f)), c;
	wf half = wf_of(0.5f), three = wf_of(3);
	wf warp = wide_value_noise2(s.x * wf_of(1.3f), s.y * wf_of(1.3f), m->seed) - half;

	c = wide_ramp(m, wf_saturate(half + half * wf_sin_turns(wf_of(0.22f) * s.y + half * warp)));
	for (uint32_t i = 0; i < 4; i++) {
		uint32_t h = hash_u32(m->seed + 77 * i);
		wf u = s.x * wf_of(0.7f) - wf_of(2 * unit_from(h));
		wf v = s.y * wf_of(0.7f) - wf_of(2 * unit_from(hash_u32(h)));
		wf x = wf_fract(u) - half + wf_of(0.3f) * warp, y = wf_fract(v) - half;
		wf d = wf_of(0.12f + 0.25f * unit_from(h ^ 0x5555u));

		d -= h & 1 ? wf_sqrt(x * x + y * y) : wf_max(wf_abs(x), wf_abs(y) * wf_of(1.6f));
		if (h & 2)
			d = wf_abs(wf_fract(d * wf_of(5)) - half) * wf_of(0.2f) *
			    wf_choose(wf_gt(d, wf_of(0)), wf_of(1), wf_of(-1));
		c = w3_mix(c, wide_colour(m, (int)((i + (h >> 3)) & 3)),
			   wf_of(0.85f) * wide_soft_edge(d, wf_of(0.7f) * width));
	}
	return w3_scale(c,
			wf_of(0.6f) + wf_of(0.8f) * wide_fractal_noise(w3_scale(p, three),
								       three * width, 3, m->seed));
}

/* Photographs lie in memory: lane by lane. */
static inline struct w3 wide_tex_photo(const struct material *m, const struct sim_photos *photos,
				       struct w2 s, wf width, wm active)
{
	float x[LANES], y[LANES], across[LANES], r[LANES] = {0}, g[LANES] = {0}, b[LANES] = {0};

	wf_store(x, s.x);
	wf_store(y, s.y);
	wf_store(across, width);
	for (uint32_t left = wm_bits(active); left; left &= left - 1) {
		uint32_t i = lowest_bit(left);
		struct v3 c = tex_photo(m, photos, v2(x[i], y[i]), across[i]);

		r[i] = c.x;
		g[i] = c.y;
		b[i] = c.z;
	}
	return w3(wf_load(r), wf_load(g), wf_load(b));
}

static inline struct w3 wide_pattern(const struct material *m, const struct sim_photos *photos,
				     struct w3 p, struct w2 s, wf width, wm active)
{
	wf half = wf_of(0.5f);

	switch (m->texture) {
	case TEX_CHECKS:
		return wide_tex_checks(m, s, width);
	case TEX_STRIPES:
		return wide_tex_stripes(m, s, width);
	case TEX_NOISE:
		return wide_ramp(
			m, wf_saturate(wf_of(1.8f) * wide_fractal_noise(p, width, 4, m->seed) -
				       wf_of(0.4f)));
	case TEX_BLOTCHES:
		return wide_tex_blotches(m, p, width);
	case TEX_MARBLE:
		return wide_tex_marble(m, p, width);
	case TEX_WOOD:
		return wide_tex_wood(m, w3(s.x, s.y, p.z), width);
	case TEX_CELLS:
		return wide_tex_cells(m, s, width);
	case TEX_TILES:
		return wide_tex_tiles(m, s, width);
	case TEX_DOTS:
		return wide_tex_dots(m, s, width);
	case TEX_PRINT:
		return wide_tex_print(m, s, width);
	case TEX_GRADIENT:
		return wide_ramp(
			m, wf_saturate(half + half * wf_sin_turns(wf_of(0.25f) *
								  (p.z + wf_of(0.3f) * p.x))));
	case TEX_FACADE:
		return wide_tex_facade(m, s, width);
	case TEX_WEAVE:
		return wide_tex_weave(m, s, width);
	case TEX_MOTIF:
		return wide_tex_motif(m, s, width);
	case TEX_PICTURE:
		return wide_tex_picture(m, s, width);
	case TEX_PHOTO:
		return wide_tex_photo(m, photos, s, width, active);
	default:
		return wide_colour(m, 0);
	}
}

/* Colour of one material at the places of the lanes of `active`. */
static inline struct w3 wide_texture_colour(const struct material *m,
					    const struct sim_photos *photos,
					    const struct wide_place *at, wm active)
{
	wf scale = wf_of(m->scale), width = at->width * scale, n;
	wf turn_cos = wf_of(m->turn_cos), turn_sin = wf_of(m->turn_sin);
	struct w3 p = w3_scale(at->solid, scale), c;
	struct w2 s = w2(scale * (turn_cos * at->sheet.x - turn_sin * at->sheet.y),
			 scale * (turn_sin * at->sheet.x + turn_cos * at->sheet.y));

	c = wide_pattern(m, photos, p, s, width, active);
	if (m->grime > 0) {
		n = wide_fractal_noise(w3_scale(at->solid, wf_of(9)), wf_of(9) * at->width,
				       m->grime > 0.15f ? 2 : 1, m->seed + 31);
		c = w3_scale(c, wf_of(1) + wf_of(m->grime * 2) * (n - wf_of(0.5f)));
	}
	return c;
}

#endif
