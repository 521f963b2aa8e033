/* The picture that the sensor makes of JPEG is the one that libjpeg makes. */
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>
#include <jpeglib.h>

#include "dio/sim_batch.h"
#include "sensor.h"

enum { WIDTH = 88, HEIGHT = 56, VIEWS = 8, VALUES = WIDTH * HEIGHT * 3 };

static const struct dio_sim_camera camera = {.width = WIDTH, .height = HEIGHT};

static unsigned char *stored(uint8_t *bytes, int quality, unsigned long *size)
{
	struct jpeg_compress_struct c;
	struct jpeg_error_mgr errors;
	unsigned char *file = NULL;

	c.err = jpeg_std_error(&errors);
	jpeg_create_compress(&c);
	jpeg_mem_dest(&c, &file, size);
	c.image_width = WIDTH;
	c.image_height = HEIGHT;
	c.input_components = 3;
	c.in_color_space = JCS_RGB;
	jpeg_set_defaults(&c);
	jpeg_set_quality(&c, quality, TRUE);
	c.dct_method = JDCT_FLOAT;
	jpeg_start_compress(&c, TRUE);
	while (c.next_scanline < HEIGHT) {
		JSAMPROW row = bytes + (size_t)c.next_scanline * WIDTH * 3;

		jpeg_write_scanlines(&c, &row, 1);
	}
	jpeg_finish_compress(&c);
	jpeg_destroy_compress(&c);
	return file;
}

static void restored(const unsigned char *file, unsigned long size, uint8_t *bytes)
{
	struct jpeg_decompress_struct d;
	struct jpeg_error_mgr errors;

	d.err = jpeg_std_error(&errors);
	jpeg_create_decompress(&d);
	jpeg_mem_src(&d, file, size);
	jpeg_read_header(&d, TRUE);
	d.do_fancy_upsampling = FALSE;
	d.dct_method = JDCT_FLOAT;
	jpeg_start_decompress(&d);
	while (d.output_scanline < HEIGHT) {
		JSAMPROW row = bytes + (size_t)d.output_scanline * WIDTH * 3;

		jpeg_read_scanlines(&d, &row, 1);
	}
	jpeg_finish_decompress(&d);
	jpeg_destroy_decompress(&d);
}

/* Mean difference from libjpeg, and from the picture before, in levels of 255. */
static void compare(uint8_t *bytes, int quality, double *from_libjpeg, double *from_picture)
{
	static float ours[VALUES];
	static uint8_t theirs[VALUES];
	struct dio_sim_sensor sensor = {.jpeg_quality = (float)quality};
	unsigned long size = 0;
	unsigned char *file = stored(bytes, quality, &size);

	restored(file, size, theirs);
	free(file);
	for (int i = 0; i < VALUES; i++)
		ours[i] = bytes[i] / 255.0f;
	sim_sensor_compress(&sensor, &camera, ours);
	*from_libjpeg = *from_picture = 0;
	for (int i = 0; i < VALUES; i++) {
		double mine = 255 * (double)ours[i];

		assert_true(mine >= 0 && mine <= 255.001);
		*from_libjpeg += fabs(mine - theirs[i]) / VALUES;
		*from_picture += fabs(mine - bytes[i]) / VALUES;
	}
}

static void pictures_are_those_of_libjpeg(void **state)
{
	static uint8_t pictures[VIEWS * VALUES];
	static float poses[VIEWS * 16], intrinsics[VIEWS * 4];
	double last = 0;

	(void)state;
	assert_int_equal(dio_sim_batch(31, 1, VIEWS, WIDTH, HEIGHT, DIO_SIM_BATCH_CLEAN, pictures,
				       poses, intrinsics),
			 0);
	for (int quality = 95; quality >= 15; quality -= 20) {
		double apart = 0, lost = 0;

		for (int v = 0; v < VIEWS; v++) {
			double a, b;

			compare(pictures + v * VALUES, quality, &a, &b);
			apart += a / VIEWS;
			lost += b / VIEWS;
		}
		print_message("quality %d: %.2f levels lost, %.2f levels from libjpeg\n", quality,
			      lost, apart);
		/* Rounding to whole levels on the way in and out, and seldom a coefficient that
		 * falls to the other side of a step. */
		assert_true(apart < 0.8);
		assert_true(apart < 0.5 * lost);
		assert_true(lost > last);
		last = lost;
	}
}

static void no_quality_changes_nothing(void **state)
{
	struct dio_sim_sensor sensor = {.jpeg_quality = 0};
	float before[VALUES], after[VALUES];

	(void)state;
	for (int i = 0; i < VALUES; i++)
		before[i] = after[i] = (float)(i % 97) / 97;
	sim_sensor_compress(&sensor, &camera, after);
	assert_memory_equal(before, after, sizeof(before));
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(pictures_are_those_of_libjpeg),
		cmocka_unit_test(no_quality_changes_nothing),
	};

	return cmocka_run_group_tests_name("sim_jpeg", tests, NULL, NULL);
}
