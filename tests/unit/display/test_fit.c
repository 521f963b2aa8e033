#include "check.h"

#include <stdlib.h>
#include <string.h>

#include "dio/fit.h"

/* An area with a guard byte pattern around every row. */
struct area {
	uint32_t width, height;
	size_t step, pitch;
	uint8_t *bytes;
};

static struct area draw(const struct dio_picture *picture, uint32_t width, uint32_t height,
			enum dio_fit_order order, bool smooth)
{
	const size_t step = order == DIO_FIT_RGB ? 3 : 4;
	struct area area = {.width = width, .height = height, .step = step};
	struct dio_fit fit;

	area.pitch = step * width + 8;
	area.bytes = malloc(area.pitch * height);
	assert_non_null(area.bytes);
	memset(area.bytes, 0xa5, area.pitch * height);
	assert_int_equal(dio_fit_init(&fit, width, height, order, smooth), DIO_OK);
	dio_fit_draw(&fit, picture, area.bytes, area.pitch);
	dio_fit_deinit(&fit);
	for (uint32_t y = 0; y < height; y++)
		for (size_t i = step * width; i < area.pitch; i++)
			assert_int_equal(area.bytes[area.pitch * y + i], 0xa5);
	return area;
}

static const uint8_t *pixel(const struct area *area, uint32_t x, uint32_t y)
{
	return area->bytes + area->pitch * y + area->step * x;
}

static struct dio_picture make_picture(uint32_t width, uint32_t height)
{
	struct dio_picture picture;
	uint32_t seed = 1;

	assert_int_equal(dio_picture_init(&picture, width, height), DIO_OK);
	for (size_t i = 0; i < 3 * (size_t)width * height; i++) {
		seed = seed * 1664525u + 1013904223u;
		picture.rgb[i] = (uint8_t)(seed >> 24);
	}
	return picture;
}

static void rectangle_keeps_proportions_and_lies_in_the_middle(void **state)
{
	static const struct {
		uint32_t width, height, area_width, area_height;
		struct dio_fit_rect rect;
	} cases[] = {
		{640, 480, 640, 480, {0, 0, 640, 480}},
		{640, 480, 1920, 1080, {240, 0, 1440, 1080}},
		{1920, 1080, 1024, 768, {0, 96, 1024, 576}},
		{1, 1, 7, 5, {1, 0, 5, 5}},
		{16384, 1, 100, 100, {0, 49, 100, 1}},
		{1, 16384, 100, 100, {49, 0, 1, 100}},
		{3, 3, 1, 1, {0, 0, 1, 1}},
	};

	(void)state;
	for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
		const struct dio_fit_rect rect = dio_fit_rect(
			cases[i].width, cases[i].height, cases[i].area_width, cases[i].area_height);

		assert_memory_equal(&rect, &cases[i].rect, sizeof(rect));
	}
}

static void picture_of_the_same_size_is_copied_exactly(void **state)
{
	struct dio_picture picture = make_picture(37, 21);

	(void)state;
	for (int smooth = 0; smooth < 2; smooth++) {
		struct area rgb = draw(&picture, 37, 21, DIO_FIT_RGB, smooth);
		struct area bgrx = draw(&picture, 37, 21, DIO_FIT_BGRX, smooth);

		for (uint32_t y = 0; y < 21; y++)
			for (uint32_t x = 0; x < 37; x++) {
				const uint8_t *in = picture.rgb + 3 * (37 * y + x);
				const uint8_t swapped[4] = {in[2], in[1], in[0], 0};

				assert_memory_equal(pixel(&rgb, x, y), in, 3);
				assert_memory_equal(pixel(&bgrx, x, y), swapped, 4);
			}
		free(rgb.bytes);
		free(bgrx.bytes);
	}
	dio_picture_deinit(&picture);
}

static void nearest_pixels_are_repeated(void **state)
{
	struct dio_picture picture = make_picture(5, 4);
	struct area area = draw(&picture, 15, 12, DIO_FIT_RGB, false);

	(void)state;
	for (uint32_t y = 0; y < 12; y++)
		for (uint32_t x = 0; x < 15; x++)
			assert_memory_equal(pixel(&area, x, y),
					    picture.rgb + 3 * (5 * (y / 3) + x / 3), 3);
	free(area.bytes);
	dio_picture_deinit(&picture);
}

