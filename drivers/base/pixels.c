#include "pixels.h"

#include <stdbool.h>
#include <string.h>

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

/* BT.601 limited range times 65536: 255/219, 2 (1 - Kr) 255/224 and so on, Kr 0.299, Kb 0.114. */
enum {
	LUMA = 76309,
	RED_OF_CR = 104597,
	GREEN_OF_CB = 25675,
	GREEN_OF_CR = 53279,
	BLUE_OF_CB = 132201,
	HALF = 1 << 15,
};

static inline uint8_t clamp_fixed(int32_t value)
{
	if (value < 0)
		return 0;
	value >>= 16;
	return value > 255 ? 255 : (uint8_t)value;
}

static inline void ycc_to_rgb(int32_t y, int32_t cb, int32_t cr, uint8_t *rgb)
{
	int32_t luma = LUMA * (y - 16) + HALF;

	cb -= 128;
	cr -= 128;
	rgb[0] = clamp_fixed(luma + RED_OF_CR * cr);
	rgb[1] = clamp_fixed(luma - GREEN_OF_CB * cb - GREEN_OF_CR * cr);
	rgb[2] = clamp_fixed(luma + BLUE_OF_CB * cb);
}

static void gray_row(const uint8_t *src, uint32_t width, uint8_t *rgb)
{
	for (uint32_t x = 0; x < width; x++)
		memset(rgb + 3 * (size_t)x, src[x], 3);
}

static void yuyv_row(const uint8_t *src, uint32_t width, uint8_t *rgb)
{
	for (uint32_t x = 0; x < width; x += 2, src += 4, rgb += 6) {
		ycc_to_rgb(src[0], src[1], src[3], rgb);
		ycc_to_rgb(src[2], src[1], src[3], rgb + 3);
	}
}

static void nv12_row(const uint8_t *luma, const uint8_t *chroma, uint32_t width, uint8_t *rgb)
{
	for (uint32_t x = 0; x < width; x += 2, luma += 2, chroma += 2, rgb += 6) {
		ycc_to_rgb(luma[0], chroma[0], chroma[1], rgb);
		ycc_to_rgb(luma[1], chroma[0], chroma[1], rgb + 3);
	}
}

void dio_pixels_to_rgb(const struct dio_frame *frame, uint8_t *rgb)
{
	const size_t pitch = frame->pitch_bytes;
	const size_t row_bytes = 3 * (size_t)frame->width;
	const uint8_t *chroma = frame->data + pitch * frame->height;

	for (uint32_t y = 0; y < frame->height; y++) {
		const uint8_t *src = frame->data + pitch * y;
		uint8_t *dst = rgb + row_bytes * y;

		switch (frame->format) {
		case DIO_PIXEL_RGB24:
			memcpy(dst, src, row_bytes);
			break;
		case DIO_PIXEL_GRAY8:
			gray_row(src, frame->width, dst);
			break;
		case DIO_PIXEL_YUYV:
			yuyv_row(src, frame->width, dst);
			break;
		case DIO_PIXEL_NV12:
			nv12_row(src, chroma + pitch * (y / 2), frame->width, dst);
			break;
		case DIO_PIXEL_MJPEG:
			break;
		}
	}
}

enum dio_status dio_pixels_check(const struct dio_frame *frame, struct dio_error *error)
{
	const char *name = dio_pixel_format_name(frame->format);
	size_t row = frame->width, rows = frame->height, need;
	bool even_width = false, even_height = false;

	switch (frame->format) {
	case DIO_PIXEL_RGB24:
		row *= 3;
		break;
	case DIO_PIXEL_GRAY8:
		break;
	case DIO_PIXEL_YUYV:
		row *= 2;
		even_width = true;
		break;
	case DIO_PIXEL_NV12:
		rows += rows / 2;
		even_width = even_height = true;
		break;
	default:
		return dio_fail(error, DIO_BAD_ARG, "frame: pixel format %d has no rows",
				(int)frame->format);
	}
	if ((even_width && frame->width % 2) || (even_height && frame->height % 2))
		return dio_fail(error, DIO_BAD_ARG, "frame: %s %ux%u must have even sides", name,
				frame->width, frame->height);
	if (rows == 0 || frame->pitch_bytes < row)
		return dio_fail(error, DIO_BAD_ARG,
				"frame: %s %ux%u needs a pitch of %zu bytes or more, not %u", name,
				frame->width, frame->height, row, frame->pitch_bytes);
	/* The last row need not be padded. */
	need = (size_t)frame->pitch_bytes * (rows - 1) + row;
	if (!frame->data || frame->size_bytes < need)
		return dio_fail(error, DIO_BAD_ARG, "frame: %s %ux%u needs %zu bytes, %zu came",
				name, frame->width, frame->height, need, frame->size_bytes);
	return DIO_OK;
}
