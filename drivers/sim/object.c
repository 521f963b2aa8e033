/* Things that stand on tables and floors, each made of a few primitives. Sizes are relative to
 * `s`, about half of the thing's largest side. */
#include "object.h"

static float simple_solid(struct builder *b, float s)
{
	struct rng *r = b->rng;
	struct material m = sim_material_any(r, s);
	float x = s * rng_in(r, 0.4f, 1), y = s * rng_in(r, 0.4f, 1), z = s * rng_in(r, 0.3f, 1.1f);

	switch (rng_below(r, 9)) {
	case 0:
	case 1:
		sim_add(b, SHAPE_BOX, v3(0, 0, z), v3(x, y, z), 0, &m);
		break;
	case 2:
		sim_add(b, SHAPE_ROUND_BOX, v3(0, 0, z), v3(x, y, z),
			rng_in(r, 0.15f, 0.6f) * minf(x, minf(y, z)), &m);
		break;
	case 3:
		sim_add(b, SHAPE_ELLIPSOID, v3(0, 0, z), v3(x, y, z), 0, &m);
		break;
	case 4:
		x = y = z = 0.7f * s;
		sim_add(b, SHAPE_ELLIPSOID, v3(0, 0, z), v3(x, y, z), 0, &m);
		break;
	case 5:
		y = x *= 0.7f;
		sim_add(b, SHAPE_CYLINDER, v3(0, 0, z), v3(x, x, z), 0, &m);
		break;
	case 6:
		y = x;
		sim_add(b, SHAPE_FRUSTUM, v3(0, 0, z), v3(x, x, z), x * rng_in(r, 0, 0.8f), &m);
		break;
	case 7:
		y = x;
		z = x * rng_in(r, 0.2f, 0.45f);
		sim_add(b, SHAPE_TORUS, v3(0, 0, z), v3(x - z, z, z), 0, &m);
		break;
	default:
		sim_add(b, SHAPE_PEBBLE, v3(0, 0, z), v3(x, y, z), rng_in(r, 0.05f, 0.2f), &m);
		break;
	}
	return maxf(x, y);
}

/* Cans, bottles, jars: a turned body with shoulder, neck and cap. */
static float vessel(struct builder *b, float s)
{
	struct rng *r = b->rng;
	struct material body = sim_material_any(r, s), cap = sim_material_plain(sim_colour_any(r));
	float radius = s * rng_in(r, 0.3f, 0.5f), high = s * rng_in(r, 0.6f, 1.0f);
	float neck = radius * rng_in(r, 0.25f, 0.9f), shoulder_h = 0.15f * high, z = 2 * high;

	sim_add(b, SHAPE_CYLINDER, v3(0, 0, high), v3(radius, radius, high), 0, &body);
	sim_add(b, SHAPE_FRUSTUM, v3(0, 0, z + shoulder_h), v3(radius, radius, shoulder_h), neck,
		rng_chance(r, 0.5f) ? &cap : &body);
	z += 2 * shoulder_h;
	if (rng_chance(r, 0.6f)) {
		float cap_h = high * rng_in(r, 0.05f, 0.3f);

		sim_add(b, SHAPE_CYLINDER, v3(0, 0, z + cap_h), v3(neck, neck, cap_h), 0, &cap);
	}
	return radius;
}

static float mug(struct builder *b, float s)
{
	struct rng *r = b->rng;
	struct material m = sim_material_any(r, s);
	float radius = 0.5f * s, high = s * rng_in(r, 0.45f, 0.8f), ring = 0.6f * high;

	sim_add(b, SHAPE_CUP, v3(0, 0, high), v3(radius, radius, high), 0.12f * radius, &m);
	if (rng_chance(r, 0.7f)) {
		/* Upright ring, the far half of it inside the wall. */
		struct rotation upright = {{1, 0, 0, 0, 0, -1, 0, 1, 0}};

		sim_add_turned(b, SHAPE_ARC, v3(radius * 0.95f, 0, high),
			       v3(ring, 0.16f * radius, 0), 0.27f, upright, &m);
	}
	return radius * 1.2f;
}

