/* Trajectories as TUM text: `timestamp tx ty tz qx qy qz qw`, one pose a line, # for comments. */
#ifndef DIO_APP_TUM_H
#define DIO_APP_TUM_H

#include <stdint.h>

#include "dio/geometry.h"
#include "dio/status.h"

/** Poses in order of the file. Release with dio_trajectory_deinit(). */
struct dio_trajectory {
	uint32_t count;
	double *time_s;         /* [count] */
	struct dio_pose *poses; /* [count] */
};

enum dio_status dio_trajectory_init(struct dio_trajectory *trajectory, uint32_t count);
void dio_trajectory_deinit(struct dio_trajectory *trajectory);

/** DIO_BAD_FILE names the line and the fault. `trajectory` is zero-initialised. */
enum dio_status dio_tum_read(const char *path, struct dio_trajectory *trajectory,
			     struct dio_error *error);
/** Write beside, sync, rename. */
enum dio_status dio_tum_write(const char *path, const struct dio_trajectory *trajectory,
			      struct dio_error *error);

/** Unit quaternion (x, y, z, w) of a rotation and back; w >= 0. */
void dio_quaternion_from_pose(const struct dio_pose *pose, double quaternion[4]);
void dio_pose_from_quaternion(const double quaternion[4], const double position[3],
			      struct dio_pose *pose);

#endif
