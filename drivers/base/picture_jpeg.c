#include "picture_codec.h"

#include <setjmp.h>
#include <stdio.h>
#include <stdlib.h>

#include <jpeglib.h>

#include <jerror.h>

#define QUALITY 95

/* A block of 8x8 pixels takes at least one bit of Huffman code; a margin of four for oddities. */
#define PIXELS_PER_BYTE_MAX (64 * 8 * 4)

struct errors {
	struct jpeg_error_mgr manager; /* first: libjpeg hands this pointer back */
	jmp_buf jump;
	const char *name, *what;
	struct dio_error *error;
	enum dio_status status;
};

static void on_error(j_common_ptr jpeg)
{
	struct errors *errors = (struct errors *)jpeg->err;
	char message[JMSG_LENGTH_MAX];
	enum dio_status status = errors->status;

	errors->manager.format_message(jpeg, message);
	if (errors->manager.msg_code == JERR_OUT_OF_MEMORY)
		status = DIO_NO_MEM;
	errors->status =
		dio_fail(errors->error, status, "%s: %s: %s", errors->name, errors->what, message);
	longjmp(errors->jump, 1);
}

/*
 * libjpeg fills what is missing with grey and only warns. Such a picture is refused; spare bytes
 * between markers, which many webcams leave, and odd version numbers do no harm.
 */
static void on_message(j_common_ptr jpeg, int level)
{
	if (level >= 0)
		return;
	switch (jpeg->err->msg_code) {
	case JWRN_EXTRANEOUS_DATA:
	case JWRN_JFIF_MAJOR:
	case JWRN_ADOBE_XFORM:
		jpeg->err->num_warnings++;
		return;
	default:
		on_error(jpeg);
	}
}

static void errors_init(struct errors *errors, const char *name, const char *what,
			enum dio_status status, struct dio_error *error)
{
	*errors = (struct errors){.name = name, .what = what, .error = error, .status = status};
	jpeg_std_error(&errors->manager);
	errors->manager.error_exit = on_error;
	errors->manager.emit_message = on_message;
}

bool dio_jpeg_is(const uint8_t *bytes, size_t size)
{
	return size >= 3 && bytes[0] == 0xff && bytes[1] == 0xd8 && bytes[2] == 0xff;
}

static enum dio_status check_size(const struct jpeg_decompress_struct *jpeg, size_t size,
				  const char *name, struct dio_error *error)
{
	if (jpeg->image_width > DIO_PICTURE_SIDE_MAX || jpeg->image_height > DIO_PICTURE_SIDE_MAX)
		return dio_fail(error, DIO_BAD_FILE, "%s: %ux%u pixels, a side may have at most %u",
				name, jpeg->image_width, jpeg->image_height, DIO_PICTURE_SIDE_MAX);
	if ((size_t)jpeg->image_width * jpeg->image_height / PIXELS_PER_BYTE_MAX > size)
		return dio_fail(
			error, DIO_BAD_FILE,
			"%s: damaged JPEG: %zu bytes cannot hold the %ux%u pixels announced", name,
			size, jpeg->image_width, jpeg->image_height);
	if (jpeg->jpeg_color_space == JCS_CMYK || jpeg->jpeg_color_space == JCS_YCCK)
		return dio_fail(error, DIO_UNSUPPORTED, "%s: a CMYK JPEG; convert it to RGB first",
				name);
	return DIO_OK;
}

/* Everything that may longjmp; the caller has set the jump. */
static enum dio_status decode(struct jpeg_decompress_struct *jpeg, const uint8_t *bytes,
			      size_t size, const char *name, struct dio_picture *picture,
			      struct dio_error *error)
{
	enum dio_status status;

	jpeg_mem_src(jpeg, bytes, size);
	jpeg_read_header(jpeg, TRUE);
	status = check_size(jpeg, size, name, error);
	if (status != DIO_OK)
		return status;
	status = dio_picture_resize(picture, jpeg->image_width, jpeg->image_height);
	if (status != DIO_OK)
		return dio_fail(error, status, "%s: %s for %ux%u pixels", name,
				dio_status_text(status), jpeg->image_width, jpeg->image_height);
	jpeg->out_color_space = JCS_RGB;
	jpeg_start_decompress(jpeg);
	while (jpeg->output_scanline < jpeg->output_height) {
		JSAMPROW row = picture->rgb + (size_t)3 * picture->width * jpeg->output_scanline;

		jpeg_read_scanlines(jpeg, &row, 1);
	}
	jpeg_finish_decompress(jpeg);
	return DIO_OK;
}

