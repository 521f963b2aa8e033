#include "check.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "dio/frame.h"

/* BT.601 limited range as the standard has it, in doubles. */
static uint8_t to_level(double value)
{
	return (uint8_t)fmin(fmax(floor(value + 0.5), 0), 255);
}

static void reference(int y, int cb, int cr, uint8_t rgb[3])
{
	const double kr = 0.299, kb = 0.114, kg = 1 - kr - kb;
	double luma = (y - 16) / 219.0, pb = (cb - 128) / 224.0, pr = (cr - 128) / 224.0;
	double r = luma + 2 * (1 - kr) * pr, b = luma + 2 * (1 - kb) * pb;

	rgb[0] = to_level(255 * r);
	rgb[1] = to_level(255 * (luma - kr / kg * (r - luma) - kb / kg * (b - luma)));
	rgb[2] = to_level(255 * b);
}

static void check_pixel(const uint8_t *rgb, int y, int cb, int cr)
{
	uint8_t expected[3];

	reference(y, cb, cr, expected);
	for (int c = 0; c < 3; c++) {
		if (abs(rgb[c] - expected[c]) > 1)
			fail_msg("Y %d Cb %d Cr %d channel %d: %d, expected %d", y, cb, cr, c,
				 rgb[c], expected[c]);
	}
}

static void yuyv_is_bt601_for_every_luma_and_chroma(void **state)
{
	enum { WIDTH = 256, HEIGHT = 256 };
	uint8_t *data = malloc(WIDTH * HEIGHT * 2);
	struct dio_picture picture = {0};
	struct dio_error error;

	(void)state;
	for (int luma = 0; luma < 256; luma += 5) {
		/* A pair shares its chroma: two lumas of it are looked at. */
		for (int cr = 0; cr < HEIGHT; cr++) {
			for (int pair = 0; pair < WIDTH / 2; pair++) {
				uint8_t *p = data + (cr * WIDTH / 2 + pair) * 4;

				p[0] = (uint8_t)luma;
				p[1] = (uint8_t)(2 * pair);
				p[2] = (uint8_t)(255 - luma);
				p[3] = (uint8_t)cr;
			}
		}
		struct dio_frame frame = {.format = DIO_PIXEL_YUYV,
					  .width = WIDTH,
					  .height = HEIGHT,
					  .pitch_bytes = WIDTH * 2,
					  .data = data,
					  .size_bytes = WIDTH * HEIGHT * 2};
		assert_ok(dio_frame_to_rgb(&frame, &picture, &error), error);
		for (int cr = 0; cr < HEIGHT; cr++) {
			for (int x = 0; x < WIDTH; x++)
				check_pixel(picture.rgb + 3 * (cr * WIDTH + x),
					    x % 2 ? 255 - luma : luma, x / 2 * 2, cr);
		}
	}
	dio_picture_deinit(&picture);
	free(data);
}

static void nv12_takes_the_chroma_that_covers_the_pixel(void **state)
{
	enum { WIDTH = 38, HEIGHT = 26, PITCH = 48 };
	uint8_t data[PITCH * HEIGHT * 3 / 2];
	struct dio_picture picture = {0};
	struct dio_error error;

	(void)state;
	for (size_t i = 0; i < sizeof(data); i++)
		data[i] = (uint8_t)(i * 2654435761u >> 13);
	struct dio_frame frame = {.format = DIO_PIXEL_NV12,
				  .width = WIDTH,
				  .height = HEIGHT,
				  .pitch_bytes = PITCH,
				  .data = data,
				  .size_bytes = sizeof(data)};
	assert_ok(dio_frame_to_rgb(&frame, &picture, &error), error);
	for (size_t y = 0; y < HEIGHT; y++) {
		for (size_t x = 0; x < WIDTH; x++) {
			const uint8_t *uv = data + PITCH * HEIGHT + PITCH * (y / 2) + x / 2 * 2;

			check_pixel(picture.rgb + 3 * (y * WIDTH + x), data[PITCH * y + x], uv[0],
				    uv[1]);
		}
	}
	dio_picture_deinit(&picture);
}

