/* view: look at a scene in a window, orbit by mouse and keys. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "commands.h"
#include "core/eye.h"
#include "core/log.h"
#include "core/options.h"
#include "core/orbit.h"
#include "core/path.h"
#include "dio/window.h"
#include "engine_options.h"
#include "report.h"

#define PI            3.14159265358979323846
#define DRAG_TURN_RAD PI        /* a drag across the window turns half round */
#define KEY_TURN_RAD  (PI / 60) /* per step while an arrow key is down */
#define POLL_MS       16

struct view_job {
	struct dio_session_options session;
	const char *source;
	uint32_t width;
};

/* True when the eye moved. */
static bool eye_move(const struct dio_window_input *input, const struct dio_orbit *orbit,
		     struct dio_eye *eye)
{
	double zoom = (double)input->wheel + (double)input->key_zoom;

	if (input->reset)
		dio_eye_reset(orbit, eye);
	dio_eye_turn(
		eye, (double)input->key_x * KEY_TURN_RAD - (double)input->drag_x * DRAG_TURN_RAD,
		(double)input->key_y * KEY_TURN_RAD + (double)input->drag_y * DRAG_TURN_RAD, zoom);
	/* Dragging with the right button carries the point looked at along. */
	dio_eye_pan(eye, -(double)input->pan_x, (double)input->pan_y);
	return input->reset || zoom != 0 || input->drag_x != 0 || input->drag_y != 0 ||
	       input->pan_x != 0 || input->pan_y != 0 || input->key_x != 0 || input->key_y != 0;
}

static enum dio_status open_scene(const struct view_job *job, struct dio_session *session,
				  struct dio_error *error)
{
	size_t length = strlen(job->source);
	struct dio_scene_file file = {0};
	struct dio_view_set set = {0};
	enum dio_status status;

	if (length > 12 && strcmp(job->source + length - 12, ".safetensors") == 0)
		return dio_session_open_scene(session, job->source, error);
	status = dio_scene_file_read(job->source, &file, error);
	if (status == DIO_OK)
		status = dio_view_set_load(&file, DIO_LOAD_CONTEXT, &set, error);
	if (status == DIO_OK)
		status = dio_session_reconstruct(session, set.context, set.context_count, NULL,
						 error);
	dio_view_set_deinit(&set);
	dio_scene_file_deinit(&file);
	return status;
}

/* The first context camera, scaled to the window's width. */
static struct dio_camera_model window_camera(const struct dvsm_scene *scene, uint32_t width)
{
	const struct dvsm_camera *first = dvsm_scene_get_cameras(scene);
	double scale = (width ? width : first->width) / (double)first->width;

	return (struct dio_camera_model){
		.width = width ? width : first->width,
		.height = (uint32_t)fmax(1, floor(first->height * scale + 0.5)),
		.fx = first->fx * scale,
		.fy = first->fy * scale,
		.cx = (first->cx + 0.5) * scale - 0.5,
		.cy = (first->cy + 0.5) * scale - 0.5,
	};
}

static enum dio_status fit_orbit(const struct dvsm_scene *scene, struct dio_orbit *orbit,
				 struct dio_error *error)
{
	uint32_t count = dvsm_scene_get_view_count(scene);
	struct dio_pose *poses = calloc(count, sizeof *poses);

	if (!poses)
		return dio_fail(error, DIO_NO_MEM, "no memory for %u poses", count);
	for (uint32_t i = 0; i < count; i++)
		memcpy(poses[i].world_from_camera,
		       dvsm_scene_get_cameras(scene)[i].world_from_camera,
		       sizeof poses[i].world_from_camera);
	dio_orbit_fit(poses, count, orbit);
	free(poses);
	return DIO_OK;
}

