/* The simulated camera: drivers/sim seen through a lens and a sensor, frame by frame. */
#include "backend.h"

#include <inttypes.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "dio/clock.h"
#include "pace.h"
#include "sim_spec.h"
#include "sim_truth.h"

#define NS_PER_S    1e9
#define EXPOSURE_US 10000

struct sim {
	struct dio_camera base; /* first */
	struct dio_sim_spec spec;
	struct dio_sim_scene *scene;
	struct dio_sim_camera lens; /* without pose */
	struct dio_sim_camera truth;
	struct dio_picture picture;
	uint64_t next;     /* index of the frame to come */
	uint64_t epoch_ns; /* when frame 0 is due; 0 when there is no pace */
	bool has_truth;
	float exposure_stops; /* of the words, at EXPOSURE_US and gain 1 */
	struct dio_frame_metadata metadata;
};

static const struct dio_camera_ops ops;

static struct sim *self(struct dio_camera *camera)
{
	return (struct sim *)camera;
}

/* splitmix64 (Steele, Lea, Flood 2014): well-spread values from counted seeds. */
static uint64_t mix(uint64_t x)
{
	x += 0x9e3779b97f4a7c15u;
	x = (x ^ (x >> 30)) * 0xbf58476d1ce4e5b9u;
	x = (x ^ (x >> 27)) * 0x94d049bb133111ebu;
	return x ^ (x >> 31);
}

/* Uniform in [-1, 1), the n-th such number of this seed. */
static double spread(uint64_t seed, uint64_t n)
{
	return (double)(mix(mix(seed) + n) >> 11) * 0x1p-52 - 1;
}

/*
 * Intrinsics as they come from a factory: not quite those on the data sheet. A calibration must
 * find them, so they follow from the seed rather than being round numbers.
 */
static void make_lens(const struct dio_sim_spec *spec, struct dio_sim_camera *lens)
{
	const uint64_t seed = spec->scene.seed;
	const double half_rad = spec->fov_deg * acos(-1.0) / 360;
	const double focal_px = 0.5 * spec->width / tan(half_rad) * (1 + 0.01 * spread(seed, 0));
	/* A wide lens reaches larger angles: the same strength must stay invertible there. */
	const double strength = spec->distortion * fmin(1, pow(0.577 / tan(half_rad), 2));

	*lens = (struct dio_sim_camera){
		.width = spec->width,
		.height = spec->height,
		.fx = focal_px,
		.fy = focal_px * (1 + 0.002 * spread(seed, 1)),
		.cx = 0.5 * (spec->width - 1) + 0.01 * spec->width * spread(seed, 2),
		.cy = 0.5 * (spec->height - 1) + 0.01 * spec->height * spread(seed, 3),
		.dist = {-0.28 * strength, 0.08 * strength, 0.002 * strength * spread(seed, 4),
			 0.002 * strength * spread(seed, 5), 0},
	};
}

static uint64_t time_of(const struct sim *sim, uint64_t i)
{
	return sim->epoch_ns + (uint64_t)((double)i * NS_PER_S / sim->spec.fps);
}

static enum dio_status sim_start(struct dio_camera *camera, struct dio_error *error)
{
	struct sim *sim = self(camera);

	(void)error;
	sim->epoch_ns = 0;
	if (!camera->options.as_fast_as_possible)
		sim->epoch_ns = dio_clock_ns() - time_of(sim, sim->next);
	return DIO_OK;
}

static enum dio_status sim_stop(struct dio_camera *camera, struct dio_error *error)
{
	(void)camera;
	(void)error;
	return DIO_OK;
}

static void sim_close(struct dio_camera *camera)
{
	struct sim *sim = self(camera);

	dio_sim_scene_destroy(sim->scene);
	dio_picture_deinit(&sim->picture);
	free(sim);
}

static bool at_end(const struct sim *sim, uint64_t i)
{
	return sim->spec.frames > 0 && i >= sim->spec.frames;
}

/* Sleep until the next frame is due, then move on to the newest that is. */
static bool keep_pace(struct sim *sim, int64_t timeout_ns)
{
	uint64_t now;

	if (!dio_pace_wait(time_of(sim, sim->next), timeout_ns))
		return false;
	now = dio_clock_ns();
	while (!sim->base.options.every_frame && !at_end(sim, sim->next + 1) &&
	       time_of(sim, sim->next + 1) <= now) {
		sim->next++;
		sim->base.counters.drained++;
	}
	return true;
}

