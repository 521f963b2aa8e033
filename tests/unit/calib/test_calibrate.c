/* Calibration from corners whose camera is known: what it finds, what it says of itself, what it
 * refuses. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "support.h"

enum { MAX_VIEWS = 40 };

static const struct dio_camera_model truth = {
	640, 480, 620, 615, 325, 236, {-0.22, 0.08, 0, 0, 0},
};

struct sample {
	struct dio_board board;
	struct dio_corners corners[MAX_VIEWS];
	uint32_t count;
	uint64_t seed;
};

static void sample_init(struct sample *sample, uint64_t seed)
{
	memset(sample, 0, sizeof(*sample));
	sample->board = board_of("chessboard:9x6:0.025");
	sample->seed = seed;
}

static void sample_add(struct sample *sample, const struct dio_camera_model *camera,
		       const struct dio_pose *pose, double sigma_px)
{
	assert_true(sample->count < MAX_VIEWS);
	project_corners(&sample->board, camera, pose, sigma_px, &sample->seed,
			&sample->corners[sample->count++]);
}

/* Views from all round, the board reaching every part of the picture in turn. */
static struct dio_pose varied_pose(uint32_t i)
{
	double azimuth = 137.5 * i * M_PI / 180, elevation = (45 + 8 * (i % 5)) * M_PI / 180;
	double distance = 0.36 + 0.03 * (i % 4);
	const double eye[3] = {distance * cos(elevation) * cos(azimuth),
			       distance * cos(elevation) * sin(azimuth), distance * sin(elevation)};
	const double target[3] = {0.06 * ((int)(i % 3) - 1), 0.05 * ((int)(i / 3 % 3) - 1), 0};

	return look_at(eye, target, 20.0 * (i % 7));
}

static void add_varied(struct sample *sample, const struct dio_camera_model *camera, uint32_t count,
		       double sigma_px)
{
	for (uint32_t i = 0; i < count; i++) {
		struct dio_pose pose = varied_pose(i);

		sample_add(sample, camera, &pose, sigma_px);
	}
}

static void sample_free(struct sample *sample)
{
	for (uint32_t i = 0; i < sample->count; i++)
		dio_corners_deinit(&sample->corners[i]);
}

static enum dio_status calibrate(const struct sample *sample, struct dio_calibration *calibration,
				 struct dio_error *error)
{
	return dio_calibrate(&sample->board, sample->corners, sample->count, truth.width,
			     truth.height, NULL, calibration, error);
}

static void calibrate_well(const struct sample *sample, struct dio_calibration *calibration)
{
	struct dio_error error = {""};

	if (calibrate(sample, calibration, &error) != DIO_OK)
		fail_msg("%s", error.text);
}

static void known_camera_is_found_within_its_own_sigmas(void **state)
{
	struct sample sample;
	struct dio_calibration c = {0};

	(void)state;
	sample_init(&sample, 1);
	add_varied(&sample, &truth, 20, 0.1);
	calibrate_well(&sample, &c);
	assert_int_equal(c.views_used, 20);
	assert_true(fabs(c.model.fx - truth.fx) < 4 * c.sigma_fx);
	assert_true(fabs(c.model.fy - truth.fy) < 4 * c.sigma_fy);
	assert_true(fabs(c.model.cx - truth.cx) < 4 * c.sigma_cx);
	assert_true(fabs(c.model.cy - truth.cy) < 4 * c.sigma_cy);
	assert_true(fabs(c.model.dist[0] - truth.dist[0]) < 4 * c.sigma_dist[0]);
	assert_true(fabs(c.model.dist[1] - truth.dist[1]) < 4 * c.sigma_dist[1]);
	assert_true(c.sigma_fx < 1);
	/* Noise of 0.1 px on each axis is 0.141 px a corner; poses and lens take a little of it. */
	assert_true(c.rms_px > 0.13 && c.rms_px < 0.145);
	assert_true(c.heldout_rms_px > c.rms_px * 0.98 && c.heldout_rms_px < c.rms_px * 1.1);
	assert_true(c.coverage > 0.7);
	assert_true(c.tilt_deg > 50);
	dio_calibration_deinit(&c);
	sample_free(&sample);
}

