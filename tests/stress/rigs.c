#include "stress/rigs.h"

#include <math.h>

/* The rig and its target by `amount` in all directions. */
static void move(struct dvsm_camera *camera, double amount)
{
	for (int row = 0; row < 3; row++)
		camera->world_from_camera[4 * row + 3] += amount * (row + 1);
}

void stress_rig_far_away(struct dvsm_view *views, uint32_t count, struct dvsm_camera *target,
			 double amount)
{
	for (uint32_t v = 0; v < count; v++)
		move(&views[v].camera, amount);
	move(target, amount);
}

void stress_rig_far_target(struct dvsm_view *views, uint32_t count, struct dvsm_camera *target,
			   double amount)
{
	(void)views;
	(void)count;
	move(target, amount);
}

static void scale(struct dvsm_camera *camera, double amount)
{
	for (int row = 0; row < 3; row++)
		camera->world_from_camera[4 * row + 3] *= amount;
}

void stress_rig_scaled(struct dvsm_view *views, uint32_t count, struct dvsm_camera *target,
		       double amount)
{
	for (uint32_t v = 0; v < count; v++)
		scale(&views[v].camera, amount);
	scale(target, amount);
}

/* All context cameras at one place, `amount` apart. */
void stress_rig_one_place(struct dvsm_view *views, uint32_t count, struct dvsm_camera *target,
			  double amount)
{
	(void)target;
	for (uint32_t v = 0; v < count; v++) {
		for (int row = 0; row < 3; row++)
			views[v].camera.world_from_camera[4 * row + 3] = 1 + amount * v * row;
	}
}

void stress_rig_one_far_place(struct dvsm_view *views, uint32_t count, struct dvsm_camera *target,
			      double amount)
{
	stress_rig_one_place(views, count, target, 0);
	stress_rig_far_away(views, count, target, amount);
}

/* One camera over and over. */
void stress_rig_one_camera(struct dvsm_view *views, uint32_t count, struct dvsm_camera *target,
			   double amount)
{
	(void)target;
	(void)amount;
	for (uint32_t v = 1; v < count; v++)
		views[v].camera = views[0].camera;
}

/* Every camera turned about an axis of its own: 0 is x, 1 is y, 2 is z. */
static void turn(struct dvsm_camera *camera, int axis, double angle)
{
	const int a = (axis + 1) % 3, b = (axis + 2) % 3;
	double *pose = camera->world_from_camera, s = sin(angle), c = cos(angle);

	for (int row = 0; row < 3; row++) {
		double u = pose[4 * row + a], v = pose[4 * row + b];

		pose[4 * row + a] = c * u + s * v;
		pose[4 * row + b] = c * v - s * u;
	}
}

/* Two cameras that look away from one another but for `amount`: the mean direction all but
 * vanishes. */
void stress_rig_back_to_back(struct dvsm_view *views, uint32_t count, struct dvsm_camera *target,
			     double amount)
{
	(void)target;
	for (uint32_t v = 1; v < count; v++) {
		double *centre = views[v].camera.world_from_camera;
		const double kept[3] = {centre[3], centre[7], centre[11]};

		views[v].camera = views[0].camera;
		for (int row = 0; row < 3; row++)
			centre[4 * row + 3] = kept[row];
		turn(&views[v].camera, 1, v % 2 ? M_PI - amount : 0);
	}
}

/* Cameras that look down along their mean y axis but for `amount`: x has hardly a direction. */
void stress_rig_crossed(struct dvsm_view *views, uint32_t count, struct dvsm_camera *target,
			double amount)
{
	(void)target;
	for (uint32_t v = 0; v < count; v++) {
		double *pose = views[v].camera.world_from_camera;
		const double s = sin(amount * (v + 1)), c = cos(amount * (v + 1));
		/* By turns y and z, z and y, so that both means point the same way. */
		const double even[9] = {c, 0, s, -s, 0, c, 0, -1, 0};
		const double odd[9] = {-c, s, 0, s, c, 0, 0, 0, -1};

		for (int i = 0; i < 9; i++)
			pose[4 * (i / 3) + i % 3] = v % 2 ? odd[i] : even[i];
	}
}

/* As far off a rotation as the engine takes. */
void stress_rig_bent(struct dvsm_view *views, uint32_t count, struct dvsm_camera *target,
		     double amount)
{
	(void)target;
	for (uint32_t v = 0; v < count; v++)
		views[v].camera.world_from_camera[0] += v % 2 ? amount : -amount;
}

void stress_rig_long_lens(struct dvsm_view *views, uint32_t count, struct dvsm_camera *target,
			  double amount)
{
	for (uint32_t v = 0; v < count; v++)
		views[v].camera.fx = views[v].camera.fy = amount * views[v].camera.width;
	target->fx = target->fy = amount * target->width;
}

void stress_rig_shifted_lens(struct dvsm_view *views, uint32_t count, struct dvsm_camera *target,
			     double amount)
{
	for (uint32_t v = 0; v < count; v++)
		views[v].camera.cx = amount * views[v].camera.width;
	target->cy = -amount * target->height;
}

/* Pictures of very different sizes: 1 x 1, one row, one column. */
void stress_rig_slivers(struct dvsm_view *views, uint32_t count, struct dvsm_camera *target,
			double amount)
{
	(void)amount;
	for (uint32_t v = 0; v < count; v++) {
		views[v].camera.width = v % 2 ? 1 : 61;
		views[v].camera.height = v % 3 ? 1 : 37;
	}
	target->width = 1;
	target->height = 53;
}
