#include "stage.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "camera/sim_truth.h"
#include "dio/calibration.h"
#include "dio/camera.h"
#include "dio/clock.h"

/* A board of the size of a sheet of paper, walked around; near enough that its markers are read
 * from wherever the walk goes: a picture without a pose shows nothing new. */
#define BOARD  "charuco:6x5:0.045:0.036:DICT_6X6_250"
#define SOURCE "sim:table?seed=7&width=320&height=240&fov=45&samples=1&distortion=0&board=" BOARD

static pid_t camera;

/* What a calibration of the simulated camera would find, without its error. */
static void write_calibration(void)
{
	const struct dio_camera_options options = {.as_fast_as_possible = true};
	struct dio_camera *sim = NULL;
	struct dio_error error = {0};
	struct dio_sim_camera truth;
	struct dio_camera_model model = {0};
	struct dio_frame frame;

	if (dio_camera_open(SOURCE, &options, &sim, &error) != DIO_OK ||
	    dio_camera_start(sim, &error) != DIO_OK ||
	    dio_camera_acquire(sim, &frame, 1000000000, &error) != DIO_OK)
		fail_msg("%s", error.text);
	assert_true(dio_sim_camera_get_truth(sim, &truth));
	dio_camera_close(sim);
	model.width = truth.width;
	model.height = truth.height;
	model.fx = truth.fx;
	model.fy = truth.fy;
	model.cx = truth.cx;
	model.cy = truth.cy;
	memcpy(model.dist, truth.dist, sizeof truth.dist);
	mkdir(fixture_path("state"), 0777);
	if (dio_camera_model_write(fixture_path("state/camera.yaml"), DIO_CAMERA_FILE_OPENCV,
				   &model, NULL, &error) != DIO_OK)
		fail_msg("%s", error.text);
}

int stage_setup(void **state)
{
	char text[2048];

	if (daemons_setup(state) != 0)
		return -1;
	write_calibration();
	snprintf(text, sizeof text,
		 "[camera]\nsource = %s\nlock = no\n"
		 "[capture]\nboard = " BOARD "\n"
		 "views_min = 3\nviews_max = 32\nreserve_mib = 1\n"
		 "[display]\noutput = none\nmode = 640x480\nframes_per_second = 60\n"
		 "[engine]\nmodel = %s\nprecision = int8\n"
		 "render_width = 128\nrender_height = 96\n"
		 "[paths]\nstate = %s\nruntime = %s\n",
		 SOURCE, APPLIANCE_MODEL, fixture_path("state"), fixture_path("run"));
	fixture_write("board.ini", text);
	return 0;
}

int stage_teardown(void **state)
{
	return daemons_teardown(state);
}

void stage_start_camera(double frames_per_second)
{
	camera = daemons_start_source(SOURCE, frames_per_second);
}

pid_t stage_get_camera(void)
{
	return camera;
}

double stage_start(double frames_per_second)
{
	uint64_t begun_ns;
	double shown_us = 0;

	stage_start_camera(frames_per_second);
	begun_ns = dio_clock_ns();
	daemons_start_viewer();
	for (int tries = 0; tries < 200 && shown_us <= 0; tries++) {
		usleep(100000);
		shown_us = atof(daemons_get("FirstShownTimestampMonotonic"));
	}
	if (shown_us <= 0)
		fail_msg("no picture of the camera is shown: %s", daemons_read_log());
	return shown_us * 1e-3 - (double)begun_ns * 1e-6;
}

void stage_reconstruct(void)
{
	for (int tries = 0; atoi(daemons_get("Views")) < 3; tries++) {
		if (tries == 600)
			fail_msg("no three views in a minute: %s", daemons_read_log());
		usleep(100000);
	}
	daemons_ctl("reconstruct", NULL);
	daemons_wait("State=view");
	daemons_wait("Source=tracked");
}
