/* Pinhole camera and picture types of the engine (MODEL.md, section 1). */
#ifndef DVSM_CAMERA_H
#define DVSM_CAMERA_H

#include <stdint.h>

/**
 * A posed pinhole camera without distortion.
 *
 * width, height        picture size in pixels, 1..16384
 * fx, fy               focal lengths in pixels, finite, > 0
 * cx, cy               principal point in pixels; pixel (0,0) is the CENTRE of the top-left pixel
 * world_from_camera    rigid 4x4, row-major; camera axes x right, y down, z forward; any unit
 */
struct dvsm_camera {
	uint32_t width, height;
	double fx, fy, cx, cy;
	double world_from_camera[16];
};

/**
 * A posed picture.
 *
 * rgb   [height][width][3] float, sRGB as captured, [0,1], no padding; borrowed
 */
struct dvsm_view {
	struct dvsm_camera camera;
	const float *rgb;
};

#endif
