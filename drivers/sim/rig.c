#include "rig.h"

#include <string.h>

#include "trace.h"
#include "viewpoint.h"

/* Field of view across the short side, in turns: mostly phones and cameras, some long and some
 * wide lenses; things on turntables are often taken from afar. */
static float draw_field_of_view(struct rng *r, bool turntable)
{
	float kind = rng_unit(r), degrees;

	if (kind < (turntable ? 0.55f : 0.25f))
		degrees = rng_in(r, 17, 32);
	else if (kind < 0.8f)
		degrees = rng_in(r, 32, 56);
	else
		degrees = rng_in(r, 56, 85);
	return degrees / 360;
}

static void draw_intrinsics(struct rig *rig, struct rng *r, uint32_t width, uint32_t height,
			    float fov)
{
	double side = width < height ? width : height;
	double focal = 0.5 * side * cos_turns(0.5f * fov) / sin_turns(0.5f * fov);
	double off = rng_chance(r, 0.25f) ? 0.12 : 0.01;

	rig->fx = focal;
	rig->fy = rng_chance(r, 0.2f) ? focal * rng_in(r, 0.97f, 1.03f) : focal;
	rig->cx = 0.5 * width - 0.5 + off * side * rng_in(r, -1, 1);
	rig->cy = 0.5 * height - 0.5 + off * side * rng_in(r, -1, 1);
}

static void draw_roll(struct rig *rig, struct rng *r)
{
	float kind = rng_unit(r);

	rig->roll_span = rng_chance(r, 0.5f) ? 0.01f : 0.04f;
	if (kind < 0.82f)
		rig->roll = 0;
	else if (kind < 0.92f) /* camera on its side */
		rig->roll = rng_chance(r, 0.5f) ? 0.25f : -0.25f;
	else {
		rig->roll = rng_unit(r);
		rig->roll_span = 0.15f;
	}
}

static void draw_around(struct rig *rig, struct rng *r, bool turntable)
{
	float kind = rng_unit(r);

	rig->style = kind < 0.45f ? RIG_RING : kind < 0.8f ? RIG_DOME : RIG_FORWARD;
	rig->turn_span = rng_in(r, 0.08f, 0.5f);
	if (turntable && rig->style != RIG_FORWARD && rng_chance(r, 0.8f))
		rig->turn_span = rng_in(r, 0.5f, 1);
	rig->height = rng_in(r, 0.03f, 0.17f);
	if (rng_chance(r, 0.15f)) /* from above */
		rig->height = rng_in(r, 0.17f, 0.24f);
	rig->height_span = rig->style == RIG_DOME ? rng_in(r, 0.06f, 0.22f) : 0.03f;
}

struct rig sim_rig_draw(const struct dio_sim_scene *s, struct rng *r, uint32_t width,
			uint32_t height)
{
	float fov = draw_field_of_view(r, s->kind == DIO_SIM_TURNTABLE);
	float reach = s->extent * cos_turns(0.5f * fov) / sin_turns(0.5f * fov);
	struct rig rig;

	memset(&rig, 0, sizeof(rig));
	rig.turn = rng_unit(r);
	rig.aim = s->focus;
	rig.aim_jitter = s->extent * rng_in(r, 0.02f, 0.35f);
	rig.away_span = rng_in(r, 0, 0.4f);
	draw_roll(&rig, r);
	switch (s->kind) {
	case DIO_SIM_ROOM:
	case DIO_SIM_STREET: {
		float toward = rng_unit(r);

		rig.style = rng_chance(r, 0.5f)   ? RIG_FORWARD
			    : rng_chance(r, 0.5f) ? RIG_WALK
						  : RIG_RING;
		rig.turn_span = rng_in(r, 0.05f, 0.3f);
		rig.height = rng_in(r, -0.02f, 0.05f);
		rig.height_span = 0.03f;
		rig.away = s->extent * rng_in(r, 1, 1.7f);
		if (s->kind == DIO_SIM_STREET) {
			rig.turn = rng_in(r, 0.65f, 0.85f);
			rig.away = maxf(0.6f * reach, rig.away);
		}
		rig.aim.x += 0.5f * s->extent * cos_turns(toward);
		rig.aim.y += 0.5f * s->extent * sin_turns(toward);
		rig.roll = rng_chance(r, 0.9f) ? 0 : rig.roll;
		break;
	}
	case DIO_SIM_TURNTABLE:
		draw_around(&rig, r, true);
		if (rig.style == RIG_FORWARD)
			rig.style = RIG_RING;
		rig.away = reach * rng_in(r, 0.75f, 1.45f);
		rig.aim_jitter *= 0.4f;
		if (rng_chance(r, 0.5f)) /* an exact turntable */
			rig.away_span = rig.aim_jitter = 0;
		break;
	default:
		draw_around(&rig, r, false);
		rig.away = reach * rng_in(r, 0.55f, 1.3f);
		break;
	}
	draw_intrinsics(&rig, r, width, height, fov);
	return rig;
}