static float book_stack(struct builder *b, float s)
{
	struct rng *r = b->rng;
	uint32_t count = 1 + rng_below(r, 5);
	float z = 0;

	for (uint32_t i = 0; i < count; i++) {
		enum texture_kind kind = rng_chance(r, 0.6f)   ? TEX_PRINT
					 : rng_chance(r, 0.5f) ? TEX_PICTURE
							       : TEX_PLAIN;
		struct material m = sim_material(r, kind, s * rng_in(r, 0.1f, 0.4f));
		float x = s * rng_in(r, 0.6f, 0.95f), thick = s * rng_in(r, 0.03f, 0.14f);

		sim_add_turned(b, SHAPE_BOX, v3(0, 0, z + thick), v3(x, 0.72f * x, thick), 0,
			       sim_turned(rng_in(r, -0.06f, 0.06f)), &m);
		z += 2 * thick;
	}
	return 0.9f * s;
}

static float plate(struct builder *b, float s)
{
	struct rng *r = b->rng;
	struct material m = sim_material_any(r, s), food = sim_material_any(r, 0.5f * s);
	float high = 0.07f * s;
	uint32_t pieces = rng_below(r, 5);

	sim_add(b, SHAPE_FRUSTUM, v3(0, 0, high), v3(0.55f * s, 0, high), 0.85f * s, &m);
	for (uint32_t i = 0; i < pieces; i++) {
		float size = s * rng_in(r, 0.12f, 0.3f);

		enum shape shape = rng_chance(r, 0.5f) ? SHAPE_ELLIPSOID : SHAPE_PEBBLE;
		struct v3 at = rng_about(r, 0.4f * s, 0.4f * s, 0);

		at.z = 2 * high + 0.8f * size;
		sim_add(b, shape, at, v3(size, size, 0.8f * size), 0.1f, &food);
	}
	return 0.85f * s;
}

static float fruit(struct builder *b, float s)
{
	struct rng *r = b->rng;
	enum texture_kind kind = rng_chance(r, 0.5f) ? TEX_NOISE : TEX_BLOTCHES;
	struct material m = sim_material(r, kind, s * rng_in(r, 0.2f, 0.8f));
	struct v3 skin = sim_hsv_in(r, v3(-0.03f, 0.6f, 0.5f), v3(0.3f, 0.9f, 0.95f));

	for (int i = 0; i < 3; i++)
		m.colour[i] = v3_mix(skin, m.colour[i], i == 0 ? 0 : 0.25f);
	if (rng_chance(r, 0.5f)) {
		float tube = s * rng_in(r, 0.16f, 0.28f);

		sim_add(b, SHAPE_ARC, v3(-0.4f * s, 0, tube), v3(0.8f * s, tube, 0),
			rng_in(r, 0.1f, 0.22f), &m);
		return 0.8f * s;
	}
	sim_add(b, SHAPE_PEBBLE, v3(0, 0, 0.55f * s), v3(0.6f * s, 0.6f * s, 0.55f * s),
		rng_in(r, 0.02f, 0.07f), &m);
	m = sim_material_plain(sim_colour_wood(r));
	sim_add(b, SHAPE_CYLINDER, v3(0, 0, 1.12f * s), v3(0.03f * s, 0, 0.12f * s), 0, &m);
	return 0.6f * s;
}

