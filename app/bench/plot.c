#include "bench/plot.h"

#include <math.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "dio/atomic_file.h"

#define PANEL_WIDTH  560
#define HEIGHT       470
#define LEFT         78 /* of a panel, for the axis' numbers */
#define RIGHT        24
#define TOP          92 /* of the plot, for title and legend */
#define BOTTOM       64
#define LABEL_HEIGHT 13
#define LETTER_WIDTH 6.6
#define DOT          5.5

struct box {
	double x0, y0, x1, y1;
};

struct point {
	const struct dio_measured *measured;
	double time_ms, error;
	double x, y; /* on the page */
	bool front;
	char label[32];
};

/* One pair of axes and what stands in it. */
struct panel {
	const char *title, *axis;
	double left;                         /* of the panel, on the page */
	double low_x, high_x, low_y, high_y; /* limits of the axes, in decades */
	struct point *points;
	uint32_t count;
	struct box *taken; /* by dots and labels so far, [2 * count] */
	uint32_t taken_count;
};

/* Colours by class, so that the page's scheme decides. */
static const char STYLE[] =
	"<style>\n"
	"text{font:12px system-ui,sans-serif;fill:#24292f}\n"
	".title{font-size:15px;font-weight:600}.small{font-size:11px}\n"
	".page{fill:#ffffff}.grid{stroke:#d8dee4;stroke-width:1}.fine{stroke:#eef1f4}\n"
	".frame{fill:none;stroke:#8c959f}.front{fill:none;stroke:#57606a;stroke-width:1.5;"
	"stroke-dasharray:5 4}\n"
	".leader{stroke:#8c959f;stroke-width:.8}\n"
	".f32{fill:#0969da;stroke:#0969da}.bf16{fill:#bc4c00;stroke:#bc4c00}"
	".fixed{fill:#1a7f37;stroke:#1a7f37}\n"
	"circle{stroke-width:2}.beaten{fill-opacity:.15}\n"
	".label{font-size:11px;stroke-width:3;paint-order:stroke}\n"
	".label.f32{stroke:#ffffff}.label.bf16{stroke:#ffffff}.label.fixed{stroke:#ffffff}\n"
	"@media (prefers-color-scheme:dark){text{fill:#e6edf3}.page{fill:#0d1117}"
	".grid{stroke:#30363d}.fine{stroke:#21262d}.frame{stroke:#6e7681}.front{stroke:#9ea7b3}"
	".leader{stroke:#6e7681}\n"
	".f32{fill:#58a6ff;stroke:#58a6ff}.bf16{fill:#f0883e;stroke:#f0883e}"
	".fixed{fill:#3fb950;stroke:#3fb950}\n"
	".label.f32{stroke:#0d1117}.label.bf16{stroke:#0d1117}.label.fixed{stroke:#0d1117}}\n"
	"</style>\n";

static double plot_width(void)
{
	return PANEL_WIDTH - LEFT - RIGHT;
}

static double to_x(const struct panel *panel, double time_ms)
{
	const double share = (log10(time_ms) - panel->low_x) / (panel->high_x - panel->low_x);

	return panel->left + LEFT + share * plot_width();
}

static double to_y(const struct panel *panel, double error)
{
	const double share = (log10(error) - panel->low_y) / (panel->high_y - panel->low_y);

	return HEIGHT - BOTTOM - share * (HEIGHT - TOP - BOTTOM);
}

/* Points of the measurements with `threads` threads whose error is known and not 0. */
static void collect(struct panel *panel, const struct dio_outcome *outcome, uint32_t threads,
		    bool truth)
{
	for (uint32_t i = 0; i < outcome->count; i++) {
		const struct dio_measured *measured = &outcome->measured[i];
		const struct dio_difference *error =
			truth ? &measured->from_truth : &measured->from_reference;
		struct point *point = &panel->points[panel->count];

		if (measured->wish.threads != threads || !error->known || !(error->rms > 0))
			continue;
		*point = (struct point){.measured = measured,
					.time_ms = measured->render.median_ms,
					.error = error->rms};
		snprintf(point->label, sizeof point->label, "p%u v%u", measured->wish.patch_px,
			 measured->wish.views);
		panel->count++;
	}
	for (uint32_t i = 0; i < panel->count; i++) {
		struct point *point = &panel->points[i];

		point->front = true;
		for (uint32_t k = 0; k < panel->count; k++) {
			const struct point *other = &panel->points[k];

			if (other->time_ms <= point->time_ms && other->error <= point->error &&
			    (other->time_ms < point->time_ms || other->error < point->error))
				point->front = false;
		}
	}
}

