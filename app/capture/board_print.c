#include "capture/board_print.h"

#include <cairo-pdf.h>
#include <cairo.h>
#include <errno.h>
#include <math.h>
#include <png.h>
#include <setjmp.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "dio/atomic_file.h"

#define MM_PER_INCH     25.4
#define POINTS_PER_INCH 72.0
#define RULER_MM        100.0
#define LINE_MM         0.15
#define TEXT_MAX_MM     2.8 /* em size of the caption where there is room */
#define TEXT_MIN_MM     1.2

/* Ink goes down as one path filled once: separate rectangles would leave hairlines between
 * neighbours in viewers that smooth each edge on its own. */
static void draw_ink(cairo_t *cr, const struct dio_board_page *page)
{
	for (uint32_t i = 0; i < page->ink_count; i++)
		cairo_rectangle(cr, page->ink[i].x, page->ink[i].y, page->ink[i].width,
				page->ink[i].height);
	cairo_fill(cr);
}

/* A line of 100 mm (or the longest whole centimetre) with a tick each 10 mm. */
static double draw_ruler(cairo_t *cr, const struct dio_rect_mm *at)
{
	double length = fmin(RULER_MM, floor(at->width / 20) * 10);
	double foot = at->y + at->height - LINE_MM;

	cairo_set_line_width(cr, LINE_MM);
	for (int i = 0; i * 10 <= length; i++) {
		double x = at->x + LINE_MM + i * 10;
		double tick = fmin(at->height * 0.6, i % 5 == 0 ? 3.0 : 1.8);

		cairo_move_to(cr, x, foot);
		cairo_line_to(cr, x, foot - tick);
	}
	cairo_move_to(cr, at->x + LINE_MM / 2, foot);
	cairo_line_to(cr, at->x + LINE_MM * 1.5 + length, foot);
	cairo_stroke(cr);
	return length;
}

/* Text at the largest size that fits into `width`. */
static void draw_text(cairo_t *cr, const char *text, double x, double y, double width, double size)
{
	cairo_text_extents_t extents;

	cairo_set_font_size(cr, size);
	cairo_text_extents(cr, text, &extents);
	if (extents.x_advance > width)
		cairo_set_font_size(cr, size * width / extents.x_advance);
	cairo_move_to(cr, x, y);
	cairo_show_text(cr, text);
}

static void draw_caption(cairo_t *cr, const struct dio_board_page *page)
{
	const struct dio_rect_mm *at = &page->caption;
	double size = fmax(TEXT_MIN_MM, fmin(TEXT_MAX_MM, at->height * 0.4));
	double length = draw_ruler(cr, at);
	double foot = at->y + at->height - LINE_MM;
	char label[32];

	cairo_select_font_face(cr, "sans-serif", CAIRO_FONT_SLANT_NORMAL, CAIRO_FONT_WEIGHT_NORMAL);
	snprintf(label, sizeof label, "%.0f mm", length);
	draw_text(cr, label, at->x + length + 2, foot, 15, size);

	/* With room the text has a line of its own; on a tight page it stands beside the ruler. */
	if (at->height >= 2 * TEXT_MAX_MM + 1)
		draw_text(cr, page->text, at->x, at->y + TEXT_MAX_MM, at->width, TEXT_MAX_MM);
	else
		draw_text(cr, page->text, at->x + length + 16, foot, at->width - length - 16, size);
}

/* The page in millimetres; scale turns them into the surface's unit. */
static cairo_status_t draw_page(cairo_surface_t *surface, const struct dio_board_page *page,
				double scale)
{
	cairo_t *cr = cairo_create(surface);
	cairo_status_t status;

	cairo_scale(cr, scale, scale);
	cairo_set_source_rgba(cr, 0, 0, 0, 1);
	draw_ink(cr, page);
	draw_caption(cr, page);
	cairo_show_page(cr);
	status = cairo_status(cr);
	cairo_destroy(cr);
	return status;
}

/* A write failed and errno says why: give the file up. */
static enum dio_status give_up(struct dio_atomic_file *file, const char *path, int errno_value,
			       struct dio_error *error)
{
	dio_atomic_file_discard(file);
	return dio_fail(error, dio_status_from_errno(errno_value), "%s: cannot write: %s", path,
			strerror(errno_value));
}

/* Where cairo's bytes go; it keeps no errno. */
struct sink {
	FILE *stream;
	int errno_value;
};

static cairo_status_t write_to_stream(void *context, const unsigned char *data, unsigned int length)
{
	struct sink *sink = context;

	if (fwrite(data, 1, length, sink->stream) == length)
		return CAIRO_STATUS_SUCCESS;
	sink->errno_value = errno ? errno : EIO;
	return CAIRO_STATUS_WRITE_ERROR;
}

enum dio_status dio_board_print_pdf(const struct dio_board_page *page, const char *path,
				    struct dio_error *error)
{
	double scale = POINTS_PER_INCH / MM_PER_INCH;
	struct dio_atomic_file *file;
	struct sink sink = {0};
	cairo_surface_t *surface;
	cairo_status_t drawn;
	enum dio_status status = dio_atomic_file_open(path, &file, error);

