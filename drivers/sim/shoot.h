/* One scene as training sees it: the scene, its cameras and what their sensor does. */
#ifndef DIO_SIM_SHOOT_H
#define DIO_SIM_SHOOT_H

#include "dio/sim_batch.h"

enum {
	SIM_SHOOT_VIEWS = 256, /* at most */
	SIM_SHOOT_SAMPLES = 2, /* see dio_sim_render() */
};

struct sim_shoot {
	struct dio_sim_scene *scene;
	struct dio_sim_camera camera[SIM_SHOOT_VIEWS];
	struct dio_sim_sensor sensor[SIM_SHOOT_VIEWS];
};

/** Draw scene number `seed` with `views` cameras; options of dio_sim_batch(). false when memory is
 * short. Release with sim_shoot_deinit(). */
bool sim_shoot_init(struct sim_shoot *shoot, uint64_t seed, uint32_t views, uint32_t width,
		    uint32_t height, uint32_t options);
void sim_shoot_deinit(struct sim_shoot *shoot);

/** Camera number v as dio_sim_batch() hands it out: 16 and 4 numbers. */
void sim_shoot_camera(const struct sim_shoot *shoot, uint32_t v, float *pose, float *intrinsics);

#endif