/* Limits with some air, at least a third of a decade apart. */
static void choose_limits(double low, double high, double *from, double *to)
{
	const double middle = 0.5 * (log10(low) + log10(high));
	const double half = fmax(0.17, 0.58 * (log10(high) - log10(low)));

	*from = middle - half;
	*to = middle + half;
}

static void fit(struct panel *panel)
{
	double low_ms = INFINITY, high_ms = 0, low = INFINITY, high = 0;

	for (uint32_t i = 0; i < panel->count; i++) {
		low_ms = fmin(low_ms, panel->points[i].time_ms);
		high_ms = fmax(high_ms, panel->points[i].time_ms);
		low = fmin(low, panel->points[i].error);
		high = fmax(high, panel->points[i].error);
	}
	choose_limits(low_ms, high_ms, &panel->low_x, &panel->high_x);
	choose_limits(low, high, &panel->low_y, &panel->high_y);
	for (uint32_t i = 0; i < panel->count; i++) {
		struct point *point = &panel->points[i];

		point->x = to_x(panel, point->time_ms);
		point->y = to_y(panel, point->error);
	}
}

/* Axes */

/* Tenths of a mantissa from one line of the grid to the next. */
static int tick_step(double span)
{
	return span < 0.6 ? 5 : 10;
}

/* Few decades leave room for more numbers. */
static bool is_labelled(int tenths, double span)
{
	const bool round = tenths % 10 == 0;

	if (span < 0.6)
		return round || tenths < 30;
	return tenths == 10 || (span < 2.2 && (tenths == 20 || tenths == 50)) ||
	       (span < 0.9 && round);
}

static void draw_x_axis(FILE *out, const struct panel *panel)
{
	const double bottom = HEIGHT - BOTTOM, span = panel->high_x - panel->low_x;

	for (int decade = (int)floor(panel->low_x); decade <= panel->high_x; decade++) {
		for (int tenths = 10; tenths < 100; tenths += tick_step(span)) {
			const double value = tenths * pow(10, decade - 1), at = log10(value);
			const bool labelled = is_labelled(tenths, span);

			if (at < panel->low_x || at > panel->high_x)
				continue;
			fprintf(out,
				"<line class='grid%s' x1='%.1f' y1='%d' x2='%.1f' y2='%.0f'/>\n",
				labelled ? "" : " fine", to_x(panel, value), TOP,
				to_x(panel, value), bottom);
			if (labelled)
				fprintf(out,
					"<text class='small' text-anchor='middle' x='%.1f' "
					"y='%.0f'>%g</text>\n",
					to_x(panel, value), bottom + 16, value);
		}
	}
	fprintf(out,
		"<text text-anchor='middle' x='%.1f' y='%.0f'>time to render one view, ms</text>\n",
		panel->left + LEFT + 0.5 * plot_width(), bottom + 38);
}

static void draw_y_axis(FILE *out, const struct panel *panel)
{
	const double left = panel->left + LEFT, span = panel->high_y - panel->low_y;

	for (int decade = (int)floor(panel->low_y); decade <= panel->high_y; decade++) {
		for (int tenths = 10; tenths < 100; tenths += tick_step(span)) {
			const double value = tenths * pow(10, decade - 1), at = log10(value);
			const bool labelled = is_labelled(tenths, span);

			if (at < panel->low_y || at > panel->high_y)
				continue;
			fprintf(out,
				"<line class='grid%s' x1='%.1f' y1='%.1f' x2='%.1f' y2='%.1f'/>\n",
				labelled ? "" : " fine", left, to_y(panel, value),
				left + plot_width(), to_y(panel, value));
			if (labelled)
				fprintf(out,
					"<text class='small' text-anchor='end' x='%.1f' y='%.1f'>"
					"%g</text>\n",
					left - 6, to_y(panel, value) + 4, value);
		}
	}
	fprintf(out,
		"<text text-anchor='middle' transform='translate(%.1f %.1f) rotate(-90)'>%s"
		"</text>\n",
		panel->left + 18, TOP + 0.5 * (HEIGHT - TOP - BOTTOM), panel->axis);
}

/* Labels: the first of eight places round the dot that is free. */

static bool overlaps(const struct box *a, const struct box *b)
{
	return a->x0 < b->x1 && b->x0 < a->x1 && a->y0 < b->y1 && b->y0 < a->y1;
}

static double overlap(const struct panel *panel, const struct box *box)
{
	double area = 0;

	if (box->x0 < panel->left + LEFT || box->x1 > panel->left + LEFT + plot_width() ||
	    box->y0 < TOP || box->y1 > HEIGHT - BOTTOM)
		area += 1e6;
	for (uint32_t i = 0; i < panel->taken_count; i++) {
		const struct box *other = &panel->taken[i];

		if (overlaps(box, other))
			area += (fmin(box->x1, other->x1) - fmax(box->x0, other->x0)) *
				(fmin(box->y1, other->y1) - fmax(box->y0, other->y0));
	}
	return area;
}