/* Columns and slabs, grown upwards: temples, shelves, machines, toys, furniture. */
static float tower(struct builder *b, float s)
{
	struct rng *r = b->rng;
	struct material a = sim_material_any(r, s), c = sim_material_any(r, 0.5f * s);
	float x = s * rng_in(r, 0.5f, 0.9f), y = s * rng_in(r, 0.4f, 0.9f), z = 0;
	uint32_t floors = 1 + rng_below(r, 3);

	for (uint32_t i = 0; i < floors; i++) {
		float slab = s * rng_in(r, 0.04f, 0.12f), post = s * rng_in(r, 0.15f, 0.5f);
		float thick = s * rng_in(r, 0.04f, 0.12f);
		enum shape shape = rng_chance(r, 0.5f) ? SHAPE_BOX : SHAPE_CYLINDER;

		sim_add(b, SHAPE_BOX, v3(0, 0, z + slab), v3(x, y, slab), 0, &a);
		z += 2 * slab;
		for (int k = 0; k < 4; k++)
			sim_add(b, shape,
				v3((k & 1 ? 0.8f : -0.8f) * x, (k & 2 ? 0.8f : -0.8f) * y,
				   z + post),
				v3(thick, thick, post), 0, &c);
		z += 2 * post;
	}
	sim_add(b, SHAPE_BOX, v3(0, 0, z + 0.05f * s), v3(1.05f * x, 1.05f * y, 0.05f * s), 0, &a);
	return sqrtf(x * x + y * y);
}

/* A body with parts stuck to it: toys, tools, vehicles, animals. */
static float assembly(struct builder *b, float s)
{
	static const enum shape shapes[] = {
		SHAPE_BOX,     SHAPE_BOX,   SHAPE_CYLINDER,  SHAPE_CYLINDER, SHAPE_ELLIPSOID,
		SHAPE_FRUSTUM, SHAPE_TORUS, SHAPE_ROUND_BOX, SHAPE_ARC,      SHAPE_PEBBLE};
	struct rng *r = b->rng;
	struct material paint[3];
	uint32_t parts = 4 + rng_below(r, 9);

	for (int i = 0; i < 3; i++)
		paint[i] = sim_material_any(r, 0.7f * s);
	sim_add(b, rng_chance(r, 0.5f) ? SHAPE_ROUND_BOX : SHAPE_BOX, v3(0, 0, 0.45f * s),
		v3(0.6f * s, 0.35f * s, 0.3f * s), 0.1f * s, &paint[0]);
	for (uint32_t i = 0; i < parts; i++) {
		enum shape shape = shapes[rng_below(r, 10)];
		float q = s * rng_in(r, 0.08f, 0.3f);
		struct v3 at = rng_box(r, v3(-0.7f * s, -0.45f * s, 0.2f * s),
				       v3(0.7f * s, 0.45f * s, 0.9f * s));
		struct v3 half = rng_box(r, v3(q, 0.3f * q, 0.3f * q), v3(q, q, 1.5f * q));
		float turn = 0.25f * (float)rng_below(r, 4);
		float pitch = 0.25f * (float)rng_below(r, 4);
		float roll = rng_chance(r, 0.2f) ? rng_unit(r) : 0;
		float extra = 0.2f * minf(half.x, minf(half.y, half.z));

		if (shape == SHAPE_FRUSTUM)
			extra = half.x * rng_in(r, 0, 0.7f);
		if (shape == SHAPE_TORUS || shape == SHAPE_ARC) {
			half.y = 0.3f * q;
			extra = 0.2f;
		}
		if (shape == SHAPE_PEBBLE)
			extra = 0.12f;
		sim_add_turned(b, shape, at, half, extra, sim_tumbled(turn, pitch, roll),
			       &paint[rng_below(r, 3)]);
	}
	return 0.9f * s;
}