static void sigmas_are_the_scatter_of_repeated_calibrations(void **state)
{
	enum { REPEATS = 24 };
	double sum = 0, sum2 = 0, stated = 0;

	(void)state;
	for (uint32_t i = 0; i < REPEATS; i++) {
		struct sample sample;
		struct dio_calibration c = {0};

		sample_init(&sample, 100 + i);
		add_varied(&sample, &truth, 10, 0.2);
		calibrate_well(&sample, &c);
		sum += c.model.fx;
		sum2 += c.model.fx * c.model.fx;
		stated += c.sigma_fx / REPEATS;
		dio_calibration_deinit(&c);
		sample_free(&sample);
	}
	double scatter = sqrt((sum2 - sum * sum / REPEATS) / (REPEATS - 1));

	print_message("fx scatters by %.3f px, stated sigma %.3f px\n", scatter, stated);
	/* The scatter of 24 is itself known to 15 percent. */
	assert_true(scatter / stated > 0.6 && scatter / stated < 1.6);
	assert_true(fabs(sum / REPEATS - truth.fx) < 4 * stated / sqrt(REPEATS));
}

static void tangential_and_third_radial_terms_are_found_when_there(void **state)
{
	struct dio_camera_model lens = truth;
	struct sample sample;
	struct dio_calibration c = {0};

	(void)state;
	lens.dist[2] = 0.004;
	lens.dist[3] = -0.003;
	sample_init(&sample, 7);
	add_varied(&sample, &lens, 20, 0.1);
	calibrate_well(&sample, &c);
	assert_true(fabs(c.model.dist[2] - lens.dist[2]) < 0.0005);
	assert_true(fabs(c.model.dist[3] - lens.dist[3]) < 0.0005);
	assert_true(c.sigma_dist[2] > 0);
	dio_calibration_deinit(&c);
	sample_free(&sample);

	lens = truth;
	lens.dist[0] = -0.35;
	lens.dist[4] = -0.25;
	sample_init(&sample, 8);
	add_varied(&sample, &lens, 20, 0.05);
	calibrate_well(&sample, &c);
	assert_true(fabs(c.model.dist[4] - lens.dist[4]) < 4 * c.sigma_dist[4]);
	assert_true(c.sigma_dist[4] > 0);
	dio_calibration_deinit(&c);
	sample_free(&sample);
}

/* Tangential terms too small to tell by eye: a picture changes by some 0.02 px, but a fit without
 * them puts the principal point well off. */
static void small_tangential_terms_are_found_or_stated_as_doubt(void **state)
{
	enum { REPEATS = 4, CASES = 2 };
	static const double p1[CASES] = {5e-4, 2e-4}, sigma_px[CASES] = {0.04, 0.1};
	static const uint32_t views[CASES] = {30, 15};

	(void)state;
	for (uint32_t i = 0; i < CASES * REPEATS; i++) {
		struct dio_camera_model lens = truth;
		struct sample sample;
		struct dio_calibration c = {0};

		lens.dist[2] = p1[i / REPEATS];
		lens.dist[3] = -0.6 * lens.dist[2];
		sample_init(&sample, 200 + i);
		add_varied(&sample, &lens, views[i / REPEATS], sigma_px[i / REPEATS]);
		calibrate_well(&sample, &c);
		print_message("p1 %.1e: cx %+.2f +- %.2f, cy %+.2f +- %.2f, p1 %.1e +- %.1e\n",
			      lens.dist[2], c.model.cx - lens.cx, c.sigma_cx, c.model.cy - lens.cy,
			      c.sigma_cy, c.model.dist[2], c.sigma_dist[2]);
		assert_true(fabs(c.model.cx - lens.cx) < 3.5 * c.sigma_cx);
		assert_true(fabs(c.model.cy - lens.cy) < 3.5 * c.sigma_cy);
		assert_true(fabs(c.model.dist[2] - lens.dist[2]) < 3.5 * c.sigma_dist[2]);
		assert_true(fabs(c.model.dist[3] - lens.dist[3]) < 3.5 * c.sigma_dist[3]);
		if (i < REPEATS)
			assert_true(c.model.dist[2] != 0);
		dio_calibration_deinit(&c);
		sample_free(&sample);
	}
}