static void draw_label(FILE *out, struct panel *panel, const struct point *point)
{
	const double width = (double)strlen(point->label) * LETTER_WIDTH;
	struct box best = {0};
	double least = INFINITY;

	for (int ring = 0; ring < 4; ring++) {
		for (int place = 0; place < 8; place++) {
			const double angle = M_PI / 4 * place, c = cos(angle), s = sin(angle);
			const double reach = DOT + 4 + 11 * ring;
			const double x = point->x + c * (reach + 0.5 * width);
			const double y = point->y + s * (reach + 0.5 * LABEL_HEIGHT);
			const struct box box = {x - 0.5 * width, y - 0.5 * LABEL_HEIGHT,
						x + 0.5 * width, y + 0.5 * LABEL_HEIGHT};
			const double cost = overlap(panel, &box) + 0.01 * ring;

			if (cost < least) {
				least = cost;
				best = box;
			}
		}
	}
	panel->taken[panel->taken_count++] = best;

	const double x = 0.5 * (best.x0 + best.x1), y = 0.5 * (best.y0 + best.y1);

	if (hypot(x - point->x, y - point->y) > 0.5 * width + 14)
		fprintf(out, "<line class='leader' x1='%.1f' y1='%.1f' x2='%.1f' y2='%.1f'/>\n",
			point->x, point->y, x, y);
	fprintf(out, "<text class='label %s' text-anchor='middle' x='%.1f' y='%.1f'>%s</text>\n",
		dvsm_precision_name(point->measured->wish.precision), x, y + 4, point->label);
}

static void draw_points(FILE *out, struct panel *panel)
{
	for (uint32_t i = 0; i < panel->count; i++) {
		const struct point *point = &panel->points[i];

		panel->taken[panel->taken_count++] =
			(struct box){point->x - DOT - 1, point->y - DOT - 1, point->x + DOT + 1,
				     point->y + DOT + 1};
	}
	for (uint32_t i = 0; i < panel->count; i++)
		draw_label(out, panel, &panel->points[i]);
	for (uint32_t i = 0; i < panel->count; i++) {
		const struct point *point = &panel->points[i];
		const struct dio_measured *measured = point->measured;

		fprintf(out,
			"<circle class='%s%s' cx='%.1f' cy='%.1f' r='%.1f'><title>%s, patch %u, "
			"%u views: render %.3f ms, reconstruct %.2f ms, error %.3g</title>"
			"</circle>\n",
			dvsm_precision_name(measured->wish.precision),
			point->front ? "" : " beaten", point->x, point->y, DOT,
			dvsm_precision_name(measured->wish.precision), measured->wish.patch_px,
			measured->wish.views, point->time_ms, measured->reconstruct.median_ms,
			point->error);
	}
}

static int by_time(const void *a, const void *b)
{
	const struct point *x = a, *y = b;

	return (x->time_ms > y->time_ms) - (x->time_ms < y->time_ms);
}

/* Steps: between two points of the front nothing better is known than the faster one. */
static void draw_front(FILE *out, struct panel *panel)
{
	const struct point *last = NULL;

	qsort(panel->points, panel->count, sizeof *panel->points, by_time);
	fprintf(out, "<path class='front' d='");
	for (uint32_t i = 0; i < panel->count; i++) {
		const struct point *point = &panel->points[i];

		if (!point->front)
			continue;
		if (!last)
			fprintf(out, "M%.1f %d V%.1f", point->x, TOP, point->y);
		else
			fprintf(out, " H%.1f V%.1f", point->x, point->y);
		last = point;
	}
	fprintf(out, " H%.1f'/>\n", panel->left + LEFT + plot_width());
}

static void draw_panel(FILE *out, struct panel *panel)
{
	fit(panel);
	draw_x_axis(out, panel);
	draw_y_axis(out, panel);
	fprintf(out, "<rect class='frame' x='%.1f' y='%d' width='%.1f' height='%d'/>\n",
		panel->left + LEFT, TOP, plot_width(), HEIGHT - TOP - BOTTOM);
	fprintf(out, "<text x='%.1f' y='%d'>%s</text>\n", panel->left + LEFT, TOP - 10,
		panel->title);
	fprintf(out,
		"<text class='small' text-anchor='end' x='%.1f' y='%d'>p: stage patch, v: views"
		"</text>\n",
		panel->left + LEFT + plot_width(), TOP - 10);
	draw_front(out, panel);
	draw_points(out, panel);
}

/* The page */

