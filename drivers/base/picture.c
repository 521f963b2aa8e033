#include "dio/frame.h"

#include <stdlib.h>
#include <string.h>
#include <strings.h>

#include "dio/atomic_file.h"
#include "dio/file.h"
#include "picture_codec.h"
#include "pixels.h"

enum dio_status dio_picture_init(struct dio_picture *picture, uint32_t width, uint32_t height)
{
	uint8_t *rgb;

	if (width == 0 || height == 0 || width > DIO_PICTURE_SIDE_MAX ||
	    height > DIO_PICTURE_SIDE_MAX)
		return DIO_BAD_ARG;
	rgb = calloc((size_t)width * height, 3);
	if (!rgb)
		return DIO_NO_MEM;
	*picture = (struct dio_picture){width, height, rgb};
	return DIO_OK;
}

void dio_picture_deinit(struct dio_picture *picture)
{
	if (!picture)
		return;
	free(picture->rgb);
	*picture = (struct dio_picture){0};
}

enum dio_status dio_picture_resize(struct dio_picture *picture, uint32_t width, uint32_t height)
{
	struct dio_picture made;
	enum dio_status status;

	if (picture->rgb && picture->width == width && picture->height == height)
		return DIO_OK;
	status = dio_picture_init(&made, width, height);
	if (status != DIO_OK)
		return status;
	free(picture->rgb);
	picture->width = made.width;
	picture->height = made.height;
	picture->rgb = made.rgb;
	return DIO_OK;
}

bool dio_bytes_append(struct dio_bytes *bytes, const void *data, size_t size)
{
	if (size > bytes->capacity - bytes->size) {
		size_t capacity = bytes->capacity * 2 + size;
		uint8_t *grown = capacity >= size ? realloc(bytes->data, capacity) : NULL;

		if (!grown)
			return false;
		bytes->data = grown;
		bytes->capacity = capacity;
	}
	memcpy(bytes->data + bytes->size, data, size);
	bytes->size += size;
	return true;
}

const char *dio_pixel_format_name(enum dio_pixel_format format)
{
	switch (format) {
	case DIO_PIXEL_RGB24:
		return "RGB24";
	case DIO_PIXEL_GRAY8:
		return "GRAY8";
	case DIO_PIXEL_YUYV:
		return "YUYV";
	case DIO_PIXEL_NV12:
		return "NV12";
	case DIO_PIXEL_MJPEG:
		return "MJPEG";
	}
	return "unknown";
}

static enum dio_status mjpeg_to_rgb(const struct dio_frame *frame, struct dio_picture *picture,
				    struct dio_error *error)
{
	enum dio_status status;

	if (!frame->data)
		return dio_fail(error, DIO_BAD_ARG, "frame: MJPEG without data");
	status = dio_jpeg_decode(frame->data, frame->size_bytes, "frame", picture, error);
	if (status != DIO_OK)
		return status;
	if ((frame->width && frame->width != picture->width) ||
	    (frame->height && frame->height != picture->height))
		return dio_fail(error, DIO_BAD_FILE,
				"frame: a JPEG of %ux%u where %ux%u was announced", picture->width,
				picture->height, frame->width, frame->height);
	return DIO_OK;
}

enum dio_status dio_frame_to_rgb(const struct dio_frame *frame, struct dio_picture *picture,
				 struct dio_error *error)
{
	enum dio_status status;

	if (frame->format == DIO_PIXEL_MJPEG)
		return mjpeg_to_rgb(frame, picture, error);
	status = dio_pixels_check(frame, error);
	if (status != DIO_OK)
		return status;
	status = dio_picture_resize(picture, frame->width, frame->height);
	if (status != DIO_OK)
		return dio_fail(error, status, "frame: %s for a picture of %ux%u",
				dio_status_text(status), frame->width, frame->height);
	dio_pixels_to_rgb(frame, picture->rgb);
	return DIO_OK;
}

struct dio_frame dio_frame_from_picture(const struct dio_picture *picture)
{
	return (struct dio_frame){
		.format = DIO_PIXEL_RGB24,
		.width = picture->width,
		.height = picture->height,
		.pitch_bytes = picture->width * 3,
		.data = picture->rgb,
		.size_bytes = (size_t)picture->width * picture->height * 3,
	};
}

enum dio_status dio_picture_decode(const uint8_t *bytes, size_t size, const char *name,
				   struct dio_picture *picture, struct dio_error *error)
{
	struct dio_picture made = {0};
	enum dio_status status;

	if (dio_png_is(bytes, size))
		status = dio_png_decode(bytes, size, name, &made, error);
	else if (dio_jpeg_is(bytes, size))
		status = dio_jpeg_decode(bytes, size, name, &made, error);
	else
		status = dio_fail(error, DIO_BAD_FILE, "%s: %s", name,
				  size ? "neither PNG nor JPEG; convert it first"
				       : "empty file where a picture should be");
	if (status != DIO_OK) {
		dio_picture_deinit(&made);
		return status;
	}
	*picture = made;
	return DIO_OK;
}

enum dio_status dio_picture_read(const char *path, struct dio_picture *picture,
				 struct dio_error *error)
{
	uint8_t *bytes;
	size_t size;
	enum dio_status status = dio_file_read(path, DIO_PICTURE_BYTES_MAX, &bytes, &size, error);

	if (status != DIO_OK)
		return status;
	status = dio_picture_decode(bytes, size, path, picture, error);
	free(bytes);
	return status;
}

static bool ends_with(const char *path, const char *ending)
{
	size_t n = strlen(path), m = strlen(ending);

	return n > m && strcasecmp(path + n - m, ending) == 0;
}

enum dio_status dio_picture_encode(const char *name, const struct dio_picture *picture,
				   uint8_t **bytes, size_t *size, struct dio_error *error)
{
	if (!picture->rgb)
		return dio_fail(error, DIO_BAD_ARG, "%s: no picture to write", name);
	if (ends_with(name, ".png"))
		return dio_png_encode(picture, name, bytes, size, error);
	if (ends_with(name, ".jpg") || ends_with(name, ".jpeg"))
		return dio_jpeg_encode(picture, name, bytes, size, error);
	return dio_fail(error, DIO_BAD_ARG, "%s: a picture's name must end in .png, .jpg or .jpeg",
			name);
}

enum dio_status dio_picture_write(const char *path, const struct dio_picture *picture,
				  struct dio_error *error)
{
	uint8_t *bytes;
	size_t size;
	enum dio_status status = dio_picture_encode(path, picture, &bytes, &size, error);

	if (status != DIO_OK)
		return status;
	status = dio_atomic_file_write(path, bytes, size, error);
	free(bytes);
	return status;
}
