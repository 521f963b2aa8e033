#include "check.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "camera/sim_truth.h"
#include "dio/camera.h"

#define SMALL "table?seed=7&width=64&height=48&samples=1"

static const struct dio_camera_options fast = {.as_fast_as_possible = true};

static struct dio_camera *start(const char *spec, const struct dio_camera_options *options)
{
	struct dio_camera *camera;
	struct dio_error error;

	assert_ok(dio_camera_open(spec, options, &camera, &error), error);
	assert_ok(dio_camera_start(camera, &error), error);
	return camera;
}

/* Frame number n of a camera, as a copy; release with free(). */
static uint8_t *frame_of(const char *spec, uint64_t n, struct dio_sim_camera *truth)
{
	struct dio_camera *camera = start(spec, &fast);
	struct dio_frame frame;
	struct dio_error error;
	uint8_t *copy;

	do
		assert_ok(dio_camera_acquire(camera, &frame, 0, &error), error);
	while (frame.sequence < n);
	copy = malloc(frame.size_bytes);
	memcpy(copy, frame.data, frame.size_bytes);
	assert_true(dio_sim_camera_get_truth(camera, truth));
	dio_camera_close(camera);
	return copy;
}

static bool same_frame(const char *a, const char *b, uint64_t n, uint64_t m)
{
	struct dio_sim_camera truth;
	uint8_t *first = frame_of(a, n, &truth), *second = frame_of(b, m, &truth);
	bool same = memcmp(first, second, (size_t)64 * 48 * 3) == 0;

	free(first);
	free(second);
	return same;
}

static void frames_follow_from_seed_and_number_alone(void **state)
{
	(void)state;
	assert_true(same_frame("sim:" SMALL, "sim:" SMALL, 3, 3));
	assert_true(same_frame("sim:" SMALL, "sim:" SMALL "&frames=9", 3, 3));
	assert_false(same_frame("sim:" SMALL, "sim:" SMALL, 3, 4));
	assert_false(same_frame("sim:" SMALL, "sim:" SMALL "&seed=8", 3, 3));
	assert_false(same_frame("sim:" SMALL, "sim:" SMALL "&style=dance", 3, 3));
	assert_false(same_frame("sim:" SMALL, "sim:" SMALL "&board=none", 3, 3));
	assert_false(same_frame("sim:" SMALL, "sim:" SMALL "&noise=0", 3, 3));
	assert_false(same_frame("sim:" SMALL, "sim:" SMALL "&exposure=1", 3, 3));
	assert_false(
		same_frame("sim:" SMALL, "sim:room?seed=7&width=64&height=48&samples=1", 3, 3));
}

static void a_frame_does_not_depend_on_those_taken_before_it(void **state)
{
	const struct dio_camera_options paced = {.frames_per_second = 50};
	struct dio_camera *camera = start("sim:" SMALL, &paced);
	struct dio_sim_camera truth, paced_truth;
	struct dio_frame frame;
	struct dio_error error;
	uint8_t *expected;

	(void)state;
	/* At a real camera's pace some numbers are passed over. */
	do
		assert_ok(dio_camera_acquire(camera, &frame, 1000000000, &error), error);
	while (frame.sequence < 4);
	assert_true(dio_sim_camera_get_truth(camera, &paced_truth));
	expected = frame_of("sim:" SMALL "&fps=50", frame.sequence, &truth);
	assert_memory_equal(frame.data, expected, frame.size_bytes);
	assert_memory_equal(&truth, &paced_truth, sizeof(truth));
	free(expected);
	dio_camera_close(camera);
}

static void truth_is_a_camera_near_the_wish_with_a_true_pose(void **state)
{
	const char *spec = "sim:table?seed=3&width=640&height=480&fov=60&distortion=1&samples=1";
	struct dio_sim_camera truth;
	double r[9];

	(void)state;
	free(frame_of(spec, 1, &truth));
	assert_int_equal(truth.width, 640);
	/* 320 / tan 30 = 554 within a factory's scatter. */
	assert_true(fabs(truth.fx / 554.256 - 1) < 0.0101);
	assert_true(fabs(truth.fy / truth.fx - 1) < 0.0021 && truth.fy != truth.fx);
	assert_true(fabs(truth.cx - 319.5) <= 6.4 && fabs(truth.cy - 239.5) <= 4.8);
	assert_true(truth.dist[0] < -0.25 && truth.dist[0] > -0.3);
	for (int i = 0; i < 9; i++)
		r[i] = truth.world_from_camera[i / 3 * 4 + i % 3];
	for (int i = 0; i < 3; i++) {
		for (int j = 0; j < 3; j++) {
			double dot = r[i] * r[j] + r[3 + i] * r[3 + j] + r[6 + i] * r[6 + j];

			assert_true(fabs(dot - (i == j)) < 1e-9);
		}
	}
	assert_true(truth.world_from_camera[11] > 0.05); /* above the table */
	free(frame_of("sim:" SMALL "&distortion=0", 1, &truth));
	for (int i = 0; i < 5; i++)
		assert_true(truth.dist[i] == 0);
}

