#include "viewd/tracker.h"

#include <errno.h>
#include <inttypes.h>
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/eventfd.h>
#include <unistd.h>

#include "dio/clock.h"
#include "ring/ring_client.h"

#define WAIT_NS INT64_C(100000000)
#define OLD_NS  UINT64_C(10000000000) /* no camera keeps a picture for so long */

/* What the loop wants; `changes` counts up when the camera model is another. */
struct wish {
	bool stop;
	enum dio_tracker_task task;
	bool calibrated;
	struct dio_camera_model camera;
	uint32_t width, height;
	enum dio_board_layout layout;
	unsigned changes;
};

struct dio_tracker {
	pthread_t thread;
	pthread_mutex_t lock;
	struct wish wish;         /* under the lock */
	struct dio_tracked ready; /* under the lock */
	bool is_ready;            /* under the lock */
	int event_fd;

	/* The thread's own. */
	struct dio_ring_client *ring;
	bool has_board;
	struct dio_board board;
	struct dio_board_detector *detector;
	struct dio_undistorter *undistorter;
	struct dio_camera_model pinhole;
	struct wish now;
	struct dio_tracked work;
};

/* Detector and undistorter for the camera as it is now. */
static void adopt_camera(struct dio_tracker *tracker, struct dio_tracked *work)
{
	struct dio_board board = tracker->board;
	struct dio_error why = {""};

	dio_undistorter_destroy(tracker->undistorter);
	tracker->undistorter = NULL;
	dio_board_detector_destroy(tracker->detector);
	tracker->detector = NULL;
	if (tracker->now.calibrated && tracker->now.layout != DIO_LAYOUT_AUTO)
		board.layout = tracker->now.layout;
	if (tracker->has_board &&
	    dio_board_detector_create(&board, &tracker->detector, &why) != DIO_OK)
		snprintf(work->fault, sizeof work->fault, "%.190s", why.text);
	if (tracker->now.calibrated &&
	    dio_undistorter_create(&tracker->now.camera, tracker->now.width, tracker->now.height,
				   &tracker->pinhole, &tracker->undistorter, &why) != DIO_OK)
		snprintf(work->fault, sizeof work->fault, "%.190s", why.text);
}

/* Take over what the loop wants by now; false: stop. */
static bool adopt_wish(struct dio_tracker *tracker)
{
	unsigned before = tracker->now.changes;

	pthread_mutex_lock(&tracker->lock);
	tracker->now = tracker->wish;
	pthread_mutex_unlock(&tracker->lock);
	if (tracker->now.stop)
		return false;
	if (tracker->now.changes != before)
		adopt_camera(tracker, &tracker->work);
	return true;
}

static void publish(struct dio_tracker *tracker)
{
	struct dio_tracked former;

	pthread_mutex_lock(&tracker->lock);
	former = tracker->ready;
	tracker->ready = tracker->work;
	tracker->is_ready = true;
	pthread_mutex_unlock(&tracker->lock);
	tracker->work = former;
	eventfd_write(tracker->event_fd, 1);
}

/* Corners, pose and the engine's picture, as far as the task goes. */
static enum dio_status examine(struct dio_tracker *tracker, struct dio_tracked *work,
			       struct dio_error *error)
{
	bool fits = tracker->now.calibrated && work->picture.width == tracker->now.camera.width &&
		    work->picture.height == tracker->now.camera.height;
	struct dio_error why = {""};
	enum dio_status status;

	work->corners.count = 0;
	if (work->task < DIO_TRACKER_FIND || !tracker->detector)
		return DIO_OK;
	status = dio_board_detect(tracker->detector, &work->picture, &work->corners, error);
	if (status != DIO_OK || work->task < DIO_TRACKER_TRACK || !tracker->now.calibrated)
		return status;
	if (!fits)
		return dio_fail(error, DIO_REFUSED,
				"the camera delivers %u x %u pixels and was calibrated at %u x %u: "
				"calibrate again",
				work->picture.width, work->picture.height,
				tracker->now.camera.width, tracker->now.camera.height);
	work->pose_known = work->corners.count > 0 &&
			   dio_pose_from_corners(dio_board_detector_get_board(tracker->detector),
						 &tracker->now.camera, &work->corners,
						 &work->estimate, &why) == DIO_OK;
	if (work->task < DIO_TRACKER_CAPTURE || !work->pose_known || !tracker->undistorter)
		return DIO_OK;
	status = dio_undistorter_apply(tracker->undistorter, &work->picture, &work->undistorted,
				       error);
	if (status != DIO_OK)
		return status;
	dio_keyframe_measure(&work->picture, &work->quality);
	work->pinhole = tracker->pinhole;
	work->undistorted_known = true;
	return DIO_OK;
}

/* A new result in the memory of an old one. */
static void begin_result(struct dio_tracker *tracker)
{
	struct dio_tracked *work = &tracker->work;

	work->task = tracker->now.task;
	work->fresh = work->pose_known = work->undistorted_known = false;
	work->fault[0] = '\0';
}

static void say_camera(struct dio_tracker *tracker)
{
	struct dio_ring_client_status status;

	dio_ring_client_get_status(tracker->ring, &status);
	tracker->work.camera = status.state;
	snprintf(tracker->work.camera_text, sizeof tracker->work.camera_text, "%s", status.text);
}

/* When the picture was taken. A replay, and some drivers, stamp by another clock than ours: then it
 * is when the daemon handed it out. */
static uint64_t time_taken(const struct dio_ring_frame *frame)
{
	uint64_t stamp = frame->frame.timestamp_ns, published = frame->published_ns;

	return stamp <= published && published - stamp < OLD_NS ? stamp : published;
}

