#include "stress/plot.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* One plot's cell and the frame inside it, in pixels. */
#define CELL_WIDTH  520
#define CELL_HEIGHT 360
#define LEFT        84
#define RIGHT       96
#define TOP         44
#define BOTTOM      56
#define PER_ROW     2

static const char *const colours[STRESS_CURVES] = {
	"#1b6ca8", "#c8553d", "#3a7d44", "#8a5a9e", "#b58900", "#2a9d8f", "#6c757d", "#d1495b",
};

struct stress_curve *stress_plot_curve(struct stress_plot *plot, const char *name)
{
	for (size_t i = 0; i < plot->count; i++) {
		if (strcmp(plot->curves[i].name, name) == 0)
			return &plot->curves[i];
	}
	if (plot->count == STRESS_CURVES) {
		fprintf(stderr, "stress: more than %d curves in a plot\n", STRESS_CURVES);
		exit(1);
	}

	struct stress_curve *curve = &plot->curves[plot->count++];

	snprintf(curve->name, sizeof(curve->name), "%s", name);
	return curve;
}

void stress_curve_add(struct stress_curve *curve, double x, double y)
{
	if (curve->count == STRESS_POINTS) {
		fprintf(stderr, "stress: more than %d points in a curve\n", STRESS_POINTS);
		exit(1);
	}
	curve->x[curve->count] = x;
	curve->y[curve->count++] = y;
}

/* A range in powers of ten, and where it lies in pixels. */
struct axis {
	double low, high; /* exponents */
	double begin, length;
};

static double at(const struct axis *axis, double value)
{
	return axis->begin + (log10(value) - axis->low) / (axis->high - axis->low) * axis->length;
}

static struct axis axis_of(const struct stress_plot *plot, bool y, double begin, double length)
{
	struct axis axis = {INFINITY, -INFINITY, begin, length};

	for (size_t i = 0; i < plot->count; i++) {
		const struct stress_curve *curve = &plot->curves[i];

		for (size_t j = 0; j < curve->count; j++) {
			double exponent = log10(y ? curve->y[j] : curve->x[j]);

			/* Whole decades upwards, to have at least one line on either side. */
			axis.low = fmin(axis.low, y ? floor(exponent) : exponent);
			axis.high = fmax(axis.high, y ? ceil(exponent) : exponent);
		}
	}
	if (!(axis.high > axis.low))
		axis.high = axis.low + 1;
	return axis;
}

static void draw_text(FILE *file, double x, double y, const char *how, const char *text)
{
	fprintf(file, "<text x=\"%.1f\" y=\"%.1f\" %s>%s</text>\n", x, y, how, text);
}

static void draw_line(FILE *file, double x1, double y1, double x2, double y2)
{
	fprintf(file, "<path d=\"M%.1f %.1fL%.1f %.1f\" stroke=\"#dddddd\" fill=\"none\"/>\n", x1,
		y1, x2, y2);
}

/* A line and a power of ten for each decade; every second one is named where they are many. */
static void draw_grid(FILE *file, const struct axis *x, const struct axis *y)
{
	int every = x->high - x->low > 6 ? 2 : 1;
	char text[32];

	for (double e = ceil(x->low); e <= x->high; e++) {
		double place = at(x, pow(10, e));

		draw_line(file, place, y->begin, place, y->begin + y->length);
		if ((int)e % every != 0)
			continue;
		snprintf(text, sizeof(text), e < 0 || e > 4 ? "1e%.0f" : "%.0f",
			 e < 0 || e > 4 ? e : pow(10, e));
		draw_text(file, place, y->begin + 18, "text-anchor=\"middle\"", text);
	}
	for (double e = y->low; e <= y->high; e++) {
		double place = at(y, pow(10, e));

		draw_line(file, x->begin, place, x->begin + x->length, place);
		snprintf(text, sizeof(text), "1e%.0f", e);
		draw_text(file, x->begin - 8, place + 4, "text-anchor=\"end\"", text);
	}
}