static void truth_is_withheld_where_there_is_none(void **state)
{
	struct dio_camera *camera = start("sim:" SMALL, &fast);
	struct dio_sim_camera truth;

	(void)state;
	assert_false(dio_sim_camera_get_truth(NULL, &truth));
	assert_false(dio_sim_camera_get_truth(camera, &truth));
	assert_non_null(dio_sim_camera_get_scene(camera));
	assert_null(dio_sim_camera_get_scene(NULL));
	dio_camera_close(camera);
}

static void it_ends_after_the_frames_that_were_asked_for(void **state)
{
	struct dio_camera *camera = start("sim:" SMALL "&frames=3&fps=10", &fast);
	struct dio_camera_info info;
	struct dio_frame frame;
	struct dio_error error;

	(void)state;
	dio_camera_get_info(camera, &info);
	assert_int_equal(info.frame_count, 3);
	assert_true(info.frames_per_second == 10);
	for (uint64_t i = 0; i < 3; i++) {
		assert_ok(dio_camera_acquire(camera, &frame, 0, &error), error);
		assert_int_equal(frame.timestamp_ns, i * 100000000);
	}
	assert_fails(dio_camera_acquire(camera, &frame, 0, &error), DIO_END, error, "all 3");
	dio_camera_close(camera);
}

static void wishes_override_the_words(void **state)
{
	const struct dio_camera_options options = {
		.width = 32, .height = 24, .frames_per_second = 5, .as_fast_as_possible = true};
	struct dio_camera *camera = start("sim:" SMALL, &options);
	struct dio_camera_info info;
	struct dio_frame frame;
	struct dio_error error;

	(void)state;
	dio_camera_get_info(camera, &info);
	assert_int_equal(info.width, 32);
	assert_true(info.frames_per_second == 5);
	assert_ok(dio_camera_acquire(camera, &frame, 0, &error), error);
	assert_int_equal(frame.height, 24);
	dio_camera_close(camera);
}

static void words_that_cannot_be_read_are_named(void **state)
{
	static const struct {
		const char *spec, *word;
	} bad[] = {
		{"sim:", "unknown scene ''"},
		{"sim:desk", "'desk'"},
		{"sim:table?sed=7", "'sed'"},
		{"sim:table?seed", "'seed' has no value"},
		{"sim:table?seed=-1", "seed=-1"},
		{"sim:table?seed=7x", "seed=7x"},
		{"sim:table?seed=99999999999999999999", "seed=9999"},
		{"sim:table?width=15", "from 16 to 4096"},
		{"sim:table?height=100000", "height=100000"},
		{"sim:table?width=", "width="},
		{"sim:table?fps=0", "fps=0"},
		{"sim:table?fps=nan", "fps=nan"},
		{"sim:table?noise=2", "noise=2"},
		{"sim:table?noise=0.1abc", "noise=0.1abc"},
		{"sim:table?distortion=-3", "distortion=-3"},
		{"sim:table?style=run", "walk or dance"},
		{"sim:table?samples=9", "samples=9"},
		{"sim:table?board=chessboard:9x6:0.025", "board=chessboard"},
		{"sim:table?board=charuco:10x7:0.0285:0.0171:DICT_4X4_50", "DICT_6X6_250"},
		{"sim:table?board=charuco:10x7:0.0171:0.0285:DICT_6X6_250", "marker smaller"},
		{"sim:table?board=charuco:2x7:0.0285:0.0171:DICT_6X6_250", "3..40"},
		{"sim:table?board=charuco:10x7:0.0285:0.0171:DICT_6X6_250:new", "legacy"},
		{"sim:table?seed=7&&width=1", "width=1"},
	};

	(void)state;
	for (size_t i = 0; i < sizeof(bad) / sizeof(bad[0]); i++) {
		struct dio_camera *camera = NULL;
		struct dio_error error;

		assert_fails(dio_camera_open(bad[i].spec, &fast, &camera, &error), DIO_BAD_ARG,
			     error, bad[i].word);
		assert_null(camera);
	}
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(frames_follow_from_seed_and_number_alone),
		cmocka_unit_test(a_frame_does_not_depend_on_those_taken_before_it),
		cmocka_unit_test(truth_is_a_camera_near_the_wish_with_a_true_pose),
		cmocka_unit_test(truth_is_withheld_where_there_is_none),
		cmocka_unit_test(it_ends_after_the_frames_that_were_asked_for),
		cmocka_unit_test(wishes_override_the_words),
		cmocka_unit_test(words_that_cannot_be_read_are_named),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
