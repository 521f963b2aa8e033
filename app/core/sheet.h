/* A contact sheet: rows of captioned pictures, each row under a title. */
#ifndef DIO_APP_SHEET_H
#define DIO_APP_SHEET_H

#include <stdint.h>

#include "dio/frame.h"
#include "dio/status.h"

struct dio_sheet_row {
	const char *title;                   /* ASCII, "" for none */
	const struct dio_picture **pictures; /* [count], NULL entries stay empty */
	const char **captions;               /* [count] ASCII, or NULL for none */
	uint32_t count;
};

/**
 * Draw the sheet. Pictures are fitted into cells of cell_px x cell_px, aspect kept; a row is as
 * high as its highest picture.
 *
 * sheet   zero-initialised; release with dio_picture_deinit()
 */
enum dio_status dio_sheet_draw(const struct dio_sheet_row *rows, uint32_t row_count,
			       uint32_t cell_px, struct dio_picture *sheet,
			       struct dio_error *error);

/** Draw ASCII text in a 5x7 font, `scale` pixels a dot, clipped; its top-left corner at (x, y). */
void dio_text_draw(struct dio_picture *picture, int32_t x, int32_t y, uint32_t scale,
		   const uint8_t rgb[3], const char *text);
/** Width in pixels that dio_text_draw() takes. */
uint32_t dio_text_width(const char *text, uint32_t scale);

#endif
