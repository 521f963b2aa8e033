#include "dio/sim_batch.h"

#include <stdlib.h>

#include "sensor.h"
#include "shoot.h"

/* View v as floats or bytes, whichever is not NULL. */
static bool render_view(const struct sim_shoot *s, uint32_t v, uint8_t *bytes, float *floats)
{
	const struct dio_sim_camera *camera = &s->camera[v];
	const struct dio_sim_sensor *sensor = &s->sensor[v];

	if (bytes)
		return dio_sim_render(s->scene, camera, sensor, SIM_SHOOT_SAMPLES, bytes);
	if (!dio_sim_render_float(s->scene, camera, sensor, SIM_SHOOT_SAMPLES, floats))
		return false;
	sim_sensor_add_noise(sensor, (size_t)camera->width * camera->height * 3, floats);
	sim_sensor_compress(sensor, camera, floats);
	return true;
}

int dio_sim_batch(uint64_t seed, uint32_t scenes, uint32_t views, uint32_t width, uint32_t height,
		  uint32_t options, void *rgb, float *poses, float *intrinsics)
{
	bool floats = options & DIO_SIM_BATCH_FLOAT, ok = true;
	size_t values = (size_t)width * height * 3, picture = 0;
	struct sim_shoot *shoot;

	if (!views || !width || !height || views > SIM_SHOOT_VIEWS)
		return -1;
	shoot = malloc(sizeof(*shoot));
	if (!shoot)
		return -1;
	for (uint32_t i = 0; i < scenes && ok; i++) {
		ok = sim_shoot_init(shoot, seed + i, views, width, height, options);
		for (uint32_t v = 0; v < views && ok; v++, picture++) {
			sim_shoot_camera(shoot, v, poses + 16 * picture, intrinsics + 4 * picture);
			ok = render_view(shoot, v,
					 floats ? NULL : (uint8_t *)rgb + picture * values,
					 floats ? (float *)rgb + picture * values : NULL);
		}
		sim_shoot_deinit(shoot);
	}
	free(shoot);
	return ok ? 0 : -1;
}
