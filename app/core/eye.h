/* An eye on a sphere round a scene, moved by hand. */
#ifndef DIO_APP_EYE_H
#define DIO_APP_EYE_H

#include "core/orbit.h"

/** Where the eye is; `orbit` tells up and the axes. */
struct dio_eye {
	struct dio_orbit orbit;
	double centre[3], azimuth, elevation, distance; /* radians, the world's unit */
};

/** Where the cameras stood. */
void dio_eye_reset(const struct dio_orbit *orbit, struct dio_eye *eye);

/** Turn round the point looked at (radians) and come nearer by notches of a tenth. */
void dio_eye_turn(struct dio_eye *eye, double azimuth, double elevation, double notches);

/** Carry the point looked at along, in shares of the distance to it. */
void dio_eye_pan(struct dio_eye *eye, double right, double up);

void dio_eye_pose(const struct dio_eye *eye, struct dio_pose *pose);

#endif
