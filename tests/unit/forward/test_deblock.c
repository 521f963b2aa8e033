/* Deblocking: the rule of geometry/deblock.h in plain words, and pictures that engines make by it.
 */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "dvsm/dvsm.h"
#include "fixed/deblock.h"
#include "fixed/picture.h"
#include "geometry/deblock.h"
#include "support/random.h"
#include "support/random_model.h"

#define UNIT 65536.0

/* One direction, on a picture of width x height: seams lie every `side` pixels of a line, whose
 * pixels are `step` numbers apart. */
static void plain_lines(double *picture, uint32_t side, uint32_t length, size_t step,
			uint32_t lines, size_t line_step)
{
	const int reach = (int)side / 2;

	if (side < 3)
		return;
	for (uint32_t line = 0; line < lines; line++)
		for (uint32_t seam = side; seam < length; seam += side)
			for (int c = 0; c < 3; c++) {
				double *q0 = picture + line * line_step + seam * step + c;
				double *p0 = q0 - step;
				double slope =
					((p0[0] - p0[-(ptrdiff_t)step]) + (q0[step] - q0[0])) / 2;
				double excess = q0[0] - p0[0] - slope;

				for (int i = 0; i < reach; i++) {
					double share =
						excess / 2 * (1 - (2 * i + 1) / (2.0 * reach));

					p0[-(ptrdiff_t)(i * step)] += share;
					q0[i * step] -= share;
				}
			}
}

static void plain_deblock(double *picture, uint32_t side, uint32_t width, uint32_t height)
{
	const size_t row = 3 * (size_t)width;

	plain_lines(picture, side, width, 3, height, row);
	plain_lines(picture, side, height, row, width, 3);
}

/* A picture of whole patches as each of the three has it. */
struct picture {
	struct dvsm_patch_plan plan;
	uint32_t side, width, height;
	size_t numbers;
	double *plain;     /* [height][width][3] */
	float *floats;     /* patches */
	int32_t *integers; /* patches, in units of 2^-16 */
};

static size_t place_of(const struct picture *picture, uint32_t x, uint32_t y, uint32_t c)
{
	const uint32_t q = picture->side;
	const size_t token = (size_t)(y / q) * picture->plan.grid.columns + x / q;

	return ((token * q + y % q) * q + x % q) * 3 + c;
}

static struct picture make_picture(uint32_t side, uint32_t columns, uint32_t rows)
{
	struct picture picture = {
		.plan = dvsm_patch_plan_make(side * columns, side * rows, side, side),
		.side = side,
		.width = side * columns,
		.height = side * rows,
	};

	picture.numbers = 3 * (size_t)picture.width * picture.height;
	picture.plain = calloc(picture.numbers, sizeof(*picture.plain));
	picture.floats = calloc(picture.numbers, sizeof(*picture.floats));
	picture.integers = calloc(picture.numbers, sizeof(*picture.integers));
	assert_true(picture.plain && picture.floats && picture.integers);
	return picture;
}

/* The same number of units of 2^-16 to all three. */
static void set_number(struct picture *picture, uint32_t x, uint32_t y, uint32_t c, int32_t units)
{
	picture->plain[((size_t)y * picture->width + x) * 3 + c] = units / UNIT;
	picture->floats[place_of(picture, x, y, c)] = (float)(units / UNIT);
	picture->integers[place_of(picture, x, y, c)] = units;
}

static void free_picture(struct picture *picture)
{
	free(picture->plain);
	free(picture->floats);
	free(picture->integers);
}

static void deblock(struct picture *picture)
{
	const struct dvsm_token_grid grid = picture->plan.grid;

	plain_deblock(picture->plain, picture->side, picture->width, picture->height);
	for (uint32_t row = 0; row < grid.rows; row++) {
		dvsm_deblock_row(&picture->plan, picture->floats, row);
		dvsm_fixed_deblock_row(&picture->plan, picture->integers, row);
	}
	/* In another order than they lie. */
	for (uint32_t row = grid.rows - 1; row-- > 0;) {
		dvsm_deblock_seam(&picture->plan, picture->floats, row);
		dvsm_fixed_deblock_seam(&picture->plan, picture->integers, row);
	}
}

