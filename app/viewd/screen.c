#include "viewd/screen.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "core/sheet.h"

#define LETTER_HIGH 7
#define LINE_HIGH   10 /* dots from one line to the next */
#define LETTER_WIDE 6
#define FRACTION    256

static const uint8_t WHITE[3] = {240, 240, 240}, ALARM[3] = {255, 120, 90}, BAR[3] = {90, 190, 255},
		     SEEN[3] = {40, 200, 90}, CORNER[3] = {255, 210, 0};

/* A box in pixels. */
struct box {
	uint32_t left, top, width, height;
};

/* The largest box of the picture's shape inside width x height. */
static struct box fit(const struct dio_picture *picture, uint32_t width, uint32_t height)
{
	double scale = fmin((double)width / picture->width, (double)height / picture->height);
	struct box box = {.width = (uint32_t)fmax(1, lround(picture->width * scale)),
			  .height = (uint32_t)fmax(1, lround(picture->height * scale))};

	box.width = box.width < width ? box.width : width;
	box.height = box.height < height ? box.height : height;
	box.left = (width - box.width) / 2;
	box.top = (height - box.height) / 2;
	return box;
}

/* Where a row or column of the box lies in the picture: the pixel before it, and how far past its
 * centre, of FRACTION. */
struct tap {
	uint32_t first, second;
	uint32_t past;
};

static struct tap find_tap(uint32_t at, uint32_t box_size, uint32_t size, bool smooth)
{
	double place = (at + 0.5) * size / box_size - 0.5;
	struct tap tap;

	if (!smooth) {
		tap.first = (uint32_t)((at + 0.5) * size / box_size);
		tap.first = tap.first < size ? tap.first : size - 1;
		return (struct tap){tap.first, tap.first, 0};
	}
	place = fmax(0, fmin(place, size - 1.0));
	tap.first = (uint32_t)place;
	tap.second = tap.first + 1 < size ? tap.first + 1 : tap.first;
	tap.past = (uint32_t)((place - tap.first) * FRACTION);
	return tap;
}

static void scale_row(const struct dio_picture *picture, const struct tap *row,
		      const struct tap *columns, uint32_t count, uint8_t *out)
{
	const uint8_t *above = picture->rgb + 3 * (size_t)row->first * picture->width;
	const uint8_t *below = picture->rgb + 3 * (size_t)row->second * picture->width;

	for (uint32_t x = 0; x < count; x++, out += 3) {
		const struct tap *column = &columns[x];

		for (int c = 0; c < 3; c++) {
			uint32_t left = 3 * column->first + (uint32_t)c;
			uint32_t right = 3 * column->second + (uint32_t)c;
			uint32_t top = above[left] * (FRACTION - column->past) +
				       above[right] * column->past;
			uint32_t foot = below[left] * (FRACTION - column->past) +
					below[right] * column->past;

			out[c] = (uint8_t)((top * (FRACTION - row->past) + foot * row->past +
					    FRACTION * FRACTION / 2) /
					   (FRACTION * FRACTION));
		}
	}
}

static enum dio_status draw_picture(const struct dio_picture *picture, bool smooth,
				    const struct box *box, struct dio_picture *canvas,
				    struct dio_error *error)
{
	struct tap *columns = malloc(sizeof *columns * box->width);

	if (!columns)
		return dio_fail(error, DIO_NO_MEM, "no memory for a %ux%u display", canvas->width,
				canvas->height);
	for (uint32_t x = 0; x < box->width; x++)
		columns[x] = find_tap(x, box->width, picture->width, smooth);
	for (uint32_t y = 0; y < box->height; y++) {
		struct tap row = find_tap(y, box->height, picture->height, smooth);

		scale_row(picture, &row, columns, box->width,
			  canvas->rgb + 3 * ((size_t)(box->top + y) * canvas->width + box->left));
	}
	free(columns);
	return DIO_OK;
}

/* Lay a colour over a box, `share` of 256; clipped. */
static void tint(struct dio_picture *canvas, struct box box, const uint8_t rgb[3], uint32_t share)
{
	uint32_t right = box.left + box.width, foot = box.top + box.height;

	right = right < canvas->width ? right : canvas->width;
	foot = foot < canvas->height ? foot : canvas->height;
	for (uint32_t y = box.top; y < foot; y++)
		for (uint32_t x = box.left; x < right; x++) {
			uint8_t *at = canvas->rgb + 3 * ((size_t)y * canvas->width + x);

			for (int c = 0; c < 3; c++)
				at[c] = (uint8_t)((at[c] * (256 - share) + rgb[c] * share) / 256);
		}
}

