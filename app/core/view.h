/* A posed view: picture, pinhole camera, pose. What the engine reconstructs from. */
#ifndef DIO_APP_VIEW_H
#define DIO_APP_VIEW_H

#include <stdint.h>

#include "core/scene_file.h"
#include "dio/frame.h"
#include "dio/geometry.h"
#include "dio/status.h"
#include "dvsm/camera.h"

struct dio_view {
	char *name; /* picture name without folder and ending, unique in the set */
	struct dio_camera_model camera; /* pinhole: dist all 0 */
	struct dio_pose pose;
	struct dio_picture picture; /* rgb NULL for a target without picture */
};

/** The views of a scene by role, in the file's order. Release with dio_view_set_deinit(). */
struct dio_view_set {
	struct dio_view *context, *target;
	uint32_t context_count, target_count;
};

/** Which pictures to load: poses and cameras are always there. */
enum dio_view_load { DIO_LOAD_CONTEXT = 1, DIO_LOAD_TARGET = 2, DIO_LOAD_ALL = 3 };

/**
 * Load the views of a scene. Pictures of a camera with distortion are undistorted to a pinhole
 * camera of the same size (dio/pose.h); the view's camera is that pinhole.
 *
 * set   zero-initialised
 *
 * DIO_BAD_FILE  a picture that cannot be read, or of another size than its camera says
 */
enum dio_status dio_view_set_load(const struct dio_scene_file *scene, enum dio_view_load load,
				  struct dio_view_set *set, struct dio_error *error);
void dio_view_set_deinit(struct dio_view_set *set);

/** The engine's camera. */
struct dvsm_camera dio_view_engine_camera(const struct dio_camera_model *camera,
					  const struct dio_pose *pose);

/**
 * Index of the context view nearest to a target: distance of the centres over their mean distance,
 * plus the angle between the two in radians. The first of equals.
 */
uint32_t dio_view_nearest(const struct dio_view_set *set, const struct dio_pose *target);

#endif
