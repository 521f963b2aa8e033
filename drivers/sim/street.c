/* Out of doors: house fronts, walls, monuments and what stands before them. */
#include "build.h"

static void add_front(struct dio_sim_scene *s, struct rng *r, struct v3 at, float turn,
		      float half_w)
{
	float high = rng_in(r, 2.5f, 7), deep = rng_in(r, 1, 3), story = rng_in(r, 2.2f, 3.2f);
	struct material wall =
		sim_material(r, rng_chance(r, 0.75f) ? TEX_FACADE : TEX_TILES, story);
	struct material trim = sim_material_plain(v3_scale(wall.colour[0], 0.8f));
	struct material roof = sim_material(r, TEX_TILES, 0.5f);
	struct builder b;

	wall.colour[0] = rng_chance(r, 0.5f) ? sim_colour_neutral(r) : sim_colour_wood(r);
	wall.specular = roof.specular = 0;
	wall.reflects = roof.reflects = false;
	if (wall.texture == TEX_TILES)
		wall.scale = 1 / rng_in(r, 0.3f, 0.9f);
	if (!sim_thing_begin(&b, s, r, at, sim_turned(turn)))
		return;
	sim_add(&b, SHAPE_BOX, v3(0, deep, high), v3(half_w, deep, high), 0, &wall);
	sim_add(&b, SHAPE_BOX, v3(0, deep, 2 * high), v3(1.02f * half_w, deep + 0.25f, 0.15f), 0,
		&trim);
	if (rng_chance(r, 0.6f)) {
		float side = 0.7071f * deep;

		sim_add_turned(&b, SHAPE_BOX, v3(0, deep, 2 * high), v3(half_w, side, side), 0,
			       sim_tumbled(0, 0, 0.125f), &roof);
	}
	if (rng_chance(r, 0.5f)) { /* a porch with columns */
		float w = 0.25f * half_w, h = 0.35f * high;

		for (int k = 0; k < 4; k++)
			sim_add(&b, SHAPE_CYLINDER, v3((float)(k - 1) * w - 0.5f * w, -0.6f, h),
				v3(0.15f, 0.15f, h), 0, &trim);
		sim_add(&b, SHAPE_BOX, v3(-0.5f * w + 0.5f * w, -0.4f, 2 * h + 0.1f),
			v3(2.1f * w, 0.5f, 0.12f), 0, &trim);
	}
	sim_thing_end(&b, false);
}

/* Stacked slabs, balls and niches, wider below: fountains, altars, memorials. */
static void add_monument(struct dio_sim_scene *s, struct rng *r, struct v3 at)
{
	struct material stone = sim_material(r, rng_chance(r, 0.5f) ? TEX_NOISE : TEX_MARBLE, 0.7f);
	uint32_t steps = 3 + rng_below(r, 5);
	float z = 0, w = rng_in(r, 1, 2.2f);
	struct builder b;

	stone.colour[0] = rng_chance(r, 0.5f) ? sim_colour_neutral(r) : sim_colour_wood(r);
	stone.colour[1] = v3_scale(stone.colour[0], 0.7f);
	stone.specular = 0;
	stone.reflects = false;
	if (!sim_thing_begin(&b, s, r, at, sim_turned(rng_in(r, -0.03f, 0.03f))))
		return;
	for (uint32_t i = 0; i < steps; i++) {
		float h = rng_in(r, 0.08f, 0.45f);

		switch (rng_below(r, 4)) {
		case 0:
			for (int k = -1; k <= 1; k++)
				sim_add(&b, SHAPE_CYLINDER,
					v3(0.7f * w * (float)k, 0, z + 1.5f * h),
					v3(0.14f * w, 0, 1.5f * h), 0, &stone);
			h *= 1.5f;
			break;
		case 1:
			sim_add(&b, SHAPE_ROUND_BOX, v3(0, 0, z + h), v3(w, 0.45f * w, h), 0.4f * h,
				&stone);
			break;
		case 2:
			sim_add(&b, SHAPE_FRUSTUM, v3(0, 0, z + h), v3(0.8f * w, 0, h), 0.5f * w,
				&stone);
			break;
		default:
			sim_add(&b, SHAPE_BOX, v3(0, 0, z + h), v3(w, 0.5f * w, h), 0, &stone);
			sim_add(&b, SHAPE_ELLIPSOID, v3(0, -0.5f * w, z + h),
				v3(0.25f * w, 0.12f * w, 0.9f * h), 0, &stone);
			break;
		}
		z += 2 * h;
		w *= rng_in(r, 0.65f, 1.02f);
	}
	sim_add(&b, SHAPE_PEBBLE, v3(0, 0, z + 0.3f), v3(0.35f * w, 0.35f * w, 0.4f), 0.12f,
		&stone);
	sim_thing_end(&b, true);
}

void sim_build_street(struct dio_sim_scene *s, struct rng *r)
{
	float half = rng_in(r, 3, 7);
	uint32_t clutter = 2 + rng_below(r, 6);
	struct v3 at;

	s->extent = 0.8f * half;
	s->focus = v3(0, 0, rng_in(r, 1, 2.2f));
	s->has_ground = true;
	s->ground = sim_material_floor(r, 8);
	s->ground.specular = 0;
	s->ground.reflects = false;
	sim_lights_outdoor(s, r);
	/* One front ahead; a wing on either side in some, so that courts and corners appear. The
	 * cameras stand at negative y. */
	at = v3(0, rng_in(r, 1.5f, 4), 0);
	add_front(s, r, at, rng_in(r, -0.03f, 0.03f), half);
	if (rng_chance(r, 0.5f))
		add_front(s, r, v3(-half, 0, 0), 0.25f, 0.8f * half);
	if (rng_chance(r, 0.4f))
		add_front(s, r, v3(half, 0, 0), -0.25f, 0.8f * half);
	if (rng_chance(r, 0.5f))
		add_monument(s, r, rng_about(r, 1, 0.5f, 0));
	for (uint32_t i = 0; i < clutter; i++) {
		at = rng_box(r, v3(-0.8f * half, -1.2f, 0), v3(0.8f * half, 1, 0));
		sim_object_add(s, r, at, rng_in(r, 0.3f, 1.1f));
	}
}
