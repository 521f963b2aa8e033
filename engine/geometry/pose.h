/* Camera poses: checks, and the normalisation of a rig (MODEL.md section 2). Private to the engine.
 */
#ifndef DVSM_GEOMETRY_POSE_H
#define DVSM_GEOMETRY_POSE_H

#include <stdint.h>

#include "dvsm/camera.h"
#include "dvsm/status.h"

/** Largest side of a picture, in pixels. */
#define DVSM_MAX_SIDE_PX 16384u

/** Largest stage patch, in pixels. */
#define DVSM_MAX_PATCH_PX 256u

/** Most context views of a scene. */
#define DVSM_MAX_VIEWS 65536u

/** A camera in the normalised frame: columns of `rotation` are its axes. */
struct dvsm_pose {
	double rotation[9]; /* row-major, normalised frame from camera */
	double centre[3];
};

/** c' = scale * axes * (c - origin), R' = axes * R. */
struct dvsm_normalisation {
	double axes[9];   /* A, row-major: rows are the rig's x, y and z axes */
	double origin[3]; /* t, mean camera centre */
	double scale;     /* s */
};

/**
 * Check one camera: size 1..16384, finite intrinsics, focal lengths > 0, pose finite and rigid
 * (rotation orthonormal, determinant +1 and last row 0 0 0 1, each to 1e-3).
 *
 * what   how the caller names it in the text, "view 3" say
 *
 * DVSM_BAD_ARG  one line that names the camera, the fault and the remedy
 */
enum dvsm_status dvsm_camera_check(const struct dvsm_camera *camera, const char *what,
				   struct dvsm_error *error);

/**
 * Check the context views: count, each camera, pictures present, every colour finite and within
 * -1..2, which leaves resampling its overshoot and catches 8-bit values.
 */
enum dvsm_status dvsm_views_check(const struct dvsm_view *views, uint32_t count,
				  struct dvsm_error *error);

/** Normalisation of a rig from its context cameras, [count], count >= 1, already checked. */
struct dvsm_normalisation dvsm_normalisation_compute(const struct dvsm_camera *cameras,
						     uint32_t count);

/** The same for views. */
struct dvsm_normalisation dvsm_normalisation_from_views(const struct dvsm_view *views,
							uint32_t count);

/**
 * Check a camera to render from: as dvsm_camera_check(), and not so far from the rig (1e9 times its
 * size) that float loses the rays.
 */
enum dvsm_status dvsm_target_check(const struct dvsm_camera *camera,
				   const struct dvsm_normalisation *normalisation, const char *what,
				   struct dvsm_error *error);

/** A world_from_camera pose (row-major 4x4) in the normalised frame. */
struct dvsm_pose dvsm_normalisation_apply(const struct dvsm_normalisation *normalisation,
					  const double world_from_camera[16]);

#endif
