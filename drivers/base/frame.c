#include "dio/frame.h"

#include "picture_codec.h"
#include "pixels.h"

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