/* What bilinear means, in floating point. */
static double expected(const struct dio_picture *picture, uint32_t x, uint32_t y, uint32_t width,
		       uint32_t height, int channel)
{
	double u = (x + 0.5) * picture->width / width - 0.5;
	double v = (y + 0.5) * picture->height / height - 0.5;
	double sum = 0;

	u = u < 0 ? 0 : u > picture->width - 1 ? picture->width - 1 : u;
	v = v < 0 ? 0 : v > picture->height - 1 ? picture->height - 1 : v;
	for (uint32_t j = (uint32_t)v; j <= (uint32_t)v + 1 && j < picture->height; j++)
		for (uint32_t i = (uint32_t)u; i <= (uint32_t)u + 1 && i < picture->width; i++) {
			double wx = i == (uint32_t)u ? 1 - (u - i) : u - (uint32_t)u;
			double wy = j == (uint32_t)v ? 1 - (v - j) : v - (uint32_t)v;

			sum += wx * wy * picture->rgb[3 * (picture->width * j + i) + channel];
		}
	return sum;
}

static void smooth_pictures_are_bilinear(void **state)
{
	static const uint32_t sizes[][2] = {{40, 30}, {53, 40}, {9, 7}, {200, 150}, {3, 2}};
	struct dio_picture picture = make_picture(16, 12);

	(void)state;
	for (size_t k = 0; k < sizeof sizes / sizeof *sizes; k++) {
		const uint32_t width = sizes[k][0], height = sizes[k][1];
		const struct dio_fit_rect rect = dio_fit_rect(16, 12, width, height);
		struct area area = draw(&picture, width, height, DIO_FIT_RGB, true);

		for (uint32_t y = 0; y < rect.height; y++)
			for (uint32_t x = 0; x < rect.width; x++)
				for (int c = 0; c < 3; c++) {
					double want = expected(&picture, x, y, rect.width,
							       rect.height, c);
					int got = pixel(&area, rect.x + x, rect.y + y)[c];

					/* Positions in 256ths of steps of up to 255, two
					 * roundings. */
					assert_true(want - got < 3 && got - want < 3);
				}
		free(area.bytes);
	}
	dio_picture_deinit(&picture);
}

static void bars_are_black_and_the_picture_is_not(void **state)
{
	struct dio_picture picture = make_picture(10, 10);
	struct area area;

	(void)state;
	memset(picture.rgb, 200, 300);
	area = draw(&picture, 31, 11, DIO_FIT_BGRX, true);
	for (uint32_t y = 0; y < 11; y++)
		for (uint32_t x = 0; x < 31; x++) {
			const bool inside = x >= 10 && x < 21;
			const uint8_t want[4] = {inside * 200, inside * 200, inside * 200, 0};

			assert_memory_equal(pixel(&area, x, y), want, 4);
		}
	free(area.bytes);
	dio_picture_deinit(&picture);
}

static void extreme_shapes_stay_inside(void **state)
{
	static const uint32_t shapes[][4] = {
		{1, 1, 1, 1}, {1, 1, 64, 3}, {999, 1, 3, 40}, {1, 999, 40, 3}, {333, 777, 2, 2},
	};

	(void)state;
	for (size_t i = 0; i < sizeof shapes / sizeof *shapes; i++)
		for (int smooth = 0; smooth < 2; smooth++) {
			struct dio_picture picture = make_picture(shapes[i][0], shapes[i][1]);
			struct area area =
				draw(&picture, shapes[i][2], shapes[i][3], DIO_FIT_BGRX, smooth);

			free(area.bytes);
			dio_picture_deinit(&picture);
		}
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(rectangle_keeps_proportions_and_lies_in_the_middle),
		cmocka_unit_test(picture_of_the_same_size_is_copied_exactly),
		cmocka_unit_test(nearest_pixels_are_repeated),
		cmocka_unit_test(smooth_pictures_are_bilinear),
		cmocka_unit_test(bars_are_black_and_the_picture_is_not),
		cmocka_unit_test(extreme_shapes_stay_inside),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
