/* What training asks for: kinds of scenes, rigs and sensors in their shares. */
#include "shoot.h"

#include <string.h>

#include "rig.h"

static enum dio_sim_kind draw_kind(struct rng *r, uint32_t options)
{
	static const struct {
		uint32_t option;
		enum dio_sim_kind kind;
		float share;
	} kinds[] = {
		{DIO_SIM_BATCH_TABLES, DIO_SIM_TABLE, 0.45f},
		{DIO_SIM_BATCH_TURNTABLES, DIO_SIM_TURNTABLE, 0.25f},
		{DIO_SIM_BATCH_ROOMS, DIO_SIM_ROOM, 0.15f},
		{DIO_SIM_BATCH_STREETS, DIO_SIM_STREET, 0.15f},
	};
	const uint32_t all = DIO_SIM_BATCH_TABLES | DIO_SIM_BATCH_TURNTABLES | DIO_SIM_BATCH_ROOMS |
			     DIO_SIM_BATCH_STREETS;
	uint32_t wanted = options & all ? options & all : all, last = 0;
	float total = 0, left;

	for (uint32_t i = 0; i < 4; i++)
		total += wanted & kinds[i].option ? kinds[i].share : 0;
	left = total * rng_unit(r);
	for (uint32_t i = 0; i < 4; i++) {
		if (!(wanted & kinds[i].option))
			continue;
		last = i;
		left -= kinds[i].share;
		if (left < 0)
			break;
	}
	return kinds[last].kind;
}

static struct dio_sim_scene *draw_scene(struct rng *r, uint64_t seed, uint32_t options)
{
	struct dio_sim_scene_options o;

	memset(&o, 0, sizeof(o));
	o.seed = seed;
	o.kind = draw_kind(r, options);
	if (o.kind == DIO_SIM_TABLE && rng_chance(r, 0.1f)) {
		o.board.cols = 5 + rng_below(r, 8);
		o.board.rows = 4 + rng_below(r, 6);
		o.board.square_m = rng_in(r, 0.02f, 0.035f);
		o.board.marker_m = 0.6 * o.board.square_m;
		o.clear_board = rng_chance(r, 0.4f);
	}
	return dio_sim_scene_create(&o);
}

/* What stays the same over a capture, and how much the camera's automatics change meanwhile. */
struct capture {
	struct dio_sim_sensor sensor;
	float exposure_drift, balance_drift;
	float blur_share; /* of the pictures that a moving hand blurs */
};

static struct capture draw_capture(struct rng *r)
{
	struct capture capture;
	struct dio_sim_sensor s;

	memset(&s, 0, sizeof(s));
	s.exposure_stops = rng_in(r, -0.5f, 0.35f);
	for (int c = 0; c < 3; c++)
		s.white_balance[c] = rng_chance(r, 0.5f) ? rng_in(r, 0.9f, 1.1f) : 1;
	if (rng_chance(r, 0.35f)) {
		s.noise = rng_in(r, 0, 0.012f);
		s.shot_noise = rng_in(r, 0, 0.02f);
	}
	if (rng_chance(r, 0.3f))
		s.blur_px = rng_in(r, 0.3f, 0.9f);
	if (rng_chance(r, 0.25f))
		s.vignetting = rng_in(r, 0, 0.35f);
	if (rng_chance(r, 0.3f))
		s.jpeg_quality = rng_in(r, 55, 95);
	capture.sensor = s;
	capture.exposure_drift = rng_chance(r, 0.25f) ? rng_in(r, 0.03f, 0.2f) : 0;
	capture.balance_drift = rng_chance(r, 0.15f) ? rng_in(r, 0.01f, 0.04f) : 0;
	capture.blur_share = rng_chance(r, 0.15f) ? 0.25f : 0;
	return capture;
}

/* The sensor of one picture. */
static struct dio_sim_sensor draw_sensor(const struct capture *c, struct rng *r, uint32_t view)
{
	struct dio_sim_sensor s = c->sensor;

	s.noise_seed = ((uint64_t)rng_u32(r) << 32) + view;
	s.exposure_stops += c->exposure_drift * rng_in(r, -1, 1);
	s.white_balance[0] *= 1 + c->balance_drift * rng_in(r, -1, 1);
	s.white_balance[2] *= 1 + c->balance_drift * rng_in(r, -1, 1);
	if (rng_chance(r, c->blur_share))
		s.blur_px += rng_in(r, 0.3f, 0.8f);
	return s;
}

bool sim_shoot_init(struct sim_shoot *shoot, uint64_t seed, uint32_t views, uint32_t width,
		    uint32_t height, uint32_t options)
{
	struct rng r = rng_seeded(seed ^ 0x5ca1ab1e5eedull);
	uint32_t order[SIM_SHOOT_VIEWS];
	struct capture capture;
	struct rig rig;

	shoot->scene = draw_scene(&r, seed, options);
	if (!shoot->scene)
		return false;
	capture = draw_capture(&r);
	rig = sim_rig_draw(shoot->scene, &r, width, height);
	for (uint32_t v = 0; v < views; v++) { /* shuffled places along the path */
		uint32_t k = rng_below(&r, v + 1);

		order[v] = order[k];
		order[k] = v;
	}
	for (uint32_t v = 0; v < views; v++) {
		float along = ((float)order[v] + rng_unit(&r)) / (float)views;

		sim_rig_camera(shoot->scene, &rig, &r, along, width, height, &shoot->camera[v]);
		shoot->sensor[v] = draw_sensor(&capture, &r, v);
		if (options & DIO_SIM_BATCH_CLEAN)
			memset(&shoot->sensor[v], 0, sizeof(shoot->sensor[v]));
	}
	return true;
}

void sim_shoot_deinit(struct sim_shoot *shoot)
{
	dio_sim_scene_destroy(shoot->scene);
	shoot->scene = NULL;
}

void sim_shoot_camera(const struct sim_shoot *shoot, uint32_t v, float *pose, float *intrinsics)
{
	const struct dio_sim_camera *c = &shoot->camera[v];

	for (int i = 0; i < 16; i++)
		pose[i] = (float)c->world_from_camera[i];
	intrinsics[0] = (float)c->fx;
	intrinsics[1] = (float)c->fy;
	intrinsics[2] = (float)c->cx;
	intrinsics[3] = (float)c->cy;
}
