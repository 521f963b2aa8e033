/* The appliance on a simulated camera, brought to the state that is wanted. */
#ifndef TESTS_APPLIANCE_STAGE_H
#define TESTS_APPLIANCE_STAGE_H

#include "unit/viewd/daemons.h"

/** Group set-up and tear-down: the shipped model, a calibrated camera, no display. */
int stage_setup(void **state);
int stage_teardown(void **state);

/** The camera at a rate, streaming. */
void stage_start_camera(double frames_per_second);
pid_t stage_get_camera(void);

/** Both daemons from nothing; ms from the start of the display daemon to the camera's first
 * picture on the display. */
double stage_start(double frames_per_second);

/** From idle to a scene that follows the tracked camera. */
void stage_reconstruct(void);

#endif