	if (status != DIO_OK)
		return status;
	sink.stream = dio_atomic_file_stream(file);
	surface = cairo_pdf_surface_create_for_stream(
		write_to_stream, &sink, page->width_mm * scale, page->height_mm * scale);
	cairo_pdf_surface_set_metadata(surface, CAIRO_PDF_METADATA_TITLE, page->text);
	drawn = draw_page(surface, page, scale);
	cairo_surface_finish(surface);
	if (drawn == CAIRO_STATUS_SUCCESS)
		drawn = cairo_surface_status(surface);
	cairo_surface_destroy(surface);

	if (sink.errno_value)
		return give_up(file, path, sink.errno_value, error);
	if (drawn != CAIRO_STATUS_SUCCESS) {
		dio_atomic_file_discard(file);
		return dio_fail(error, DIO_NO_MEM, "%s: cannot draw the page: %s", path,
				cairo_status_to_string(drawn));
	}
	return dio_atomic_file_commit(file, error);
}

struct png_fault {
	jmp_buf back;
	char text[128];
	int errno_value; /* of a write; libpng itself keeps none */
};

static void on_png_error(png_structp png, png_const_charp message)
{
	struct png_fault *fault = png_get_error_ptr(png);

	fault->errno_value = errno;
	snprintf(fault->text, sizeof fault->text, "%s", message);
	longjmp(fault->back, 1);
}

static void on_png_warning(png_structp png, png_const_charp message)
{
	(void)png;
	(void)message;
}

/* The surface holds ink as alpha: one byte a pixel, 255 is black. */
static void write_png(png_structp png, png_infop info, FILE *stream, cairo_surface_t *surface,
		      uint32_t dpi)
{
	const unsigned char *ink = cairo_image_surface_get_data(surface);
	int pitch = cairo_image_surface_get_stride(surface);
	int height = cairo_image_surface_get_height(surface);
	png_uint_32 per_metre = (png_uint_32)lround(dpi / MM_PER_INCH * 1000);

	png_init_io(png, stream);
	png_set_IHDR(png, info, (png_uint_32)cairo_image_surface_get_width(surface),
		     (png_uint_32)height, 8, PNG_COLOR_TYPE_GRAY, PNG_INTERLACE_NONE,
		     PNG_COMPRESSION_TYPE_DEFAULT, PNG_FILTER_TYPE_DEFAULT);
	png_set_pHYs(png, info, per_metre, per_metre, PNG_RESOLUTION_METER);
	png_write_info(png, info);
	png_set_invert_mono(png);
	for (int y = 0; y < height; y++)
		png_write_row(png, ink + (ptrdiff_t)y * pitch);
	png_write_end(png, info);
}

static enum dio_status save_png(cairo_surface_t *surface, uint32_t dpi, const char *path,
				struct dio_error *error)
{
	struct png_fault fault = {.text = "no memory"};
	struct dio_atomic_file *file;
	png_infop info;
	png_structp png;
	enum dio_status status = dio_atomic_file_open(path, &file, error);

	if (status != DIO_OK)
		return status;
	png = png_create_write_struct(PNG_LIBPNG_VER_STRING, &fault, on_png_error, on_png_warning);
	info = png ? png_create_info_struct(png) : NULL;
	if (!info || setjmp(fault.back)) {
		png_destroy_write_struct(&png, &info);
		if (ferror(dio_atomic_file_stream(file)) && fault.errno_value)
			return give_up(file, path, fault.errno_value, error);
		dio_atomic_file_discard(file);
		return dio_fail(error, DIO_IO, "%s: cannot write PNG: %s", path, fault.text);
	}
	write_png(png, info, dio_atomic_file_stream(file), surface, dpi);
	png_destroy_write_struct(&png, &info);
	return dio_atomic_file_commit(file, error);
}

enum dio_status dio_board_print_png(const struct dio_board_page *page, uint32_t dpi,
				    const char *path, struct dio_error *error)
{
	double scale = dpi / MM_PER_INCH;
	cairo_surface_t *surface;
	cairo_status_t drawn;
	enum dio_status status;

	if (dpi < DIO_PRINT_DPI_MIN || dpi > DIO_PRINT_DPI_MAX)
		return dio_fail(error, DIO_BAD_ARG, "%u dots per inch: %u to %u are taken", dpi,
				DIO_PRINT_DPI_MIN, DIO_PRINT_DPI_MAX);
	surface = cairo_image_surface_create(CAIRO_FORMAT_A8, (int)lround(page->width_mm * scale),
					     (int)lround(page->height_mm * scale));
	drawn = draw_page(surface, page, scale);
	cairo_surface_flush(surface);
	if (drawn == CAIRO_STATUS_SUCCESS)
		status = save_png(surface, dpi, path, error);
	else
		status = dio_fail(error, DIO_NO_MEM, "%s: cannot draw the page at %u dpi: %s", path,
				  dpi, cairo_status_to_string(drawn));
	cairo_surface_destroy(surface);
	return status;
}
