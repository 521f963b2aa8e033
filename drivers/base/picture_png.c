#include "picture_codec.h"

#include <png.h>
#include <setjmp.h>
#include <stdlib.h>
#include <string.h>
#include <zlib.h>

/* deflate cannot squeeze more than this many bytes into one. */
#define DEFLATE_RATIO_MAX 1032

struct reader {
	const uint8_t *bytes;
	size_t size, at;
	const char *name;
	struct dio_error *error;
	enum dio_status status;
	png_structp png;
	png_infop info;
	uint8_t *rgba; /* whole picture, only when it has alpha */
};

struct writer {
	struct dio_bytes out;
	const char *name;
	struct dio_error *error;
	enum dio_status status;
	png_structp png;
	png_infop info;
};

static void on_read_error(png_structp png, png_const_charp message)
{
	struct reader *reader = png_get_error_ptr(png);

	/* The first cause stands: libpng may fail again while it unwinds. */
	if (reader->status == DIO_OK)
		reader->status = dio_fail(reader->error, DIO_BAD_FILE, "%s: damaged PNG: %s",
					  reader->name, message);
	png_longjmp(png, 1);
}

static void on_write_error(png_structp png, png_const_charp message)
{
	struct writer *writer = png_get_error_ptr(png);

	if (writer->status == DIO_OK)
		writer->status = dio_fail(writer->error, DIO_IO, "%s: cannot encode PNG: %s",
					  writer->name, message);
	png_longjmp(png, 1);
}

/* What libpng warns of (odd ancillary chunks) does not change the pixels. */
static void on_warning(png_structp png, png_const_charp message)
{
	(void)png;
	(void)message;
}

static void take_bytes(png_structp png, png_bytep to, size_t n)
{
	struct reader *reader = png_get_io_ptr(png);

	if (n > reader->size - reader->at)
		png_error(png, "the file ends too early");
	memcpy(to, reader->bytes + reader->at, n);
	reader->at += n;
}

static void put_bytes(png_structp png, png_bytep from, size_t n)
{
	struct writer *writer = png_get_io_ptr(png);

	if (!dio_bytes_append(&writer->out, from, n)) {
		writer->status =
			dio_fail(writer->error, DIO_NO_MEM, "%s: out of memory", writer->name);
		png_error(png, "out of memory");
	}
}

static void flush_bytes(png_structp png)
{
	(void)png;
}

bool dio_png_is(const uint8_t *bytes, size_t size)
{
	return size >= 8 && png_sig_cmp(bytes, 0, 8) == 0;
}

static void check_size(struct reader *reader, uint32_t width, uint32_t height)
{
	size_t raw = (png_get_rowbytes(reader->png, reader->info) + 1) * height;

	if (width > DIO_PICTURE_SIDE_MAX || height > DIO_PICTURE_SIDE_MAX) {
		reader->status = dio_fail(reader->error, DIO_BAD_FILE,
					  "%s: %ux%u pixels, a side may have at most %u",
					  reader->name, width, height, DIO_PICTURE_SIDE_MAX);
		png_longjmp(reader->png, 1);
	}
	/* A tiny file that announces a huge picture must not make us allocate it. */
	if (raw / DEFLATE_RATIO_MAX > reader->size) {
		reader->status = dio_fail(
			reader->error, DIO_BAD_FILE,
			"%s: damaged PNG: %zu bytes cannot hold the %ux%u pixels announced",
			reader->name, reader->size, width, height);
		png_longjmp(reader->png, 1);
	}
}

static void lay_over_white(const uint8_t *rgba, size_t pixels, uint8_t *rgb)
{
	for (size_t i = 0; i < pixels; i++) {
		uint32_t alpha = rgba[4 * i + 3];

		for (size_t c = 0; c < 3; c++)
			rgb[3 * i + c] =
				(uint8_t)((rgba[4 * i + c] * alpha + 255 * (255 - alpha) + 127) /
					  255);
	}
}

