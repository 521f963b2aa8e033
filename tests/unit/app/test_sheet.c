/* The contact sheet: pictures where they belong, text inside its bounds. */
#include "unit/app/fixture.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "core/sheet.h"

static struct dio_picture plain(uint32_t width, uint32_t height, uint8_t value)
{
	struct dio_picture picture = {0};

	assert_int_equal(dio_picture_init(&picture, width, height), DIO_OK);
	memset(picture.rgb, value, (size_t)width * height * 3);
	return picture;
}

static uint8_t at(const struct dio_picture *picture, uint32_t x, uint32_t y)
{
	return picture->rgb[3 * ((size_t)y * picture->width + x)];
}

static void pictures_stand_in_their_cells_with_their_aspect(void **state)
{
	struct dio_picture wide = plain(200, 100, 200), small = plain(8, 8, 90), sheet = {0};
	const struct dio_picture *first[] = {&wide, &small}, *second[] = {NULL, &wide};
	const char *captions[] = {"wide", "small"};
	const struct dio_sheet_row rows[] = {
		{.title = "", .pictures = first, .captions = captions, .count = 2},
		{.title = "second", .pictures = second, .count = 2},
	};

	(void)state;
	assert_int_equal(dio_sheet_draw(rows, 2, 64, &sheet, NULL), DIO_OK);
	assert_int_equal(sheet.width, 8 + 2 * (64 + 8));
	/* The wide one fills 64 x 32 in the middle of its cell, the small one all of its own. */
	assert_int_equal(at(&sheet, 8, 8 + 16), 200);
	assert_int_equal(at(&sheet, 8 + 63, 8 + 47), 200);
	assert_int_not_equal(at(&sheet, 8 + 32, 8 + 14), 200);
	assert_int_equal(sheet.height, (8 + 64 + 9) + (8 + 18 + 32) + 8);
	assert_int_equal(at(&sheet, 80, 8), 90);
	assert_int_equal(at(&sheet, 80 + 63, 8 + 63), 90);
	dio_picture_deinit(&sheet);
	dio_picture_deinit(&wide);
	dio_picture_deinit(&small);
}

static void a_shrunk_picture_is_averaged(void **state)
{
	struct dio_picture stripes = plain(128, 128, 0), sheet = {0};
	const struct dio_picture *list[] = {&stripes};
	const struct dio_sheet_row row = {.title = "", .pictures = list, .count = 1};

	(void)state;
	for (uint32_t i = 0; i < 128 * 128; i++)
		memset(stripes.rgb + 3 * i, i % 2 ? 200 : 100, 3);
	assert_int_equal(dio_sheet_draw(&row, 1, 64, &sheet, NULL), DIO_OK);
	assert_int_equal(at(&sheet, 8 + 30, 8 + 30), 150);
	dio_picture_deinit(&sheet);
	dio_picture_deinit(&stripes);
}

static void text_never_leaves_the_picture(void **state)
{
	const uint8_t white[3] = {255, 255, 255};
	struct dio_picture picture = plain(20, 10, 0);
	unsigned lit = 0;

	(void)state;
	/* The sanitizer build sees any write outside. */
	dio_text_draw(&picture, -7, -3, 3, white, "clipped on all sides \x80\xff\n");
	dio_text_draw(&picture, 18, 8, 1, white, "x");
	dio_text_draw(&picture, INT32_MAX, INT32_MAX, 9, white, "far");
	for (uint32_t i = 0; i < 200; i++)
		lit += picture.rgb[3 * i] == 255;
	assert_in_range(lit, 1, 199);
	assert_int_equal(dio_text_width("abc", 2), 36);
	dio_picture_deinit(&picture);
}

static void every_letter_has_a_shape_of_its_own(void **state)
{
	const uint8_t white[3] = {255, 255, 255};
	static uint8_t shapes[95][6 * 7 * 3];

	(void)state;
	for (int i = 0; i < 95; i++) {
		struct dio_picture picture = plain(6, 7, 0);
		const char text[2] = {(char)(32 + i), '\0'};

		dio_text_draw(&picture, 0, 0, 1, white, text);
		memcpy(shapes[i], picture.rgb, sizeof shapes[i]);
		dio_picture_deinit(&picture);
		for (int j = 0; j < i; j++)
			if (memcmp(shapes[i], shapes[j], sizeof shapes[i]) == 0)
				fail_msg("'%c' looks like '%c'", 32 + i, 32 + j);
	}
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(pictures_stand_in_their_cells_with_their_aspect),
		cmocka_unit_test(a_shrunk_picture_is_averaged),
		cmocka_unit_test(text_never_leaves_the_picture),
		cmocka_unit_test(every_letter_has_a_shape_of_its_own),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
