#include "viewd/screen.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "core/sheet.h"

#define LETTER_HIGH 7
#define LINE_HIGH   10 /* dots from one line to the next */
#define LETTER_WIDE 6

static const uint8_t WHITE[3] = {240, 240, 240}, ALARM[3] = {255, 120, 90}, BAR[3] = {90, 190, 255},
		     SEEN[3] = {40, 200, 90}, CORNER[3] = {255, 210, 0};

/* Lay a colour over a box, `share` of 256; clipped. */
static void tint(struct dio_picture *canvas, struct dio_fit_rect box, const uint8_t rgb[3],
		 uint32_t share)
{
	uint32_t right = box.x + box.width, foot = box.y + box.height;

	right = right < canvas->width ? right : canvas->width;
	foot = foot < canvas->height ? foot : canvas->height;
	for (uint32_t y = box.y; y < foot; y++)
		for (uint32_t x = box.x; x < right; x++) {
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
	struct dio_fit_rect box = {left > scale ? left - scale : 0, top > scale ? top - scale : 0,
				   dio_text_width(text, scale) + scale, (LETTER_HIGH + 2) * scale};

	if (!*text)
		return;
	tint(canvas, box, GROUND, 150);
	dio_text_draw(canvas, (int32_t)left, (int32_t)top, scale, rgb, text);
}

static void draw_cells(struct dio_picture *canvas, const struct dio_fit_rect *box,
		       const struct dio_overlay *overlay)
{
	for (uint32_t row = 0; row < DIO_BOARD_CELLS; row++)
		for (uint32_t column = 0; column < DIO_BOARD_CELLS; column++) {
			uint32_t left = box->x + box->width * column / DIO_BOARD_CELLS;
			uint32_t top = box->y + box->height * row / DIO_BOARD_CELLS;
			struct dio_fit_rect cell = {
				left + 1, top + 1,
				box->x + box->width * (column + 1) / DIO_BOARD_CELLS - left - 1,
				box->y + box->height * (row + 1) / DIO_BOARD_CELLS - top - 1};

			if (overlay->cells[row * DIO_BOARD_CELLS + column])
				tint(canvas, cell, SEEN, 60);
		}
}

static void draw_corners(struct dio_picture *canvas, const struct dio_fit_rect *box,
			 const struct dio_overlay *overlay, uint32_t scale)
{
	for (uint32_t i = 0; i < overlay->corner_count; i++) {
		double x = box->x + (double)overlay->corners[i][0] * box->width;
		double y = box->y + (double)overlay->corners[i][1] * box->height;

		if (x >= scale && y >= scale)
			tint(canvas,
			     (struct dio_fit_rect){(uint32_t)x - scale, (uint32_t)y - scale,
						   2 * scale + 1, 2 * scale + 1},
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
		struct dio_fit_rect track = {margin, top - line, width, 6 * scale}, done = track;

		done.width = (uint32_t)(width * fmin(overlay->progress, 1));
		tint(canvas, track, WHITE, 60);
		tint(canvas, done, BAR, 220);
	}
}

static void draw_overlay(struct dio_picture *canvas, const struct dio_fit_rect *box,
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

/* Canvas and scaler for a display of this size. */
static enum dio_status prepare(struct dio_screen *screen, uint32_t width, uint32_t height,
			       bool smooth)
{
	enum dio_status status;

	if (screen->canvas.rgb && screen->canvas.width == width &&
	    screen->canvas.height == height && screen->fit.smooth == smooth)
		return DIO_OK;
	dio_screen_deinit(screen);
	status = dio_picture_init(&screen->canvas, width, height);
	if (status == DIO_OK)
		status = dio_fit_init(&screen->fit, width, height, DIO_FIT_RGB, smooth);
	if (status != DIO_OK)
		dio_screen_deinit(screen);
	return status;
}

enum dio_status dio_screen_compose(struct dio_screen *screen, const struct dio_picture *picture,
				   uint32_t width, uint32_t height, bool smooth,
				   const struct dio_overlay *overlay, struct dio_error *error)
{
	struct dio_fit_rect box = {0, 0, width, height};
	enum dio_status status = prepare(screen, width, height, smooth);

	if (status != DIO_OK)
		return dio_fail(error, status, "no memory for a %ux%u display", width, height);
	if (picture && picture->rgb) {
		box = dio_fit_rect(picture->width, picture->height, width, height);
		dio_fit_draw(&screen->fit, picture, screen->canvas.rgb, (size_t)3 * width);
	} else {
		memset(screen->canvas.rgb, 0, (size_t)3 * width * height);
	}
	if (overlay)
		draw_overlay(&screen->canvas, &box, overlay);
	return DIO_OK;
}

void dio_screen_deinit(struct dio_screen *screen)
{
	dio_picture_deinit(&screen->canvas);
	dio_fit_deinit(&screen->fit);
}