/* A board held so that it bends: the corners of a view are off together, each view its own way. */
static void bend(struct sample *sample, double by_px)
{
	for (uint32_t i = 0; i < sample->count; i++) {
		struct dio_corners *corners = &sample->corners[i];
		double coefficients[6];

		for (int k = 0; k < 6; k++)
			coefficients[k] = by_px * noise(&sample->seed);
		for (uint32_t at = 0; at < corners->count; at++) {
			double x = corners->board_m[at][0] / 0.1 - 1;
			double y = corners->board_m[at][1] / 0.0625 - 1;

			for (int axis = 0; axis < 2; axis++) {
				const double *k = coefficients + 3 * axis;

				corners->image_px[at][axis] +=
					(float)(k[0] * x * x + k[1] * x * y + k[2] * y * y);
			}
		}
	}
}

static void errors_that_a_view_shares_widen_the_sigmas(void **state)
{
	enum { REPEATS = 8, PARAMETERS = 4 };
	uint32_t within = 0;

	(void)state;
	for (uint32_t i = 0; i < REPEATS; i++) {
		struct sample sample;
		struct dio_calibration c = {0};

		sample_init(&sample, 300 + i);
		add_varied(&sample, &truth, 15, 0.05);
		bend(&sample, 0.15);
		calibrate_well(&sample, &c);
		within += fabs(c.model.fx - truth.fx) < 2 * c.sigma_fx;
		within += fabs(c.model.fy - truth.fy) < 2 * c.sigma_fy;
		within += fabs(c.model.cx - truth.cx) < 2 * c.sigma_cx;
		within += fabs(c.model.cy - truth.cy) < 2 * c.sigma_cy;
		dio_calibration_deinit(&c);
		sample_free(&sample);
	}
	print_message("%u of %u within two sigmas\n", within, REPEATS * PARAMETERS);
	/* 95 percent are expected; fx and fy go together, so the count scatters by more than
	 * a binomial one. */
	assert_true(within >= REPEATS * PARAMETERS * 4 / 5);
}

static void terms_that_are_not_there_stay_zero(void **state)
{
	struct sample sample;
	struct dio_calibration c = {0};

	(void)state;
	sample_init(&sample, 11);
	add_varied(&sample, &truth, 12, 0.3);
	calibrate_well(&sample, &c);
	assert_true(c.model.dist[2] == 0 && c.model.dist[3] == 0 && c.model.dist[4] == 0);
	for (int i = 2; i < 5; i++)
		assert_true(c.sigma_dist[i] > 0);
	dio_calibration_deinit(&c);

	struct dio_calibration_options options;

	dio_calibration_defaults(&options);
	options.fix_k3 = true;
	assert_int_equal(dio_calibrate(&sample.board, sample.corners, sample.count, truth.width,
				       truth.height, &options, &c, NULL),
			 DIO_OK);
	assert_true(c.model.dist[4] == 0 && c.sigma_dist[4] == 0);
	dio_calibration_deinit(&c);
	sample_free(&sample);
}

static bool count_down(void *context)
{
	int *left = context;

	return (*left)-- > 0;
}

static void a_fit_is_given_up_between_any_two_steps(void **state)
{
	struct dio_calibration_options options;
	struct dio_calibration c = {0};
	struct dio_error error = {""};
	enum dio_status status = DIO_REFUSED;
	struct sample sample;
	int steps = 0;

	(void)state;
	sample_init(&sample, 17);
	add_varied(&sample, &truth, 12, 0.1);
	dio_calibration_defaults(&options);
	options.keep_going = count_down;
	for (; status == DIO_REFUSED && steps < 100; steps++) {
		int left = steps;

		options.context = &left;
		status = dio_calibrate(&sample.board, sample.corners, sample.count, truth.width,
				       truth.height, &options, &c, &error);
		if (status == DIO_REFUSED)
			assert_non_null(strstr(error.text, "cancelled"));
	}
	assert_int_equal(status, DIO_OK);
	assert_true(steps > 3);
	dio_calibration_deinit(&c);
	sample_free(&sample);
}

/* Half the corners of a view carried off, as when another board or a reflection was taken. */
static void spoil(struct dio_corners *corners, double by_px)
{
	for (uint32_t i = 0; i < corners->count; i += 2) {
		corners->image_px[i][0] += (float)by_px;
		corners->image_px[i][1] -= (float)by_px;
	}
}

