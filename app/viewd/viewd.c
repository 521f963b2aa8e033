#include "viewd/viewd.h"

#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "core/log.h"
#include "core/path.h"
#include "dio/calibration.h"
#include "dio/clock.h"

#define TICK_US UINT64_C(250000) /* figures, devices that come back, LEDs */

void dio_viewd_say(struct dio_viewd *viewd, bool alarm, const char *format, ...)
{
	char text[sizeof viewd->status.message] = ""; /* compared to its end */
	va_list arguments;

	va_start(arguments, format);
	vsnprintf(text, sizeof text, format, arguments);
	va_end(arguments);
	if (strcmp(text, viewd->status.message) == 0 && viewd->status.alarm == alarm)
		return;
	memcpy(viewd->status.message, text, sizeof text);
	viewd->status.alarm = alarm;
	if (!*text)
		return;
	if (alarm)
		dio_log_error("%s", text);
	else
		dio_log_note("%s", text);
}

static bool has_space(const struct dio_viewd *viewd, uint64_t bytes)
{
	struct dio_error ignored;

	return dio_store_check_space(viewd->store, bytes, &ignored) == DIO_OK;
}

static struct dio_viewd_facts gather_facts(const struct dio_viewd *viewd)
{
	const struct dio_profile *profile = viewd->profile;
	uint64_t picture =
		(uint64_t)profile->engine.render_width * profile->engine.render_height * 4;

	return (struct dio_viewd_facts){
		.board_known = viewd->has_board,
		.calibrated = viewd->calibrated,
		.engine_opening = viewd->engine_opening,
		.engine_ready = viewd->engine_ready,
		.camera_streaming = viewd->tracked.camera == DIO_CAPTURE_STREAMING,
		.pose_known = viewd->tracked.undistorted_known,
		.scene_there = viewd->scene_there,
		.views_closed = viewd->views_closed,
		.reconstruct_due = viewd->due_at_start,
		.space_for_views = has_space(viewd, picture * profile->capture.views_max),
		.space_for_scene = has_space(viewd, dio_viewd_scene_bytes(viewd)),
		.gathered = viewd->gathered.count,
		.views = viewd->views,
		.views_min = profile->capture.views_min,
	};
}

/* What a state looks for in the camera's pictures. */
static void set_task(struct dio_viewd *viewd)
{
	static const enum dio_tracker_task TASKS[DIO_VIEWD_STATE_COUNT] = {
		[DIO_VIEWD_IDLE] = DIO_TRACKER_LOOK,
		[DIO_VIEWD_CALIBRATE] = DIO_TRACKER_FIND,
		[DIO_VIEWD_CAPTURE] = DIO_TRACKER_CAPTURE,
		[DIO_VIEWD_RECONSTRUCT] = DIO_TRACKER_LOOK,
		[DIO_VIEWD_VIEW] = DIO_TRACKER_TRACK,
		[DIO_VIEWD_PLAY] = DIO_TRACKER_LOOK,
	};

	dio_tracker_set_task(viewd->tracker, TASKS[viewd->machine.state]);
}

/* A word on what to do next. */
static void greet(struct dio_viewd *viewd)
{
	switch (viewd->machine.state) {
	case DIO_VIEWD_IDLE:
		dio_viewd_say(viewd, false, "%s",
			      viewd->calibrated ? "ready" : "ready; the camera is not calibrated");
		break;
	case DIO_VIEWD_CALIBRATE:
		dio_viewd_say(viewd, false,
			      "calibrating: show the board near, far, tilted, into the corners");
		break;
	case DIO_VIEWD_CAPTURE:
		dio_viewd_say(viewd, false, "capturing: walk the camera round the scene");
		break;
	case DIO_VIEWD_RECONSTRUCT:
		dio_viewd_say(viewd, false, "reconstructing from %u views", viewd->views);
		break;
	case DIO_VIEWD_VIEW:
		dio_viewd_say(viewd, false, "viewing");
		break;
	case DIO_VIEWD_PLAY:
		dio_viewd_say(viewd, false, "playing");
		break;
	case DIO_VIEWD_STATE_COUNT:
		break;
	}
}

static void enter_state(struct dio_viewd *viewd, bool says)
{
	dio_figures_clear(&viewd->figures);
	set_task(viewd);
	if (viewd->machine.state != DIO_VIEWD_CALIBRATE)
		atomic_fetch_add(&viewd->fit_number, 1); /* cancelled, if one is under way */
	dio_viewpoint_play(&viewd->viewpoint, viewd->machine.state == DIO_VIEWD_PLAY,
			   dio_clock_ns());
	viewd->rendered_taken_ns = 0;
	viewd->take_now = false;
	if (says)
		greet(viewd);
}

