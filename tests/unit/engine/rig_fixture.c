#include "rig_fixture.h"

#include <math.h>
#include <string.h>

static void cross(const double a[3], const double b[3], double out[3])
{
	out[0] = a[1] * b[2] - a[2] * b[1];
	out[1] = a[2] * b[0] - a[0] * b[2];
	out[2] = a[0] * b[1] - a[1] * b[0];
}

static void normalise(double a[3])
{
	double length = sqrt(a[0] * a[0] + a[1] * a[1] + a[2] * a[2]);
	for (int i = 0; i < 3; i++)
		a[i] /= length;
}

struct dvsm_camera rig_camera(const double eye[3], const double target[3])
{
	const double down[3] = {0, 1, 0};
	double x[3], y[3];
	double z[3] = {target[0] - eye[0], target[1] - eye[1], target[2] - eye[2]};
	normalise(z);
	cross(down, z, x);
	normalise(x);
	cross(z, x, y);
	struct dvsm_camera camera = {
		.width = 48, .height = 32, .fx = 47.7, .fy = 48.6, .cx = 24.2, .cy = 15.1};
	double *pose = camera.world_from_camera;
	for (int i = 0; i < 3; i++) {
		pose[4 * i] = x[i];
		pose[4 * i + 1] = y[i];
		pose[4 * i + 2] = z[i];
		pose[4 * i + 3] = eye[i];
	}
	pose[15] = 1;
	return camera;
}

void rig_make_arc(struct dvsm_camera *cameras, unsigned count)
{
	const double target[3] = {0, 0, 0};
	for (unsigned i = 0; i < count; i++) {
		double angle = 0.4 * i - 0.5;
		const double eye[3] = {3 * sin(angle), -1 - 0.2 * i, -3 * cos(angle)};
		cameras[i] = rig_camera(eye, target);
	}
}

void rig_transform(struct dvsm_camera *cameras, unsigned count, double angle_rad, double scale,
		   const double move[3])
{
	/* Rodrigues about a fixed skew axis. */
	double axis[3] = {0.3, -0.8, 0.5};
	normalise(axis);
	double s = sin(angle_rad), c = cos(angle_rad), turn[9];
	const double skew[9] = {0, -axis[2], axis[1], axis[2], 0, -axis[0], -axis[1], axis[0], 0};
	for (int i = 0; i < 3; i++) {
		for (int j = 0; j < 3; j++)
			turn[3 * i + j] = (i == j ? c : 0) + s * skew[3 * i + j] +
					  (1 - c) * axis[i] * axis[j];
	}
	for (unsigned n = 0; n < count; n++) {
		double old[16], *pose = cameras[n].world_from_camera;
		memcpy(old, pose, sizeof(old));
		for (int i = 0; i < 3; i++) {
			for (int j = 0; j < 4; j++) {
				double sum = 0;
				for (int k = 0; k < 3; k++)
					sum += turn[3 * i + k] * old[4 * k + j];
				pose[4 * i + j] = j == 3 ? scale * sum + move[i] : sum;
			}
		}
	}
}
