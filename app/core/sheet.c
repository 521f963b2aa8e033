#include "core/sheet.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#define GAP_PX        8
#define TITLE_SCALE   2
#define CAPTION_SCALE 1
#define LINE_DOTS     9 /* 7 of a letter and 2 between lines */
#define CELL_MIN_PX   16
#define CELL_MAX_PX   4096

static const uint8_t PAPER[3] = {24, 24, 26}, INK[3] = {235, 235, 235}, FAINT[3] = {170, 170, 175};

/* A picture's size in its cell: the longer side takes all of it. */
static void fit(const struct dio_picture *picture, uint32_t cell_px, uint32_t *width,
		uint32_t *height)
{
	double scale = cell_px / fmax(picture->width, picture->height);

	*width = (uint32_t)fmax(1, floor(picture->width * scale + 0.5));
	*height = (uint32_t)fmax(1, floor(picture->height * scale + 0.5));
}

static uint32_t cell_height(const struct dio_sheet_row *row, uint32_t cell_px)
{
	uint32_t highest = 0, width, height;

	for (uint32_t i = 0; i < row->count; i++) {
		if (!row->pictures[i] || !row->pictures[i]->rgb)
			continue;
		fit(row->pictures[i], cell_px, &width, &height);
		highest = height > highest ? height : highest;
	}
	return highest ? highest : cell_px;
}

static uint32_t row_height(const struct dio_sheet_row *row, uint32_t cell_px)
{
	return GAP_PX + (*row->title ? TITLE_SCALE * LINE_DOTS : 0) + cell_height(row, cell_px) +
	       (row->captions ? CAPTION_SCALE * LINE_DOTS : 0);
}

static void fill(struct dio_picture *picture, const uint8_t rgb[3])
{
	size_t pixels = (size_t)picture->width * picture->height;

	for (size_t i = 0; i < pixels; i++)
		memcpy(picture->rgb + 3 * i, rgb, 3);
}

/* Mean of the source pixels under a destination pixel, with their shares: exact when shrinking. */
static void sample(const struct dio_picture *from, double x0, double x1, double y0, double y1,
		   uint8_t out[3])
{
	double sum[3] = {0}, area = 0;
	uint32_t last_x = (uint32_t)fmin(ceil(x1), from->width);
	uint32_t last_y = (uint32_t)fmin(ceil(y1), from->height);

	for (uint32_t y = (uint32_t)y0; y < last_y; y++) {
		double share_y = fmin(y1, y + 1.0) - fmax(y0, y);

		for (uint32_t x = (uint32_t)x0; x < last_x; x++) {
			double share = share_y * (fmin(x1, x + 1.0) - fmax(x0, x));
			const uint8_t *rgb = from->rgb + 3 * ((size_t)y * from->width + x);

			area += share;
			for (int c = 0; c < 3; c++)
				sum[c] += share * rgb[c];
		}
	}
	for (int c = 0; c < 3; c++)
		out[c] = area > 0 ? (uint8_t)lround(sum[c] / area) : 0;
}

/* Draw a picture in the middle of the cell whose corner is (left, top). */
static void place_picture(struct dio_picture *sheet, const struct dio_picture *from, uint32_t left,
			  uint32_t top, uint32_t cell_px, uint32_t cell_high)
{
	double step = fmax(from->width, from->height) / (double)cell_px;
	uint32_t width, height;

	fit(from, cell_px, &width, &height);
	left += (cell_px - width) / 2;
	top += (cell_high - height) / 2;
	for (uint32_t y = 0; y < height; y++)
		for (uint32_t x = 0; x < width; x++)
			sample(from, x * step, (x + 1) * step, y * step, (y + 1) * step,
			       sheet->rgb + 3 * ((size_t)(top + y) * sheet->width + left + x));
}

static void draw_row(struct dio_picture *sheet, const struct dio_sheet_row *row, uint32_t top,
		     uint32_t cell_px)
{
	uint32_t y = top + GAP_PX, cell_high = cell_height(row, cell_px);

	if (*row->title) {
		dio_text_draw(sheet, GAP_PX, (int32_t)y, TITLE_SCALE, INK, row->title);
		y += TITLE_SCALE * LINE_DOTS;
	}
	for (uint32_t i = 0; i < row->count; i++) {
		uint32_t x = GAP_PX + i * (cell_px + GAP_PX);

		if (row->pictures[i] && row->pictures[i]->rgb)
			place_picture(sheet, row->pictures[i], x, y, cell_px, cell_high);
		if (row->captions && row->captions[i])
			dio_text_draw(sheet, (int32_t)x, (int32_t)(y + cell_high + 2),
				      CAPTION_SCALE, FAINT, row->captions[i]);
	}
}

enum dio_status dio_sheet_draw(const struct dio_sheet_row *rows, uint32_t row_count,
			       uint32_t cell_px, struct dio_picture *sheet, struct dio_error *error)
{
	uint64_t width = 0, height = GAP_PX;
	uint32_t columns = 0, top = 0;
	enum dio_status status;

	if (cell_px < CELL_MIN_PX || cell_px > CELL_MAX_PX)
		return dio_fail(error, DIO_BAD_ARG, "contact sheet: cells of %u pixels", cell_px);
	for (uint32_t i = 0; i < row_count; i++) {
		columns = rows[i].count > columns ? rows[i].count : columns;
		height += row_height(&rows[i], cell_px);
	}
	width = GAP_PX + (uint64_t)columns * (cell_px + GAP_PX);
	status = width > UINT32_MAX || height > UINT32_MAX
			 ? DIO_BAD_ARG
			 : dio_picture_init(sheet, (uint32_t)width, (uint32_t)height);
	if (status != DIO_OK)
		return dio_fail(error, status, "contact sheet: %s: %llu x %llu pixels",
				dio_status_text(status), (unsigned long long)width,
				(unsigned long long)height);
	fill(sheet, PAPER);
	for (uint32_t i = 0; i < row_count; i++) {
		draw_row(sheet, &rows[i], top, cell_px);
		top += row_height(&rows[i], cell_px);
	}
	return DIO_OK;
}
