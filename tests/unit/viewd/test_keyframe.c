/* Keyframe choice: what is kept, what is skipped, and the reason given. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>
#include <math.h>
#include <string.h>

#include "viewd/keyframe.h"

#define PI    3.14159265358979323846
#define STEP  UINT64_C(400000000) /* between pictures, ns */
#define REACH 0.8

static const double CENTRE[3] = {0.1, -0.2, 0};
static const struct dio_keyframe_quality SHARP = {.board_seen = true, .sharpness = 1};

/* A camera at `degrees` round the centre, looking along its x axis (no test looks at where). */
static struct dio_pose at(double degrees, double reach)
{
	double angle = degrees * PI / 180;

	return (struct dio_pose){{cos(angle), -sin(angle), 0, CENTRE[0] + reach * cos(angle),
				  sin(angle), cos(angle), 0, CENTRE[1] + reach * sin(angle), 0, 0,
				  1, CENTRE[2], 0, 0, 0, 1}};
}

static int make(void **state)
{
	static struct dio_keyframes keyframes;

	keyframes = (struct dio_keyframes){0};
	dio_keyframe_defaults(8, 4, &keyframes.options);
	*state = &keyframes;
	return 0;
}

static int drop(void **state)
{
	dio_keyframe_deinit(*state);
	return 0;
}

static enum dio_keyframe_verdict judge(struct dio_keyframes *keyframes, struct dio_pose pose,
				       struct dio_keyframe_quality quality, unsigned picture)
{
	return dio_keyframe_judge(keyframes, &quality, &pose, CENTRE, STEP * (picture + 1));
}

static void only_new_viewpoints_are_kept(void **state)
{
	struct dio_keyframes *keyframes = *state;
	struct dio_pose first = at(0, REACH);

	assert_int_equal(judge(keyframes, first, SHARP, 0), DIO_KEYFRAME_KEPT);
	assert_true(dio_keyframe_keep(keyframes, &first));
	assert_int_equal(judge(keyframes, at(7.9, REACH), SHARP, 1), DIO_KEYFRAME_KNOWN);
	assert_int_equal(judge(keyframes, at(8.1, REACH), SHARP, 2), DIO_KEYFRAME_KEPT);
	/* Nearer by a tenth is nothing new, by a quarter it is. */
	assert_int_equal(judge(keyframes, at(0, REACH * 0.9), SHARP, 3), DIO_KEYFRAME_KNOWN);
	assert_int_equal(judge(keyframes, at(0, REACH * 0.75), SHARP, 4), DIO_KEYFRAME_KEPT);
	assert_int_equal(keyframes->verdicts[DIO_KEYFRAME_KNOWN], 2);
	assert_int_equal(keyframes->verdicts[DIO_KEYFRAME_KEPT], 3);
}

static void enough_views_are_enough(void **state)
{
	struct dio_keyframes *keyframes = *state;

	for (unsigned i = 0; i < 4; i++) {
		struct dio_pose pose = at(9.0 * i, REACH);

		assert_int_equal(judge(keyframes, pose, SHARP, i), DIO_KEYFRAME_KEPT);
		assert_true(dio_keyframe_keep(keyframes, &pose));
	}
	assert_int_equal(judge(keyframes, at(36, REACH), SHARP, 4), DIO_KEYFRAME_FULL);
	dio_keyframe_clear(keyframes);
	assert_int_equal(judge(keyframes, at(36, REACH), SHARP, 5), DIO_KEYFRAME_KEPT);
	assert_int_equal(keyframes->verdicts[DIO_KEYFRAME_FULL], 0);
}

static void without_a_pose_the_reason_says_whether_the_board_was_seen(void **state)
{
	struct dio_keyframes *keyframes = *state;
	struct dio_keyframe_quality unseen = {0};

	assert_int_equal(dio_keyframe_judge(keyframes, &unseen, NULL, CENTRE, STEP),
			 DIO_KEYFRAME_NO_BOARD);
	assert_int_equal(dio_keyframe_judge(keyframes, &SHARP, NULL, CENTRE, 2 * STEP),
			 DIO_KEYFRAME_NO_POSE);
}