static void carry_out(struct dio_viewd *viewd, uint32_t orders)
{
	if (orders & DIO_VIEWD_CANCEL_ENGINE)
		atomic_store(&viewd->cancel, true);
	if (orders & DIO_VIEWD_BEGIN_GATHER)
		dio_viewd_begin_gather(viewd);
	if (orders & DIO_VIEWD_FIT)
		dio_viewd_fit(viewd);
	if (orders & DIO_VIEWD_BEGIN_VIEWS)
		dio_viewd_begin_views(viewd);
	if (orders & DIO_VIEWD_TAKE_VIEW)
		viewd->take_now = true;
	if (orders & DIO_VIEWD_RECONSTRUCT_NOW)
		dio_viewd_reconstruct(viewd);
	if (orders & DIO_VIEWD_QUIT) {
		viewd->quitting = true;
		sd_event_exit(viewd->loop, 0);
	}
}

static enum dio_status step(struct dio_viewd *viewd, const struct dio_viewd_event *event,
			    uint32_t *orders, struct dio_error *error)
{
	const struct dio_viewd_facts facts = gather_facts(viewd);
	enum dio_viewd_state before = viewd->machine.state;
	enum dio_status status =
		dio_viewd_machine_step(&viewd->machine, event, &facts, orders, error);

	/* News that change the state bring their own message. */
	if (viewd->machine.state != before)
		enter_state(viewd, event->kind == DIO_VIEWD_ASKED ||
					   event->kind == DIO_VIEWD_STARTED ||
					   event->kind == DIO_VIEWD_VIEWS_FULL);
	carry_out(viewd, *orders);
	dio_viewd_set_leds(viewd);
	dio_viewd_refresh(viewd);
	return status;
}

enum dio_status dio_viewd_ask(struct dio_viewd *viewd, enum dio_action action,
			      struct dio_error *error)
{
	const struct dio_viewd_event event = {.kind = DIO_VIEWD_ASKED, .action = action};
	struct dio_error why = {""};
	uint32_t orders = 0;
	enum dio_status status = step(viewd, &event, &orders, &why);

	if (status != DIO_OK) {
		dio_viewd_say(viewd, true, "%s", why.text);
		dio_viewd_refresh(viewd);
		return dio_fail(error, status, "%s", why.text);
	}
	if (orders & DIO_VIEWD_QUIT)
		viewd->power_off = true;
	return DIO_OK;
}

void dio_viewd_tell(struct dio_viewd *viewd, enum dio_viewd_event_kind kind)
{
	const struct dio_viewd_event event = {.kind = kind};
	struct dio_error ignored;
	uint32_t orders = 0;

	step(viewd, &event, &orders, &ignored);
}

static int on_tick(sd_event_source *source, uint64_t now_us, void *context)
{
	struct dio_viewd *viewd = context;

	dio_viewd_open_devices(viewd);
	dio_viewd_page_tick(viewd);
	dio_viewd_show_tick(viewd);
	dio_viewd_refresh(viewd);
	sd_event_source_set_time(source, now_us + TICK_US);
	return sd_event_source_set_enabled(source, SD_EVENT_ONESHOT);
}

static int on_tracker(sd_event_source *source, int fd, uint32_t events, void *context)
{
	(void)source;
	(void)fd;
	(void)events;
	dio_viewd_look(context);
	return 0;
}

static int on_worker(sd_event_source *source, int fd, uint32_t events, void *context)
{
	(void)source;
	(void)fd;
	(void)events;
	dio_worker_dispatch(context);
	return 0;
}

/* The loop's sources that live as long as the daemon. */
static enum dio_status watch(struct dio_viewd *viewd, struct dio_error *error)
{
	struct dio_worker *const workers[] = {viewd->engine, viewd->files, viewd->screen};
	int result = sd_event_add_io(viewd->loop, NULL, dio_tracker_get_fd(viewd->tracker), EPOLLIN,
				     on_tracker, viewd);

	for (size_t i = 0; result >= 0 && i < sizeof workers / sizeof workers[0]; i++)
		result = sd_event_add_io(viewd->loop, NULL, dio_worker_get_fd(workers[i]), EPOLLIN,
					 on_worker, workers[i]);
	if (result >= 0)
		result = sd_event_add_time_relative(viewd->loop, NULL, CLOCK_MONOTONIC, 0, 1000,
						    on_tick, viewd);
	if (result < 0)
		return dio_fail(error, DIO_IO, "event loop: %s", strerror(-result));
	return DIO_OK;
}

/* The camera as the last calibration left it. */
static enum dio_status open_calibration(struct dio_viewd *viewd, struct dio_error *error)
{
	const char *named = viewd->profile->camera.calibration;
	struct dio_camera_model camera;
	struct dio_error why = {""};
	enum dio_status status;

	viewd->camera_file =
		*named ? strdup(named) : dio_path_join(viewd->profile->paths.state, "camera.yaml");
	if (!viewd->camera_file)
		return dio_fail(error, DIO_NO_MEM, "no memory");
	status = dio_camera_model_read(viewd->camera_file, &camera, &why);
	if (status == DIO_OK)
		status = dio_viewd_set_camera(viewd, &camera, DIO_LAYOUT_AUTO, &why);
	/* A file that is damaged is no reason not to start: one can calibrate again. */
	if (status != DIO_OK && status != DIO_NOT_FOUND)
		dio_viewd_say(viewd, true, "%s", why.text);
	return DIO_OK;
}

