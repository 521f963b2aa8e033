#include "dio/fit.h"

#include <stdlib.h>
#include <string.h>

#define NO_ROW UINT32_MAX

struct dio_fit_rect dio_fit_rect(uint32_t width, uint32_t height, uint32_t area_width,
				 uint32_t area_height)
{
	struct dio_fit_rect rect = {.width = area_width, .height = area_height};

	if ((uint64_t)width * area_height > (uint64_t)height * area_width)
		rect.height = (uint32_t)(((uint64_t)height * area_width + width / 2) / width);
	else
		rect.width = (uint32_t)(((uint64_t)width * area_height + height / 2) / height);
	rect.width += rect.width == 0;
	rect.height += rect.height == 0;
	rect.x = (area_width - rect.width) / 2;
	rect.y = (area_height - rect.height) / 2;
	return rect;
}

static size_t get_pixel_bytes(const struct dio_fit *fit)
{
	return fit->order == DIO_FIT_RGB ? 3 : 4;
}

enum dio_status dio_fit_init(struct dio_fit *fit, uint32_t width, uint32_t height,
			     enum dio_fit_order order, bool smooth)
{
	struct dio_fit made = {.width = width, .height = height, .order = order, .smooth = smooth};

	made.positions = calloc(width, sizeof(*made.positions));
	for (int i = 0; i < 2; i++)
		made.rows[i] = calloc(width, get_pixel_bytes(&made));
	if (!made.positions || !made.rows[0] || !made.rows[1]) {
		dio_fit_deinit(&made);
		return DIO_NO_MEM;
	}
	*fit = made;
	return DIO_OK;
}

void dio_fit_deinit(struct dio_fit *fit)
{
	free(fit->positions);
	free(fit->rows[0]);
	free(fit->rows[1]);
	*fit = (struct dio_fit){0};
}

/* Where the middle of cell `at` of `to` cells lies among `from` cells, in 256ths, from the middle
 * of the first. */
static uint32_t get_position(const struct dio_fit *fit, uint32_t at, uint32_t from, uint32_t to)
{
	uint64_t position = (2 * (uint64_t)at + 1) * from * 256 / (2 * (uint64_t)to);
	const uint64_t last = (uint64_t)(from - 1) * 256;

	if (!fit->smooth)
		return (uint32_t)(position / 256 * 256);
	position = position < 128 ? 0 : position - 128;
	return (uint32_t)(position < last ? position : last);
}

/* a where share is 0, b where it would be 256. */
static inline uint8_t blend(uint8_t a, uint8_t b, uint32_t share)
{
	return (uint8_t)((a * (256 - share) + b * share + 128) >> 8);
}

/* One row of the picture as wide as it is. */
static void swap_row(const uint8_t *rgb, uint32_t width, uint8_t *out)
{
	for (uint32_t x = 0; x < width; x++, rgb += 3, out += 4) {
		out[0] = rgb[2];
		out[1] = rgb[1];
		out[2] = rgb[0];
	}
}

/* One row of the picture at the rectangle's width. */
static void stretch_row(const struct dio_fit *fit, const uint8_t *rgb, uint32_t width, uint8_t *out)
{
	const size_t step = get_pixel_bytes(fit);
	const unsigned red = fit->order == DIO_FIT_RGB ? 0 : 2;

	for (uint32_t x = 0; x < width; x++, out += step) {
		const uint32_t at = fit->positions[x] >> 8, share = fit->positions[x] & 255;
		const uint8_t *left = rgb + (size_t)3 * at;
		/* The last pixel has no share of one to the right. */
		const uint8_t *right = share ? left + 3 : left;

		out[red] = blend(left[0], right[0], share);
		out[1] = blend(left[1], right[1], share);
		out[2 - red] = blend(left[2], right[2], share);
	}
}

/* The stretched row, made or found; `keep` is the other one in use. */
static const uint8_t *get_row(struct dio_fit *fit, const struct dio_picture *picture, uint32_t row,
			      uint32_t width, uint32_t keep)
{
	const uint8_t *rgb = picture->rgb + (size_t)3 * picture->width * row;
	const bool stretched = width != picture->width;
	int slot;

	if (!stretched && fit->order == DIO_FIT_RGB)
		return rgb;
	for (slot = 0; slot < 2; slot++)
		if (fit->row_of[slot] == row)
			return fit->rows[slot];
	slot = fit->row_of[0] == keep ? 1 : 0;
	if (stretched)
		stretch_row(fit, rgb, width, fit->rows[slot]);
	else
		swap_row(rgb, width, fit->rows[slot]);
	fit->row_of[slot] = row;
	return fit->rows[slot];
}

static void draw_row(struct dio_fit *fit, const struct dio_picture *picture, uint32_t position,
		     const struct dio_fit_rect *rect, uint8_t *out)
{
	const uint32_t row = position >> 8, share = position & 255;
	const size_t step = get_pixel_bytes(fit), bytes = step * rect->width;
	const uint8_t *upper = get_row(fit, picture, row, rect->width, NO_ROW);
	const uint8_t *lower = share ? get_row(fit, picture, row + 1, rect->width, row) : upper;

	memset(out, 0, step * rect->x);
	out += step * rect->x;
	if (share == 0)
		memcpy(out, upper, bytes);
	else
		for (size_t i = 0; i < bytes; i++)
			out[i] = blend(upper[i], lower[i], share);
	memset(out + bytes, 0, step * (fit->width - rect->x - rect->width));
}

void dio_fit_draw(struct dio_fit *fit, const struct dio_picture *picture, uint8_t *pixels,
		  size_t pitch_bytes)
{
	const struct dio_fit_rect rect =
		dio_fit_rect(picture->width, picture->height, fit->width, fit->height);

	for (uint32_t x = 0; x < rect.width; x++)
		fit->positions[x] = get_position(fit, x, picture->width, rect.width);
	fit->row_of[0] = fit->row_of[1] = NO_ROW;
	for (uint32_t y = 0; y < fit->height; y++) {
		uint8_t *out = pixels + pitch_bytes * y;

		if (y < rect.y || y >= rect.y + rect.height)
			memset(out, 0, get_pixel_bytes(fit) * fit->width);
		else
			draw_row(fit, picture,
				 get_position(fit, y - rect.y, picture->height, rect.height), &rect,
				 out);
	}
}
