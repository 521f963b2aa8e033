/* Both daemons, from the board to the picture on the display. The tests build on one another. */
#include "unit/viewd/daemons.h"

#include <math.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "core/path.h"
#include "core/session.h"
#include "dio/pose.h"
#include "support/files.h"

#define WIDTH       64u
#define HEIGHT      48u
#define PSNR_MIN_DB 50.0 /* the pose goes through the digits of a TUM file */

static void what_cannot_be_is_refused_in_one_line(void **state)
{
	struct fixture_run run;

	(void)state;
	daemons_expect_refusal("calibrate", "diorama-viewd is not running|systemctl start");
	daemons_start_viewer();
	assert_string_equal(daemons_get("State"), "idle");
	daemons_expect_refusal("capture", "not calibrated");
	daemons_expect_refusal("reconstruct", "0 views of at least 3");
	daemons_expect_refusal("play", "no scene");
	daemons_expect_refusal("save", "nothing to save");
	daemons_expect_refusal("follow", "no scene");
	daemons_expect_refusal("lock", "diorama-captured is not running");
	fixture_diorama(&run, "ctl", "dance", NULL);
	fixture_expect_refusal(&run, 1, "dance|no such word");
	fixture_diorama(&run, "ctl", "turn", "1", "x", "1", NULL);
	fixture_expect_refusal(&run, 1, "turn takes");
	fixture_diorama(&run, "ctl", "--timeout", "0", "wait", "State=view", NULL);
	fixture_expect_refusal(&run, 1, "State=view|it is idle");
	assert_string_equal(daemons_get("Camera"), "absent");
}

static void the_camera_is_calibrated_from_live_frames(void **state)
{
	(void)state;
	daemons_ctl("calibrate", NULL);
	daemons_wait("State=calibrate");
	/* A busy machine sees few of the pictures: then they come again, slower. */
	for (double rate = 6; rate > 1 && strcmp(daemons_get("Calibrated"), "true") != 0;
	     rate /= 2) {
		daemons_start_camera("dance", rate);
		daemons_wait("Camera=streaming");
		daemons_wait("Camera=ended");
		if (atof(daemons_get("Coverage")) < 0.45)
			continue;
		if (strcmp(daemons_get("State"), "calibrate") == 0)
			daemons_ctl("calibrate", NULL);
		daemons_wait("Calibrated=true");
	}
	daemons_wait("Calibrated=true");
	daemons_wait("State=idle");
	assert_true(dio_path_is_file(fixture_path("state/camera.yaml")));
}

static void views_are_chosen_and_a_scene_is_made(void **state)
{
	struct fixture_run run;

	(void)state;
	daemons_ctl("capture", NULL);
	daemons_wait("State=capture");
	/* Five views are enough by the profile: then it goes on by itself. */
	for (double rate = 2.5; rate > 0.7 && atoi(daemons_get("Views")) < 5; rate /= 2) {
		daemons_start_camera("walk", rate);
		daemons_wait("Camera=streaming");
		do {
			fixture_diorama(&run, "ctl", "--timeout", "1", "wait", "Views=5", NULL);
		} while (run.code != 0 && strcmp(daemons_get("Camera"), "ended") != 0);
	}
	daemons_wait("State=view");
	assert_string_equal(daemons_get("Views"), "5");
	assert_string_equal(daemons_get("Scene"), "true");
	assert_true(dio_path_is_file(fixture_path("state/captures/000001/scene.safetensors")));
	assert_true(dio_path_is_file(fixture_path("state/captures/000001/path.tum")));
	assert_false(dio_path_is_file(fixture_path("state/captures/000001/reconstruct.due")));
	assert_non_null(strstr(daemons_get("Skipped"), "{"));
}

