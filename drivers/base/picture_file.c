#include "dio/frame.h"

#include <stdlib.h>
#include <string.h>
#include <strings.h>

#include "dio/atomic_file.h"
#include "dio/file.h"
#include "picture_codec.h"

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
