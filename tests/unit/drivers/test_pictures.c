#include "check.h"

#include <png.h>
#include <stdbool.h>
#include <stdlib.h>
#include <string.h>
#include <zlib.h>

#include "dio/file.h"
#include "dio/frame.h"
#include "scratch.h"

/* Smooth in one channel, hard edges in another: what a camera sees. */
static struct dio_picture make_picture(uint32_t width, uint32_t height)
{
	struct dio_picture picture;

	assert_int_equal(dio_picture_init(&picture, width, height), DIO_OK);
	for (uint32_t y = 0; y < height; y++) {
		for (uint32_t x = 0; x < width; x++) {
			uint8_t *p = picture.rgb + 3 * ((size_t)y * width + x);

			p[0] = (uint8_t)(x * 255 / width);
			p[1] = (uint8_t)(y * 255 / height);
			p[2] = (x / 16 + y / 16) % 2 ? 200 : 60;
		}
	}
	return picture;
}

static void read_bytes(const char *path, uint8_t **bytes, size_t *size)
{
	struct dio_error error;

	assert_ok(dio_file_read(path, 1 << 24, bytes, size, &error), error);
}

static void png_comes_back_bit_for_bit(void **state)
{
	const uint32_t sizes[][2] = {{1, 1}, {1, 7}, {7, 1}, {63, 65}, {320, 240}};
	const char *path = scratch_path(*state, "a.PNG");

	for (size_t i = 0; i < sizeof(sizes) / sizeof(sizes[0]); i++) {
		struct dio_picture picture = make_picture(sizes[i][0], sizes[i][1]), back;
		struct dio_error error;

		assert_ok(dio_picture_write(path, &picture, &error), error);
		assert_ok(dio_picture_read(path, &back, &error), error);
		assert_int_equal(back.width, picture.width);
		assert_int_equal(back.height, picture.height);
		assert_memory_equal(back.rgb, picture.rgb, 3 * (size_t)back.width * back.height);
		dio_picture_deinit(&picture);
		dio_picture_deinit(&back);
	}
}

static void jpeg_comes_back_within_its_quality(void **state)
{
	struct dio_picture picture = make_picture(321, 241), back;
	const char *path = scratch_path(*state, "a.jpeg");
	struct dio_error error;
	double sum = 0;

	assert_ok(dio_picture_write(path, &picture, &error), error);
	assert_ok(dio_picture_read(path, &back, &error), error);
	assert_int_equal(back.width, 321);
	for (size_t i = 0; i < 3 * 321 * 241; i++)
		sum += abs(back.rgb[i] - picture.rgb[i]);
	assert_true(sum / (3 * 321 * 241) < 2);
	dio_picture_deinit(&picture);
	dio_picture_deinit(&back);
}

/* Write any PNG that libpng can: the decoder must bring it to 8-bit RGB. */
static void write_png(const char *path, uint32_t format, const void *pixels, int32_t stride,
		      const void *colours, uint32_t colour_count)
{
	png_image image = {.version = PNG_IMAGE_VERSION,
			   .width = 2,
			   .height = 1,
			   .format = format,
			   .flags = PNG_IMAGE_FLAG_16BIT_sRGB,
			   .colormap_entries = colour_count};

	assert_true(png_image_write_to_file(&image, path, 0, pixels, stride, colours));
}

static void assert_reads_as(const char *path, const uint8_t expected[6])
{
	struct dio_picture picture;
	struct dio_error error;

	assert_ok(dio_picture_read(path, &picture, &error), error);
	assert_memory_equal(picture.rgb, expected, 6);
	dio_picture_deinit(&picture);
}

static void other_kinds_of_png_become_rgb(void **state)
{
	const char *path = scratch_path(*state, "a.png");
	const uint8_t rgba[8] = {200, 100, 0, 255, 200, 100, 0, 0};
	const uint8_t half[8] = {200, 100, 0, 128, 0, 0, 0, 1};
	const uint8_t gray[2] = {10, 250}, index[2] = {1, 0};
	const uint8_t colours[6] = {1, 2, 3, 40, 50, 60};

	write_png(path, PNG_FORMAT_RGBA, rgba, 8, NULL, 0);
	assert_reads_as(path, (const uint8_t[6]){200, 100, 0, 255, 255, 255});
	/* (200 128 + 255 127) / 255 and so on, rounded. */
	write_png(path, PNG_FORMAT_RGBA, half, 8, NULL, 0);
	assert_reads_as(path, (const uint8_t[6]){227, 177, 127, 254, 254, 254});
	write_png(path, PNG_FORMAT_GRAY, gray, 2, NULL, 0);
	assert_reads_as(path, (const uint8_t[6]){10, 10, 10, 250, 250, 250});
	write_png(path, PNG_FORMAT_RGB_COLORMAP, index, 2, colours, 2);
	assert_reads_as(path, (const uint8_t[6]){40, 50, 60, 1, 2, 3});
}

