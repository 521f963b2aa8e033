#include "geometry/pose.h"

#include <math.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdio.h>

#include "base/error.h"

/* How far a pose may be from rigid, in any entry of R^T R - I, the determinant, the last row. */
#define RIGID_TOLERANCE 1e-3

/* Camera centres stay below this, so that no product of coordinates leaves float's range. */
#define MAX_COORDINATE 1e12

/* Below this length a mean of unit axes has no direction. */
#define MIN_AXIS_LENGTH 1e-6

/* Below this extent a rig is one point and keeps its scale. */
#define MIN_EXTENT 1e-9

/* Farthest camera to render from, in the normalised frame. */
#define MAX_DISTANCE 1e9

/* Colours are 0..1; resamplers overshoot a little, 8-bit values by far. */
#define MIN_COLOUR (-1.0f)
#define MAX_COLOUR 2.0f

/* A rig leaves this share of the unit cube as margin (GS-LRM). */
#define EXTENT_MARGIN 1.35

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

/* Scale to length one; false, and untouched, when too short to have a direction. */
static bool normalise(double a[3])
{
	double length = sqrt(dot(a, a));
	if (!(length > MIN_AXIS_LENGTH))
		return false;
	for (int i = 0; i < 3; i++)
		a[i] /= length;
	return true;
}

/* Column `axis` of the rotation of a row-major 4x4. */
static void camera_axis(const double pose[16], int axis, double out[3])
{
	for (int i = 0; i < 3; i++)
		out[i] = pose[4 * i + axis];
}

static void camera_centre(const double pose[16], double out[3])
{
	camera_axis(pose, 3, out);
}

static enum dvsm_status check_intrinsics(const struct dvsm_camera *camera, const char *what,
					 struct dvsm_error *error)
{
	if (camera->width < 1 || camera->width > DVSM_MAX_SIDE_PX || camera->height < 1 ||
	    camera->height > DVSM_MAX_SIDE_PX)
		return dvsm_fail(
			error, DVSM_BAD_ARG,
			"%s: picture size %ux%u is outside 1..%u pixels: scale the picture", what,
			camera->width, camera->height, DVSM_MAX_SIDE_PX);
	if (!isfinite(camera->fx) || !isfinite(camera->fy) || !(camera->fx > 0) ||
	    !(camera->fy > 0))
		return dvsm_fail(error, DVSM_BAD_ARG,
				 "%s: focal length fx %g, fy %g must be finite and above 0 pixels: "
				 "calibrate the camera",
				 what, camera->fx, camera->fy);
	/* The ratio to the picture is what enters the rays; beyond this it is no camera. */
	const double limit = 1e6;
	if (camera->fx < camera->width / limit || camera->fy < camera->height / limit ||
	    camera->fx > camera->width * limit || camera->fy > camera->height * limit)
		return dvsm_fail(error, DVSM_BAD_ARG,
				 "%s: focal length fx %g, fy %g cannot belong to a %ux%u picture: "
				 "calibrate the camera",
				 what, camera->fx, camera->fy, camera->width, camera->height);
	if (!isfinite(camera->cx) || !isfinite(camera->cy) ||
	    fabs(camera->cx) > camera->width * limit || fabs(camera->cy) > camera->height * limit)
		return dvsm_fail(error, DVSM_BAD_ARG,
				 "%s: principal point (%g, %g) cannot belong to a %ux%u picture: "
				 "calibrate the camera",
				 what, camera->cx, camera->cy, camera->width, camera->height);
	return DVSM_OK;
}

/* Largest departure of the rotation from orthonormal, in R^T R - I. */
static double orthonormality_error(const double pose[16])
{
	double largest = 0;
	for (int a = 0; a < 3; a++) {
		for (int b = a; b < 3; b++) {
			double u[3], v[3];
			camera_axis(pose, a, u);
			camera_axis(pose, b, v);
			double off = fabs(dot(u, v) - (a == b ? 1.0 : 0.0));
			if (off > largest)
				largest = off;
		}
	}
	return largest;
}

