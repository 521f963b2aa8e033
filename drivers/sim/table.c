/* Things on a table top at z = 0, in a room, in the open or before nothing much. */
#include "build.h"

/* Where things may stand, so that they do not run into one another. */
struct plot {
	float x, y, radius;
};

struct layout {
	struct plot plots[SIM_MAX_THINGS];
	uint32_t count;
	float clear_x, clear_y; /* kept free around the origin: the board */
	float reach_x, reach_y;
};

static bool place_is_free(const struct layout *l, float x, float y, float radius, float squeeze)
{
	if (absf(x) < l->clear_x + radius && absf(y) < l->clear_y + radius)
		return false;
	for (uint32_t i = 0; i < l->count; i++) {
		float dx = x - l->plots[i].x, dy = y - l->plots[i].y;
		float apart = squeeze * (radius + l->plots[i].radius);

		if (dx * dx + dy * dy < apart * apart)
			return false;
	}
	return true;
}

static void scatter(struct dio_sim_scene *s, struct rng *r, struct layout *l, uint32_t count,
		    float size)
{
	for (uint32_t i = 0; i < count && l->count < SIM_MAX_THINGS; i++) {
		float mine = size * rng_in(r, 0.5f, 1.3f);
		/* The first one stands where the cameras look: no picture of a bare table. */
		float wide = i == 0 && l->clear_x <= 0 ? 0.35f : 1;

		for (int attempt = 0; attempt < 24; attempt++) {
			float x = wide * rng_in(r, -l->reach_x, l->reach_x);
			float y = wide * rng_in(r, -l->reach_y, l->reach_y);
			struct plot *p = &l->plots[l->count];

			if (!place_is_free(l, x, y, mine, 0.85f))
				continue;
			if (sim_object_add(s, r, v3(x, y, 0), mine) <= 0)
				return;
			p->x = x;
			p->y = y;
			p->radius = mine;
			l->count++;
			break;
		}
	}
}

static void add_table(struct dio_sim_scene *s, struct rng *r, float half_x, float half_y)
{
	struct material top = sim_material_floor(r, 4 * s->extent);
	struct material leg = sim_material_any(r, half_x);
	struct builder b;
	float thick = 0.02f;

	top.emission = 0;
	if (top.specular > 0.1f)
		top.specular = 0.05f;
	if (!sim_thing_begin(&b, s, r, v3(0, 0, 0), sim_turned(0)))
		return;
	sim_add(&b, SHAPE_BOX, v3(0, 0, -thick), v3(half_x, half_y, thick), 0, &top);
	for (int k = 0; k < 4; k++)
		sim_add(&b, SHAPE_BOX,
			v3((k & 1 ? 0.9f : -0.9f) * half_x, (k & 2 ? 0.9f : -0.9f) * half_y,
			   0.5f * s->ground_z - thick),
			v3(0.035f, 0.035f, -0.5f * s->ground_z - thick), 0, &leg);
	sim_thing_end(&b, false);
}

