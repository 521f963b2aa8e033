/* The public face of the simulated camera. */
#include "dio/sim.h"

#include <stdlib.h>

#include "build.h"
#include "photo.h"
#include "render.h"
#include "sensor.h"

/* White margin of the printed board, in squares. */
#define PAPER_MARGIN 0.6

static void build(struct dio_sim_scene *s, const struct dio_sim_scene_options *o)
{
	struct rng rng = rng_seeded(o->seed * 4 + (uint64_t)o->kind);

	s->seed = o->seed;
	s->kind = o->kind;
	s->board = o->board;
	if (o->board.cols > 0 && o->board.rows > 0 && o->board.square_m > 0) {
		s->paper_half_x = (float)((0.5 * o->board.cols + PAPER_MARGIN) * o->board.square_m);
		s->paper_half_y = (float)((0.5 * o->board.rows + PAPER_MARGIN) * o->board.square_m);
	}
	switch (o->kind) {
	case DIO_SIM_ROOM:
		sim_build_room(s, &rng);
		break;
	case DIO_SIM_TURNTABLE:
		sim_build_turntable(s, &rng);
		break;
	case DIO_SIM_STREET:
		sim_build_street(s, &rng);
		break;
	default:
		sim_build_table(s, &rng, o->clear_board);
		break;
	}
	sim_photos_hang(s);
}

static bool render_linear(const struct dio_sim_scene *scene, const struct dio_sim_camera *camera,
			  uint32_t samples, float *rgb)
{
#ifdef DIO_SIM_HAVE_WIDE
	if (__builtin_cpu_supports("avx512f"))
		return sim_render_linear_avx512(scene, camera, samples, rgb);
	if (__builtin_cpu_supports("avx2"))
		return sim_render_linear_avx2(scene, camera, samples, rgb);
#endif
	return sim_render_linear(scene, camera, samples, rgb);
}

/* Half way, as cameras do, from the light as it is to a picture of middle brightness; judged by a
 * small picture from the first viewpoint. 1 when memory is short. */
static float automatic_exposure(const struct dio_sim_scene *s)
{
	enum { WIDTH = 20, HEIGHT = 15 };
	struct dio_sim_camera c = {.width = WIDTH, .height = HEIGHT, .fx = 18, .fy = 18};
	float rgb[WIDTH * HEIGHT * 3], sum = 0, middle = 0.3f;

	/* A plain backdrop says nothing about the light on the thing before it. */
	if (s->surround == SURROUND_PLAIN)
		return 1;
	c.cx = 0.5 * (WIDTH - 1);
	c.cy = 0.5 * (HEIGHT - 1);
	dio_sim_viewpoint(s, 0, 0, c.world_from_camera);
	if (!render_linear(s, &c, 1, rgb))
		return 1;
	for (int i = 0; i < WIDTH * HEIGHT * 3; i++)
		sum += minf(rgb[i], 1.5f);
	sum /= WIDTH * HEIGHT * 3;
	/* White paper in view must not burn out. */
	return clampf(sqrtf(middle / maxf(sum, 1e-3f)), 0.7f, s->paper_half_x > 0 ? 1.2f : 2);
}

struct dio_sim_scene *dio_sim_scene_create(const struct dio_sim_scene_options *options)
{
	struct dio_sim_scene *s = calloc(1, sizeof(*s));

	if (!s)
		return NULL;
	build(s, options);
	s->exposure = automatic_exposure(s);
	return s;
}

void dio_sim_scene_destroy(struct dio_sim_scene *scene)
{
	free(scene);
}

bool dio_sim_render_float(const struct dio_sim_scene *scene, const struct dio_sim_camera *camera,
			  const struct dio_sim_sensor *sensor, uint32_t samples, float *rgb)
{
	static const struct dio_sim_sensor perfect;

	return render_linear(scene, camera, samples, rgb) &&
	       sim_sensor_expose(sensor ? sensor : &perfect, camera, scene->exposure, rgb);
}

bool dio_sim_render(const struct dio_sim_scene *scene, const struct dio_sim_camera *camera,
		    const struct dio_sim_sensor *sensor, uint32_t samples, uint8_t *rgb)
{
	size_t values = (size_t)camera->width * camera->height * 3;
	float *picture = malloc(values * sizeof(float));
	bool ok = picture && dio_sim_render_float(scene, camera, sensor, samples, picture);

	if (ok) {
		if (sensor) {
			sim_sensor_add_noise(sensor, values, picture);
			sim_sensor_compress(sensor, camera, picture);
		}
		sim_sensor_quantise(picture, values, rgb);
	}
	free(picture);
	return ok;
}