/* Text as XML wants it. */
static void put_text(FILE *out, const char *text)
{
	for (; *text; text++) {
		if (*text == '&')
			fputs("&amp;", out);
		else if (*text == '<')
			fputs("&lt;", out);
		else if (*text == '>')
			fputs("&gt;", out);
		else
			fputc(*text, out);
	}
}

static void draw_legend(FILE *out, const struct panel *panels, uint32_t count, double right)
{
	double x = right - RIGHT;

	for (int p = DVSM_PRECISION_FIXED; p >= (int)DVSM_PRECISION_F32; p--) {
		const char *name = dvsm_precision_name((enum dvsm_precision)p);
		bool used = false;

		for (uint32_t i = 0; i < count; i++)
			for (uint32_t k = 0; k < panels[i].count; k++)
				used |= (int)panels[i].points[k].measured->wish.precision == p;
		if (!used)
			continue;
		x -= 58;
		fprintf(out,
			"<circle class='%s' cx='%.1f' cy='24' r='%.1f'/><text x='%.1f' "
			"y='28'>%s</text>\n",
			name, x, DOT, x + 11, name);
	}
}

static void draw_page(FILE *out, const struct dio_report *report, uint32_t threads,
		      struct panel *panels, uint32_t count)
{
	const struct dvsm_model_config *config = &report->work->config;
	const struct dio_camera_model *camera = &report->work->views.target[0].camera;
	const double width = (double)PANEL_WIDTH * count;

	fprintf(out,
		"<svg xmlns='http://www.w3.org/2000/svg' viewBox='0 0 %.0f %d' width='%.0f' "
		"height='%d'>\n%s<rect class='page' width='%.0f' height='%d'/>\n",
		width, HEIGHT, width, HEIGHT, STYLE, width, HEIGHT);
	fprintf(out, "<text class='title' x='%d' y='28'>Run time against error</text>\n", LEFT);
	fprintf(out, "<text class='small' x='%d' y='46'>", LEFT);
	put_text(out, report->machine->processor);
	fprintf(out, ", %u thread%s, %s</text>\n<text class='small' x='%d' y='61'>", threads,
		threads == 1 ? "" : "s", dvsm_cpu_name(dvsm_cpu_detect()), LEFT);
	put_text(out, report->work->model_name);
	fprintf(out, ": D %u, %u blocks; %ux%u pixels</text>\n", config->dim, config->layers,
		camera->width, camera->height);
	draw_legend(out, panels, count, width);
	for (uint32_t i = 0; i < count; i++)
		draw_panel(out, &panels[i]);
	fprintf(out, "</svg>\n");
}

static bool panel_init(struct panel *panel, const struct dio_outcome *outcome, uint32_t threads,
		       bool truth)
{
	*panel = (struct panel){
		.title = truth ? "Distance from the true pictures"
			       : "Distance from the same model in float64",
		.axis = truth ? "root mean square of 8-bit pictures, 1 = white"
			      : "root mean square, 1 = white",
		.points = calloc(outcome->count + 1u, sizeof *panel->points),
		.taken = calloc(2 * (outcome->count + 1u), sizeof *panel->taken),
	};
	if (!panel->points || !panel->taken)
		return false;
	collect(panel, outcome, threads, truth);
	return true;
}

enum dio_status dio_plot_write(const struct dio_report *report, const struct dio_outcome *outcome,
			       const char *path, struct dio_error *error)
{
	struct panel made[2] = {{0}}, shown[2];
	struct dio_atomic_file *file = NULL;
	enum dio_status status = DIO_OK;
	uint32_t threads = 0, count = 0;

	for (uint32_t i = 0; i < outcome->count; i++)
		if (outcome->measured[i].wish.threads > threads)
			threads = outcome->measured[i].wish.threads;
	for (int i = 0; status == DIO_OK && i < 2; i++) {
		if (!panel_init(&made[i], outcome, threads, i == 1))
			status = dio_fail(error, DIO_NO_MEM, "%s: no memory", path);
		if (made[i].count == 0)
			continue;
		shown[count] = made[i];
		shown[count].left = (double)PANEL_WIDTH * count;
		count++;
	}
	if (status == DIO_OK && count == 0)
		status = dio_fail(error, DIO_BAD_ARG,
				  "%s: no error is known to plot: give --reference, or a scene "
				  "whose targets have pictures",
				  path);
	if (status == DIO_OK)
		status = dio_atomic_file_open(path, &file, error);
	if (status == DIO_OK) {
		draw_page(dio_atomic_file_stream(file), report, threads, shown, count);
		status = dio_atomic_file_commit(file, error);
	}
	for (int i = 0; i < 2; i++) {
		free(made[i].points);
		free(made[i].taken);
	}
	return status;
}
