/* Line plots, logarithmic on both axes, as SVG. */
#ifndef TESTS_STRESS_PLOT_H
#define TESTS_STRESS_PLOT_H

#include <stdbool.h>
#include <stddef.h>

#define STRESS_POINTS 24
#define STRESS_CURVES 8

struct stress_curve {
	char name[32];
	double x[STRESS_POINTS], y[STRESS_POINTS]; /* above 0 */
	size_t count;
};

struct stress_plot {
	const char *title, *x_title, *y_title;
	struct stress_curve curves[STRESS_CURVES];
	size_t count;
};

/** The curve of this name, made when it is new; exits with a line when there are too many. */
struct stress_curve *stress_plot_curve(struct stress_plot *plot, const char *name);
void stress_curve_add(struct stress_curve *curve, double x, double y);

/** All plots beside and below one another; false with a printed line when it cannot be written. */
bool stress_plots_write(const struct stress_plot *plots, size_t count, const char *path);

#endif
