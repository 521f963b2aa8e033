#include "viewd/viewd.h"

#include <stdlib.h>
#include <string.h>

#include "core/path.h"
#include "dio/calibration.h"
#include "dio/clock.h"

#define TICK_US  UINT64_C(250000)     /* figures, what nothing else calls for */
#define RETRY_NS UINT64_C(2000000000) /* devices that come back */

/* Bus and devices that are missing, as often as it makes sense to look for them. */
static void keep_devices(struct dio_viewd *viewd)
{
	uint64_t now_ns = dio_clock_ns();

	if (now_ns < viewd->devices_due_ns)
		return;
	viewd->devices_due_ns = now_ns + RETRY_NS;
	dio_viewd_keep_bus(viewd);
	dio_viewd_open_devices(viewd);
}

static int on_tick(sd_event_source *source, uint64_t now_us, void *context)
{
	struct dio_viewd *viewd = context;

	keep_devices(viewd);
	dio_viewd_page_tick(viewd);
	dio_viewd_show_tick(viewd);
	viewd->news = true;
	sd_event_source_set_time(source, now_us + TICK_US);
	return sd_event_source_set_enabled(source, SD_EVENT_ONESHOT);
}

/* After whatever happened on the loop, before anything else does: who asks next is told the new
 * state. */
static int on_happened(sd_event_source *source, void *context)
{
	struct dio_viewd *viewd = context;

	(void)source;
	if (!viewd->news)
		return 0;
	viewd->news = false;
	dio_viewd_set_leds(viewd);
	dio_viewd_publish(viewd);
	return 0;
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
	sd_event_source *happened = NULL;
	int result = sd_event_add_io(viewd->loop, NULL, dio_tracker_get_fd(viewd->tracker), EPOLLIN,
				     on_tracker, viewd);

	for (size_t i = 0; result >= 0 && i < sizeof workers / sizeof workers[0]; i++)
		result = sd_event_add_io(viewd->loop, NULL, dio_worker_get_fd(workers[i]), EPOLLIN,
					 on_worker, workers[i]);
	if (result >= 0)
		result = sd_event_add_time_relative(viewd->loop, NULL, CLOCK_MONOTONIC, 0, 1000,
						    on_tick, viewd);
	if (result >= 0)
		result = sd_event_add_post(viewd->loop, &happened, on_happened, viewd);
	if (result >= 0)
		result = sd_event_source_set_priority(happened, SD_EVENT_PRIORITY_IMPORTANT);
	if (result >= 0)
		result = sd_event_source_set_floating(happened, true);
	sd_event_source_unref(happened);
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

	*viewd = (struct dio_viewd){
		.profile = profile,
		.loop = loop,
		.bus_address = options->bus,
		.on_event = dio_viewd_take_event,
	};
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
		dio_viewd_greet(viewd);
	dio_viewd_open_engine(viewd);
	keep_devices(viewd);
	dio_viewd_publish(viewd);
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