enum dio_status dio_jpeg_decode(const uint8_t *bytes, size_t size, const char *name,
				struct dio_picture *picture, struct dio_error *error)
{
	struct jpeg_decompress_struct jpeg = {0};
	struct errors errors;
	enum dio_status status;

	if (!dio_jpeg_is(bytes, size))
		return dio_fail(error, DIO_BAD_FILE, "%s: not a JPEG", name);
	errors_init(&errors, name, "damaged JPEG", DIO_BAD_FILE, error);
	jpeg.err = &errors.manager;
	if (setjmp(errors.jump) != 0) {
		jpeg_destroy_decompress(&jpeg);
		return errors.status;
	}
	jpeg_create_decompress(&jpeg);
	status = decode(&jpeg, bytes, size, name, picture, error);
	jpeg_destroy_decompress(&jpeg);
	return status;
}

/* jpeg_mem_dest() loses its buffer when it fails half-way; this one does not. */
struct destination {
	struct jpeg_destination_mgr manager; /* first: libjpeg hands this pointer back */
	struct dio_bytes out;
	JOCTET chunk[1 << 14];
};

static void rewind_chunk(j_compress_ptr jpeg)
{
	struct destination *destination = (struct destination *)jpeg->dest;

	destination->manager.next_output_byte = destination->chunk;
	destination->manager.free_in_buffer = sizeof(destination->chunk);
}

static void put_bytes(j_compress_ptr jpeg, size_t n)
{
	struct destination *destination = (struct destination *)jpeg->dest;

	if (!dio_bytes_append(&destination->out, destination->chunk, n))
		ERREXIT1(jpeg, JERR_OUT_OF_MEMORY, 0);
}

static boolean put_full_chunk(j_compress_ptr jpeg)
{
	put_bytes(jpeg, sizeof(((struct destination *)jpeg->dest)->chunk));
	rewind_chunk(jpeg);
	return TRUE;
}

static void put_last_chunk(j_compress_ptr jpeg)
{
	struct destination *destination = (struct destination *)jpeg->dest;

	put_bytes(jpeg, sizeof(destination->chunk) - destination->manager.free_in_buffer);
}

static void encode(struct jpeg_compress_struct *jpeg, const struct dio_picture *picture)
{
	jpeg->image_width = picture->width;
	jpeg->image_height = picture->height;
	jpeg->input_components = 3;
	jpeg->in_color_space = JCS_RGB;
	jpeg_set_defaults(jpeg);
	jpeg_set_quality(jpeg, QUALITY, TRUE);
	/* Full colour resolution: these pictures are measured, not only looked at. */
	jpeg->comp_info[0].h_samp_factor = 1;
	jpeg->comp_info[0].v_samp_factor = 1;
	jpeg_start_compress(jpeg, TRUE);
	while (jpeg->next_scanline < jpeg->image_height) {
		JSAMPROW row = picture->rgb + (size_t)3 * picture->width * jpeg->next_scanline;

		jpeg_write_scanlines(jpeg, &row, 1);
	}
	jpeg_finish_compress(jpeg);
}

enum dio_status dio_jpeg_encode(const struct dio_picture *picture, const char *name,
				uint8_t **bytes, size_t *size, struct dio_error *error)
{
	struct destination destination;
	struct jpeg_compress_struct jpeg = {0};
	struct errors errors;

	destination.out = (struct dio_bytes){0};
	destination.manager.init_destination = rewind_chunk;
	destination.manager.empty_output_buffer = put_full_chunk;
	destination.manager.term_destination = put_last_chunk;
	errors_init(&errors, name, "cannot encode JPEG", DIO_IO, error);
	jpeg.err = &errors.manager;
	if (setjmp(errors.jump) != 0) {
		jpeg_destroy_compress(&jpeg);
		free(destination.out.data);
		return errors.status;
	}
	jpeg_create_compress(&jpeg);
	jpeg.dest = &destination.manager;
	encode(&jpeg, picture);
	jpeg_destroy_compress(&jpeg);
	*bytes = destination.out.data;
	*size = destination.out.size;
	return DIO_OK;
}
