/* A camera model of its own for checking the simulator: written from OpenCV's formulas, forwards,
 * where the simulator goes backwards. */
#ifndef SIM_TEST_SUPPORT_H
#define SIM_TEST_SUPPORT_H

#include <stddef.h>

#include "dio/sim.h"

struct pixel {
	double u, v;
};

/** Camera of 640 x 480, focal length 600 px; strong distortion when `distorted`. */
struct dio_sim_camera test_camera(bool distorted);

/** A table with a board of cols x rows squares of 28.5 mm. */
struct dio_sim_scene *test_scene(uint64_t seed, uint32_t cols, uint32_t rows, bool legacy);

/** Where a point of the world appears. */
struct pixel test_project(const struct dio_sim_camera *camera, double x, double y, double z);

/** Bilinear value of the green channel in linear light. */
double test_light_at(const float *rgb, const struct dio_sim_camera *camera, struct pixel p);

/** FNV-1a. */
uint64_t test_hash(const void *bytes, size_t count);

#endif