static void dark_bright_and_blurred_pictures_are_told_apart(void **state)
{
	struct dio_keyframes *keyframes = *state;
	struct dio_keyframe_quality dark = SHARP, bright = SHARP, blurred = SHARP;

	dark.dark = 0.6;
	bright.bright = 0.6;
	blurred.sharpness = 0.4;
	assert_int_equal(judge(keyframes, at(0, REACH), SHARP, 0), DIO_KEYFRAME_KEPT);
	assert_int_equal(judge(keyframes, at(9, REACH), dark, 1), DIO_KEYFRAME_DARK);
	assert_int_equal(judge(keyframes, at(18, REACH), bright, 2), DIO_KEYFRAME_BRIGHT);
	assert_int_equal(judge(keyframes, at(27, REACH), blurred, 3), DIO_KEYFRAME_BLURRED);
	/* Once all pictures are like that, it is the scene: the yardstick follows. */
	for (unsigned i = 0; i < DIO_KEYFRAME_MEMORY; i++)
		judge(keyframes, at(27, REACH), blurred, 4 + i);
	assert_int_equal(judge(keyframes, at(27, REACH), blurred, 40), DIO_KEYFRAME_KEPT);
}

static void a_hasty_camera_is_waited_for(void **state)
{
	struct dio_keyframes *keyframes = *state;

	assert_int_equal(dio_keyframe_judge(keyframes, &SHARP, &(struct dio_pose){{0}}, CENTRE,
					    1) != DIO_KEYFRAME_MOVING,
			 true);
	judge(keyframes, at(0, REACH), SHARP, 1);
	/* 20 degrees in 0.4 s. */
	assert_int_equal(judge(keyframes, at(20, REACH), SHARP, 2), DIO_KEYFRAME_MOVING);
	assert_int_equal(judge(keyframes, at(22, REACH), SHARP, 3), DIO_KEYFRAME_KEPT);
	/* A gap says nothing about speed. */
	assert_int_equal(judge(keyframes, at(90, REACH), SHARP, 6), DIO_KEYFRAME_KEPT);
}

static void fill(struct dio_picture *picture, unsigned kind)
{
	for (uint32_t y = 0; y < picture->height; y++)
		for (uint32_t x = 0; x < picture->width; x++) {
			double wave = kind == 2 ? 127.5 + 120 * sin(x * 0.2)
						: (x / 4 + y / 4) % 2 * 200.0;
			uint8_t value = kind == 0 ? 2 : (uint8_t)wave;

			memset(picture->rgb + 3 * ((size_t)y * picture->width + x), value, 3);
		}
}

static void sharpness_does_not_depend_on_contrast(void **state)
{
	struct dio_keyframe_quality dark, checks, waves, faint;
	struct dio_picture picture = {0};

	(void)state;
	assert_int_equal(dio_picture_init(&picture, 64, 48), DIO_OK);
	fill(&picture, 0);
	dio_keyframe_measure(&picture, &dark);
	assert_true(dark.dark > 0.99 && dark.sharpness == 0);
	fill(&picture, 1);
	dio_keyframe_measure(&picture, &checks);
	for (size_t i = 0; i < (size_t)64 * 48 * 3; i++)
		picture.rgb[i] = (uint8_t)(100 + picture.rgb[i] / 4);
	dio_keyframe_measure(&picture, &faint);
	assert_true(fabs(faint.sharpness / checks.sharpness - 1) < 0.01);
	fill(&picture, 2);
	dio_keyframe_measure(&picture, &waves);
	assert_true(waves.sharpness < 0.2 * checks.sharpness);
	dio_picture_deinit(&picture);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test_setup_teardown(only_new_viewpoints_are_kept, make, drop),
		cmocka_unit_test_setup_teardown(enough_views_are_enough, make, drop),
		cmocka_unit_test_setup_teardown(
			without_a_pose_the_reason_says_whether_the_board_was_seen, make, drop),
		cmocka_unit_test_setup_teardown(dark_bright_and_blurred_pictures_are_told_apart,
						make, drop),
		cmocka_unit_test_setup_teardown(a_hasty_camera_is_waited_for, make, drop),
		cmocka_unit_test(sharpness_does_not_depend_on_contrast),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
