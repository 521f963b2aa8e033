/* The camera: from pixels to rays through OpenCV's distortion model (k1, k2, p1, p2, k3). */
#ifndef DIO_SIM_LENS_H
#define DIO_SIM_LENS_H

#include "dio/sim.h"
#include "shape.h"

/* Where a pixel looks on the plane z = 1, and how that moves with the pixel. */
struct lens_point {
	double x, y;
	double dx_du, dx_dv, dy_du, dy_dv;
};

DIO_SIM_FN bool lens_is_pinhole(const struct dio_sim_camera *c)
{
	return c->dist[0] == 0 && c->dist[1] == 0 && c->dist[2] == 0 && c->dist[3] == 0 &&
	       c->dist[4] == 0;
}

/* Undo the distortion for pixel (u, v) by Newton's method from p->x, p->y, which should hold the
 * solution of a neighbour or the undistorted guess. */
DIO_SIM_FN void lens_solve(const struct dio_sim_camera *c, double u, double v, int steps,
			   struct lens_point *p)
{
	double want_x = (u - c->cx) / c->fx, want_y = (v - c->cy) / c->fy;
	double k1 = c->dist[0], k2 = c->dist[1], p1 = c->dist[2], p2 = c->dist[3], k3 = c->dist[4];
	double x = p->x, y = p->y, a = 1, b = 0, e = 1, det;

	for (int i = 0; i <= steps; i++) {
		double r2 = x * x + y * y;
		double radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k3));
		double slope = 2 * (k1 + r2 * (2 * k2 + r2 * 3 * k3));
		double off_x = x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x) - want_x;
		double off_y = y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y - want_y;

		/* Jacobian; its off-diagonal elements are equal. */
		a = radial + x * x * slope + 2 * p1 * y + 6 * p2 * x;
		b = x * y * slope + 2 * p1 * x + 2 * p2 * y;
		e = radial + y * y * slope + 6 * p1 * y + 2 * p2 * x;
		det = a * e - b * b;
		/* Past the fold of a strong lens nothing can be solved: keep the last point. */
		if (det < 0.05)
			break;
		/* Squared 1e-13 of the focal length: the error of the last step is far less. */
		if (off_x * off_x + off_y * off_y < 1e-26)
			break;
		if (i < steps) {
			x -= (e * off_x - b * off_y) / det;
			y -= (a * off_y - b * off_x) / det;
		}
	}
	det = a * e - b * b;
	if (det < 0.05)
		det = 0.05;
	p->x = x;
	p->y = y;
	p->dx_du = e / det / c->fx;
	p->dx_dv = -b / det / c->fy;
	p->dy_du = -b / det / c->fx;
	p->dy_dv = a / det / c->fy;
}

/* `steps` of Newton; 0 uses what a pinhole camera would give. */
DIO_SIM_FN struct lens_point lens_at(const struct dio_sim_camera *c, double u, double v)
{
	struct lens_point p;

	p.x = (u - c->cx) / c->fx;
	p.y = (v - c->cy) / c->fy;
	p.dx_du = 1 / c->fx;
	p.dy_dv = 1 / c->fy;
	p.dx_dv = p.dy_du = 0;
	if (!lens_is_pinhole(c))
		lens_solve(c, u, v, 12, &p);
	return p;
}

DIO_SIM_FN struct ray lens_ray(const struct dio_sim_camera *c, double x, double y)
{
	const double *m = c->world_from_camera;
	struct v3 from = v3((float)m[3], (float)m[7], (float)m[11]);
	struct v3 along =
		v3((float)(m[0] * x + m[1] * y + m[2]), (float)(m[4] * x + m[5] * y + m[6]),
		   (float)(m[8] * x + m[9] * y + m[10]));

	return ray_of(from, v3_unit(along), (float)(1 / c->fx));
}

#endif