static void look_at(struct dio_tracker *tracker, struct dio_ring_frame *frame)
{
	struct dio_tracked *work = &tracker->work;
	uint64_t start_ns = dio_clock_ns();
	struct dio_error why = {""};
	enum dio_status status;

	begin_result(tracker);
	say_camera(tracker);
	status = dio_frame_to_rgb(&frame->frame, &work->picture, &why);
	/* Overtaken by the daemon: the next frame is there already. */
	if (!dio_ring_client_is_whole(tracker->ring, frame))
		return;
	if (status == DIO_OK) {
		work->fresh = true;
		work->timestamp_ns = time_taken(frame);
		work->index = frame->index;
		status = examine(tracker, work, &why);
	}
	if (status != DIO_OK)
		snprintf(work->fault, sizeof work->fault, "%.190s", why.text);
	work->work_ns = dio_clock_ns() - start_ns;
	publish(tracker);
}

static void *track(void *context)
{
	struct dio_tracker *tracker = context;
	enum dio_capture_state said = DIO_CAPTURE_STREAMING;
	struct dio_ring_client_status now;
	struct dio_ring_frame frame;
	struct dio_error why = {""};
	enum dio_status status;

	while (adopt_wish(tracker)) {
		status = dio_ring_client_acquire(tracker->ring, &frame, WAIT_NS, &why);
		if (status == DIO_OK) {
			said = DIO_CAPTURE_STREAMING;
			look_at(tracker, &frame);
			continue;
		}
		/* No frame: say so once a state, and again when it is another. */
		dio_ring_client_get_status(tracker->ring, &now);
		if (now.state == said)
			continue;
		said = now.state;
		begin_result(tracker);
		say_camera(tracker);
		publish(tracker);
	}
	return NULL;
}

static void release(struct dio_tracker *tracker)
{
	dio_undistorter_destroy(tracker->undistorter);
	dio_board_detector_destroy(tracker->detector);
	dio_ring_client_close(tracker->ring);
	dio_tracked_deinit(&tracker->work);
	dio_tracked_deinit(&tracker->ready);
	if (tracker->event_fd >= 0)
		close(tracker->event_fd);
	free(tracker);
}

enum dio_status dio_tracker_start(const struct dio_tracker_options *options,
				  struct dio_tracker **tracker, struct dio_error *error)
{
	const struct dio_ring_client_options ring = {
		.path = options->socket, .name = "diorama-viewd", .order = DIO_RING_NEWEST};
	struct dio_tracker *made = calloc(1, sizeof *made);
	enum dio_status status;
	int result;

	if (!made)
		return dio_fail(error, DIO_NO_MEM, "tracker: no memory");
	made->event_fd = eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK);
	if (options->board) {
		made->board = *options->board;
		made->has_board = true;
	}
	/* The first wish adopts the camera that there is by then, and makes the detector. */
	made->wish.changes = 1;
	status = made->event_fd >= 0 ? dio_ring_client_open(&ring, &made->ring, error)
				     : dio_fail(error, DIO_IO, "tracker: no descriptor left");
	if (status != DIO_OK) {
		release(made);
		return status;
	}
	pthread_mutex_init(&made->lock, NULL);
	result = pthread_create(&made->thread, NULL, track, made);
	if (result != 0) {
		pthread_mutex_destroy(&made->lock);
		release(made);
		return dio_fail(error, dio_status_from_errno(result), "tracker: no thread: %s",
				strerror(result));
	}
	pthread_setname_np(made->thread, "tracker");
	*tracker = made;
	return DIO_OK;
}

void dio_tracker_stop(struct dio_tracker *tracker)
{
	if (!tracker)
		return;
	pthread_mutex_lock(&tracker->lock);
	tracker->wish.stop = true;
	pthread_mutex_unlock(&tracker->lock);
	pthread_join(tracker->thread, NULL);
	pthread_mutex_destroy(&tracker->lock);
	release(tracker);
}

void dio_tracker_set_task(struct dio_tracker *tracker, enum dio_tracker_task task)
{
	pthread_mutex_lock(&tracker->lock);
	tracker->wish.task = task;
	pthread_mutex_unlock(&tracker->lock);
}

void dio_tracker_set_camera(struct dio_tracker *tracker, const struct dio_camera_model *camera,
			    uint32_t width, uint32_t height, enum dio_board_layout layout)
{
	pthread_mutex_lock(&tracker->lock);
	tracker->wish.calibrated = camera != NULL;
	if (camera)
		tracker->wish.camera = *camera;
	tracker->wish.width = width;
	tracker->wish.height = height;
	tracker->wish.layout = layout;
	tracker->wish.changes++;
	pthread_mutex_unlock(&tracker->lock);
}

int dio_tracker_get_fd(const struct dio_tracker *tracker)
{
	return tracker->event_fd;
}

bool dio_tracker_take(struct dio_tracker *tracker, struct dio_tracked *tracked)
{
	struct dio_tracked former = *tracked;
	eventfd_t count;
	bool taken;

	eventfd_read(tracker->event_fd, &count);
	pthread_mutex_lock(&tracker->lock);
	taken = tracker->is_ready;
	if (taken) {
		*tracked = tracker->ready;
		tracker->ready = former;
		tracker->is_ready = false;
	}
	pthread_mutex_unlock(&tracker->lock);
	return taken;
}

void dio_tracked_deinit(struct dio_tracked *tracked)
{
	dio_picture_deinit(&tracked->picture);
	dio_picture_deinit(&tracked->undistorted);
	dio_corners_deinit(&tracked->corners);
	*tracked = (struct dio_tracked){0};
}