/* 16 bits a channel, as bytes of the file say: value v becomes v / 257, rounded. */
static void sixteen_bit_png_is_rounded(void **state)
{
	const char *path = scratch_path(*state, "a.png");
	const uint8_t row[12] = {0xff, 0xff, 0x80, 0x80, 0x01, 0x02,
				 0x00, 0x7f, 0x00, 0x82, 0x01, 0x81};
	FILE *file = fopen(path, "wb");
	png_structp png = png_create_write_struct(PNG_LIBPNG_VER_STRING, NULL, NULL, NULL);
	png_infop info = png_create_info_struct(png);

	png_init_io(png, file);
	png_set_IHDR(png, info, 2, 1, 16, PNG_COLOR_TYPE_RGB, PNG_INTERLACE_ADAM7,
		     PNG_COMPRESSION_TYPE_DEFAULT, PNG_FILTER_TYPE_DEFAULT);
	png_write_info(png, info);
	for (int passes = png_set_interlace_handling(png); passes > 0; passes--)
		png_write_row(png, row);
	png_write_end(png, info);
	png_destroy_write_struct(&png, &info);
	fclose(file);
	assert_reads_as(path, (const uint8_t[6]){255, 128, 1, 0, 1, 1});
}

static void every_truncation_is_refused_by_name(void **state)
{
	const char *names[] = {"a.png", "a.jpg"};
	struct dio_picture picture = make_picture(64, 48), back = {0};
	struct dio_error error;

	for (int n = 0; n < 2; n++) {
		const char *path = scratch_path(*state, names[n]);
		uint8_t *bytes;
		size_t size;

		assert_ok(dio_picture_write(path, &picture, &error), error);
		read_bytes(path, &bytes, &size);
		for (size_t cut = 0; cut < size; cut += 1 + size / 300) {
			scratch_write(path, bytes, cut);
			assert_fails(dio_picture_read(path, &back, &error), DIO_BAD_FILE, error,
				     names[n]);
			assert_null(back.rgb);
		}
		free(bytes);
	}
	dio_picture_deinit(&picture);
}

static bool same_pixels(const struct dio_picture *a, const struct dio_picture *b)
{
	return a->width == b->width && a->height == b->height &&
	       memcmp(a->rgb, b->rgb, (size_t)3 * a->width * a->height) == 0;
}

static void flipped_bits_are_refused_or_harmless_but_never_fatal(void **state)
{
	const char *names[] = {"a.png", "a.jpg"};
	struct dio_picture picture = make_picture(64, 48);
	struct dio_error error;

	for (int n = 0; n < 2; n++) {
		const char *path = scratch_path(*state, names[n]);
		size_t size, refused = 0, changed = 0;
		uint8_t *bytes;

		assert_ok(dio_picture_write(path, &picture, &error), error);
		read_bytes(path, &bytes, &size);
		for (size_t bit = 0; bit < 8 * size; bit += 1 + size / 500) {
			struct dio_picture back;

			bytes[bit / 8] ^= (uint8_t)(1 << bit % 8);
			if (dio_picture_decode(bytes, size, names[n], &back, &error) == DIO_OK) {
				changed += !same_pixels(&picture, &back);
				dio_picture_deinit(&back);
			} else {
				refused++;
			}
			bytes[bit / 8] ^= (uint8_t)(1 << bit % 8);
		}
		/* PNG has a checksum over everything that makes pixels (newer libpng no longer
		   looks at that of the empty end chunk); a JPEG's pixels have none. */
		if (n == 0)
			assert_int_equal(changed, 0);
		assert_true(refused > 0);
		free(bytes);
	}
	dio_picture_deinit(&picture);
}

static void put_u32(uint8_t *to, uint32_t value)
{
	for (int i = 0; i < 4; i++)
		to[i] = (uint8_t)(value >> (24 - 8 * i));
}

