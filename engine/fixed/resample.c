#include "fixed/resample.h"

#include "kernels/fixed_math.h"

/* 2^16 (sigmoid(i / 8) - 1/2): knots of the piecewise linear function nearest in the mean square.
 */
static const uint16_t SIGMOID[129] = {
	0,     2047,  4077,  6077,  8030,  9925,  11749, 13494, 15150, 16714, 18181, 19550, 20821,
	21994, 23073, 24061, 24963, 25782, 26525, 27196, 27802, 28346, 28834, 29272, 29663, 30013,
	30325, 30602, 30849, 31069, 31264, 31437, 31591, 31727, 31847, 31954, 32049, 32133, 32207,
	32272, 32330, 32381, 32426, 32466, 32502, 32533, 32560, 32585, 32606, 32625, 32642, 32657,
	32670, 32681, 32691, 32700, 32708, 32715, 32722, 32727, 32732, 32736, 32740, 32743, 32746,
	32749, 32751, 32753, 32755, 32756, 32758, 32759, 32760, 32761, 32762, 32762, 32763, 32764,
	32764, 32765, 32765, 32765, 32766, 32766, 32766, 32766, 32767, 32767, 32767, 32767, 32767,
	32767, 32767, 32767, 32767, 32768, 32768, 32768, 32768, 32768, 32768, 32768, 32768, 32768,
	32768, 32768, 32768, 32768, 32768, 32768, 32768, 32768, 32768, 32768, 32768, 32768, 32768,
	32768, 32768, 32768, 32768, 32768, 32768, 32768, 32768, 32768, 32768, 32768, 32768,
};

int32_t dvsm_fixed_sigmoid(int32_t y)
{
	uint32_t size = y < 0 ? 0u - (uint32_t)y : (uint32_t)y;
	uint32_t at = size >> 13, rest = size & 8191; /* eighths of a unit */
	int32_t half;

	if (at >= 128)
		half = 1 << 15;
	else
		half = (int32_t)(SIGMOID[at] +
				 ((SIGMOID[at + 1] - SIGMOID[at]) * rest + 4096) / 8192);
	return (1 << 15) + (y < 0 ? -half : half);
}

/*
 * The source samples one target sample is made of, as geometry/resample.c has them, with weights
 * in units of 1 / whole.
 */
struct span {
	uint32_t first, last;
	int64_t first_weight, inner_weight, last_weight, whole;
};

static struct span box_span(uint64_t at, uint64_t source, uint64_t target)
{
	uint64_t begin = at * source, end = begin + source;
	struct span span = {
		.first = (uint32_t)(begin / target),
		.last = (uint32_t)((end - 1) / target),
		.inner_weight = (int64_t)target,
		.whole = (int64_t)source,
	};
	uint64_t first_end = ((uint64_t)span.first + 1) * target;

	span.first_weight = (int64_t)((first_end < end ? first_end : end) - begin);
	span.last_weight = (int64_t)(end - (uint64_t)span.last * target);
	return span;
}

static struct span bilinear_span(uint64_t at, uint64_t source, uint64_t target)
{
	uint64_t shifted = (2 * at + 1) * source;
	uint64_t position = shifted > target ? shifted - target : 0;
	struct span span = {
		.first = (uint32_t)(position / (2 * target)),
		.last_weight = (int64_t)(position % (2 * target)),
		.whole = (int64_t)(2 * target),
	};

	span.first_weight = span.whole - span.last_weight;
	span.last = span.first + 1;
	if (span.last >= source) {
		span.last = span.first;
		span.first_weight = span.whole;
	}
	return span;
}

static struct span span_at(uint32_t at, uint32_t source, uint32_t target)
{
	if (source > target)
		return box_span(at, source, target);
	if (source < target)
		return bilinear_span(at, source, target);
	return (struct span){.first = at, .last = at, .first_weight = 1, .whole = 1};
}

static int64_t weight_of(const struct span *span, uint32_t i)
{
	if (i == span->first)
		return span->first_weight;
	return i == span->last ? span->last_weight : span->inner_weight;
}

/* One row of the map, mixed of those that picture row y covers. */
static void mix_rows(const struct dvsm_patch_plan *plan, const int32_t *patches,
		     const struct span *span, int64_t *mixed)
{
	const uint32_t q = plan->patch_px;
	const size_t run = 3 * (size_t)q;

	for (uint32_t i = span->first; i <= span->last; i++) {
		size_t token = (size_t)(i / q) * plan->grid.columns;
		int64_t weight = weight_of(span, i);

		for (uint32_t column = 0; column < plan->grid.columns; column++) {
			const int32_t *from = patches + ((token + column) * q + i % q) * run;
			int64_t *to = mixed + column * run;

			for (size_t n = 0; n < run; n++)
				to[n] = (i == span->first ? 0 : to[n]) + weight * from[n];
		}
	}
}