/* Text on a dark ground, so that it reads over any picture. */
static void draw_text(struct dio_picture *canvas, uint32_t left, uint32_t top, uint32_t scale,
		      const uint8_t rgb[3], const char *text)
{
	static const uint8_t GROUND[3] = {0, 0, 0};
	struct box box = {left > scale ? left - scale : 0, top > scale ? top - scale : 0,
			  dio_text_width(text, scale) + scale, (LETTER_HIGH + 2) * scale};

	if (!*text)
		return;
	tint(canvas, box, GROUND, 150);
	dio_text_draw(canvas, (int32_t)left, (int32_t)top, scale, rgb, text);
}

static void draw_cells(struct dio_picture *canvas, const struct box *box,
		       const struct dio_overlay *overlay)
{
	for (uint32_t row = 0; row < DIO_BOARD_CELLS; row++)
		for (uint32_t column = 0; column < DIO_BOARD_CELLS; column++) {
			uint32_t left = box->left + box->width * column / DIO_BOARD_CELLS;
			uint32_t top = box->top + box->height * row / DIO_BOARD_CELLS;
			struct box cell = {
				left + 1, top + 1,
				box->left + box->width * (column + 1) / DIO_BOARD_CELLS - left - 1,
				box->top + box->height * (row + 1) / DIO_BOARD_CELLS - top - 1};

			if (overlay->cells[row * DIO_BOARD_CELLS + column])
				tint(canvas, cell, SEEN, 60);
		}
}

static void draw_corners(struct dio_picture *canvas, const struct box *box,
			 const struct dio_overlay *overlay, uint32_t scale)
{
	for (uint32_t i = 0; i < overlay->corner_count; i++) {
		double x = box->left + (double)overlay->corners[i][0] * box->width;
		double y = box->top + (double)overlay->corners[i][1] * box->height;

		if (x >= scale && y >= scale)
			tint(canvas,
			     (struct box){(uint32_t)x - scale, (uint32_t)y - scale, 2 * scale + 1,
					  2 * scale + 1},
			     CORNER, 256);
	}
}

static void draw_foot(struct dio_picture *canvas, const struct dio_overlay *overlay, uint32_t scale)
{
	uint32_t margin = 4 * scale, line = LINE_HIGH * scale;
	uint32_t top = canvas->height > margin + line ? canvas->height - margin - line : 0;

	draw_text(canvas, margin, top, scale, overlay->alarm ? ALARM : WHITE, overlay->message);
	if (overlay->progress >= 0 && top > line && canvas->width > 2 * margin) {
		uint32_t width = canvas->width - 2 * margin;
		struct box track = {margin, top - line, width, 6 * scale}, done = track;

		done.width = (uint32_t)(width * fmin(overlay->progress, 1));
		tint(canvas, track, WHITE, 60);
		tint(canvas, done, BAR, 220);
	}
}

static void draw_overlay(struct dio_picture *canvas, const struct box *box,
			 const struct dio_overlay *overlay)
{
	/* About 75 letters across, whatever the display has. */
	uint32_t scale = canvas->width / (75 * LETTER_WIDE), top, right;

	scale = scale > 0 ? scale : 1;
	top = 4 * scale;
	right = dio_text_width(overlay->figures, scale) + 4 * scale;
	if (overlay->show_cells)
		draw_cells(canvas, box, overlay);
	draw_corners(canvas, box, overlay, scale);
	draw_text(canvas, 4 * scale, top, 2 * scale, WHITE, overlay->state);
	if (canvas->width > right)
		draw_text(canvas, canvas->width - right, top, scale, WHITE, overlay->figures);
	top += 2 * LINE_HIGH * scale;
	for (int i = 0; i < 3; i++, top += LINE_HIGH * scale)
		draw_text(canvas, 4 * scale, top, scale, WHITE, overlay->lines[i]);
	draw_foot(canvas, overlay, scale);
}

enum dio_status dio_screen_compose(const struct dio_picture *picture, uint32_t width,
				   uint32_t height, bool smooth, const struct dio_overlay *overlay,
				   struct dio_picture *canvas, struct dio_error *error)
{
	struct box box = {0, 0, width, height};
	enum dio_status status = DIO_OK;

	if (canvas->width != width || canvas->height != height) {
		dio_picture_deinit(canvas);
		status = dio_picture_init(canvas, width, height);
		if (status != DIO_OK)
			return dio_fail(error, status, "no memory for a %ux%u display", width,
					height);
	}
	if (picture && picture->rgb)
		box = fit(picture, width, height);
	if (!picture || !picture->rgb || box.width < width || box.height < height)
		memset(canvas->rgb, 0, (size_t)width * height * 3);
	if (picture && picture->rgb)
		status = draw_picture(picture, smooth, &box, canvas, error);
	if (status == DIO_OK && overlay)
		draw_overlay(canvas, &box, overlay);
	return status;
}