/* The next name that is free: view-000.png and on. */
static void save_picture(const struct dio_picture *picture)
{
	struct dio_error error = {0};
	char name[32];

	for (unsigned i = 0; i < 1000; i++) {
		snprintf(name, sizeof name, "view-%03u.png", i);
		if (dio_path_is_file(name))
			continue;
		if (dio_picture_write(name, picture, &error) == DIO_OK)
			dio_log_note("saved %s", name);
		else
			dio_log_error("view: %s", error.text);
		return;
	}
	dio_log_error("view: view-000.png to view-999.png are all there: clear some away");
}

static enum dio_status look(struct dio_session *session, const struct dio_camera_model *camera,
			    struct dio_window *window, struct dio_error *error)
{
	struct dio_window_input input = {0};
	struct dio_picture picture = {0};
	struct dio_orbit orbit = {0};
	struct dio_pose pose;
	struct dio_eye eye = {0};
	bool moved = true;
	enum dio_status status = fit_orbit(dio_session_get_scene(session), &orbit, error);

	dio_eye_reset(&orbit, &eye);
	while (status == DIO_OK && !input.quit) {
		if (moved) {
			dio_eye_pose(&eye, &pose);
			status = dio_session_render_picture(session, camera, &pose, &picture, NULL,
							    error);
		}
		/* Shown again even when nothing moved: the window may have been uncovered. */
		if (status == DIO_OK)
			status = dio_window_show(window, &picture, error);
		dio_window_poll(window, POLL_MS, &input);
		moved = eye_move(&input, &orbit, &eye);
		if (input.save && status == DIO_OK)
			save_picture(&picture);
	}
	dio_picture_deinit(&picture);
	return status;
}

static enum dio_status view(const struct view_job *job, struct dio_error *error)
{
	struct dio_session *session = NULL;
	struct dio_window *window = NULL;
	struct dio_camera_model camera;
	enum dio_status status = dio_session_open(&job->session, &session, error);

	if (status == DIO_OK)
		status = open_scene(job, session, error);
	if (status == DIO_OK) {
		camera = window_camera(dio_session_get_scene(session), job->width);
		status = dio_window_open("Diorama", camera.width, camera.height, &window, error);
	}
	if (status == DIO_OK) {
		dio_report_engine(session);
		status = look(session, &camera, window, error);
	}
	dio_window_close(window);
	dio_session_close(session);
	return status;
}

int dio_command_view(int argc, char **argv)
{
	struct view_job job = {0};
	const struct dio_option options[] = {
		DIO_OPTION_MODEL(job.session),
		{"width", DIO_OPTION_COUNT, "PX",
		 "width of the rendered picture (default: as captured)", &job.width, 16, 4096,
		 false},
		DIO_OPTION_PATCH_RECON(job.session),
		DIO_OPTION_PATCH_RENDER(job.session),
		DIO_OPTION_THREADS(job.session),
		DIO_OPTION_CPU(job.session),
		DIO_OPTION_PRECISION(job.session),
		DIO_OPTION_DEBLOCKING(job.session),
	};
	const struct dio_usage usage = {
		.command = "view",
		.summary = "look at a scene in a window",
		.arguments = "SCENE",
		.details =
			"SCENE is a scene cache (.safetensors) or a scene.json, which is "
			"reconstructed first.\nDrag or arrow keys turn, right drag moves, wheel "
			"or + and - zoom; r starts over,\ns saves view-NNN.png here, q or Escape "
			"leaves.\n\n" DIO_HELP_PATCH,
		.min_arguments = 1,
		.max_arguments = 1,
		.options = options,
		.option_count = sizeof options / sizeof *options,
	};
	struct dio_error error = {0};
	char **arguments;
	uint32_t count;
	enum dio_options_result result = dio_options_parse(&usage, argc, argv, &arguments, &count);

	if (result != DIO_OPTIONS_RUN)
		return dio_options_exit_code(result);
	job.source = arguments[0];
	if (view(&job, &error) != DIO_OK)
		return dio_report_failure(usage.command, &error);
	return DIO_EXIT_OK;
}