/* Keep out of things, inside of rooms and above the ground. */
static bool stands_free(const struct dio_sim_scene *s, struct v3 at, float room)
{
	if (s->has_ground && at.z < s->ground_z + room)
		return false;
	if (s->surround == SURROUND_ROOM &&
	    (at.x < s->room_lo.x + room || at.x > s->room_hi.x - room ||
	     at.y < s->room_lo.y + room || at.y > s->room_hi.y - room ||
	     at.z < s->room_lo.z + room || at.z > s->room_hi.z - room))
		return false;
	for (uint32_t i = 0; i < s->thing_count; i++) {
		if (at.x > s->lo_x[i] - room && at.x < s->hi_x[i] + room &&
		    at.y > s->lo_y[i] - room && at.y < s->hi_y[i] + room &&
		    at.z > s->lo_z[i] - room && at.z < s->hi_z[i] + room)
			return false;
	}
	return true;
}

static struct v3 into_room(const struct dio_sim_scene *s, struct v3 at, float margin)
{
	if (s->surround != SURROUND_ROOM)
		return at;
	at.x = clampf(at.x, s->room_lo.x + margin, s->room_hi.x - margin);
	at.y = clampf(at.y, s->room_lo.y + margin, s->room_hi.y - margin);
	at.z = clampf(at.z, s->room_lo.z + margin, s->room_hi.z - margin);
	return at;
}

static void place_on_path(const struct rig *rig, struct rng *r, float along, struct v3 *from,
			  struct v3 *aim)
{
	float u = along - 0.5f, turn = rig->turn, height = rig->height;
	float away = rig->away * (1 + rig->away_span * rng_in(r, -0.5f, 0.5f));
	struct v3 d;

	*aim = v3_add(rig->aim, v3_scale(rng_about(r, 1, 1, 0.6f), rig->aim_jitter));
	if (rig->style == RIG_RING || rig->style == RIG_DOME) {
		turn += rig->turn_span * u;
		height += rig->height_span * rng_in(r, -0.5f, 0.5f);
	}
	height = clampf(height, -0.05f, 0.245f);
	d = v3(cos_turns(turn) * cos_turns(height), sin_turns(turn) * cos_turns(height),
	       sin_turns(height));
	*from = v3_mad(rig->aim, d, away);
	if (rig->style == RIG_FORWARD || rig->style == RIG_WALK) {
		struct v3 side = v3(-sin_turns(turn), cos_turns(turn), 0);
		float wide = rig->away * 3 * rig->turn_span;

		*from = v3_mad(*from, side, wide * u);
		from->z += rig->away * rig->height_span * rng_in(r, -2, 2);
		if (rig->style == RIG_FORWARD) /* not quite parallel */
			*aim = v3_mad(*aim, side, 0.6f * wide * u);
		else /* walk on while looking there */
			*from = v3_mad(*from, d, -0.35f * rig->away * u);
	}
}

void sim_rig_camera(const struct dio_sim_scene *s, const struct rig *rig, struct rng *r,
		    float along, uint32_t width, uint32_t height, struct dio_sim_camera *camera)
{
	float room = 0.12f * rig->away;
	struct v3 from, aim;

	/* A place inside of something is drawn anew, higher and higher up in the end. */
	for (int attempt = 0; attempt < 12; attempt++) {
		place_on_path(rig, r, along, &from, &aim);
		if (attempt > 5)
			from.z += 0.08f * (float)(attempt - 5) * rig->away;
		if (s->has_ground)
			from.z = maxf(from.z, s->ground_z + room);
		from = into_room(s, from, 0.1f);
		if (stands_free(s, from, attempt < 9 ? room : 0.3f * room))
			break;
	}
	memset(camera, 0, sizeof(*camera));
	camera->width = width;
	camera->height = height;
	camera->fx = rig->fx;
	camera->fy = rig->fy;
	camera->cx = rig->cx;
	camera->cy = rig->cy;
	sim_look_at(from, aim, rig->roll + rig->roll_span * rng_in(r, -0.5f, 0.5f),
		    camera->world_from_camera);
}
