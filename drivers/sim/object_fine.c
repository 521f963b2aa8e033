/* Things with carved, dented, clear or thin parts. */
#include "object.h"

float sim_make_rocks(struct builder *b, float s)
{
	struct rng *r = b->rng;
	enum texture_kind kind = rng_chance(r, 0.7f) ? TEX_NOISE : TEX_BLOTCHES;
	struct material m = sim_material(r, kind, s * rng_in(r, 0.15f, 0.6f));
	uint32_t count = rng_chance(r, 0.6f) ? 1 : 2 + rng_below(r, 4);
	float each = count > 1 ? 0.5f * s : 0.9f * s;

	m.reflects = false;
	for (uint32_t i = 0; i < count; i++) {
		struct v3 at = rng_about(r, count > 1 ? 0.5f * s : 0, count > 1 ? 0.5f * s : 0, 0);
		struct v3 half = rng_box(r, v3(0.6f * each, 0.5f * each, 0.35f * each),
					 v3(each, each, 0.9f * each));
		float depth = rng_in(r, 0.12f, 0.32f);

		at.z = (1 - 0.5f * depth) * half.z;
		sim_add_rock(b, at, half, depth, rng_in(r, 0.8f, 3), &m);
	}
	return 0.9f * s;
}

float sim_make_relief(struct builder *b, float s)
{
	struct rng *r = b->rng;
	struct material m = sim_material_any(r, s), base = sim_material_any(r, s);
	float x = s * rng_in(r, 0.5f, 0.95f), y = x * rng_in(r, 0.6f, 1);
	float z = s * rng_in(r, 0.1f, 0.4f), foot = s * rng_in(r, 0.02f, 0.1f);
	float depth = rng_in(r, 0.2f, 0.85f), hills = rng_in(r, 1.5f, 5);

	if (rng_chance(r, 0.25f)) { /* standing: a carved wall or tablet */
		sim_add_relief(b, v3(0, 0, y), v3(x, y, 0.4f * z), depth, 1.5f * hills,
			       sim_tumbled(0, 0, 0.25f), &m);
		return x;
	}
	sim_add(b, SHAPE_BOX, v3(0, 0, foot), v3(1.03f * x, 1.03f * y, foot), 0, &base);
	sim_add_relief(b, v3(0, 0, 2 * foot + z), v3(x, y, z), depth, hills, sim_turned(0), &m);
	return maxf(x, y);
}

float sim_make_carved(struct builder *b, float s)
{
	static const struct {
		enum solid solid;
		enum cut cut;
		float least, most; /* size of the cut in the smaller half side */
	} kinds[] = {
		{SOLID_BOX, CUT_DIP, 0.5f, 0.95f},     {SOLID_BOX, CUT_BORE, 0.3f, 0.8f},
		{SOLID_BOX, CUT_SLOT, 0.15f, 0.6f},    {SOLID_BOX, CUT_CORNERS, 0.3f, 0.8f},
		{SOLID_BOX, CUT_FLUTES, 0.08f, 0.25f}, {SOLID_BALL, CUT_DIP, 0.5f, 0.9f},
		{SOLID_BALL, CUT_BORE, 0.2f, 0.6f},    {SOLID_BALL, CUT_SLOT, 0.1f, 0.4f},
		{SOLID_DRUM, CUT_DIP, 0.5f, 0.9f},     {SOLID_DRUM, CUT_SLOT, 0.15f, 0.5f},
		{SOLID_DRUM, CUT_FLUTES, 0.1f, 0.3f},
	};
	struct rng *r = b->rng;
	struct material m = sim_material_any(r, s);
	uint32_t kind = rng_below(r, sizeof(kinds) / sizeof(kinds[0]));
	float x = s * rng_in(r, 0.5f, 0.9f), y = x * rng_in(r, 0.7f, 1);
	float z = s * rng_in(r, 0.25f, 0.7f), size;

	if (kinds[kind].solid != SOLID_BOX)
		y = x;
	size = minf(x, minf(y, 1.4f * z)) * rng_in(r, kinds[kind].least, kinds[kind].most);
	sim_add_carved(b, kinds[kind].solid, kinds[kind].cut, v3(0, 0, z), v3(x, y, z), size, &m);
	return x;
}

