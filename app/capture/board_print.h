/* Printing a calibration board at its true size: PDF (vector) or PNG (with its dots per inch). */
#ifndef DIO_CAPTURE_BOARD_PRINT_H
#define DIO_CAPTURE_BOARD_PRINT_H

#include <stdint.h>

#include "capture/board_page.h"
#include "dio/status.h"

/** Resolutions taken for PNG. */
#define DIO_PRINT_DPI_MIN 50u
#define DIO_PRINT_DPI_MAX 1200u

/** Draw the page as a PDF of the paper's size; every edge is a vector at its exact place. */
enum dio_status dio_board_print_pdf(const struct dio_board_page *page, const char *path,
				    struct dio_error *error);

/** Draw the page as a grey PNG of the paper's size that states its resolution (pHYs). */
enum dio_status dio_board_print_png(const struct dio_board_page *page, uint32_t dpi,
				    const char *path, struct dio_error *error);

#endif
