/* Camera model and pose: the types between calibration, tracking and the engine. */
#ifndef DIO_GEOMETRY_H
#define DIO_GEOMETRY_H

#include <stdint.h>

/**
 * A calibrated camera with OpenCV's plumb-bob distortion.
 *
 * width, height   picture size in pixels
 * fx, fy, cx, cy  pixels; pixel (0,0) is the CENTRE of the top-left pixel
 * dist            k1, k2, p1, p2, k3
 */
struct dio_camera_model {
	uint32_t width, height;
	double fx, fy, cx, cy;
	double dist[5];
};

/** Rigid T_world_cam, 4x4 row-major; camera axes x right, y down, z forward; metres after
 * calibration. */
struct dio_pose {
	double world_from_camera[16];
};

#endif
