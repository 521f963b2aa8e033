#include "core/orbit.h"

#include <math.h>
#include <stdlib.h>

#define PI               3.14159265358979323846
#define CLOSED_GAP_RAD   (PI / 2)  /* a wider gap between neighbours opens the circle */
#define NEAR_RAD         (PI / 6)  /* cameras this near in azimuth shape the path */
#define STILL_HALF_RAD   (PI / 60) /* a lone camera sways by 3 degrees */
#define AXES_REGULARISER 1e-6

static double dot(const double a[3], const double b[3])
{
	return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

static void cross(const double a[3], const double b[3], double out[3])
{
	out[0] = a[1] * b[2] - a[2] * b[1];
	out[1] = a[2] * b[0] - a[0] * b[2];
	out[2] = a[0] * b[1] - a[1] * b[0];
}

/* False when the vector is too short to have a direction. */
static bool normalise(double v[3])
{
	double length = sqrt(dot(v, v));

	if (length < 1e-9)
		return false;
	for (int i = 0; i < 3; i++)
		v[i] /= length;
	return true;
}

static void get_centre(const struct dio_pose *pose, double out[3])
{
	for (int i = 0; i < 3; i++)
		out[i] = pose->world_from_camera[4 * i + 3];
}

static void get_axis(const struct dio_pose *pose, int axis, double out[3])
{
	for (int i = 0; i < 3; i++)
		out[i] = pose->world_from_camera[4 * i + axis];
}

/* Solve a symmetric positive definite 3x3 system by Cramer's rule. */
static void solve(const double a[3][3], const double b[3], double x[3])
{
	double c0[3], c1[3], c2[3], det;

	cross(a[1], a[2], c0);
	cross(a[2], a[0], c1);
	cross(a[0], a[1], c2);
	det = dot(a[0], c0);
	for (int i = 0; i < 3; i++)
		x[i] = (c0[i] * b[0] + c1[i] * b[1] + c2[i] * b[2]) / det;
}

/* The point nearest to all optical axes, seen from the cameras' mean so that far-off worlds stay
 * exact. */
static void nearest_to_axes(const struct dio_pose *poses, uint32_t count, const double mean[3],
			    double out[3])
{
	double a[3][3] = {{0}}, b[3] = {0}, x[3];

	for (uint32_t n = 0; n < count; n++) {
		double z[3], c[3];

		get_axis(&poses[n], 2, z);
		get_centre(&poses[n], c);
		for (int i = 0; i < 3; i++)
			for (int j = 0; j < 3; j++) {
				double m = (i == j) - z[i] * z[j];

				a[i][j] += m;
				b[i] += m * (c[j] - mean[j]);
			}
	}
	for (int i = 0; i < 3; i++)
		a[i][i] += AXES_REGULARISER * count;
	solve(a, b, x);
	for (int i = 0; i < 3; i++)
		out[i] = mean[i] + x[i];
}

static int compare_doubles(const void *a, const void *b)
{
	double x = *(const double *)a, y = *(const double *)b;

	return (x > y) - (x < y);
}

/* Half of the depths of `point` are below this. */
static double median_depth(const struct dio_pose *poses, uint32_t count, const double point[3])
{
	double *depths = malloc(sizeof *depths * count), median = 0;

	if (!depths)
		return 0;
	for (uint32_t n = 0; n < count; n++) {
		double z[3], c[3], d[3];

		get_axis(&poses[n], 2, z);
		get_centre(&poses[n], c);
		for (int i = 0; i < 3; i++)
			d[i] = point[i] - c[i];
		depths[n] = dot(d, z);
	}
	qsort(depths, count, sizeof *depths, compare_doubles);
	median = depths[count / 2];
	free(depths);
	return median;
}

static double spread(const struct dio_pose *poses, uint32_t count, const double mean[3])
{
	double most = 0;

	for (uint32_t n = 0; n < count; n++) {
		double c[3], d[3];

		get_centre(&poses[n], c);
		for (int i = 0; i < 3; i++)
			d[i] = c[i] - mean[i];
		most = fmax(most, sqrt(dot(d, d)));
	}
	return most;
}

/* Where the cameras look. Axes that (nearly) never meet leave a point ahead of their mean. */
static void fit_centre(const struct dio_pose *poses, uint32_t count, double centre[3])
{
	double mean[3] = {0}, ahead[3] = {0}, wide, depth;

	for (uint32_t n = 0; n < count; n++) {
		double c[3], z[3];

		get_centre(&poses[n], c);
		get_axis(&poses[n], 2, z);
		for (int i = 0; i < 3; i++) {
			mean[i] += c[i] / count;
			ahead[i] += z[i];
		}
	}
	nearest_to_axes(poses, count, mean, centre);
	wide = spread(poses, count, mean);
	depth = median_depth(poses, count, centre);
	if (depth > 0.05 * wide && depth < 50 * wide)
		return;
	if (!normalise(ahead))
		get_axis(&poses[0], 2, ahead);
	for (int i = 0; i < 3; i++)
		centre[i] = mean[i] + ahead[i] * (wide > 0 ? 3 * wide : 1);
}

/* Up is against the cameras' mean y; east and north make it a frame. */
static void fit_axes(const struct dio_pose *poses, uint32_t count, struct dio_orbit *orbit)
{
	double x[3];

	for (int i = 0; i < 3; i++) {
		orbit->up[i] = 0;
		for (uint32_t n = 0; n < count; n++)
			orbit->up[i] -= poses[n].world_from_camera[4 * i + 1];
	}
	if (!normalise(orbit->up)) {
		get_axis(&poses[0], 1, orbit->up);
		for (int i = 0; i < 3; i++)
			orbit->up[i] = -orbit->up[i];
	}
	/* East is the first camera's x made level; a camera rolled by 90 degrees gives its z. */
	for (int axis = 0; axis < 3; axis++) {
		get_axis(&poses[0], axis, x);
		double along = dot(x, orbit->up);

		for (int i = 0; i < 3; i++)
			orbit->east[i] = x[i] - along * orbit->up[i];
		if (fabs(along) < 0.9 && normalise(orbit->east))
			break;
	}
	cross(orbit->up, orbit->east, orbit->north);
}

/* Cylindrical place of a camera: azimuth, height and radius round the centre. */
static void place(const struct dio_orbit *orbit, const struct dio_pose *pose, double out[3])
{
	double c[3], d[3], e, n;

	get_centre(pose, c);
	for (int i = 0; i < 3; i++)
		d[i] = c[i] - orbit->centre[i];
	e = dot(d, orbit->east);
	n = dot(d, orbit->north);
	out[0] = atan2(n, e);
	out[1] = dot(d, orbit->up);
	out[2] = sqrt(e * e + n * n);
}

/* The widest gap between neighbours in azimuth; what is left is the arc that they span. */
static void fit_arc(double *azimuths, uint32_t count, struct dio_orbit *orbit)
{
	double widest = 0, start = azimuths[0];

	qsort(azimuths, count, sizeof *azimuths, compare_doubles);
	for (uint32_t n = 0; n < count; n++) {
		double next = n + 1 < count ? azimuths[n + 1] : azimuths[0] + 2 * PI;

		if (next - azimuths[n] > widest) {
			widest = next - azimuths[n];
			start = next;
		}
	}
	orbit->closed = widest < CLOSED_GAP_RAD;
	orbit->azimuth_half = orbit->closed ? PI : fmax((2 * PI - widest) / 2, STILL_HALF_RAD);
	orbit->azimuth_mid = start + (2 * PI - widest) / 2;
}

void dio_orbit_fit(const struct dio_pose *poses, uint32_t count, struct dio_orbit *orbit)
{
	double *azimuths = malloc(sizeof *azimuths * count);
	double at[3];

	*orbit = (struct dio_orbit){.azimuth_half = STILL_HALF_RAD};
	fit_centre(poses, count, orbit->centre);
	fit_axes(poses, count, orbit);
	for (uint32_t n = 0; n < count; n++) {
		place(orbit, &poses[n], at);
		orbit->height += at[1] / count;
		orbit->radius += at[2] / count;
		if (azimuths)
			azimuths[n] = at[0];
	}
	if (azimuths)
		fit_arc(azimuths, count, orbit);
	free(azimuths);
}

void dio_orbit_look(const struct dio_orbit *orbit, double azimuth_rad, double height, double radius,
		    struct dio_pose *pose)
{
	double c[3], x[3], y[3], z[3];

	for (int i = 0; i < 3; i++) {
		z[i] = -(radius * (cos(azimuth_rad) * orbit->east[i] +
				   sin(azimuth_rad) * orbit->north[i]) +
			 height * orbit->up[i]);
		c[i] = orbit->centre[i] - z[i];
	}
	if (!normalise(z))
		for (int i = 0; i < 3; i++)
			z[i] = -orbit->up[i];
	cross(z, orbit->up, x);
	if (!normalise(x)) /* straight down or up */
		for (int i = 0; i < 3; i++)
			x[i] = -sin(azimuth_rad) * orbit->east[i] +
			       cos(azimuth_rad) * orbit->north[i];
	cross(z, x, y);
	for (int i = 0; i < 3; i++) {
		pose->world_from_camera[4 * i + 0] = x[i];
		pose->world_from_camera[4 * i + 1] = y[i];
		pose->world_from_camera[4 * i + 2] = z[i];
		pose->world_from_camera[4 * i + 3] = c[i];
		pose->world_from_camera[12 + i] = 0;
	}
	pose->world_from_camera[15] = 1;
}

/* Height and radius at an azimuth: the cameras' mean, the near ones weighing most. */
static void shape(const struct dio_orbit *orbit, const struct dio_pose *poses, uint32_t count,
		  double azimuth, double *height, double *radius)
{
	double sum = 0, h = 0, r = 0;

	for (uint32_t n = 0; n < count; n++) {
		double at[3], off, weight;

		place(orbit, &poses[n], at);
		off = remainder(at[0] - azimuth, 2 * PI) / NEAR_RAD;
		weight = exp(-0.5 * off * off) + 1e-6;
		sum += weight;
		h += weight * at[1];
		r += weight * at[2];
	}
	*height = h / sum;
	*radius = r / sum;
}

enum dio_status dio_orbit_path(const struct dio_pose *poses, uint32_t pose_count, uint32_t count,
			       double frames_per_second, struct dio_trajectory *path)
{
	struct dio_trajectory made = {0};
	struct dio_orbit orbit;
	enum dio_status status = dio_trajectory_init(&made, count);

	if (status != DIO_OK)
		return status;
	dio_orbit_fit(poses, pose_count, &orbit);
	for (uint32_t i = 0; i < count; i++) {
		double turn = 2 * PI * i / count, azimuth, height, radius;

		azimuth =
			orbit.azimuth_mid + (orbit.closed ? turn : orbit.azimuth_half * sin(turn));
		shape(&orbit, poses, pose_count, azimuth, &height, &radius);
		dio_orbit_look(&orbit, azimuth, height, radius, &made.poses[i]);
		made.time_s[i] = i / frames_per_second;
	}
	*path = made;
	return DIO_OK;
}
