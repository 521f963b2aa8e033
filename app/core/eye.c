#include "core/eye.h"

#include <math.h>
#include <string.h>

#define PI            3.14159265358979323846
#define ZOOM_NOTCH    0.9
#define ELEVATION_MAX (0.48 * PI)

void dio_eye_reset(const struct dio_orbit *orbit, struct dio_eye *eye)
{
	eye->orbit = *orbit;
	memcpy(eye->centre, orbit->centre, sizeof eye->centre);
	eye->azimuth = orbit->azimuth_mid;
	eye->elevation = atan2(orbit->height, orbit->radius);
	eye->distance = hypot(orbit->height, orbit->radius);
}

void dio_eye_turn(struct dio_eye *eye, double azimuth, double elevation, double notches)
{
	eye->azimuth += azimuth;
	eye->elevation = fmax(-ELEVATION_MAX, fmin(ELEVATION_MAX, eye->elevation + elevation));
	eye->distance *= pow(ZOOM_NOTCH, notches);
}

void dio_eye_pan(struct dio_eye *eye, double right, double up)
{
	for (int i = 0; i < 3; i++) {
		double axis = -sin(eye->azimuth) * eye->orbit.east[i] +
			      cos(eye->azimuth) * eye->orbit.north[i];

		eye->centre[i] += eye->distance * (up * eye->orbit.up[i] + right * axis);
	}
}

void dio_eye_pose(const struct dio_eye *eye, struct dio_pose *pose)
{
	struct dio_orbit orbit = eye->orbit;

	memcpy(orbit.centre, eye->centre, sizeof orbit.centre);
	dio_orbit_look(&orbit, eye->azimuth, eye->distance * sin(eye->elevation),
		       eye->distance * cos(eye->elevation), pose);
}