static float house(struct builder *b, float s)
{
	struct rng *r = b->rng;
	struct material wall = sim_material(r, TEX_FACADE, s * rng_in(r, 0.15f, 0.3f));
	struct material roof =
		sim_material(r, rng_chance(r, 0.5f) ? TEX_TILES : TEX_STRIPES, 0.1f * s);
	float x = s * rng_in(r, 0.5f, 0.9f), y = s * rng_in(r, 0.3f, 0.6f),
	      z = s * rng_in(r, 0.3f, 0.6f);
	float side = 0.7071f * y;

	wall.specular = 0;
	wall.reflects = false;
	sim_add(b, SHAPE_BOX, v3(0, 0, z), v3(x, y, z), 0, &wall);
	/* A bar on its edge makes the gable. */
	sim_add_turned(b, SHAPE_BOX, v3(0, 0, 2 * z), v3(1.03f * x, side, side), 0,
		       sim_tumbled(0, 0, 0.125f), &roof);
	if (rng_chance(r, 0.6f))
		sim_add(b, SHAPE_BOX, v3(rng_in(r, -0.6f, 0.6f) * x, 0.4f * y, 2 * z + 0.5f * y),
			v3(0.06f * s, 0.06f * s, 0.5f * y), 0, &wall);
	if (rng_chance(r, 0.5f)) {
		float w = 0.35f * x;

		sim_add(b, SHAPE_BOX, v3(w - x, -y, 1.3f * z), v3(w, w, 1.3f * z), 0, &wall);
		sim_add(b, SHAPE_FRUSTUM, v3(w - x, -y, 2.6f * z + 0.3f * z),
			v3(1.2f * w, 0, 0.3f * z), 0.02f * w, &roof);
	}
	return sqrtf(x * x + y * y);
}

/* Sheets of paper, cloths, phones: flat and printed. */
static float flat(struct builder *b, float s)
{
	struct rng *r = b->rng;
	enum texture_kind kind = rng_chance(r, 0.6f)   ? TEX_PICTURE
				 : rng_chance(r, 0.6f) ? TEX_PRINT
						       : TEX_MOTIF;
	struct material m = sim_material(r, kind, s * rng_in(r, 0.1f, 0.8f));
	float x = s * rng_in(r, 0.5f, 1), y = s * rng_in(r, 0.4f, 0.8f),
	      thick = rng_chance(r, 0.6f) ? 0.006f * s : 0.05f * s;

	sim_add(b, SHAPE_BOX, v3(0, 0, thick), v3(x, y, thick), 0, &m);
	return maxf(x, y);
}

/* Sticks: pencils, cutlery, cables, railings. */
static float sticks(struct builder *b, float s)
{
	struct rng *r = b->rng;
	uint32_t count = 1 + rng_below(r, 4);

	for (uint32_t i = 0; i < count; i++) {
		struct material m = sim_material_any(r, 0.3f * s);
		float thin = s * rng_in(r, 0.02f, 0.06f);
		struct v3 at = rng_about(r, 0.3f * s, 0.3f * s, 0);
		enum shape shape = rng_chance(r, 0.5f) ? SHAPE_CYLINDER : SHAPE_BOX;
		float length = s * rng_in(r, 0.5f, 0.9f);

		at.z = thin;
		sim_add_turned(b, shape, at, v3(thin, thin, length), 0,
			       sim_tumbled(rng_unit(r), 0.25f, 0), &m);
	}
	return 0.7f * s;
}

float sim_object_add(struct dio_sim_scene *scene, struct rng *rng, struct v3 origin, float size)
{
	static float (*const makers[])(struct builder *, float) = {
		simple_solid,
		simple_solid,
		simple_solid,
		simple_solid,
		vessel,
		vessel,
		mug,
		book_stack,
		plate,
		fruit,
		fruit,
		tower,
		assembly,
		assembly,
		house,
		flat,
		sticks,
		sim_make_rocks,
		sim_make_relief,
		sim_make_relief,
		sim_make_carved,
		sim_make_carved,
		sim_make_rings,
		sim_make_plant,
		sim_make_plant,
		sim_make_rack,
		sim_make_glassware,
		sim_make_glassware,
		sim_make_wires,
		sim_make_chair,
		sim_make_figure,
		sim_make_lamp,
		sim_make_frame,
	};
	struct builder b;
	float radius;

	if (!sim_thing_begin(&b, scene, rng, origin, sim_turned(rng_unit(rng))))
		return 0;
	radius = makers[rng_below(rng, sizeof(makers) / sizeof(makers[0]))](&b, size);
	sim_thing_end(&b, true);
	return radius;
}
