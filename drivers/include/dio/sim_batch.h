/* Training scenes in bulk: random scenes, cameras around them, pictures and true cameras. */
#ifndef DIO_SIM_BATCH_H
#define DIO_SIM_BATCH_H

#include "dio/sim.h"

#ifdef __cplusplus
extern "C" {
#endif

/** Options, or-ed. Without a bit of the middle group all kinds of scenes are drawn. */
enum dio_sim_batch_option {
	DIO_SIM_BATCH_FLOAT = 1, /* rgb receives floats in [0,1] instead of bytes */
	DIO_SIM_BATCH_CLEAN = 2, /* perfect sensor: no noise, blur or exposure changes */

	DIO_SIM_BATCH_TABLES = 16,
	DIO_SIM_BATCH_ROOMS = 32,
	DIO_SIM_BATCH_TURNTABLES = 64,
	DIO_SIM_BATCH_STREETS = 128,
};

/**
 * Render `views` pictures of each of `scenes` random scenes.
 *
 * Scene i depends on seed + i, views, width, height and options only, so that any split over
 * threads and processes gives the same data; call it from several threads at once. Any two views
 * of a scene look at overlapping parts of it; their order is random along the camera's path, so
 * the first k are fair context views and the rest fair targets.
 *
 * rgb         [scenes][views][height][width][3] bytes or floats, sRGB-encoded
 * poses       [scenes][views][16] world_from_camera, row-major, OpenCV axes, metres
 * intrinsics  [scenes][views][4] fx, fy, cx, cy in pixels, (0,0) at a pixel's centre; no distortion
 *
 * 0, or -1 when memory is short or a size is 0
 */
DIO_SIM_API int dio_sim_batch(uint64_t seed, uint32_t scenes, uint32_t views, uint32_t width,
			      uint32_t height, uint32_t options, void *rgb, float *poses,
			      float *intrinsics);

#ifdef __cplusplus
}
#endif
#endif