float sim_make_rings(struct builder *b, float s)
{
	struct rng *r = b->rng;
	uint32_t count = 1 + rng_below(r, 3);
	float z = 0, x = s * rng_in(r, 0.5f, 0.8f);

	for (uint32_t i = 0; i < count; i++) {
		struct material m = sim_material_any(r, s);
		float high = s * rng_in(r, 0.06f, 0.3f);
		enum solid solid = rng_chance(r, 0.7f) ? SOLID_DRUM : SOLID_BOX;

		sim_add_carved(b, solid, CUT_BORE, v3(0, 0, z + high), v3(x, x, high),
			       x * rng_in(r, 0.35f, 0.8f), &m);
		z += 2 * high;
		x *= rng_in(r, 0.7f, 1);
	}
	return 0.8f * s;
}

float sim_make_plant(struct builder *b, float s)
{
	struct rng *r = b->rng;
	struct material pot = sim_material_any(r, 0.5f * s), leaf;
	float high = s * rng_in(r, 0.2f, 0.4f), wide = s * rng_in(r, 0.25f, 0.4f);
	uint32_t leaves = 5 + rng_below(r, 8);

	leaf = sim_material(r, TEX_STRIPES, s * rng_in(r, 0.05f, 0.2f));
	for (int i = 0; i < 3; i++)
		leaf.colour[i] = sim_hsv_in(r, v3(0.18f, 0.3f, 0.2f), v3(0.4f, 0.8f, 0.6f));
	sim_add(b, SHAPE_FRUSTUM, v3(0, 0, high), v3(0.75f * wide, wide, high), wide, &pot);
	for (uint32_t i = 0; i < leaves; i++) {
		float turn = ((float)i + 0.5f * rng_unit(r)) / (float)leaves;
		float rise = rng_in(r, 0.03f, 0.21f), length = s * rng_in(r, 0.3f, 0.55f);
		struct v3 along = v3(cos_turns(turn) * cos_turns(rise),
				     sin_turns(turn) * cos_turns(rise), sin_turns(rise));
		struct v3 at = v3_scale(along, 0.9f * length);

		at.z += 2 * high;
		sim_add_turned(b, SHAPE_ELLIPSOID, at,
			       v3(length, length * rng_in(r, 0.15f, 0.35f), 0.035f * length), 0,
			       sim_tumbled(turn, -rise, 0), &leaf);
	}
	return 0.7f * s;
}

/* What is kept in glass: a drink, a ball, a block. */
static void fill_glass(struct builder *b, float wide, float floor, float high)
{
	struct rng *r = b->rng;
	struct material m = sim_material_any(r, wide);

	switch (rng_below(r, 3)) {
	case 0:
		high *= rng_in(r, 0.3f, 0.9f);
		sim_add(b, SHAPE_CYLINDER, v3(0, 0, floor + high), v3(wide, wide, high), 0, &m);
		break;
	case 1:
		wide = minf(wide, high);
		sim_add(b, SHAPE_ELLIPSOID, v3(0, 0, floor + wide), v3(wide, wide, wide), 0, &m);
		break;
	default:
		sim_add(b, SHAPE_BOX, v3(0, 0, floor + 0.5f * high),
			v3(0.6f * wide, 0.5f * wide, 0.5f * high), 0, &m);
		break;
	}
}