/* Of both from the plain rule's numbers, the latter in units of 2^-16. */
static void check_picture(const struct picture *picture, double tolerance, double units)
{
	for (uint32_t y = 0; y < picture->height; y++)
		for (uint32_t x = 0; x < picture->width; x++)
			for (uint32_t c = 0; c < 3; c++) {
				double plain =
					picture->plain[((size_t)y * picture->width + x) * 3 + c];
				size_t place = place_of(picture, x, y, c);

				assert_true(fabs(picture->floats[place] - plain) <= tolerance);
				assert_true(fabs(picture->integers[place] - plain * UNIT) <= units);
			}
}

/* Colours of -1..2, of which an excess has up to 12: a weight that is no whole number of 2^-16 is
 * off by half of that, twice. */
static void both_follow_the_plain_rule(void **state)
{
	static const uint32_t shapes[][3] = {
		{8, 4, 3}, {8, 1, 5}, {8, 5, 1}, {8, 1, 1}, {3, 4, 4},  {4, 3, 2},  {5, 2, 3},
		{6, 3, 3}, {7, 2, 2}, {1, 5, 4}, {2, 3, 4}, {16, 2, 2}, {256, 2, 1}};
	struct support_random random = {20261201};

	(void)state;
	for (size_t i = 0; i < sizeof(shapes) / sizeof(*shapes); i++) {
		struct picture picture = make_picture(shapes[i][0], shapes[i][1], shapes[i][2]);

		for (uint32_t y = 0; y < picture.height; y++)
			for (uint32_t x = 0; x < picture.width; x++)
				for (uint32_t c = 0; c < 3; c++)
					set_number(
						&picture, x, y, c,
						(int32_t)(support_random_below(&random, 196609)) -
							65536);
		deblock(&picture);
		check_picture(&picture, 4e-6, 16);
		free_picture(&picture);
	}
}

static void a_slope_stays_as_it_is(void **state)
{
	struct picture picture = make_picture(8, 3, 3);

	(void)state;
	for (uint32_t y = 0; y < picture.height; y++)
		for (uint32_t x = 0; x < picture.width; x++)
			for (uint32_t c = 0; c < 3; c++)
				set_number(&picture, x, y, c,
					   1000 + (int32_t)(c * 700 + x * 128 + y * 256));
	deblock(&picture);
	for (uint32_t y = 0; y < picture.height; y++)
		for (uint32_t x = 0; x < picture.width; x++)
			for (uint32_t c = 0; c < 3; c++) {
				int32_t units = 1000 + (int32_t)(c * 700 + x * 128 + y * 256);
				size_t place = place_of(&picture, x, y, c);

				assert_int_equal(picture.integers[place], units);
				assert_true(picture.floats[place] == (float)(units / UNIT));
			}
	free_picture(&picture);
}

static void integers_keep_to_their_limit(void **state)
{
	struct picture picture = make_picture(8, 4, 4);
	struct support_random random = {20261202};
	uint32_t at_limit = 0;

	(void)state;
	for (size_t i = 0; i < picture.numbers; i++)
		picture.integers[i] = support_random_below(&random, 2) ? DVSM_FIXED_COLOUR_LIMIT
								       : -DVSM_FIXED_COLOUR_LIMIT;
	deblock(&picture);
	for (size_t i = 0; i < picture.numbers; i++) {
		assert_in_range((uint32_t)abs(picture.integers[i]), 0, DVSM_FIXED_COLOUR_LIMIT);
		at_limit += abs(picture.integers[i]) == DVSM_FIXED_COLOUR_LIMIT;
	}
	assert_true(at_limit > 0);
	free_picture(&picture);
}

/* Engines */

enum { SIDE = 48, PATCH = 8, NUMBERS = SIDE * SIDE * 3 };

struct fixture {
	struct dvsm_model *model;
	struct dvsm_view view;
	struct dvsm_camera target;
	float rgb[NUMBERS];
	struct dvsm_error error;
};

static const struct dvsm_model_config small = {
	.dim = 64, .heads = 2, .layers = 2, .patch_px = PATCH, .mlp_ratio = 4, .norm_eps = 1e-6};