static void bad_views_are_left_out_with_a_reason(void **state)
{
	struct sample sample;
	struct dio_calibration c = {0};

	(void)state;
	sample_init(&sample, 2);
	add_varied(&sample, &truth, 15, 0.1);
	spoil(&sample.corners[3], 4);
	spoil(&sample.corners[8], 40);
	calibrate_well(&sample, &c);
	assert_int_equal(c.views_used, 13);
	for (uint32_t i = 0; i < c.views_total; i++) {
		bool bad = i == 3 || i == 8;

		assert_int_equal(c.views[i].use, bad ? DIO_VIEW_OUTLIER : DIO_VIEW_USED);
		assert_int_equal(strlen(c.views[i].reason) > 0, bad);
		assert_true(bad ? c.views[i].rms_px > 2 : c.views[i].rms_px < 0.3);
	}
	assert_true(fabs(c.model.fx - truth.fx) < 4 * c.sigma_fx);
	dio_calibration_deinit(&c);
	sample_free(&sample);
}

static void views_of_another_zoom_are_left_out(void **state)
{
	struct dio_camera_model zoomed = truth;
	struct sample sample;
	struct dio_calibration c = {0};

	(void)state;
	zoomed.fx *= 1.3;
	zoomed.fy *= 1.3;
	sample_init(&sample, 3);
	for (uint32_t i = 0; i < 15; i++) {
		struct dio_pose pose = varied_pose(i);

		sample_add(&sample, i == 4 || i == 9 ? &zoomed : &truth, &pose, 0.1);
	}
	calibrate_well(&sample, &c);
	assert_int_equal(c.views[4].use, DIO_VIEW_OUTLIER);
	assert_int_equal(c.views[9].use, DIO_VIEW_OUTLIER);
	assert_true(fabs(c.model.fx - truth.fx) < 4 * c.sigma_fx);
	dio_calibration_deinit(&c);
	sample_free(&sample);
}

static void pictures_without_a_board_or_a_new_viewpoint_are_listed(void **state)
{
	struct sample sample;
	struct dio_calibration c = {0};
	struct dio_pose pose = varied_pose(0);

	(void)state;
	sample_init(&sample, 4);
	add_varied(&sample, &truth, 10, 0.1);
	sample_add(&sample, &truth, &pose, 0.1);
	sample_add(&sample, &truth, &pose, 0.1);
	sample.corners[11].count = 0;
	sample_add(&sample, &truth, &pose, 0.1);
	sample.corners[12].count = 5;
	calibrate_well(&sample, &c);
	assert_int_equal(c.views_total, 13);
	assert_int_equal(c.views_used, 10);
	assert_int_equal(c.views[10].use, DIO_VIEW_DUPLICATE);
	assert_non_null(strstr(c.views[10].reason, "picture 1"));
	assert_int_equal(c.views[11].use, DIO_VIEW_NO_BOARD);
	assert_int_equal(c.views[12].use, DIO_VIEW_NO_BOARD);
	assert_non_null(strstr(c.views[12].reason, "5 corners"));
	dio_calibration_deinit(&c);
	sample_free(&sample);
}

static void expect_refusal(struct sample *sample, const char *reason)
{
	struct dio_calibration c = {0};
	struct dio_error error = {""};

	assert_int_equal(calibrate(sample, &c, &error), DIO_REFUSED);
	print_message("%s\n", error.text);
	if (reason && !strstr(error.text, reason))
		fail_msg("'%s' does not say '%s'", error.text, reason);
	assert_int_equal(c.views_total, sample->count);
	dio_calibration_deinit(&c);
	sample_free(sample);
}

static void too_few_views_are_refused(void **state)
{
	struct sample sample;

	(void)state;
	sample_init(&sample, 5);
	expect_refusal(&sample, "0 usable views");
	sample_init(&sample, 5);
	add_varied(&sample, &truth, 3, 0.1);
	expect_refusal(&sample, "3 usable views");
}

static void views_from_straight_above_are_refused(void **state)
{
	struct sample sample;

	(void)state;
	/* A camera and a board that nobody moved. */
	sample_init(&sample, 6);
	for (uint32_t i = 0; i < 10; i++) {
		struct dio_pose pose = orbit(0, 89.9, 0.4, 0);

		sample_add(&sample, &truth, &pose, 0.1);
	}
	expect_refusal(&sample, "9 repeat a viewpoint");
	/* Nearly the same place, by hand. */
	sample_init(&sample, 6);
	for (uint32_t i = 0; i < 10; i++) {
		struct dio_pose pose = orbit(36 * i, 89, 0.4 + 0.01 * i, -36.0 * i);

		sample_add(&sample, &truth, &pose, 0.1);
	}
	expect_refusal(&sample, "tilt");
	/* The board moved about in its plane: many places, no tilt. */
	sample_init(&sample, 6);
	for (uint32_t i = 0; i < 10; i++) {
		const double eye[3] = {0.06 * ((int)(i % 3) - 1), 0.05 * ((int)(i / 3) - 1), 0.4};
		const double target[3] = {eye[0], eye[1], 0};
		struct dio_pose pose = look_at(eye, target, 10.0 * i);

		sample_add(&sample, &truth, &pose, 0.1);
	}
	expect_refusal(&sample, "tilt");
}

