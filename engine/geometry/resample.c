#include "geometry/resample.h"

#include <stdbool.h>

/*
 * The source samples one target sample is made of: first .. last, all between them with weight
 * `inner`. A box, a bilinear pair and a copy all have this form. Weights add up to one.
 */
struct span {
	uint32_t first, last;
	double first_weight, inner_weight, last_weight;
};

/* Overlap of source sample i with target sample `at`, both cut into target resp. source parts. */
static double box_weight(uint64_t i, uint64_t at, uint32_t source, uint32_t target)
{
	uint64_t begin = i * target, end = begin + target;
	uint64_t box_begin = at * source, box_end = box_begin + source;
	uint64_t from = begin > box_begin ? begin : box_begin;
	uint64_t to = end < box_end ? end : box_end;
	return (double)(to - from) / source;
}

static struct span box_span(uint32_t at, uint32_t source, uint32_t target)
{
	struct span span;
	span.first = (uint32_t)((uint64_t)at * source / target);
	span.last = (uint32_t)((((uint64_t)at + 1) * source - 1) / target);
	span.first_weight = box_weight(span.first, at, source, target);
	span.inner_weight = (double)target / source;
	span.last_weight = box_weight(span.last, at, source, target);
	return span;
}

/* Position (at + 0.5) source / target - 0.5, clamped, as whole samples and a rest over 2 target. */
static struct span bilinear_span(uint32_t at, uint32_t source, uint32_t target)
{
	uint64_t shifted = (2 * (uint64_t)at + 1) * source;
	uint64_t position = shifted > target ? shifted - target : 0;
	uint64_t whole = position / (2 * (uint64_t)target);
	double rest = (double)(position % (2 * (uint64_t)target)) / (2.0 * target);
	struct span span = {
		.first = (uint32_t)whole,
		.last = (uint32_t)whole + 1,
		.first_weight = 1 - rest,
		.last_weight = rest,
	};
	if (span.last >= source) {
		span.last = span.first;
		span.first_weight = 1;
	}
	return span;
}

static struct span span_at(uint32_t at, uint32_t source, uint32_t target)
{
	if (source > target)
		return box_span(at, source, target);
	if (source < target)
		return bilinear_span(at, source, target);
	return (struct span){.first = at, .last = at, .first_weight = 1};
}

static double span_weight(const struct span *span, uint32_t i)
{
	if (i == span->first)
		return span->first_weight;
	return i == span->last ? span->last_weight : span->inner_weight;
}

/* sum = weight * row, or sum += weight * row. */
static void add_row(double *sum, const float *row, size_t count, double weight, bool begin)
{
	if (begin) {
		for (size_t i = 0; i < count; i++)
			sum[i] = weight * row[i];
	} else {
		for (size_t i = 0; i < count; i++)
			sum[i] += weight * row[i];
	}
}

/* The same as bilinear_span() gives, its place counted on from pixel to pixel. */
static void grow_row(const double *row, uint32_t source, uint32_t target, uint32_t first,
		     uint32_t count, double gain, double offset, float *out)
{
	const int64_t step = 2 * (int64_t)target;
	const double *last = row + 3 * ((size_t)source - 1);
	int64_t rest = (2 * (int64_t)first + 1) * source - target;

	if (rest >= step) {
		row += 3 * (rest / step);
		rest %= step;
	}
	for (uint32_t x = 0; x < count; x++, rest += 2 * (int64_t)source, out += 3) {
		if (rest >= step) {
			rest -= step;
			row += 3;
		}
		const double *next = row < last ? row + 3 : row;
		const double weight = rest > 0 && row < last ? (double)rest / (double)step : 0;

		for (int c = 0; c < 3; c++)
			out[c] =
				(float)(gain * ((1 - weight) * row[c] + weight * next[c]) + offset);
	}
}

/* Target pixels first .. first + count - 1 of a row of `source` pixels, as gain * value + offset.
 */
