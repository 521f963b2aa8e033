/* The only place of the demo that knows the truth, and it runs when all estimates are made. */
#include "camera/sim_truth.h"

#include <math.h>
#include <stdio.h>

#include "demo/state.h"

#define GRID 24 /* rays a side, over the picture */

/* A frame's pose does not depend on the picture's size: small pictures are quick to make. */
#define SMALL_WIDTH  32u
#define SMALL_HEIGHT 24u

/* Where a ray lands in a picture (plumb-bob distortion). */
static void project(double fx, double fy, double cx, double cy, const double dist[5], double x,
		    double y, double px[2])
{
	double r2 = x * x + y * y;
	double radial = 1 + r2 * (dist[0] + r2 * (dist[1] + r2 * dist[4]));

	px[0] = fx * (x * radial + 2 * dist[2] * x * y + dist[3] * (r2 + 2 * x * x)) + cx;
	px[1] = fy * (y * radial + dist[2] * (r2 + 2 * y * y) + 2 * dist[3] * x * y) + cy;
}

/* Rays over the picture as a camera without lens sees it: those that fall outside are left out. */
static void compare_rays(const struct dio_camera_model *model, const struct dio_sim_camera *truth,
			 struct dio_demo_truth *result)
{
	double sum = 0;
	uint32_t count = 0;

	for (int j = 0; j <= GRID; j++) {
		for (int i = 0; i <= GRID; i++) {
			double x = ((double)i / GRID - 0.5) * 1.3 * truth->width / truth->fx;
			double y = ((double)j / GRID - 0.5) * 1.3 * truth->height / truth->fy;
			double is[2], was[2], off;

			project(truth->fx, truth->fy, truth->cx, truth->cy, truth->dist, x, y, was);
			if (was[0] < 0 || was[1] < 0 || was[0] > truth->width - 1 ||
			    was[1] > truth->height - 1)
				continue;
			project(model->fx, model->fy, model->cx, model->cy, model->dist, x, y, is);
			off = hypot(is[0] - was[0], is[1] - was[1]);
			result->ray_max_px = fmax(result->ray_max_px, off);
			sum += off;
			count++;
		}
	}
	result->ray_mean_px = count ? sum / count : 0;
}

static void compare_camera(struct dio_demo *demo, const struct dio_sim_camera *truth)
{
	const struct dio_camera_model *model = &demo->calibrating.calibration.model;

	demo->truth.fx_px = model->fx - truth->fx;
	demo->truth.fy_px = model->fy - truth->fy;
	demo->truth.cx_px = model->cx - truth->cx;
	demo->truth.cy_px = model->cy - truth->cy;
	compare_rays(model, truth, &demo->truth);
}

static void compare_pose(const double is[16], const double was[16], struct dio_demo_truth *result)
{
	double off = hypot(hypot(is[3] - was[3], is[7] - was[7]), is[11] - was[11]) * 1000;
	double sum = 0, turned;

	/* The Frobenius distance of two rotations is sqrt(8) sin(angle / 2): exact near zero,
	 * where an arc cosine of the trace loses half its digits. */
	for (int row = 0; row < 3; row++)
		for (int col = 0; col < 3; col++) {
			double d = is[4 * row + col] - was[4 * row + col];

			sum += d * d;
		}
	turned = 2 * asin(fmin(1, sqrt(sum / 8))) * 180 / acos(-1);
	result->position_mean_mm += off;
	result->position_max_mm = fmax(result->position_max_mm, off);
	result->rotation_mean_deg += turned;
	result->rotation_max_deg = fmax(result->rotation_max_deg, turned);
	result->poses++;
}

static bool has_pose(const struct dio_posed_view *view)
{
	return view->use == DIO_POSED_CONTEXT || view->use == DIO_POSED_TARGET ||
	       view->use == DIO_POSED_SPARE;
}

/* The walk once more: frame i of a simulated camera is the same each time. */
static enum dio_status compare_poses(struct dio_demo *demo, struct dio_error *error)
{
	const struct dio_posing *posing = &demo->posing;
	struct dio_camera_options options = {
		.frames_per_second = demo->recording.camera.frames_per_second,
		.width = SMALL_WIDTH,
		.height = SMALL_HEIGHT,
	};
	struct dio_input *input;
	struct dio_input_frame about;
	struct dio_sim_camera truth;
	struct dio_frame frame;
	enum dio_status status = dio_input_open(demo->walk, &options, &input, error);

	if (status != DIO_OK)
		return status;
	for (uint32_t i = 0; i < posing->count && status == DIO_OK;) {
		status = dio_input_next_frame(input, &frame, &about, error);
		if (status != DIO_OK || about.index < posing->views[i].index)
			continue;
		if (has_pose(&posing->views[i]) &&
		    dio_sim_camera_get_truth(dio_input_get_camera(input), &truth))
			compare_pose(posing->views[i].estimate.pose.world_from_camera,
				     truth.world_from_camera, &demo->truth);
		i++;
	}
	dio_input_close(input);
	return status;
}

enum dio_status dio_demo_compare(struct dio_demo *demo, struct dio_error *error)
{
	struct dio_demo_truth *result = &demo->truth;
	struct dio_sim_camera truth;
	struct dio_input *input;
	struct dio_frame frame;
	enum dio_status status = dio_input_open(demo->walk, NULL, &input, error);

	if (status != DIO_OK)
		return status;
	status = dio_input_next_frame(input, &frame, NULL, error);
	if (status == DIO_OK && !dio_sim_camera_get_truth(dio_input_get_camera(input), &truth))
		status = dio_fail(error, DIO_UNSUPPORTED, "%s: this camera knows no truth",
				  demo->walk);
	dio_input_close(input);
	if (status != DIO_OK)
		return status;
	compare_camera(demo, &truth);
	status = compare_poses(demo, error);
	if (status != DIO_OK)
		return status;
	if (result->poses > 0) {
		result->position_mean_mm /= result->poses;
		result->rotation_mean_deg /= result->poses;
	}
	result->known = true;
	return DIO_OK;
}