static enum dvsm_status check_pose(const double pose[16], const char *what,
				   struct dvsm_error *error)
{
	for (int i = 0; i < 16; i++) {
		if (!isfinite(pose[i]))
			return dvsm_fail(error, DVSM_BAD_ARG,
					 "%s: world_from_camera row %d column %d is not finite: "
					 "estimate the pose again or drop the view",
					 what, i / 4, i % 4);
		if (fabs(pose[i]) > MAX_COORDINATE)
			return dvsm_fail(error, DVSM_BAD_ARG,
					 "%s: world_from_camera row %d column %d is %g, beyond %g: "
					 "use a larger unit of length",
					 what, i / 4, i % 4, pose[i], MAX_COORDINATE);
	}
	for (int i = 0; i < 4; i++) {
		double expected = i == 3 ? 1.0 : 0.0;
		if (fabs(pose[12 + i] - expected) > RIGID_TOLERANCE)
			return dvsm_fail(error, DVSM_BAD_ARG,
					 "%s: the last row of world_from_camera is not 0 0 0 1: "
					 "give the 4x4 row by row",
					 what);
	}

	double off = orthonormality_error(pose);
	if (off > RIGID_TOLERANCE)
		return dvsm_fail(error, DVSM_BAD_ARG,
				 "%s: the rotation is off orthonormal by %.3g, more than %g: "
				 "remove scale and skew from world_from_camera",
				 what, off, RIGID_TOLERANCE);

	double x[3], y[3], z[3], right[3];
	camera_axis(pose, 0, x);
	camera_axis(pose, 1, y);
	camera_axis(pose, 2, z);
	cross(y, z, right);
	if (!(dot(x, right) > 0))
		return dvsm_fail(
			error, DVSM_BAD_ARG,
			"%s: the rotation is mirrored (determinant -1): convert the axes to "
			"x right, y down, z forward",
			what);
	return DVSM_OK;
}

enum dvsm_status dvsm_camera_check(const struct dvsm_camera *camera, const char *what,
				   struct dvsm_error *error)
{
	enum dvsm_status status = check_intrinsics(camera, what, error);
	if (status != DVSM_OK)
		return status;
	return check_pose(camera->world_from_camera, what, error);
}

static enum dvsm_status check_picture(const struct dvsm_view *view, const char *what,
				      struct dvsm_error *error)
{
	if (!view->rgb)
		return dvsm_fail(error, DVSM_BAD_ARG, "%s: has no picture", what);

	size_t row = (size_t)view->camera.width * 3;
	for (uint32_t y = 0; y < view->camera.height; y++) {
		const float *rgb = view->rgb + y * row;
		for (size_t i = 0; i < row; i++) {
			/* Written so that NaN fails as well. */
			if (!(rgb[i] >= MIN_COLOUR && rgb[i] <= MAX_COLOUR))
				return dvsm_fail(error, DVSM_BAD_ARG,
						 "%s: pixel (%zu, %u) channel %zu is %g: colours "
						 "are 0..1, divide 8-bit values by 255",
						 what, i / 3, y, i % 3, (double)rgb[i]);
		}
	}
	return DVSM_OK;
}

enum dvsm_status dvsm_views_check(const struct dvsm_view *views, uint32_t count,
				  struct dvsm_error *error)
{
	if (!views || count == 0)
		return dvsm_fail(error, DVSM_BAD_ARG,
				 "no context views: give at least one posed picture");
	if (count > DVSM_MAX_VIEWS)
		return dvsm_fail(error, DVSM_BAD_ARG, "%u context views, at most %u are taken",
				 count, DVSM_MAX_VIEWS);

	for (uint32_t i = 0; i < count; i++) {
		char what[32];
		snprintf(what, sizeof(what), "view %u", i);
		enum dvsm_status status = dvsm_camera_check(&views[i].camera, what, error);
		if (status == DVSM_OK)
			status = check_picture(&views[i], what, error);
		if (status != DVSM_OK)
			return status;
	}
	return DVSM_OK;
}

/*
 * Sums over the context cameras: all that the normalisation's origin and axes depend on. Centres
 * are taken from the first one's: cameras at one place far from the world's origin then have a mean
 * that is that place to the last bit, and not a rig as wide as the rounding of a sum.
 */
struct rig_sums {
	double offset[3], y_axis[3], z_axis[3];
};

static void sums_add(struct rig_sums *sums, const double pose[16], const double first[3])
{
	double centre[3], y[3], z[3];
	camera_centre(pose, centre);
	camera_axis(pose, 1, y);
	camera_axis(pose, 2, z);
	for (int i = 0; i < 3; i++) {
		sums->offset[i] += centre[i] - first[i];
		sums->y_axis[i] += y[i];
		sums->z_axis[i] += z[i];
	}
}