/* What was saved as seen, beside what `diorama render` makes of the same scene and pose. */
static void compare_with_render(const char *name, const char *deblock)
{
	char scene[256], path[256], out[256], png[256];
	struct dio_picture rendered = {0}, seen = {0};
	struct dio_error error = {0};
	unsigned char *npy;
	struct fixture_run run;
	size_t size, numbers = (size_t)WIDTH * HEIGHT * 3;
	double psnr;

	snprintf(scene, sizeof scene, "state/scenes/%s/scene.safetensors", name);
	snprintf(path, sizeof path, "state/scenes/%s/view.tum", name);
	snprintf(png, sizeof png, "state/scenes/%s/view.png", name);
	snprintf(out, sizeof out, "render-%s", name);
	fixture_diorama(&run, "render", "--model", fixture_path("tiny.safetensors"),
			"--scene-cache", fixture_path(scene), "--path", fixture_path(path), "--out",
			fixture_path(out), "--raw", "--deblock", deblock, "--patch-render", "8",
			"--threads", "1", NULL);
	if (run.code != 0)
		fail_msg("%s", run.err);
	snprintf(out, sizeof out, "render-%s/frames.npy", name);
	npy = support_read_file(fixture_path(out), &size);
	assert_non_null(npy);
	assert_true(size > numbers * sizeof(float));
	assert_int_equal(dio_picture_init(&rendered, WIDTH, HEIGHT), DIO_OK);
	dio_picture_from_float((const float *)(const void *)(npy + size - numbers * sizeof(float)),
			       &rendered);
	if (dio_picture_read(fixture_path(png), &seen, &error) != DIO_OK)
		fail_msg("%s", error.text);
	psnr = dio_metrics_psnr(&rendered, &seen);
	printf("%s: %.1f dB beside diorama render\n", name, psnr);
	assert_true(psnr >= PSNR_MIN_DB);
	free(npy);
	dio_picture_deinit(&rendered);
	dio_picture_deinit(&seen);
}

static void the_tracked_view_is_what_render_renders(void **state)
{
	(void)state;
	daemons_start_camera("walk", 5);
	daemons_wait("Source=tracked");
	daemons_ctl("save", "tracked");
	compare_with_render("tracked", "on");
	assert_true(atof(daemons_get("LatencyMs")) > 0);
	/* The pictures end: tracking is lost, and the scene is shown all the same. */
	daemons_wait("Camera=ended");
	daemons_wait("Source=orbit");
	daemons_ctl("save", "orbit");
	compare_with_render("orbit", "on");
}

static void play_turn_and_follow_change_where_it_is_seen_from(void **state)
{
	struct fixture_run run;

	(void)state;
	daemons_ctl("play", NULL);
	daemons_wait("State=play");
	daemons_wait("Source=path");
	daemons_ctl("play", NULL);
	daemons_wait("State=view");
	fixture_diorama(&run, "ctl", "turn", "0.3", "-0.1", "1", NULL);
	assert_int_equal(run.code, 0);
	daemons_wait("Source=hand");
	daemons_ctl("follow", NULL);
	daemons_wait("Source=orbit");
	fixture_diorama(&run, "ctl", "turn", "nan", "0", "0", NULL);
	fixture_expect_refusal(&run, 1, "radians");
}

/* Share of a picture's pixels whose channels differ by more than grey text and ground do. */
static double share_of_colour(const char *path)
{
	struct dio_picture picture = {0};
	struct dio_error error = {0};
	size_t coloured = 0, pixels;

	if (dio_picture_read(path, &picture, &error) != DIO_OK)
		return 0;
	pixels = (size_t)picture.width * picture.height;
	for (size_t i = 0; i < pixels; i++) {
		const uint8_t *rgb = picture.rgb + 3 * i;
		int low = rgb[0] < rgb[1] ? rgb[0] : rgb[1],
		    high = rgb[0] > rgb[1] ? rgb[0] : rgb[1];

		low = rgb[2] < low ? rgb[2] : low;
		high = rgb[2] > high ? rgb[2] : high;
		coloured += high - low > 24;
	}
	dio_picture_deinit(&picture);
	return (double)coloured / (double)pixels;
}

static void the_page_shows_the_scene_in_a_browser(void **state)
{
	struct fixture_run run;
	char option[300], profile[300], wait[32];
	double share = 0;

	(void)state;
	fixture_program(&run, "sh", "-c", "command -v chromium", NULL);
	if (run.code != 0) {
		printf("skipped: chromium is not installed\n");
		skip();
	}
	snprintf(option, sizeof option, "--screenshot=%s", fixture_path("page.png"));
	snprintf(profile, sizeof profile, "--user-data-dir=%s", fixture_path("chromium"));
	/* A busy machine may need longer until the first picture is there. */
	for (int timeout_ms = 5000; timeout_ms <= 40000 && share < 0.1; timeout_ms *= 2) {
		snprintf(wait, sizeof wait, "--timeout=%d", timeout_ms);
		fixture_program(&run, "timeout", "90", "chromium", "--headless", "--no-sandbox",
				"--disable-gpu", "--window-size=1200,800", profile, wait, option,
				daemons_get_page(), NULL);
		share = share_of_colour(fixture_path("page.png"));
	}
	printf("page: %.0f %% of the screenshot is the scene\n", share * 100);
	/* The render of random weights is a field of colours; everything else is grey but a button.
	 */
	assert_true(share > 0.1);
}

