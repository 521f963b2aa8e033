/* The picture file formats, bytes in memory on both sides. */
#ifndef DIO_BASE_PICTURE_CODEC_H
#define DIO_BASE_PICTURE_CODEC_H

#include <stdbool.h>

#include "dio/frame.h"

/** The longest side and the most bytes of a picture file that is looked at. */
#define DIO_PICTURE_SIDE_MAX  16384u
#define DIO_PICTURE_BYTES_MAX ((size_t)1 << 30)

/** Bytes that grow at their end; zero-initialised is empty, the memory is released with free(). */
struct dio_bytes {
	uint8_t *data;
	size_t size, capacity;
};

/** False when memory is short; the bytes stay as they were. */
bool dio_bytes_append(struct dio_bytes *bytes, const void *data, size_t size);

/** Bring a picture to a size, keeping its memory when it fits already. */
enum dio_status dio_picture_resize(struct dio_picture *picture, uint32_t width, uint32_t height);

bool dio_png_is(const uint8_t *bytes, size_t size);
bool dio_jpeg_is(const uint8_t *bytes, size_t size);

/** Decode into `picture` as dio_frame_to_rgb() describes it; on failure its pixels are undefined.
 */
enum dio_status dio_png_decode(const uint8_t *bytes, size_t size, const char *name,
			       struct dio_picture *picture, struct dio_error *error);
enum dio_status dio_jpeg_decode(const uint8_t *bytes, size_t size, const char *name,
				struct dio_picture *picture, struct dio_error *error);

/** Encode; `bytes` is released with free(). `name` is for messages. */
enum dio_status dio_png_encode(const struct dio_picture *picture, const char *name, uint8_t **bytes,
			       size_t *size, struct dio_error *error);
enum dio_status dio_jpeg_encode(const struct dio_picture *picture, const char *name,
				uint8_t **bytes, size_t *size, struct dio_error *error);

#endif
