#include "dio/frame.h"

#include <stdlib.h>
#include <string.h>

#include "picture_codec.h"

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
