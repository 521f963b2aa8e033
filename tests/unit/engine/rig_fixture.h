/* Camera rigs for tests. */
#ifndef RIG_FIXTURE_H
#define RIG_FIXTURE_H

#include "dvsm/camera.h"

/** A 48 x 32 camera that stands at `eye` and looks at `target`, its y axis as far down as it can.
 */
struct dvsm_camera rig_camera(const double eye[3], const double target[3]);

/** Cameras on an arc around the origin, at differing heights. */
void rig_make_arc(struct dvsm_camera *cameras, unsigned count);

/** The rig turned about a skew axis by `angle_rad`, scaled by `scale`, then moved. */
void rig_transform(struct dvsm_camera *cameras, unsigned count, double angle_rad, double scale,
		   const double move[3]);

#endif
