/* Where a hand would hold the camera. */
#include "viewpoint.h"

#include <string.h>

void sim_look_at(struct v3 from, struct v3 at, float roll, double world_from_camera[16])
{
	struct v3 z = v3_unit(v3_sub(at, from));
	struct v3 up = absf(z.z) > 0.999f ? v3(0, 1, 0) : v3(0, 0, 1);
	struct v3 x = v3_unit(v3_cross(z, up)), y = v3_cross(z, x);
	float c = cos_turns(roll), s = sin_turns(roll);
	struct v3 rx = v3_mad(v3_scale(x, c), y, s), ry = v3_mad(v3_scale(y, c), x, -s);
	/* Single precision leaves the axes 1e-7 off square: finish in double. */
	double a[3] = {rx.x, rx.y, rx.z}, b[3] = {ry.x, ry.y, ry.z}, dot = 0, na = 0, nb = 0;
	double pose[16] = {[3] = from.x, [7] = from.y, [11] = from.z, [15] = 1};

	for (int i = 0; i < 3; i++)
		na += a[i] * a[i];
	na = sqrt(na);
	for (int i = 0; i < 3; i++) {
		a[i] /= na;
		dot += a[i] * b[i];
	}
	for (int i = 0; i < 3; i++) {
		b[i] -= dot * a[i];
		nb += b[i] * b[i];
	}
	nb = sqrt(nb);
	for (int i = 0; i < 3; i++)
		b[i] /= nb;
	for (int i = 0; i < 3; i++) {
		int j = (i + 1) % 3, k = (i + 2) % 3;

		pose[4 * i] = a[i];
		pose[4 * i + 1] = b[i];
		pose[4 * i + 2] = a[j] * b[k] - a[k] * b[j];
	}
	memcpy(world_from_camera, pose, sizeof(pose));
}

/* Unsteady hand: slow sway and a little tremor, in units of `reach`. */
static struct v3 shake(double t, float reach)
{
	float s = (float)t;

	return v3(reach * (sin_turns(0.31f * s) + 0.3f * sin_turns(1.7f * s + 0.2f)),
		  reach * (sin_turns(0.23f * s + 0.4f) + 0.3f * sin_turns(1.9f * s + 0.7f)),
		  reach * (sin_turns(0.37f * s + 0.8f) + 0.3f * sin_turns(2.3f * s + 0.1f)));
}

/* Distance at which a thing of radius 1 fills a 45 degree picture with some room around it. */
#define COMFORTABLE 2.9f

/* Half the paper's diagonal; 0 without a board. */
static float board_radius(const struct dio_sim_scene *s)
{
	return sqrtf(s->paper_half_x * s->paper_half_x + s->paper_half_y * s->paper_half_y);
}

/* Once round in 40 s while rising and sinking, now nearer, now farther. */
static void walk(const struct dio_sim_scene *s, double t, double pose[16])
{
	float turn = (float)fmod(t / 40, 1.0) + unit_from(hash_u32((uint32_t)s->seed));
	float height = 0.105f + 0.035f * sin_turns((float)fmod(t / 17, 1.0)); /* turns */
	float board = board_radius(s);
	/* The markers of a board are small: near enough that a common lens reads them. */
	float reach = board > 0 ? 2.5f * board : COMFORTABLE * s->extent;
	float away = reach * (1 + 0.15f * sin_turns((float)fmod(t / 23, 1.0)));
	struct v3 d = v3(cos_turns(turn) * cos_turns(height), sin_turns(turn) * cos_turns(height),
			 sin_turns(height));
	struct v3 from = v3_mad(s->focus, d, away), at = s->focus;

	if (s->surround == SURROUND_ROOM && s->kind == DIO_SIM_ROOM) {
		/* Stand in the middle and look out. */
		from = v3(0.3f * s->extent * d.x, 0.3f * s->extent * d.y, 1.5f);
		at = v3_sub(s->focus, v3_scale(v3(d.x, d.y, 0), s->extent));
	}
	from = v3_add(from, shake(t, 0.012f * away));
	at = v3_add(at, shake(t + 100, 0.02f * s->extent));
	sim_look_at(from, at, 0.008f * sin_turns(0.2f * (float)t), pose);
}

/* Calibration: a new stand every 1.5 s with a quick move between. Over the stands the board is
 * near and far, tilted to every side, in every part of the picture, and the camera is rolled. */
static void stand(const struct dio_sim_scene *s, uint32_t index, struct v3 *from, struct v3 *at,
		  float *roll)
{
	float board = board_radius(s);
	float reach = board > 0 ? board : s->extent;
	/* Low-discrepancy sequences (powers of the plastic number) so that few stands cover much.
	 */
	float a = fract(0.5f + 0.7548777f * (float)index),
	      b = fract(0.5f + 0.5698403f * (float)index);
	float c = fract(0.5f + 0.8191725f * (float)index),
	      d = fract(0.5f + 0.6710436f * (float)index);
	float tilt = 0.02f + 0.115f * b, turn = a + 0.1f * d;
	float away = reach * (1.9f + 1.9f * c), aside = 0.22f * away;
	struct v3 dir = v3(sin_turns(tilt) * cos_turns(turn), sin_turns(tilt) * sin_turns(turn),
			   cos_turns(tilt));

	*from = v3_scale(dir, away);
	*at = v3(aside * (2 * d - 1), aside * (2 * fract(a + 3 * c) - 1), 0);
	*roll = index % 4 == 3 ? 0.25f : 0.04f * (2 * c - 1);
}

static void dance(const struct dio_sim_scene *s, double t, double pose[16])
{
	double beat = t / 1.5;
	uint32_t index = (uint32_t)fmod(beat, 4096);
	/* The hand rests for the first two thirds of a beat. */
	float part = smooth_step(0.67f, 1, (float)(beat - floor(beat)));
	struct v3 from0, from1, at0, at1;
	float roll0, roll1;

	stand(s, index, &from0, &at0, &roll0);
	stand(s, index + 1, &from1, &at1, &roll1);
	from0 = v3_add(v3_mix(from0, from1, part), shake(t, 0.004f * s->extent));
	sim_look_at(from0, v3_mix(at0, at1, part), mixf(roll0, roll1, part), pose);
}

void dio_sim_viewpoint(const struct dio_sim_scene *scene, uint32_t style, double time_s,
		       double world_from_camera[16])
{
	double t = time_s > 0 ? time_s : 0;

	if (style == 1)
		dance(scene, t, world_from_camera);
	else
		walk(scene, t, world_from_camera);
}
