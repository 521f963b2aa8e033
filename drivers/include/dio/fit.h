/* A picture into a frame buffer: as large as fits, proportions kept, black around. */
#ifndef DIO_FIT_H
#define DIO_FIT_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "dio/frame.h"

#ifdef __cplusplus
extern "C" {
#endif

/** Where a picture lies in an area. */
struct dio_fit_rect {
	uint32_t x, y, width, height;
};

/** The largest rectangle of the picture's proportions, at least a pixel, in the middle. */
struct dio_fit_rect dio_fit_rect(uint32_t width, uint32_t height, uint32_t area_width,
				 uint32_t area_height);

/** Order of the bytes of a pixel. */
enum dio_fit_order {
	DIO_FIT_RGB,  /* red, green, blue */
	DIO_FIT_BGRX, /* blue, green, red, 0: XRGB8888 of DRM */
};

/** What drawing into one area needs; made once, thread-bound. */
struct dio_fit {
	uint32_t width, height; /* of the area, at most 16384 */
	enum dio_fit_order order;
	bool smooth;         /* bilinear; otherwise the nearest pixel */
	uint32_t *positions; /* [width] of a column in the picture, in 256ths of a pixel */
	uint8_t *rows[2];    /* [width] pixels: rows of the picture, stretched */
	uint32_t row_of[2];  /* which ones */
};

/** DIO_NO_MEM. Release with dio_fit_deinit(). */
enum dio_status dio_fit_init(struct dio_fit *fit, uint32_t width, uint32_t height,
			     enum dio_fit_order order, bool smooth);
void dio_fit_deinit(struct dio_fit *fit);

/**
 * Draw the whole area. Each byte is written once and none is read back, as suits memory that is
 * slow to read. A picture of the area's own size is copied exactly.
 */
void dio_fit_draw(struct dio_fit *fit, const struct dio_picture *picture, uint8_t *pixels,
		  size_t pitch_bytes);

#ifdef __cplusplus
}
#endif
#endif