static enum dio_status sim_acquire(struct dio_camera *camera, struct dio_frame *frame,
				   int64_t timeout_ns, struct dio_error *error)
{
	struct sim *sim = self(camera);
	struct dio_sim_sensor sensor = sim->spec.sensor;

	if (at_end(sim, sim->next))
		return dio_fail(error, DIO_END, "camera sim: all %" PRIu64 " frames were delivered",
				sim->spec.frames);
	if (!camera->options.as_fast_as_possible && !keep_pace(sim, timeout_ns))
		return dio_fail(error, DIO_AGAIN, "camera sim: frame %" PRIu64 " is not due yet",
				sim->next);
	/* Frame i is the same whichever frames were taken before it. */
	sim->truth = sim->lens;
	dio_sim_viewpoint(sim->scene, sim->spec.style, (double)sim->next / sim->spec.fps,
			  sim->truth.world_from_camera);
	sensor.noise_seed = mix(mix(sim->spec.scene.seed) ^ sim->next);
	sim->has_truth = dio_sim_render(sim->scene, &sim->truth, &sensor, sim->spec.samples,
					sim->picture.rgb);
	if (!sim->has_truth)
		return dio_fail(error, DIO_NO_MEM, "camera sim: no memory to render frame %" PRIu64,
				sim->next);
	*frame = dio_frame_from_picture(&sim->picture);
	frame->timestamp_ns = time_of(sim, sim->next);
	frame->sequence = sim->next++;
	frame->metadata = sim->metadata;
	return DIO_OK;
}

/* Nothing of a simulated sensor varies by itself: it can be held, and then it says so. */
static enum dio_status sim_control(struct dio_camera *camera, const struct dio_camera_wish *wish,
				   struct dio_camera_controls *controls, struct dio_error *error)
{
	const uint32_t all = DIO_LOCK_EXPOSURE | DIO_LOCK_GAIN | DIO_LOCK_WHITE_BALANCE;
	struct sim *sim = self(camera);
	struct dio_frame_metadata *metadata = &sim->metadata;

	(void)error;
	if (wish) {
		metadata->locked = wish->hold ? all : 0;
		/* In stops against a hundredth of a second at gain 1. */
		if (wish->exposure_us > 0)
			metadata->exposure_us = wish->exposure_us;
		if (wish->gain > 0)
			metadata->gain = (float)wish->gain;
		sim->spec.sensor.exposure_stops =
			sim->exposure_stops +
			log2f((float)metadata->exposure_us / EXPOSURE_US * metadata->gain);
	}
	*controls = (struct dio_camera_controls){.offered = all, .metadata = *metadata};
	return DIO_OK;
}

static const struct dio_camera_ops ops = {
	.start = sim_start,
	.stop = sim_stop,
	.acquire = sim_acquire,
	.close = sim_close,
	.control = sim_control,
};

bool dio_sim_camera_get_truth(const struct dio_camera *camera, struct dio_sim_camera *truth)
{
	const struct sim *sim = (const struct sim *)camera;

	if (!camera || camera->ops != &ops || !sim->has_truth)
		return false;
	*truth = sim->truth;
	return true;
}

const struct dio_sim_scene *dio_sim_camera_get_scene(const struct dio_camera *camera)
{
	if (!camera || camera->ops != &ops)
		return NULL;
	return ((const struct sim *)camera)->scene;
}

/* A size or rate that is wished overrides the words, so that callers need not rewrite them. */
static void apply_options(const struct dio_camera_options *options, struct dio_sim_spec *spec)
{
	if (options->width >= 16 && options->width <= 4096)
		spec->width = options->width;
	if (options->height >= 16 && options->height <= 4096)
		spec->height = options->height;
	if (options->frames_per_second >= 0.01)
		spec->fps = options->frames_per_second;
}

enum dio_status dio_sim_open(const char *words, const struct dio_camera_options *options,
			     struct dio_camera **camera, struct dio_error *error)
{
	struct dio_sim_spec spec;
	enum dio_status status = dio_sim_spec_parse(words, &spec, error);
	struct sim *sim;

	if (status != DIO_OK)
		return status;
	apply_options(options, &spec);
	sim = calloc(1, sizeof(*sim));
	if (!sim)
		return dio_fail(error, DIO_NO_MEM, "camera sim: out of memory");
	sim->base.ops = &ops;
	sim->base.options = *options;
	sim->base.frame_name = "";
	sim->spec = spec;
	sim->exposure_stops = spec.sensor.exposure_stops;
	sim->metadata = (struct dio_frame_metadata){
		.exposure_us = EXPOSURE_US, .gain = 1, .white_balance_k = 6500};
	make_lens(&spec, &sim->lens);
	sim->scene = dio_sim_scene_create(&spec.scene);
	if (!sim->scene || dio_picture_init(&sim->picture, spec.width, spec.height) != DIO_OK) {
		sim_close(&sim->base);
		return dio_fail(error, DIO_NO_MEM, "camera sim: no memory for a scene at %ux%u",
				spec.width, spec.height);
	}
	snprintf(sim->base.info.name, sizeof(sim->base.info.name), "sim:%s", words);
	sim->base.info.format = DIO_PIXEL_RGB24;
	sim->base.info.width = spec.width;
	sim->base.info.height = spec.height;
	sim->base.info.frames_per_second = spec.fps;
	sim->base.info.frame_count = spec.frames;
	*camera = &sim->base;
	return DIO_OK;
}