/* Everything that may longjmp; the caller has set the jump. */
static void decode(struct reader *reader, struct dio_picture *picture)
{
	png_structp png = reader->png;
	png_infop info = reader->info;
	uint32_t width, height;
	int passes;
	bool alpha;

	png_read_info(png, info);
	width = png_get_image_width(png, info);
	height = png_get_image_height(png, info);
	check_size(reader, width, height);

	alpha = (png_get_color_type(png, info) & PNG_COLOR_MASK_ALPHA) ||
		png_get_valid(png, info, PNG_INFO_tRNS);
	png_set_expand(png);
	png_set_scale_16(png);
	png_set_gray_to_rgb(png);
	passes = png_set_interlace_handling(png);
	png_read_update_info(png, info);

	reader->status = dio_picture_resize(picture, width, height);
	if (reader->status == DIO_OK && alpha) {
		reader->rgba = calloc((size_t)width * height, 4);
		if (!reader->rgba)
			reader->status = DIO_NO_MEM;
	}
	if (reader->status != DIO_OK) {
		dio_fail(reader->error, reader->status, "%s: no memory for %ux%u pixels",
			 reader->name, width, height);
		png_longjmp(png, 1);
	}
	for (int pass = 0; pass < passes; pass++) {
		for (size_t y = 0; y < height; y++)
			png_read_row(png,
				     alpha ? reader->rgba + 4 * width * y
					   : picture->rgb + 3 * width * y,
				     NULL);
	}
	png_read_end(png, NULL);
	if (alpha)
		lay_over_white(reader->rgba, (size_t)width * height, picture->rgb);
}

enum dio_status dio_png_decode(const uint8_t *bytes, size_t size, const char *name,
			       struct dio_picture *picture, struct dio_error *error)
{
	struct reader reader = {.bytes = bytes, .size = size, .name = name, .error = error};

	reader.png =
		png_create_read_struct(PNG_LIBPNG_VER_STRING, &reader, on_read_error, on_warning);
	if (reader.png)
		reader.info = png_create_info_struct(reader.png);
	if (!reader.info) {
		png_destroy_read_struct(&reader.png, NULL, NULL);
		return dio_fail(error, DIO_NO_MEM, "%s: libpng does not start: out of memory",
				name);
	}
	if (setjmp(png_jmpbuf(reader.png)) == 0) {
		png_set_read_fn(reader.png, &reader, take_bytes);
		/* Larger sides are named by check_size(); these only bound libpng itself. */
		png_set_user_limits(reader.png, PNG_UINT_31_MAX, PNG_UINT_31_MAX);
		decode(&reader, picture);
	}
	free(reader.rgba);
	png_destroy_read_struct(&reader.png, &reader.info, NULL);
	return reader.status;
}

enum dio_status dio_png_encode(const struct dio_picture *picture, const char *name, uint8_t **bytes,
			       size_t *size, struct dio_error *error)
{
	struct writer writer = {.name = name, .error = error};

	writer.png =
		png_create_write_struct(PNG_LIBPNG_VER_STRING, &writer, on_write_error, on_warning);
	if (writer.png)
		writer.info = png_create_info_struct(writer.png);
	if (!writer.info) {
		png_destroy_write_struct(&writer.png, NULL);
		return dio_fail(error, DIO_NO_MEM, "%s: libpng does not start: out of memory",
				name);
	}
	if (setjmp(png_jmpbuf(writer.png)) == 0) {
		png_set_write_fn(writer.png, &writer, put_bytes, flush_bytes);
		png_set_IHDR(writer.png, writer.info, picture->width, picture->height, 8,
			     PNG_COLOR_TYPE_RGB, PNG_INTERLACE_NONE, PNG_COMPRESSION_TYPE_DEFAULT,
			     PNG_FILTER_TYPE_DEFAULT);
		/*
		 * A camera's noise leaves deflate no repeats to find but runs. Looking for nothing
		 * else gives files of the same size as level 3 in a third of the time.
		 */
		png_set_compression_level(writer.png, 1);
		png_set_compression_strategy(writer.png, Z_RLE);
		png_set_filter(writer.png, PNG_FILTER_TYPE_BASE, PNG_FILTER_SUB | PNG_FILTER_UP);
		png_write_info(writer.png, writer.info);
		for (size_t y = 0; y < picture->height; y++)
			png_write_row(writer.png, picture->rgb + 3 * y * picture->width);
		png_write_end(writer.png, writer.info);
	}
	png_destroy_write_struct(&writer.png, &writer.info);
	if (writer.status != DIO_OK) {
		free(writer.out.data);
		return writer.status;
	}
	*bytes = writer.out.data;
	*size = writer.out.size;
	return DIO_OK;
}