/* What the last run left in the store. */
static enum dio_status open_store(struct dio_viewd *viewd, struct dio_error *error)
{
	const struct dio_profile *profile = viewd->profile;
	struct dio_store_report report;
	const struct dio_camera_model *camera;
	enum dio_status status =
		dio_store_open(profile->paths.state, (uint64_t)profile->capture.reserve_mib << 20,
			       &viewd->store, &report, error);

	if (status != DIO_OK)
		return status;
	if (*report.text)
		dio_viewd_say(viewd, true, "%s", report.text);
	if (dio_store_get_folder(viewd->store))
		viewd->capture_folder = strdup(dio_store_get_folder(viewd->store));
	viewd->views = dio_store_get_count(viewd->store);
	viewd->due_at_start = dio_store_is_due(viewd->store);
	camera = dio_store_get_camera(viewd->store);
	viewd->views_closed = dio_store_has_scene(viewd->store) ||
			      (camera && !dio_camera_model_equal(camera, &viewd->pinhole));
	for (uint32_t i = 0; i < viewd->views; i++)
		if (!dio_keyframe_keep(&viewd->keyframes, &dio_store_get_poses(viewd->store)[i]))
			return dio_fail(error, DIO_NO_MEM, "no memory for %u views", viewd->views);
	return DIO_OK;
}

static enum dio_status open_threads(struct dio_viewd *viewd, struct dio_error *error)
{
	char *socket = dio_path_join(viewd->profile->paths.runtime, "frames");
	const struct dio_tracker_options tracker = {
		.socket = socket, .board = viewd->has_board ? &viewd->board : NULL};
	enum dio_status status = socket ? dio_worker_create("engine", &viewd->engine, error)
					: dio_fail(error, DIO_NO_MEM, "no memory");

	if (status == DIO_OK)
		status = dio_worker_create("files", &viewd->files, error);
	if (status == DIO_OK)
		status = dio_worker_create("screen", &viewd->screen, error);
	if (status == DIO_OK)
		status = dio_tracker_start(&tracker, &viewd->tracker, error);
	free(socket);
	return status;
}

enum dio_status dio_viewd_open(const struct dio_viewd_options *options, sd_event *loop,
			       struct dio_viewd *viewd, struct dio_error *error)
{
	const struct dio_profile *profile = options->profile;
	enum dio_status status = DIO_OK;

	*viewd = (struct dio_viewd){.profile = profile, .loop = loop, .bus_address = options->bus};
	viewd->tracked.camera = DIO_CAPTURE_ABSENT;
	viewd->has_board = *profile->capture.board != '\0';
	if (viewd->has_board)
		status = dio_board_parse(profile->capture.board, &viewd->board, error);
	dio_keyframe_defaults(profile->capture.new_view_deg, profile->capture.views_max,
			      &viewd->keyframes.options);
	if (status == DIO_OK)
		status = dio_folder_make(profile->paths.state, error);
	if (status == DIO_OK)
		status = open_threads(viewd, error);
	if (status == DIO_OK)
		status = open_calibration(viewd, error);
	if (status == DIO_OK)
		status = open_store(viewd, error);
	if (status == DIO_OK)
		status = dio_viewd_open_bus(viewd, error);
	if (status == DIO_OK)
		status = watch(viewd, error);
	if (status != DIO_OK)
		return status;
	if (!*viewd->status.message)
		greet(viewd);
	dio_viewd_open_engine(viewd);
	dio_viewd_open_devices(viewd);
	dio_viewd_refresh(viewd);
	return DIO_OK;
}

void dio_viewd_close(struct dio_viewd *viewd)
{
	viewd->quitting = true;
	atomic_store(&viewd->cancel, true);
	atomic_fetch_add(&viewd->fit_number, 1);
	dio_tracker_stop(viewd->tracker);
	/* Their last done() may post to one another; nothing is begun any more. */
	dio_worker_destroy(viewd->screen);
	dio_worker_destroy(viewd->engine);
	dio_worker_destroy(viewd->files);
	viewd->screen = viewd->engine = viewd->files = NULL;
	dio_viewd_close_devices(viewd);
	dio_bus_close(viewd->bus);
	dio_session_close(viewd->session);
	dio_store_close(viewd->store);
	dio_viewpoint_deinit(&viewd->viewpoint);
	dio_keyframe_deinit(&viewd->keyframes);
	dio_trajectory_deinit(&viewd->walk);
	dio_board_views_deinit(&viewd->gathered);
	dio_tracked_deinit(&viewd->tracked);
	dio_viewd_release_pictures(viewd);
	free(viewd->capture_folder);
	free(viewd->camera_file);
}
