/* Inside four walls: furniture along them, pictures, windows and doors on them, clutter. */
#include "build.h"

static void hang_on_wall(struct dio_sim_scene *s, struct rng *r)
{
	struct v3 lo = s->room_lo, hi = s->room_hi, half, at;
	bool on_x = rng_chance(r, 0.5f), high = rng_chance(r, 0.5f);
	float w = rng_in(r, 0.15f, 0.8f), h = rng_in(r, 0.15f, 0.8f), d = rng_in(r, 0.01f, 0.06f);
	float z = rng_in(r, lo.z + 0.9f, hi.z - 0.5f), kind = rng_unit(r);
	struct material m = sim_material_any(r, 0.8f);
	struct material frame = sim_material_plain(sim_colour_any(r));
	struct builder b;

	if (kind < 0.35f) {
		m = sim_material(r, TEX_PICTURE, rng_in(r, 0.2f, 0.8f));
	} else if (kind < 0.5f) { /* a window onto the sky */
		m = sim_material_plain(v3_scale(v3(0.75f, 0.85f, 1), rng_in(r, 0.5f, 1.3f)));
		m.emission = 1;
	} else if (kind < 0.65f) { /* a door */
		h = 1;
		w = 0.42f;
		z = lo.z + h;
	}
	half = on_x ? v3(d, w, h) : v3(w, d, h);
	at = rng_box(r, v3(lo.x + w, lo.y + w, z), v3(hi.x - w, hi.y - w, z));
	if (on_x)
		at.x = high ? hi.x : lo.x;
	else
		at.y = high ? hi.y : lo.y;
	if (!sim_thing_begin(&b, s, r, at, sim_turned(0)))
		return;
	sim_add(&b, SHAPE_BOX, v3(0, 0, 0), half, 0, &m);
	half = v3_add(half, v3(0.05f, 0.05f, 0.05f));
	if (on_x)
		half.x = 0.7f * d;
	else
		half.y = 0.7f * d;
	sim_add(&b, SHAPE_BOX, v3(0, 0, 0), half, 0, &frame);
	sim_thing_end(&b, false);
}

/* Cupboards, sofas, beds: large boxes with parts, standing at a wall. */
static void furnish(struct dio_sim_scene *s, struct rng *r)
{
	struct material m = sim_material_any(r, 0.8f), second = sim_material_any(r, 0.5f);
	float w = rng_in(r, 0.3f, 0.9f), d = rng_in(r, 0.2f, 0.4f), h = rng_in(r, 0.2f, 0.9f);
	uint32_t wall = rng_below(r, 4), parts = 1 + rng_below(r, 4);
	float turn = 0.25f * (float)wall, u = rng_in(r, 0.15f, 0.85f);
	struct v3 lo = s->room_lo, hi = s->room_hi, at;
	struct builder b;

	/* Wall 0 is y high; the thing's own y points at its wall. */
	at = wall == 0   ? v3(mixf(lo.x, hi.x, u), hi.y - d, lo.z)
	     : wall == 1 ? v3(lo.x + d, mixf(lo.y, hi.y, u), lo.z)
	     : wall == 2 ? v3(mixf(lo.x, hi.x, u), lo.y + d, lo.z)
			 : v3(hi.x - d, mixf(lo.y, hi.y, u), lo.z);
	if (!sim_thing_begin(&b, s, r, at, sim_turned(turn)))
		return;
	if (rng_chance(r, 0.3f)) { /* a seat: base, back, arms */
		sim_add(&b, SHAPE_ROUND_BOX, v3(0, 0, 0.2f), v3(w, d, 0.2f), 0.06f, &m);
		sim_add(&b, SHAPE_ROUND_BOX, v3(0, 0.75f * d, 0.5f), v3(w, 0.25f * d, 0.4f), 0.06f,
			&m);
		sim_add(&b, SHAPE_ROUND_BOX, v3(w, 0, 0.3f), v3(0.1f, d, 0.3f), 0.06f, &second);
		sim_add(&b, SHAPE_ROUND_BOX, v3(-w, 0, 0.3f), v3(0.1f, d, 0.3f), 0.06f, &second);
	} else {
		sim_add(&b, SHAPE_BOX, v3(0, 0, h), v3(w, d, h), 0, &m);
		for (uint32_t i = 0; i < parts; i++) /* drawers and doors */
			sim_add(&b, SHAPE_BOX, v3(0, -d, 2 * h * ((float)i + 0.5f) / (float)parts),
				v3(0.9f * w, 0.02f, 0.85f * h / (float)parts), 0, &second);
		sim_thing_end(&b, true);
		if (rng_chance(r, 0.7f))
			sim_object_add(s, r, v3(at.x, at.y, lo.z + 2 * h), rng_in(r, 0.1f, 0.25f));
		return;
	}
	sim_thing_end(&b, true);
}

void sim_build_room(struct dio_sim_scene *s, struct rng *r)
{
	float half_x = rng_in(r, 1.5f, 4), half_y = rng_in(r, 1.5f, 4);
	struct material wall = sim_material_wall(r, 3);
	uint32_t hung = 2 + rng_below(r, 7), large = 2 + rng_below(r, 6),
		 small = 2 + rng_below(r, 7);

	s->surround = SURROUND_ROOM;
	s->ground_z = 0;
	s->room_lo = v3(-half_x, -half_y, 0);
	s->room_hi = v3(half_x, half_y, rng_in(r, 2.2f, 3.2f));
	for (int i = 0; i < 6; i++)
		s->wall[i] = wall;
	if (rng_chance(r, 0.5f))
		s->wall[rng_below(r, 4)] = sim_material_wall(r, 3);
	s->wall[4] = sim_material_floor(r, 4);
	s->wall[5] = sim_material_plain(sim_hsv_in(r, v3(0, 0.05f, 0.7f), v3(1, 0.05f, 0.95f)));
	s->focus = v3(0, 0, rng_in(r, 0.6f, 1.2f));
	s->extent = 0.75f * minf(half_x, half_y);
	sim_lights_indoor(s, r);
	/* Lamps hang below the ceiling. */
	for (uint32_t i = 0; i < s->light_count; i++) {
		struct light *l = &s->light[i];
		float before, now;
		struct v3 d;

		if (l->directional)
			continue;
		d = v3_sub(l->at, s->focus);
		before = v3_dot(d, d);
		l->at.x = clampf(l->at.x, -0.8f * half_x, 0.8f * half_x);
		l->at.y = clampf(l->at.y, -0.8f * half_y, 0.8f * half_y);
		l->at.z = minf(l->at.z, s->room_hi.z - 0.15f);
		d = v3_sub(l->at, s->focus);
		now = v3_dot(d, d);
		l->colour = v3_scale(l->colour, (now + 0.3f) / before);
	}
	for (uint32_t i = 0; i < hung; i++)
		hang_on_wall(s, r);
	for (uint32_t i = 0; i < large; i++)
		furnish(s, r);
	for (uint32_t i = 0; i < small; i++) {
		struct v3 at = rng_about(r, 0.85f * half_x, 0.85f * half_y, 0);

		sim_object_add(s, r, at, rng_in(r, 0.12f, 0.45f));
	}
}