float sim_make_glassware(struct builder *b, float s)
{
	struct rng *r = b->rng;
	struct material glass = sim_material_glass(r), cap = sim_material_any(r, s);
	float radius = s * rng_in(r, 0.3f, 0.5f), high = s * rng_in(r, 0.4f, 0.9f), neck;

	switch (rng_below(r, 4)) {
	case 0: /* a drinking glass */
		sim_add(b, SHAPE_CUP, v3(0, 0, high), v3(radius, radius, high), 0.06f * radius,
			&glass);
		if (rng_chance(r, 0.6f))
			fill_glass(b, 0.9f * radius, 0.1f * radius, 0.8f * high);
		return radius;
	case 1: /* a bottle, with a label on most */
		neck = radius * rng_in(r, 0.2f, 0.5f);
		sim_add(b, SHAPE_CYLINDER, v3(0, 0, high), v3(radius, radius, high), 0, &glass);
		sim_add(b, SHAPE_FRUSTUM, v3(0, 0, 2.2f * high), v3(radius, radius, 0.2f * high),
			neck, &glass);
		sim_add(b, SHAPE_CYLINDER, v3(0, 0, 2.55f * high), v3(neck, neck, 0.15f * high), 0,
			&cap);
		cap = sim_material(r, rng_chance(r, 0.5f) ? TEX_PRINT : TEX_PICTURE, 0.3f * s);
		if (rng_chance(r, 0.7f))
			sim_add(b, SHAPE_CYLINDER, v3(0, 0, 0.9f * high),
				v3(1.01f * radius, radius, 0.45f * high), 0, &cap);
		return radius;
	case 2: /* a ball or a lens */
		sim_add(b, SHAPE_ELLIPSOID, v3(0, 0, high),
			v3(radius, radius, rng_chance(r, 0.5f) ? radius : high), 0, &glass);
		sim_add(b, SHAPE_CYLINDER, v3(0, 0, 0.5f * high), v3(0.3f * radius, 0, 0.5f * high),
			0, &cap);
		return radius;
	default: /* a case */
		fill_glass(b, 0.8f * radius, 0.06f * s, 0.8f * high);
		sim_add(b, SHAPE_BOX, v3(0, 0, 0.03f * s),
			v3(1.1f * radius, 1.1f * radius, 0.03f * s), 0, &cap);
		sim_add(b, SHAPE_BOX, v3(0, 0, 0.06f * s + high), v3(radius, radius, high), 0,
			&glass);
		return 1.3f * radius;
	}
}

float sim_make_lamp(struct builder *b, float s)
{
	struct rng *r = b->rng;
	struct material metal = sim_material_any(r, s);
	struct material shade =
		sim_material_plain(sim_hsv_in(r, v3(0.06f, 0.1f, 0.8f), v3(0.15f, 0.5f, 0.95f)));
	float stem = s * rng_in(r, 0.4f, 0.7f), wide = s * rng_in(r, 0.3f, 0.5f);
	float high = s * rng_in(r, 0.2f, 0.35f);

	shade.emission = rng_in(r, 0.3f, 1.2f);
	sim_add(b, SHAPE_CYLINDER, v3(0, 0, 0.05f * s), v3(0.35f * s, 0, 0.05f * s), 0, &metal);
	sim_add(b, SHAPE_CYLINDER, v3(0, 0, stem), v3(0.04f * s, 0, stem), 0, &metal);
	sim_add(b, SHAPE_FRUSTUM, v3(0, 0, 2 * stem + 0.6f * high), v3(wide, wide, high),
		wide * rng_in(r, 0.4f, 1), &shade);
	return maxf(wide, 0.35f * s);
}

float sim_make_rack(struct builder *b, float s)
{
	struct rng *r = b->rng;
	struct material m = sim_material_any(r, 0.3f * s);
	uint32_t bars = 4 + rng_below(r, 7);
	float x = s * rng_in(r, 0.5f, 0.9f), high = s * rng_in(r, 0.2f, 0.6f);
	float thin = s * rng_in(r, 0.012f, 0.04f);
	enum shape shape = rng_chance(r, 0.5f) ? SHAPE_CYLINDER : SHAPE_BOX;

	for (uint32_t i = 0; i < bars; i++)
		sim_add(b, shape, v3(x * (2 * (float)i / (float)(bars - 1) - 1), 0, high),
			v3(thin, thin, high), 0, &m);
	sim_add(b, SHAPE_BOX, v3(0, 0, 2 * high), v3(1.05f * x, 1.5f * thin, 1.2f * thin), 0, &m);
	sim_add(b, SHAPE_BOX, v3(0, 0, 0.3f * high), v3(1.05f * x, 1.5f * thin, 1.2f * thin), 0,
		&m);
	return x;
}

float sim_make_wires(struct builder *b, float s)
{
	struct rng *r = b->rng;
	uint32_t count = 2 + rng_below(r, 4);

	for (uint32_t i = 0; i < count; i++) {
		struct material m = sim_material_plain(sim_colour_any(r));
		float ring = s * rng_in(r, 0.3f, 0.7f), tube = s * rng_in(r, 0.02f, 0.06f);
		struct v3 at = rng_about(r, 0.3f * s, 0.3f * s, 0);
		bool up = rng_chance(r, 0.4f);
		float turn = rng_unit(r), span = up ? 0.25f : rng_in(r, 0.1f, 0.45f);

		/* An upright one stands on its two ends. */
		at.z = up ? 0 : tube;
		sim_add_turned(b, SHAPE_ARC, at, v3(ring, tube, 0), span,
			       up ? sim_tumbled(turn, -0.25f, 0) : sim_turned(turn), &m);
	}
	return 0.8f * s;
}