/* Rows x, y, z of A from the mean axes; the first camera's axes when these have no direction. */
static void rig_axes(const double mean_y[3], const double mean_z[3], const double first_pose[16],
		     double axes[9])
{
	double z[3] = {mean_z[0], mean_z[1], mean_z[2]};
	double x[3], y[3];
	bool usable = normalise(z);
	if (usable) {
		cross(mean_y, z, x);
		usable = normalise(x);
	}
	if (usable) {
		cross(z, x, y);
	} else {
		camera_axis(first_pose, 0, x);
		camera_axis(first_pose, 1, y);
		camera_axis(first_pose, 2, z);
	}
	for (int i = 0; i < 3; i++) {
		axes[i] = x[i];
		axes[3 + i] = y[i];
		axes[6 + i] = z[i];
	}
}

/* A (c - t). */
static void to_rig(const struct dvsm_normalisation *n, const double centre[3], double out[3])
{
	const double offset[3] = {centre[0] - n->origin[0], centre[1] - n->origin[1],
				  centre[2] - n->origin[2]};
	for (int i = 0; i < 3; i++)
		out[i] = dot(n->axes + 3 * i, offset);
}

static double largest_coordinate(const struct dvsm_normalisation *n, const double pose[16])
{
	double centre[3], placed[3];
	camera_centre(pose, centre);
	to_rig(n, centre, placed);
	return fmax(fmax(fabs(placed[0]), fabs(placed[1])), fabs(placed[2]));
}

/* `stride` bytes lie between one camera and the next: cameras alone, or cameras within views. */
static struct dvsm_normalisation compute(const struct dvsm_camera *first, size_t stride,
					 uint32_t count)
{
	const char *base = (const char *)first;
	struct rig_sums sums = {0};
	double centre[3];
	camera_centre(first->world_from_camera, centre);
	for (uint32_t i = 0; i < count; i++) {
		const void *camera = base + i * stride;
		sums_add(&sums, ((const struct dvsm_camera *)camera)->world_from_camera, centre);
	}

	struct dvsm_normalisation n;
	for (int i = 0; i < 3; i++) {
		n.origin[i] = centre[i] + sums.offset[i] / count;
		sums.y_axis[i] /= count;
		sums.z_axis[i] /= count;
	}
	rig_axes(sums.y_axis, sums.z_axis, first->world_from_camera, n.axes);

	double extent = 0;
	for (uint32_t i = 0; i < count; i++) {
		const void *camera = base + i * stride;
		const double *pose = ((const struct dvsm_camera *)camera)->world_from_camera;
		extent = fmax(extent, largest_coordinate(&n, pose));
	}
	n.scale = extent > MIN_EXTENT ? 1.0 / (EXTENT_MARGIN * extent) : 1.0;
	return n;
}

struct dvsm_normalisation dvsm_normalisation_compute(const struct dvsm_camera *cameras,
						     uint32_t count)
{
	return compute(cameras, sizeof(*cameras), count);
}

struct dvsm_normalisation dvsm_normalisation_from_views(const struct dvsm_view *views,
							uint32_t count)
{
	return compute(&views[0].camera, sizeof(*views), count);
}

struct dvsm_pose dvsm_normalisation_apply(const struct dvsm_normalisation *normalisation,
					  const double world_from_camera[16])
{
	struct dvsm_pose pose;
	for (int column = 0; column < 3; column++) {
		double axis[3];
		camera_axis(world_from_camera, column, axis);
		for (int row = 0; row < 3; row++)
			pose.rotation[3 * row + column] = dot(normalisation->axes + 3 * row, axis);
	}
	double centre[3];
	camera_centre(world_from_camera, centre);
	to_rig(normalisation, centre, pose.centre);
	for (int i = 0; i < 3; i++)
		pose.centre[i] *= normalisation->scale;
	return pose;
}

enum dvsm_status dvsm_target_check(const struct dvsm_camera *camera,
				   const struct dvsm_normalisation *normalisation, const char *what,
				   struct dvsm_error *error)
{
	enum dvsm_status status = dvsm_camera_check(camera, what, error);
	if (status != DVSM_OK)
		return status;
	struct dvsm_pose pose = dvsm_normalisation_apply(normalisation, camera->world_from_camera);
	for (int i = 0; i < 3; i++) {
		if (fabs(pose.centre[i]) > MAX_DISTANCE)
			return dvsm_fail(error, DVSM_BAD_ARG,
					 "%s: stands %.3g rig sizes away, at most %g: is its pose "
					 "in the frame and unit of the context views?",
					 what, fabs(pose.centre[i]), MAX_DISTANCE);
	}
	return DVSM_OK;
}
