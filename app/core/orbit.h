/* A path round a scene, fitted to the cameras that saw it. */
#ifndef DIO_APP_ORBIT_H
#define DIO_APP_ORBIT_H

#include <stdbool.h>

#include "core/tum.h"

/** What the cameras say of the scene: where they look, which way is up, how they stand round. */
struct dio_orbit {
	double centre[3];                /* point nearest to all optical axes */
	double up[3], east[3], north[3]; /* right-handed, unit */
	double radius, height; /* mean distance from the up axis, mean height over the centre */
	double azimuth_mid, azimuth_half; /* arc that the cameras span; half is pi when closed */
	bool closed;                      /* they stand all round: the path is a full circle */
};

/** Fit to `count` >= 1 poses. */
void dio_orbit_fit(const struct dio_pose *poses, uint32_t count, struct dio_orbit *orbit);

/** A camera at (azimuth, height, radius) that looks at the centre. */
void dio_orbit_look(const struct dio_orbit *orbit, double azimuth_rad, double height, double radius,
		    struct dio_pose *pose);

/**
 * A closed path of `count` poses at `frames_per_second`: a full circle when the cameras stand all
 * round, else to and fro inside their arc; radius and height follow the cameras near by, so the
 * path stays inside the field that they span.
 */
enum dio_status dio_orbit_path(const struct dio_pose *poses, uint32_t pose_count, uint32_t count,
			       double frames_per_second, struct dio_trajectory *path);

#endif