float sim_make_chair(struct builder *b, float s)
{
	struct rng *r = b->rng;
	struct material wood = sim_material(r, TEX_WOOD, 0.3f * s), seat = sim_material_any(r, s);
	float x = 0.45f * s, y = 0.45f * s, high = s * rng_in(r, 0.35f, 0.55f), thin = 0.05f * s;
	float back = rng_chance(r, 0.75f) ? s * rng_in(r, 0.35f, 0.6f) : 0;

	for (int k = 0; k < 4; k++)
		sim_add(b, SHAPE_BOX,
			v3((k & 1 ? 1 : -1) * (x - thin), (k & 2 ? 1 : -1) * (y - thin), high),
			v3(thin, thin, high), 0, &wood);
	sim_add(b, SHAPE_ROUND_BOX, v3(0, 0, 2 * high + thin), v3(x, y, 1.2f * thin), thin, &seat);
	if (back > 0) {
		for (int k = -1; k <= 1; k += 2)
			sim_add(b, SHAPE_BOX, v3((float)k * (x - thin), y - thin, 2 * high + back),
				v3(thin, thin, back), 0, &wood);
		sim_add(b, SHAPE_BOX, v3(0, y - thin, 2 * high + 1.6f * back),
			v3(x, 0.7f * thin, 0.4f * back), 0, &seat);
	}
	return 1.3f * x;
}

float sim_make_frame(struct builder *b, float s)
{
	struct rng *r = b->rng;
	struct material frame = sim_material_any(r, 0.3f * s), inner;
	float x = s * rng_in(r, 0.4f, 0.8f), z = s * rng_in(r, 0.4f, 0.9f), edge = 0.08f * s;
	struct rotation lean = sim_tumbled(0, 0, rng_in(r, -0.05f, -0.02f));

	if (rng_chance(r, 0.5f)) {
		inner = sim_material_plain(v3(0.03f, 0.03f, 0.03f));
		inner.specular = rng_in(r, 0.7f, 0.92f);
		inner.gloss_log2 = 9;
		inner.reflects = true;
	} else {
		inner = sim_material(r, TEX_PICTURE, s * rng_in(r, 0.3f, 0.8f));
	}
	sim_add_turned(b, SHAPE_BOX, v3(0, 0, z + edge), v3(x + edge, 0.03f * s, z + edge), 0, lean,
		       &frame);
	sim_add_turned(b, SHAPE_BOX, v3(0, -0.02f * s, z + edge), v3(x, 0.03f * s, z), 0, lean,
		       &inner);
	return x;
}

float sim_make_figure(struct builder *b, float s)
{
	struct rng *r = b->rng;
	struct material stone =
		sim_material(r, rng_chance(r, 0.6f) ? TEX_NOISE : TEX_PLAIN, 0.4f * s);
	uint32_t lumps = 3 + rng_below(r, 5);
	float z = 0.12f * s, w = s * rng_in(r, 0.3f, 0.5f);

	stone.reflects = false;
	sim_add_carved(b, SOLID_BOX, CUT_FLUTES, v3(0, 0, z), v3(1.3f * w, 1.3f * w, z), 0.06f * s,
		       &stone);
	z *= 2;
	for (uint32_t i = 0; i < lumps; i++) {
		float h = w * rng_in(r, 0.5f, 1.1f), y = w * rng_in(r, 0.6f, 1);
		float depth = rng_in(r, 0.08f, 0.25f), wave = rng_in(r, 1, 3);
		struct v3 at = rng_about(r, 0.35f * w, 0.35f * w, 0);

		at.z = z + 0.8f * h;
		sim_add_rock(b, at, v3(w, y, h), depth, wave, &stone);
		z += 1.1f * h;
		w *= rng_in(r, 0.6f, 1);
	}
	return 0.65f * s;
}