/* Colours are at most this in size. */
#define MOST ((int64_t)1 << 24)

/* What the numbers of a row are divided by; a shift or a product stands for each division. */
struct divisor {
	int64_t whole;    /* at most 2^36: memory holds no larger map */
	uint64_t inverse; /* 2^62 / (2 whole), rounded down */
	int shift;        /* whole = 2^shift, or -1 */
};

static struct divisor divisor_of(int64_t whole)
{
	struct divisor by = {whole, ((uint64_t)1 << 61) / (uint64_t)whole, -1};

	for (int shift = 0; by.shift < 0 && shift <= 36; shift++)
		if (whole == (int64_t)1 << shift)
			by.shift = shift;
	return by;
}

/*
 * number / whole, halves up. MOST wholes more and nothing is negative, nor beyond 2^62: the product
 * is less than 1 too small, its floor the quotient or one less.
 */
static int32_t divide(int64_t number, const struct divisor *by)
{
	if (by->shift >= 0)
		return (int32_t)dvsm_fixed_round(number, by->shift);

	const uint64_t whole = 2 * (uint64_t)by->whole;
	const uint64_t twice = (uint64_t)(2 * (number + MOST * by->whole) + by->whole);
	uint64_t quotient = (uint64_t)((unsigned __int128)twice * by->inverse >> 62);

	if (twice - quotient * whole >= whole)
		quotient++;
	return (int32_t)((int64_t)quotient - MOST);
}

/* A row as wide as the map. */
static void copy_columns(const int64_t *mixed, uint32_t width, int64_t whole, int32_t *out)
{
	const struct divisor by = divisor_of(whole);

	for (size_t i = 0; i < 3 * (size_t)width; i++)
		out[i] = divide(mixed[i], &by);
}

/* A wider one: bilinear_span() of each pixel, counted on from the last. */
static void grow_columns(const int64_t *mixed, uint32_t source, uint32_t width, int64_t whole,
			 int32_t *out)
{
	const int64_t step = 2 * (int64_t)width;
	const int64_t *last = mixed + 3 * ((size_t)source - 1);
	const struct divisor by = divisor_of(whole * step);
	int64_t rest = (int64_t)source - width;

	for (uint32_t x = 0; x < width; x++, rest += 2 * (int64_t)source, out += 3) {
		if (rest >= step) {
			rest -= step;
			mixed += 3;
		}
		const int64_t weight = rest > 0 ? rest : 0;
		const int64_t *next = mixed < last ? mixed + 3 : mixed;

		for (int c = 0; c < 3; c++)
			out[c] = divide((step - weight) * mixed[c] + weight * next[c], &by);
	}
}

/* A narrower one. */
static void shrink_columns(const int64_t *mixed, uint32_t source, uint32_t width, int64_t whole,
			   int32_t *out)
{
	const struct divisor by = divisor_of(whole * source);

	for (uint32_t x = 0; x < width; x++, out += 3) {
		struct span columns = box_span(x, source, width);
		int64_t rgb[3] = {0};

		for (uint32_t i = columns.first; i <= columns.last; i++) {
			int64_t weight = weight_of(&columns, i);

			for (size_t c = 0; c < 3; c++)
				rgb[c] += weight * mixed[3 * (size_t)i + c];
		}
		for (int c = 0; c < 3; c++)
			out[c] = divide(rgb[c], &by);
	}
}

static size_t map_numbers(const struct dvsm_patch_plan *plan)
{
	return 3 * (size_t)plan->grid.columns * plan->patch_px;
}

const int32_t *dvsm_fixed_join_row(const struct dvsm_patch_plan *plan, const int32_t *patches,
				   uint32_t y, void *scratch)
{
	const uint32_t map_width = plan->grid.columns * plan->patch_px;
	struct span rows = span_at(y, plan->grid.rows * plan->patch_px, plan->height);
	int64_t *mixed = scratch;
	int32_t *out = (int32_t *)(void *)(mixed + map_numbers(plan));

	mix_rows(plan, patches, &rows, mixed);
	if (plan->width == map_width)
		copy_columns(mixed, map_width, rows.whole, out);
	else if (plan->width > map_width)
		grow_columns(mixed, map_width, plan->width, rows.whole, out);
	else
		shrink_columns(mixed, map_width, plan->width, rows.whole, out);
	return out;
}