static void resample_row(const double *row, uint32_t source, uint32_t target, uint32_t first,
			 uint32_t count, double gain, double offset, float *out)
{
	if (source == target) {
		const double *from = row + 3 * (size_t)first;
		for (size_t i = 0; i < 3 * (size_t)count; i++)
			out[i] = (float)(gain * from[i] + offset);
		return;
	}
	if (source < target) {
		grow_row(row, source, target, first, count, gain, offset, out);
		return;
	}
	for (uint32_t x = first; x < first + count; x++, out += 3) {
		struct span span = box_span(x, source, target);
		double rgb[3] = {0};
		for (uint32_t i = span.first; i <= span.last; i++) {
			double weight = span_weight(&span, i);
			for (int c = 0; c < 3; c++)
				rgb[c] += weight * row[3 * (size_t)i + c];
		}
		for (int c = 0; c < 3; c++)
			out[c] = (float)(gain * rgb[c] + offset);
	}
}

struct dvsm_patch_plan dvsm_patch_plan_make(uint32_t width, uint32_t height, uint32_t patch_px,
					    uint32_t stage_patch_px)
{
	struct dvsm_patch_plan plan = {
		.width = width,
		.height = height,
		.patch_px = patch_px,
		.grid = dvsm_token_grid_of(width, height, stage_patch_px),
	};
	/* One source row, mixed of the rows that a target row covers: the picture's or the map's.
	 */
	size_t map_width = (size_t)plan.grid.columns * patch_px;
	size_t widest = width > map_width ? width : map_width;
	plan.scratch_bytes = widest * 3 * sizeof(double);
	return plan;
}

void dvsm_patch_cut_rows(const struct dvsm_patch_plan *plan, const float *rgb, uint32_t first_row,
			 uint32_t count, float *patches, void *scratch)
{
	uint32_t q = plan->patch_px;
	uint32_t map_width = plan->grid.columns * q, map_height = plan->grid.rows * q;
	size_t row_floats = 3 * (size_t)plan->width;
	double *mixed = scratch;

	for (uint32_t y = first_row * q; y < (first_row + count) * q; y++) {
		struct span span = span_at(y, plan->height, map_height);
		for (uint32_t i = span.first; i <= span.last; i++)
			add_row(mixed, rgb + i * row_floats, row_floats, span_weight(&span, i),
				i == span.first);

		size_t token = (size_t)(y / q) * plan->grid.columns;
		for (uint32_t column = 0; column < plan->grid.columns; column++) {
			float *run = patches + ((token + column) * q + y % q) * q * 3;
			resample_row(mixed, plan->width, map_width, column * q, q, 2, -1, run);
		}
	}
}

void dvsm_patch_join_row(const struct dvsm_patch_plan *plan, const float *patches, uint32_t y,
			 float *rgb, void *scratch)
{
	uint32_t q = plan->patch_px;
	uint32_t map_width = plan->grid.columns * q, map_height = plan->grid.rows * q;
	size_t run_floats = 3 * (size_t)q;
	struct span span = span_at(y, map_height, plan->height);
	double *mixed = scratch;

	for (uint32_t i = span.first; i <= span.last; i++) {
		size_t token = (size_t)(i / q) * plan->grid.columns;
		for (uint32_t column = 0; column < plan->grid.columns; column++)
			add_row(mixed + column * run_floats,
				patches + ((token + column) * q + i % q) * run_floats, run_floats,
				span_weight(&span, i), i == span.first);
	}
	resample_row(mixed, map_width, plan->width, 0, plan->width, 1, 0, rgb);
}

void dvsm_patch_join_rows(const struct dvsm_patch_plan *plan, const float *patches,
			  uint32_t first_row, uint32_t count, float *rgb, void *scratch)
{
	for (uint32_t y = first_row; y < first_row + count; y++)
		dvsm_patch_join_row(plan, patches, y, rgb + (size_t)y * plan->width * 3, scratch);
}