/* Walls at some distance, a floor below the table, shelves and pictures on the walls. */
static void add_room_around(struct dio_sim_scene *s, struct rng *r)
{
	struct material walls = sim_material_wall(r, 2.5f), floor = sim_material_floor(r, 2.5f);
	float far = maxf(1.2f, 3.5f * s->extent);

	s->surround = SURROUND_ROOM;
	s->room_lo = v3_scale(rng_box(r, v3(1, 1, 0), v3(2.2f, 2.2f, 0)), -far);
	s->room_lo.z = s->ground_z;
	s->room_hi = v3_scale(rng_box(r, v3(1, 1, 0), v3(2.2f, 2.2f, 0)), far);
	s->room_hi.z = s->ground_z + 2.6f;
	for (int i = 0; i < 6; i++)
		s->wall[i] = walls;
	if (rng_chance(r, 0.3f))
		s->wall[rng_below(r, 4)] = sim_material_wall(r, 2.5f);
	s->wall[4] = floor;
	s->wall[5] = sim_material_plain(v3(0.7f, 0.7f, 0.68f));
	for (int i = 0; i < 6; i++) {
		struct material pic = sim_material_any(r, 0.5f);
		float w = rng_in(r, 0.1f, 0.5f), h = rng_in(r, 0.1f, 0.5f),
		      d = rng_in(r, 0.01f, 0.15f);
		bool on_x = rng_chance(r, 0.5f), high = rng_chance(r, 0.5f);
		struct v3 lo = s->room_lo, hi = s->room_hi, at, half;
		struct builder b;

		half = on_x ? v3(d, w, h) : v3(w, d, h);
		at = rng_box(r, v3(lo.x + w, lo.y + w, -0.2f), v3(hi.x - w, hi.y - w, 0.8f));
		if (rng_chance(r, 0.5f))
			at.z = lo.z + h;
		if (on_x)
			at.x = high ? hi.x - d : lo.x + d;
		else
			at.y = high ? hi.y - d : lo.y + d;
		if (!sim_thing_begin(&b, s, r, at, sim_turned(0)))
			return;
		sim_add(&b, SHAPE_BOX, v3(0, 0, 0), half, 0, &pic);
		sim_thing_end(&b, true);
	}
}

static void add_backdrop(struct dio_sim_scene *s, struct rng *r)
{
	float value = rng_in(r, 0.1f, 0.9f);

	s->surround = SURROUND_SKY;
	s->sky[0] = sim_hsv_in(r, v3(0, 0, value), v3(1, 0.3f, value));
	s->sky[1] = sim_hsv_in(r, v3(0, 0, 0.6f * value), v3(1, 0.3f, 1.1f * value));
	s->sky[2] = s->sky[0];
}

void sim_build_table(struct dio_sim_scene *s, struct rng *r, bool clear_board)
{
	struct layout layout = {.count = 0};
	float board_r =
		sqrtf(s->paper_half_x * s->paper_half_x + s->paper_half_y * s->paper_half_y);
	float around = rng_unit(r), size;
	struct v3 half;
	uint32_t count = rng_chance(r, 0.2f) ? 1 + rng_below(r, 2) : 3 + rng_below(r, 9);

	s->extent = rng_in(r, 0.16f, 0.4f);
	if (board_r > 0) /* the board fills a good part of the picture */
		s->extent = clampf(s->extent, 1.05f * board_r, 1.3f * board_r);
	if (clear_board) /* and there is something around it to look at */
		count = 5 + count / 2;
	s->focus = v3(0, 0, 0.1f * s->extent);
	s->ground_z = -rng_in(r, 0.45f, 0.8f);
	size = s->extent * rng_in(r, 0.28f, 0.5f);
	if (count > 6)
		size *= 0.75f;
	if (count < 3) /* a close look */
		size *= 1.3f;
	if (clear_board) /* what stands before the board should not hide it */
		size *= 0.65f;

	if (around < 0.55f) {
		add_room_around(s, r);
		half = rng_box(r, v3(1.6f, 1.4f, 0), v3(4, 3, 0));
		add_table(s, r, s->extent * half.x, s->extent * half.y);
		sim_lights_indoor(s, r);
	} else {
		s->has_ground = true;
		s->ground_z = 0;
		s->ground = sim_material_floor(r, 4 * s->extent);
		if (s->ground.specular > 0.1f)
			s->ground.specular = 0.05f;
		if (around < 0.75f) {
			sim_lights_outdoor(s, r);
		} else {
			add_backdrop(s, r);
			sim_lights_indoor(s, r);
		}
	}

	layout.reach_x = layout.reach_y = count < 3 ? 0.3f * s->extent : s->extent;
	if (clear_board && s->paper_half_x > 0) {
		layout.clear_x = s->paper_half_x;
		layout.clear_y = s->paper_half_y;
		layout.reach_x = s->paper_half_x + 2.2f * size;
		layout.reach_y = s->paper_half_y + 2.2f * size;
	}
	scatter(s, r, &layout, count, size);
}