static void a_killed_viewer_opens_its_scene_again(void **state)
{
	(void)state;
	assert_int_equal(daemons_stop_viewer(SIGKILL), -1);
	daemons_start_viewer();
	daemons_wait("State=view");
	assert_string_equal(daemons_get("Views"), "5");
	assert_string_equal(daemons_get("Calibrated"), "true");
	daemons_end_viewer(SIGTERM);
}

static void a_reconstruction_is_taken_up_after_a_kill(void **state)
{
	(void)state;
	/* As a kill in the middle of it leaves it. */
	assert_int_equal(unlink(fixture_path("state/captures/000001/scene.safetensors")), 0);
	fixture_write("state/captures/000001/reconstruct.due", "");
	daemons_start_viewer();
	daemons_wait("State=view");
	assert_true(dio_path_is_file(fixture_path("state/captures/000001/scene.safetensors")));
	assert_false(dio_path_is_file(fixture_path("state/captures/000001/reconstruct.due")));
	daemons_end_viewer(SIGTERM);
}

static void a_damaged_scene_is_made_again_from_its_views(void **state)
{
	(void)state;
	fixture_write("state/captures/000001/scene.safetensors", "no scene at all");
	daemons_start_viewer();
	daemons_wait("State=view");
	assert_non_null(strstr(daemons_read_log(), "scene.safetensors"));
}

static void the_camera_may_go_and_come_back(void **state)
{
	(void)state;
	daemons_start_camera("walk", 5);
	daemons_wait("Camera=streaming");
	daemons_stop_camera();
	daemons_wait("Camera=absent");
	assert_string_equal(daemons_get("State"), "view");
	daemons_start_camera("walk", 5);
	daemons_wait("Camera=streaming");
	daemons_wait("Source=tracked");
}

static void a_full_disk_is_refused_before_it_starts(void **state)
{
	(void)state;
	daemons_end_viewer(SIGTERM);
	/* A reserve that no disk has. */
	daemons_write_profile(1048576, "auto");
	daemons_start_viewer();
	daemons_wait("State=view");
	daemons_expect_refusal("capture", "disk|free some space");
	daemons_expect_refusal("save", "disk|free some space");
	assert_string_equal(daemons_get("State"), "view");
	daemons_end_viewer(SIGTERM);
	daemons_write_profile(1, "off");
}

static void the_profile_has_the_last_word_on_deblocking(void **state)
{
	(void)state;
	daemons_start_viewer();
	daemons_wait("Source=orbit");
	daemons_ctl("save", "seamed");
	compare_with_render("seamed", "off");
	daemons_end_viewer(SIGTERM);
}

static void shutdown_ends_the_daemon_cleanly(void **state)
{
	(void)state;
	daemons_start_viewer();
	daemons_wait("State=view");
	daemons_ctl("shutdown", NULL);
	/* The signal finds it gone, or on its way out: either way it ends by itself. */
	daemons_end_viewer(0);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(what_cannot_be_is_refused_in_one_line),
		cmocka_unit_test(the_camera_is_calibrated_from_live_frames),
		cmocka_unit_test(views_are_chosen_and_a_scene_is_made),
		cmocka_unit_test(the_tracked_view_is_what_render_renders),
		cmocka_unit_test(play_turn_and_follow_change_where_it_is_seen_from),
		cmocka_unit_test(the_page_shows_the_scene_in_a_browser),
		cmocka_unit_test(a_killed_viewer_opens_its_scene_again),
		cmocka_unit_test(a_reconstruction_is_taken_up_after_a_kill),
		cmocka_unit_test(a_damaged_scene_is_made_again_from_its_views),
		cmocka_unit_test(the_camera_may_go_and_come_back),
		cmocka_unit_test(a_full_disk_is_refused_before_it_starts),
		cmocka_unit_test(the_profile_has_the_last_word_on_deblocking),
		cmocka_unit_test(shutdown_ends_the_daemon_cleanly),
	};

	return cmocka_run_group_tests(tests, daemons_setup, daemons_teardown);
}
