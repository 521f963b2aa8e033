/* What a simulated camera knows and a real one does not. For tests and for judging a demonstration
 * only: nothing on the way from the camera to the picture may look at it. */
#ifndef DIO_CAMERA_SIM_TRUTH_H
#define DIO_CAMERA_SIM_TRUTH_H

#include <stdbool.h>

#include "dio/camera.h"
#include "dio/sim.h"

#ifdef __cplusplus
extern "C" {
#endif

/** True camera of the frame acquired last; false when `camera` is not simulated or took none. */
bool dio_sim_camera_get_truth(const struct dio_camera *camera, struct dio_sim_camera *truth);

/** The scene behind it, borrowed, to render true pictures of it; NULL when not simulated. */
const struct dio_sim_scene *dio_sim_camera_get_scene(const struct dio_camera *camera);

#ifdef __cplusplus
}
#endif
#endif
