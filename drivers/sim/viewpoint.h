/* Camera poses. */
#ifndef DIO_SIM_VIEWPOINT_H
#define DIO_SIM_VIEWPOINT_H

#include "scene.h"

/** Camera at `from` looking at `at`, OpenCV axes, rolled clockwise by `roll` turns. */
void sim_look_at(struct v3 from, struct v3 at, float roll, double world_from_camera[16]);

#endif