static void gray_and_rgb_are_copied_without_their_padding(void **state)
{
	const uint8_t data[2][8] = {{1, 2, 3, 4, 5, 6, 99, 99}, {7, 8, 9, 10, 11, 12, 99, 99}};
	struct dio_frame frame = {.width = 2,
				  .height = 2,
				  .pitch_bytes = 8,
				  .data = data[0],
				  .size_bytes = 14}; /* the last row is not padded */
	struct dio_picture picture = {0};
	struct dio_error error;

	(void)state;
	frame.format = DIO_PIXEL_RGB24;
	assert_ok(dio_frame_to_rgb(&frame, &picture, &error), error);
	assert_memory_equal(picture.rgb, data[0], 6);
	assert_memory_equal(picture.rgb + 6, data[1], 6);
	frame.format = DIO_PIXEL_GRAY8;
	assert_ok(dio_frame_to_rgb(&frame, &picture, &error), error);
	assert_memory_equal(picture.rgb, "\1\1\1\2\2\2\7\7\7\10\10\10", 12);
	dio_picture_deinit(&picture);
}

static void picture_memory_is_reused_at_the_same_size(void **state)
{
	uint8_t data[64 * 64] = {0};
	struct dio_frame frame = {.format = DIO_PIXEL_GRAY8,
				  .width = 64,
				  .height = 32,
				  .pitch_bytes = 64,
				  .data = data,
				  .size_bytes = sizeof(data)};
	struct dio_picture picture = {0};
	struct dio_error error;
	const uint8_t *first;

	(void)state;
	assert_ok(dio_frame_to_rgb(&frame, &picture, &error), error);
	first = picture.rgb;
	assert_ok(dio_frame_to_rgb(&frame, &picture, &error), error);
	assert_ptr_equal(picture.rgb, first);
	frame.height = 64;
	assert_ok(dio_frame_to_rgb(&frame, &picture, &error), error);
	assert_int_equal(picture.height, 64);
	dio_picture_deinit(&picture);
}

static void frames_too_small_for_their_format_are_refused(void **state)
{
	static const struct {
		struct dio_frame frame;
		const char *word;
	} bad[] = {
		{{.format = DIO_PIXEL_RGB24,
		  .width = 4,
		  .height = 4,
		  .pitch_bytes = 11,
		  .size_bytes = 64},
		 "pitch of 12"},
		{{.format = DIO_PIXEL_RGB24,
		  .width = 4,
		  .height = 4,
		  .pitch_bytes = 12,
		  .size_bytes = 47},
		 "needs 48 bytes"},
		{{.format = DIO_PIXEL_NV12,
		  .width = 4,
		  .height = 4,
		  .pitch_bytes = 4,
		  .size_bytes = 16},
		 "needs 24 bytes"},
		{{.format = DIO_PIXEL_YUYV,
		  .width = 3,
		  .height = 4,
		  .pitch_bytes = 8,
		  .size_bytes = 64},
		 "even"},
		{{.format = DIO_PIXEL_NV12,
		  .width = 4,
		  .height = 3,
		  .pitch_bytes = 4,
		  .size_bytes = 64},
		 "even"},
		{{.format = DIO_PIXEL_GRAY8,
		  .width = 0,
		  .height = 4,
		  .pitch_bytes = 4,
		  .size_bytes = 64},
		 "0x4"},
		{{.format = DIO_PIXEL_GRAY8,
		  .width = 4,
		  .height = 0,
		  .pitch_bytes = 4,
		  .size_bytes = 64},
		 "4x0"},
		{{.format = (enum dio_pixel_format)99, .width = 4, .height = 4, .size_bytes = 64},
		 "format 99"},
		{{.format = DIO_PIXEL_MJPEG, .width = 4, .height = 4, .size_bytes = 64},
		 "not a JPEG"},
	};
	uint8_t data[64] = {0};

	(void)state;
	for (size_t i = 0; i < sizeof(bad) / sizeof(bad[0]); i++) {
		struct dio_frame frame = bad[i].frame;
		struct dio_picture picture = {0};
		struct dio_error error;

		frame.data = data;
		assert_fails(dio_frame_to_rgb(&frame, &picture, &error),
			     frame.format == DIO_PIXEL_MJPEG ? DIO_BAD_FILE : DIO_BAD_ARG, error,
			     bad[i].word);
		assert_null(picture.rgb);
	}
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(yuyv_is_bt601_for_every_luma_and_chroma),
		cmocka_unit_test(nv12_takes_the_chroma_that_covers_the_pixel),
		cmocka_unit_test(gray_and_rgb_are_copied_without_their_padding),
		cmocka_unit_test(picture_memory_is_reused_at_the_same_size),
		cmocka_unit_test(frames_too_small_for_their_format_are_refused),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