static void draw_curve(FILE *file, const struct stress_curve *curve, const char *colour,
		       const struct axis *x, const struct axis *y)
{
	fputs("<path d=\"", file);
	for (size_t i = 0; i < curve->count; i++)
		fprintf(file, "%c%.1f %.1f", i ? 'L' : 'M', at(x, curve->x[i]), at(y, curve->y[i]));
	fprintf(file, "\" stroke=\"%s\" stroke-width=\"2\" fill=\"none\"/>\n", colour);
	for (size_t i = 0; i < curve->count; i++)
		fprintf(file, "<circle cx=\"%.1f\" cy=\"%.1f\" r=\"2.5\" fill=\"%s\"/>\n",
			at(x, curve->x[i]), at(y, curve->y[i]), colour);
}

/* Names stand to the right, at the height where their curves end, but never on one another. */
static void draw_names(FILE *file, const struct stress_plot *plot, const struct axis *x,
		       const struct axis *y)
{
	double taken[STRESS_CURVES];
	char how[64];

	for (size_t i = 0; i < plot->count; i++) {
		const struct stress_curve *curve = &plot->curves[i];
		double place = at(y, curve->y[curve->count - 1]) + 4;

		for (size_t j = 0; j < i; j++) {
			if (fabs(taken[j] - place) < 14) {
				place = taken[j] + 14;
				j = (size_t)-1;
			}
		}
		taken[i] = place;
		snprintf(how, sizeof(how), "fill=\"%s\"", colours[i]);
		draw_text(file, x->begin + x->length + 8, place, how, curve->name);
	}
}

static void draw_plot(FILE *file, const struct stress_plot *plot, double left, double top)
{
	/* y grows downwards. */
	struct axis x = axis_of(plot, false, left + LEFT, CELL_WIDTH - LEFT - RIGHT);
	struct axis y = axis_of(plot, true, top + CELL_HEIGHT - BOTTOM,
				-(double)(CELL_HEIGHT - TOP - BOTTOM));
	char how[96];
	double middle = top + TOP + (CELL_HEIGHT - TOP - BOTTOM) / 2.0;

	draw_grid(file, &x, &y);
	for (size_t i = 0; i < plot->count; i++)
		draw_curve(file, &plot->curves[i], colours[i], &x, &y);
	draw_names(file, plot, &x, &y);
	draw_text(file, left + LEFT, top + TOP - 16, "font-size=\"15\" font-weight=\"bold\"",
		  plot->title);
	draw_text(file, x.begin + x.length / 2, top + CELL_HEIGHT - 16, "text-anchor=\"middle\"",
		  plot->x_title);
	snprintf(how, sizeof(how), "text-anchor=\"middle\" transform=\"rotate(-90 %.1f %.1f)\"",
		 left + 24, middle);
	draw_text(file, left + 24, middle, how, plot->y_title);
}

bool stress_plots_write(const struct stress_plot *plots, size_t count, const char *path)
{
	size_t rows = (count + PER_ROW - 1) / PER_ROW;
	size_t width = PER_ROW * CELL_WIDTH, height = rows * CELL_HEIGHT;
	FILE *file = fopen(path, "w");

	if (!file) {
		perror(path);
		return false;
	}
	fprintf(file,
		"<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"%zu\" height=\"%zu\" "
		"font-family=\"sans-serif\" font-size=\"12\" fill=\"#222222\">\n"
		"<rect width=\"%zu\" height=\"%zu\" fill=\"white\"/>\n",
		width, height, width, height);
	for (size_t i = 0; i < count; i++) {
		if (plots[i].count > 0)
			draw_plot(file, &plots[i], (double)(i % PER_ROW * CELL_WIDTH),
				  (double)(i / PER_ROW * CELL_HEIGHT));
	}
	fputs("</svg>\n", file);

	bool failed = ferror(file);

	if (fclose(file) != 0 || failed) {
		perror(path);
		return false;
	}
	return true;
}