static void a_small_file_cannot_announce_a_huge_picture(void **state)
{
	const uint32_t sides[] = {16000, 0x7fffffff};
	struct dio_picture picture = make_picture(16, 16), back;
	struct dio_error error;
	uint8_t *bytes;
	size_t size;

	(void)state;
	assert_ok(dio_picture_encode("a.png", &picture, &bytes, &size, &error), error);
	for (int i = 0; i < 2; i++) {
		put_u32(bytes + 16, sides[i]);
		put_u32(bytes + 20, sides[i]);
		put_u32(bytes + 29, (uint32_t)crc32_z(0, bytes + 12, 17));
		assert_fails(dio_picture_decode(bytes, size, "huge.png", &back, &error),
			     DIO_BAD_FILE, error, i ? "at most 16384" : "cannot hold");
	}
	free(bytes);
	assert_ok(dio_picture_encode("a.jpg", &picture, &bytes, &size, &error), error);
	for (size_t i = 0; i + 9 < size; i++) {
		if (bytes[i] == 0xff && bytes[i + 1] == 0xc0) {
			bytes[i + 5] = bytes[i + 7] = 0x3e;
			bytes[i + 6] = bytes[i + 8] = 0x80;
			assert_fails(dio_picture_decode(bytes, size, "huge.jpg", &back, &error),
				     DIO_BAD_FILE, error, "cannot hold");
			bytes[i + 5] = bytes[i + 7] = 0xff;
			assert_fails(dio_picture_decode(bytes, size, "huge.jpg", &back, &error),
				     DIO_BAD_FILE, error, "huge.jpg");
		}
	}
	free(bytes);
	dio_picture_deinit(&picture);
}

static void what_is_no_picture_is_said_to_be_none(void **state)
{
	const char *path = scratch_path(*state, "a.png");
	struct dio_picture picture = {0};
	struct dio_error error;

	scratch_write(path, "GIF89a...........", 17);
	assert_fails(dio_picture_read(path, &picture, &error), DIO_BAD_FILE, error, "PNG nor JPEG");
	scratch_write(path, "", 0);
	assert_fails(dio_picture_read(path, &picture, &error), DIO_BAD_FILE, error, "empty");
	assert_fails(dio_picture_read(*state, &picture, &error), DIO_BAD_FILE, error, "folder");
	assert_fails(dio_picture_write(path, &picture, &error), DIO_BAD_ARG, error, "no picture");
	picture = make_picture(4, 4);
	assert_fails(dio_picture_write(scratch_path(*state, "a.gif"), &picture, &error),
		     DIO_BAD_ARG, error, ".png, .jpg");
	dio_picture_deinit(&picture);
	assert_int_equal(dio_picture_init(&picture, 0, 4), DIO_BAD_ARG);
	assert_int_equal(dio_picture_init(&picture, 4, 16385), DIO_BAD_ARG);
}

static void mjpeg_frames_with_spare_bytes_decode_and_wrong_sizes_do_not(void **state)
{
	struct dio_picture picture = make_picture(64, 48), back = {0};
	struct dio_frame frame = {.format = DIO_PIXEL_MJPEG, .width = 64, .height = 48};
	struct dio_error error;
	uint8_t *bytes, *spare;
	size_t size;

	(void)state;
	assert_ok(dio_picture_encode("a.jpg", &picture, &bytes, &size, &error), error);
	/* Webcams pad between the last bits and the end marker, and after it. */
	spare = calloc(1, size + 64);
	memcpy(spare, bytes, size - 2);
	memcpy(spare + size + 30, bytes + size - 2, 2);
	frame.data = spare;
	frame.size_bytes = size + 64;
	assert_ok(dio_frame_to_rgb(&frame, &back, &error), error);
	assert_int_equal(back.width, 64);
	frame.height = 50;
	assert_fails(dio_frame_to_rgb(&frame, &back, &error), DIO_BAD_FILE, error, "64x50");
	frame.height = 48;
	frame.size_bytes = size / 2;
	assert_fails(dio_frame_to_rgb(&frame, &back, &error), DIO_BAD_FILE, error, "damaged JPEG");
	free(spare);
	free(bytes);
	dio_picture_deinit(&picture);
	dio_picture_deinit(&back);
}

#define scratch_test(function)                                                                     \
	cmocka_unit_test_setup_teardown(function, scratch_make, scratch_remove)

int main(void)
{
	const struct CMUnitTest tests[] = {
		scratch_test(png_comes_back_bit_for_bit),
		scratch_test(jpeg_comes_back_within_its_quality),
		scratch_test(other_kinds_of_png_become_rgb),
		scratch_test(sixteen_bit_png_is_rounded),
		scratch_test(every_truncation_is_refused_by_name),
		scratch_test(flipped_bits_are_refused_or_harmless_but_never_fatal),
		cmocka_unit_test(a_small_file_cannot_announce_a_huge_picture),
		scratch_test(what_is_no_picture_is_said_to_be_none),
		cmocka_unit_test(mjpeg_frames_with_spare_bytes_decode_and_wrong_sizes_do_not),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