static void board_in_the_middle_only_is_refused(void **state)
{
	struct sample sample;

	(void)state;
	sample_init(&sample, 9);
	for (uint32_t i = 0; i < 12; i++) {
		struct dio_pose pose = orbit(30 * i, 60, 1.5, 7.0 * i);

		sample_add(&sample, &truth, &pose, 0.05);
	}
	expect_refusal(&sample, "cover");
}

static void half_the_views_spoiled_is_refused(void **state)
{
	const double by_px[] = {3, 10, 60};

	(void)state;
	for (uint32_t k = 0; k < 3; k++) {
		struct sample sample;

		sample_init(&sample, 10);
		add_varied(&sample, &truth, 14, 0.1);
		for (uint32_t i = 0; i < 14; i += 2)
			spoil(&sample.corners[i], by_px[k]);
		expect_refusal(&sample, NULL);
	}
}

static void half_the_views_of_another_zoom_is_refused(void **state)
{
	struct dio_camera_model zoomed = truth;
	struct sample sample;

	(void)state;
	zoomed.fx *= 1.25;
	zoomed.fy *= 1.25;
	sample_init(&sample, 12);
	for (uint32_t i = 0; i < 16; i++) {
		struct dio_pose pose = varied_pose(i);

		sample_add(&sample, i % 2 ? &zoomed : &truth, &pose, 0.1);
	}
	expect_refusal(&sample, NULL);
}

static void corners_all_in_one_row_are_no_view(void **state)
{
	struct sample sample;
	struct dio_calibration c = {0};

	(void)state;
	sample_init(&sample, 13);
	add_varied(&sample, &truth, 8, 0.1);
	for (uint32_t i = 0; i < sample.count; i++)
		sample.corners[i].count = 9;
	assert_int_equal(calibrate(&sample, &c, NULL), DIO_REFUSED);
	for (uint32_t i = 0; i < sample.count; i++)
		assert_int_equal(c.views[i].use, DIO_VIEW_NO_BOARD);
	dio_calibration_deinit(&c);
	sample_free(&sample);
}

static void corners_that_are_not_numbers_are_refused(void **state)
{
	struct sample sample;
	struct dio_calibration c = {0};
	struct dio_error error = {""};

	(void)state;
	sample_init(&sample, 14);
	add_varied(&sample, &truth, 8, 0.1);
	sample.corners[2].image_px[5][1] = NAN;
	assert_int_equal(calibrate(&sample, &c, &error), DIO_BAD_ARG);
	assert_non_null(strstr(error.text, "not finite"));
	dio_calibration_deinit(&c);
	sample_free(&sample);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(known_camera_is_found_within_its_own_sigmas),
		cmocka_unit_test(sigmas_are_the_scatter_of_repeated_calibrations),
		cmocka_unit_test(tangential_and_third_radial_terms_are_found_when_there),
		cmocka_unit_test(small_tangential_terms_are_found_or_stated_as_doubt),
		cmocka_unit_test(errors_that_a_view_shares_widen_the_sigmas),
		cmocka_unit_test(terms_that_are_not_there_stay_zero),
		cmocka_unit_test(bad_views_are_left_out_with_a_reason),
		cmocka_unit_test(views_of_another_zoom_are_left_out),
		cmocka_unit_test(pictures_without_a_board_or_a_new_viewpoint_are_listed),
		cmocka_unit_test(too_few_views_are_refused),
		cmocka_unit_test(views_from_straight_above_are_refused),
		cmocka_unit_test(board_in_the_middle_only_is_refused),
		cmocka_unit_test(half_the_views_spoiled_is_refused),
		cmocka_unit_test(half_the_views_of_another_zoom_is_refused),
		cmocka_unit_test(a_fit_is_given_up_between_any_two_steps),
		cmocka_unit_test(corners_all_in_one_row_are_no_view),
		cmocka_unit_test(corners_that_are_not_numbers_are_refused),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