static int set_up(void **state)
{
	struct fixture *f = calloc(1, sizeof(*f));
	struct support_random random = {20261203};
	const struct dvsm_camera camera = {
		.width = SIDE,
		.height = SIDE,
		.fx = 50,
		.fy = 50,
		.cx = 23.5,
		.cy = 23.5,
		.world_from_camera = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, -3, 0, 0, 0, 1},
	};

	assert_non_null(f);
	f->model = support_random_model(&small, &random);
	assert_non_null(f->model);
	f->view = support_random_view(&random, &camera, f->rgb);
	f->target = camera;
	f->target.world_from_camera[3] = 0.25;
	*state = f;
	return 0;
}

static int tear_down(void **state)
{
	struct fixture *f = *state;

	dvsm_model_close(f->model);
	free(f);
	return 0;
}

static void render(struct fixture *f, enum dvsm_precision precision, uint32_t threads, bool deblock,
		   float *rgb, uint8_t *bytes)
{
	const struct dvsm_engine_options options = {
		.threads = threads, .precision = precision, .deblock = deblock};
	struct dvsm_engine *engine = NULL;
	struct dvsm_scene *scene = NULL;

	assert_int_equal(dvsm_engine_create(f->model, &options, &engine, &f->error), DVSM_OK);
	assert_int_equal(
		dvsm_reconstruct(engine, &f->view, 1, PATCH, NULL, NULL, &scene, NULL, &f->error),
		DVSM_OK);
	assert_int_equal(dvsm_render(engine, scene, &f->target, PATCH, rgb, NULL, &f->error),
			 DVSM_OK);
	assert_int_equal(dvsm_render_rgb8(engine, scene, &f->target, PATCH, bytes, NULL, &f->error),
			 DVSM_OK);
	dvsm_scene_destroy(scene);
	dvsm_engine_destroy(engine);
}

/* The picture is as large as its patches, so that nothing is resampled behind the seams. */
static void engines_deblock_when_asked_to(void **state)
{
	static const enum dvsm_precision precisions[] = {DVSM_PRECISION_F32, DVSM_PRECISION_BF16,
							 DVSM_PRECISION_FIXED};
	struct fixture *f = *state;
	static float without[NUMBERS], with[NUMBERS], shared[NUMBERS];
	static uint8_t bytes_without[NUMBERS], bytes[NUMBERS], shared_bytes[NUMBERS];
	static double plain[NUMBERS];
	char hash[65];

	for (size_t p = 0; p < sizeof(precisions) / sizeof(*precisions); p++) {
		double changed = 0;

		render(f, precisions[p], 1, false, without, bytes_without);
		render(f, precisions[p], 1, true, with, bytes);
		render(f, precisions[p], 3, true, shared, shared_bytes);
		for (size_t i = 0; i < NUMBERS; i++)
			plain[i] = without[i];
		plain_deblock(plain, PATCH, SIDE, SIDE);
		for (size_t i = 0; i < NUMBERS; i++) {
			assert_true(fabs(with[i] - plain[i]) <=
				    (precisions[p] == DVSM_PRECISION_FIXED ? 4 / UNIT : 4e-6));
			changed = fmax(changed, fabs((double)with[i] - without[i]));
		}
		assert_true(changed > 0.01);
		assert_memory_equal(with, shared, sizeof(with));
		assert_memory_equal(bytes, shared_bytes, sizeof(bytes));
		assert_memory_not_equal(bytes, bytes_without, sizeof(bytes));
	}
	/* Of fixed: the same on every processor. */
	dvsm_hash_bytes(bytes, sizeof(bytes), hash);
	assert_string_equal(hash,
			    "f9e4610c5713023c424f91db4fe92fd73f5781921ca8aa425ad8ae9d8d308929");
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(both_follow_the_plain_rule),
		cmocka_unit_test(a_slope_stays_as_it_is),
		cmocka_unit_test(integers_keep_to_their_limit),
		cmocka_unit_test_setup_teardown(engines_deblock_when_asked_to, set_up, tear_down),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
