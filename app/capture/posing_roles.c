#include "capture/posing_roles.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>

/* A pose is an outlier when its error is this much above the median, and not small by itself. */
#define OUTLIER_RATIO  3.0
#define OUTLIER_MIN_PX 0.5

static bool is_posed(const struct dio_posed_view *view)
{
	return view->use == DIO_POSED_CONTEXT || view->use == DIO_POSED_TARGET ||
	       view->use == DIO_POSED_SPARE;
}

static int compare_doubles(const void *a, const void *b)
{
	double x = *(const double *)a, y = *(const double *)b;

	return (x > y) - (x < y);
}

/* Median error of the posed views; 0 when there are none or memory is short. */
static double median_rms(const struct dio_posing *result)
{
	double *errors = malloc((result->count ? result->count : 1) * sizeof *errors);
	double median = 0;
	uint32_t n = 0;

	if (!errors)
		return 0;
	for (uint32_t i = 0; i < result->count; i++)
		if (is_posed(&result->views[i]))
			errors[n++] = result->views[i].estimate.rms_px;
	qsort(errors, n, sizeof *errors, compare_doubles);
	if (n > 0)
		median = errors[n / 2];
	free(errors);
	return median;
}

void dio_posing_mark_outliers(struct dio_posing *result)
{
	double median = median_rms(result);

	if (median <= 0)
		return;
	for (uint32_t i = 0; i < result->count; i++) {
		struct dio_posed_view *view = &result->views[i];
		double rms = view->estimate.rms_px;

		if (!is_posed(view) || rms <= fmax(OUTLIER_RATIO * median, OUTLIER_MIN_PX))
			continue;
		view->use = DIO_POSED_OUTLIER;
		snprintf(view->reason, sizeof view->reason,
			 "reprojection error %.2f px, the median is %.2f px", rms, median);
		dio_picture_deinit(&view->picture);
	}
}

static double distance(const struct dio_posed_view *a, const struct dio_posed_view *b)
{
	const double *p = a->estimate.pose.world_from_camera;
	const double *q = b->estimate.pose.world_from_camera;

	return sqrt((p[3] - q[3]) * (p[3] - q[3]) + (p[7] - q[7]) * (p[7] - q[7]) +
		    (p[11] - q[11]) * (p[11] - q[11]));
}

/* Distance from a view to the nearest that is context already; infinite before the first. */
static double gap(const struct dio_posing *result, uint32_t view)
{
	double least = INFINITY;

	for (uint32_t i = 0; i < result->count; i++)
		if (result->views[i].use == DIO_POSED_CONTEXT)
			least = fmin(least, distance(&result->views[i], &result->views[view]));
	return least;
}

/* The spare view nearest to the middle of all spare views: the first context view. */
static uint32_t most_central(const struct dio_posing *result)
{
	double mean[3] = {0}, best = INFINITY;
	uint32_t n = 0, chosen = 0;

	for (uint32_t i = 0; i < result->count; i++) {
		if (result->views[i].use != DIO_POSED_SPARE)
			continue;
		for (int k = 0; k < 3; k++)
			mean[k] += result->views[i].estimate.pose.world_from_camera[4 * k + 3];
		n++;
	}
	for (uint32_t i = 0; i < result->count; i++) {
		const double *p = result->views[i].estimate.pose.world_from_camera;
		double sum = 0;

		if (result->views[i].use != DIO_POSED_SPARE)
			continue;
		for (int k = 0; k < 3; k++)
			sum += (p[4 * k + 3] - mean[k] / n) * (p[4 * k + 3] - mean[k] / n);
		if (sum < best) {
			best = sum;
			chosen = i;
		}
	}
	return chosen;
}

/* Farthest-point sampling of the camera centres. */
static void choose_context(struct dio_posing *result, uint32_t spare, uint32_t most)
{
	uint32_t wanted = most > 0 && most < spare ? most : spare;

	for (uint32_t n = 0; n < wanted; n++) {
		uint32_t chosen = n == 0 ? most_central(result) : 0;
		double widest = -1;

		for (uint32_t i = 0; n > 0 && i < result->count; i++) {
			double here;

			if (result->views[i].use != DIO_POSED_SPARE)
				continue;
			here = gap(result, i);
			if (here > widest) {
				widest = here;
				chosen = i;
			}
		}
		result->views[chosen].use = DIO_POSED_CONTEXT;
	}
	result->context = wanted;
}

/* One picture of every how many is held back: enough to judge by, few enough to spare. */
static uint32_t hold_out_step(const struct dio_posing_options *options, uint32_t posed)
{
	if (options->hold_out_none || posed < 2)
		return 0;
	if (options->hold_out > 0)
		return options->hold_out;
	if (posed >= 16)
		return 8;
	return posed / 3 > 2 ? posed / 3 : 2;
}

void dio_posing_assign_roles(struct dio_posing *result, const struct dio_posing_options *options)
{
	uint32_t step, seen = 0;
	double sum = 0;

	result->posed = result->context = result->targets = 0;
	for (uint32_t i = 0; i < result->count; i++)
		result->posed += is_posed(&result->views[i]);
	step = hold_out_step(options, result->posed);
	for (uint32_t i = 0; i < result->count; i++) {
		struct dio_posed_view *view = &result->views[i];

		if (!is_posed(view))
			continue;
		view->use = DIO_POSED_SPARE;
		/* At least one view stays to reconstruct from. */
		if (step > 0 && seen % step == 0 && result->targets + 1 < result->posed) {
			view->use = DIO_POSED_TARGET;
			result->targets++;
		}
		sum += view->estimate.rms_px;
		seen++;
	}
	if (seen > 0)
		result->rms_px = sum / seen;
	choose_context(result, result->posed - result->targets, options->context);
}
