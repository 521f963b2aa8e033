#include "captured/camera_thread.h"

#include <errno.h>
#include <inttypes.h>
#include <pthread.h>
#include <stdatomic.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include <unistd.h>

#include "captured/rate.h"
#include "captured/steady.h"
#include "core/log.h"
#include "dio/clock.h"

#define NS_PER_MS 1000000ull
#define NS_PER_S  1000000000ull
/* How long one wait for a frame may be: so often stop, wishes and the heartbeat are looked at. */
#define SLICE_NS (100 * NS_PER_MS)
/* Pauses between tries to open. A replugged camera is found within the longest. */
#define PAUSE_MIN_NS (50 * NS_PER_MS)
#define PAUSE_MAX_NS (500 * NS_PER_MS)
/* Exposure and gain are read while they may vary, so that readers see what they are. */
#define READ_PERIOD_NS NS_PER_S

struct dio_camera_thread {
	pthread_t thread;
	const struct dio_captured_settings *settings;
	struct dio_ring_server *ring;
	struct dio_recording *recording;
	int changed_fd;

	pthread_mutex_t lock; /* guards status and what is asked */
	pthread_cond_t asked;
	struct dio_capture_status status;
	bool stop;
	bool hold_asked, hold_wish;

	/* The thread's own. */
	struct dio_camera *camera; /* NULL: closed */
	uint64_t pause_ns;         /* before the next try to open */
	uint64_t opened_ns, last_frame_ns, last_read_ns;
	uint64_t frames; /* since it was opened */
	bool failed;     /* since the last frame */
	bool hold;       /* is wished */
	uint64_t settle_until_ns;
	struct dio_steady steady;
	struct dio_rate rate;
	struct dio_camera_counters before; /* of the openings before this one */
};

const char *dio_hold_state_name(enum dio_hold_state state)
{
	switch (state) {
	case DIO_HOLD_AUTOMATIC:
		return "automatic";
	case DIO_HOLD_SETTLING:
		return "settling";
	case DIO_HOLD_HELD:
		return "held";
	case DIO_HOLD_PARTLY:
		return "partly held";
	case DIO_HOLD_NOT_OFFERED:
		return "not offered";
	}
	return "unknown";
}

/* Wake whoever shows the status; an eventfd that is full wakes it as well. */
static void tell_changed(const struct dio_camera_thread *thread)
{
	const uint64_t one = 1;

	if (write(thread->changed_fd, &one, sizeof(one)) < 0 && errno != EAGAIN)
		dio_log_warn("status: eventfd: %s", strerror(errno));
}

/* Log on change of state only; a fault that repeats while we try again is one fault. */
static void set_state(struct dio_camera_thread *thread, enum dio_capture_state state,
		      const char *text)
{
	struct dio_capture_status *status = &thread->status;
	bool other_state, other_text;

	pthread_mutex_lock(&thread->lock);
	other_state = status->state != state;
	other_text = strcmp(status->text, text) != 0;
	status->state = state;
	snprintf(status->text, sizeof(status->text), "%s", text);
	if (state != DIO_CAPTURE_STREAMING)
		status->rate = 0;
	pthread_mutex_unlock(&thread->lock);
	if (!other_state && !other_text)
		return;
	if (other_state)
		dio_log_note("%s%s%s", dio_capture_state_name(state), text[0] ? ": " : "", text);
	dio_ring_server_set_state(thread->ring, state, text);
	tell_changed(thread);
}

static bool are_same(const struct dio_camera_controls *a, const struct dio_camera_controls *b)
{
	const struct dio_frame_metadata *m = &a->metadata, *n = &b->metadata;

	return a->offered == b->offered && a->flicker == b->flicker &&
	       m->exposure_us == n->exposure_us && m->gain == n->gain &&
	       m->white_balance_k == n->white_balance_k && m->red_gain == n->red_gain &&
	       m->blue_gain == n->blue_gain && m->locked == n->locked;
}

static void set_hold_state(struct dio_camera_thread *thread, enum dio_hold_state state,
			   bool settled, const struct dio_camera_controls *controls)
{
	struct dio_capture_status *status = &thread->status;
	bool other;

	pthread_mutex_lock(&thread->lock);
	other = status->hold != state;
	status->hold = state;
	status->settled = settled;
	if (controls) {
		other = other || !are_same(&status->controls, controls);
		status->controls = *controls;
	}
	pthread_mutex_unlock(&thread->lock);
	if (other)
		tell_changed(thread);
}

static void add_counters(struct dio_camera_counters *sum, const struct dio_camera_counters *more)
{
	sum->delivered += more->delivered;
	sum->drained += more->drained;
	sum->lost += more->lost;
	sum->broken += more->broken;
}

static void update_counters(struct dio_camera_thread *thread)
{
	struct dio_camera_counters sum = thread->before, now = {0};

	if (thread->camera)
		dio_camera_get_counters(thread->camera, &now);
	add_counters(&sum, &now);
	pthread_mutex_lock(&thread->lock);
	thread->status.counters = sum;
	thread->status.rate = dio_rate_get(&thread->rate);
	pthread_mutex_unlock(&thread->lock);
}

static void close_camera(struct dio_camera_thread *thread)
{
	struct dio_camera_counters now;

	if (!thread->camera)
		return;
	dio_camera_get_counters(thread->camera, &now);
	add_counters(&thread->before, &now);
	dio_camera_close(thread->camera);
	thread->camera = NULL;
	thread->settle_until_ns = 0;
	dio_rate_reset(&thread->rate);
	update_counters(thread);
	set_hold_state(thread, thread->hold ? DIO_HOLD_SETTLING : DIO_HOLD_AUTOMATIC, false, NULL);
}

/* What a failure means to those who look on. A stalled stream stays one until a frame comes,
 * however often the device is opened anew without one. */
static enum dio_capture_state state_of_failure(const struct dio_camera_thread *thread,
					       enum dio_status status)
{
	switch (status) {
	case DIO_NOT_FOUND:
	case DIO_GONE:
		return DIO_CAPTURE_UNPLUGGED;
	case DIO_IO:
	case DIO_AGAIN:
		return thread->frames > 0 || thread->status.state == DIO_CAPTURE_STALLED
			       ? DIO_CAPTURE_STALLED
			       : DIO_CAPTURE_REFUSED;
	default:
		return DIO_CAPTURE_REFUSED;
	}
}

/* Close, show why, and try again after a pause that grows while there is no success. */
static void give_up(struct dio_camera_thread *thread, enum dio_status status,
		    const struct dio_error *error)
{
	enum dio_capture_state state = state_of_failure(thread, status);

	thread->failed = true;
	close_camera(thread);
	set_state(thread, state, error->text);
}

static void begin_settling(struct dio_camera_thread *thread)
{
	dio_steady_reset(&thread->steady);
	thread->settle_until_ns =
		dio_clock_ns() + (uint64_t)thread->settings->settle_ms * NS_PER_MS;
	set_hold_state(thread, DIO_HOLD_SETTLING, false, NULL);
}

/* Tell the camera, and show what it made of it. */
static void apply_wish(struct dio_camera_thread *thread, bool hold, bool settled)
{
	struct dio_camera_wish wish = thread->settings->wish;
	struct dio_camera_controls done = {0};
	enum dio_hold_state state = DIO_HOLD_AUTOMATIC;
	struct dio_error error;
	enum dio_status status;

	wish.hold = hold;
	status = dio_camera_set_controls(thread->camera, &wish, &done, &error);
	if (status != DIO_OK && status != DIO_UNSUPPORTED)
		dio_log_warn("%s", error.text);
	if (hold) {
		state = DIO_HOLD_PARTLY;
		if (done.offered == 0)
			state = DIO_HOLD_NOT_OFFERED;
		else if ((done.offered & ~done.metadata.locked) == 0)
			state = DIO_HOLD_HELD;
		dio_log_note("exposure, gain and white balance: %s%s", dio_hold_state_name(state),
			     settled ? "" : ", before the picture had come to rest");
	}
	set_hold_state(thread, state, settled, &done);
	thread->last_read_ns = dio_clock_ns();
}

static void open_camera(struct dio_camera_thread *thread)
{
	const struct dio_captured_settings *settings = thread->settings;
	struct dio_camera_info info;
	struct dio_error error;
	enum dio_status status =
		dio_camera_open(settings->camera, &settings->options, &thread->camera, &error);

	if (status == DIO_OK)
		status = dio_camera_start(thread->camera, &error);
	thread->frames = 0;
	if (status != DIO_OK) {
		give_up(thread, status, &error);
		return;
	}
	dio_camera_get_info(thread->camera, &info);
	pthread_mutex_lock(&thread->lock);
	thread->status.camera = info;
	pthread_mutex_unlock(&thread->lock);
	thread->opened_ns = thread->last_frame_ns = dio_clock_ns();
	/* The first frames decide whether this was a success. */
	if (thread->status.state == DIO_CAPTURE_STARTING)
		dio_log_note("%s: %s %ux%u", info.name, dio_pixel_format_name(info.format),
			     info.width, info.height);
	apply_wish(thread, false, false);
	if (thread->hold)
		begin_settling(thread);
}

static void heed_hold(struct dio_camera_thread *thread)
{
	bool asked, hold;

	pthread_mutex_lock(&thread->lock);
	asked = thread->hold_asked;
	hold = thread->hold_wish;
	thread->hold_asked = false;
	pthread_mutex_unlock(&thread->lock);
	if (!asked)
		return;
	thread->hold = hold;
	thread->settle_until_ns = 0;
	if (!thread->camera)
		return;
	/* What was held is let go first: the scene may be another by now. */
	apply_wish(thread, false, false);
	if (hold)
		begin_settling(thread);
}

static void look_at_rest(struct dio_camera_thread *thread, const struct dio_frame *frame)
{
	bool steady;

	if (thread->settle_until_ns == 0)
		return;
	steady = dio_steady_look(&thread->steady, frame);
	if (!steady && dio_clock_ns() < thread->settle_until_ns)
		return;
	thread->settle_until_ns = 0;
	apply_wish(thread, true, steady);
}

static void read_controls(struct dio_camera_thread *thread)
{
	struct dio_camera_controls now;

	if (thread->status.hold != DIO_HOLD_AUTOMATIC ||
	    dio_clock_ns() < thread->last_read_ns + READ_PERIOD_NS)
		return;
	thread->last_read_ns = dio_clock_ns();
	if (dio_camera_get_controls(thread->camera, &now, NULL) == DIO_OK)
		set_hold_state(thread, DIO_HOLD_AUTOMATIC, false, &now);
}

static void take_frame(struct dio_camera_thread *thread, const struct dio_frame *frame)
{
	struct dio_error error;

	thread->last_frame_ns = dio_clock_ns();
	thread->pause_ns = 0;
	thread->frames++;
	dio_rate_add(&thread->rate, frame->timestamp_ns);
	if (thread->failed) {
		thread->failed = false;
		pthread_mutex_lock(&thread->lock);
		thread->status.recoveries++;
		pthread_mutex_unlock(&thread->lock);
	}
	set_state(thread, DIO_CAPTURE_STREAMING, "");
	if (dio_ring_server_publish(thread->ring, frame, &error) != DIO_OK)
		dio_log_warn("%s", error.text);
	dio_recording_offer(thread->recording, frame);
	look_at_rest(thread, frame);
	read_controls(thread);
}

/* No frame in this slice: is the stream dead? A device that never gave one has no signal; one that
 * did is opened anew. */
static void miss_frame(struct dio_camera_thread *thread)
{
	const uint32_t limit_ms = thread->settings->stalled_ms;
	const struct dio_camera_info *camera = &thread->status.camera;
	struct dio_error error;

	if (dio_clock_ns() - thread->last_frame_ns < limit_ms * NS_PER_MS)
		return;
	/* The driver knows of this slice only. */
	dio_fail(&error, DIO_AGAIN,
		 "camera %s: no frame for %u ms (%s %ux%u, %" PRIu64
		 " frames before): is the cable in?",
		 camera->name, limit_ms, dio_pixel_format_name(camera->format), camera->width,
		 camera->height, thread->frames);
	if (thread->frames > 0) {
		give_up(thread, DIO_AGAIN, &error);
		return;
	}
	thread->failed = true;
	close_camera(thread);
	if (thread->status.state != DIO_CAPTURE_STALLED)
		set_state(thread, DIO_CAPTURE_NO_SIGNAL, error.text);
}

static void pass_slice(struct dio_camera_thread *thread)
{
	struct dio_frame frame;
	struct dio_error error = {""};
	enum dio_status status = dio_camera_acquire(thread->camera, &frame, SLICE_NS, &error);

	switch (status) {
	case DIO_OK:
		take_frame(thread, &frame);
		break;
	case DIO_AGAIN:
		miss_frame(thread);
		break;
	case DIO_NO_SIGNAL:
		thread->last_frame_ns = dio_clock_ns();
		dio_rate_reset(&thread->rate);
		set_state(thread, DIO_CAPTURE_NO_SIGNAL, error.text);
		break;
	case DIO_BAD_FILE:
		dio_log_warn("%s", error.text);
		pthread_mutex_lock(&thread->lock);
		thread->status.unreadable++;
		pthread_mutex_unlock(&thread->lock);
		break;
	case DIO_END:
		set_state(thread, DIO_CAPTURE_ENDED, error.text);
		break;
	default:
		give_up(thread, status, &error);
	}
	if (thread->camera)
		update_counters(thread);
}

/* Sleep until there is something to do: the time, a wish, or the end. */
static void rest(struct dio_camera_thread *thread, uint64_t duration_ns)
{
	const uint64_t until = dio_clock_ns() + duration_ns;
	const struct timespec ts = {(time_t)(until / NS_PER_S), (long)(until % NS_PER_S)};

	pthread_mutex_lock(&thread->lock);
	while (!thread->stop && !thread->hold_asked &&
	       pthread_cond_timedwait(&thread->asked, &thread->lock, &ts) == 0)
		;
	pthread_mutex_unlock(&thread->lock);
}

static bool come_round(struct dio_camera_thread *thread)
{
	bool stop;

	pthread_mutex_lock(&thread->lock);
	thread->status.heartbeat_ns = dio_clock_ns();
	stop = thread->stop;
	pthread_mutex_unlock(&thread->lock);
	return !stop;
}

static void *run(void *context)
{
	struct dio_camera_thread *thread = context;

	pthread_setname_np(pthread_self(), "camera");
	while (come_round(thread)) {
		heed_hold(thread);
		if (thread->camera && thread->status.state == DIO_CAPTURE_ENDED) {
			rest(thread, SLICE_NS);
		} else if (thread->camera) {
			pass_slice(thread);
		} else {
			rest(thread, thread->pause_ns);
			thread->pause_ns = thread->pause_ns ? thread->pause_ns * 2 : PAUSE_MIN_NS;
			if (thread->pause_ns > PAUSE_MAX_NS)
				thread->pause_ns = PAUSE_MAX_NS;
			open_camera(thread);
		}
	}
	close_camera(thread);
	return NULL;
}

/* Waits are by the monotonic clock: setting the time of day must not move them. */
static int init_condition(pthread_cond_t *condition)
{
	pthread_condattr_t attributes;
	int result = pthread_condattr_init(&attributes);

	if (result != 0)
		return result;
	pthread_condattr_setclock(&attributes, CLOCK_MONOTONIC);
	result = pthread_cond_init(condition, &attributes);
	pthread_condattr_destroy(&attributes);
	return result;
}

enum dio_status dio_camera_thread_create(const struct dio_captured_settings *settings,
					 struct dio_ring_server *ring,
					 struct dio_recording *recording, int changed_fd,
					 struct dio_camera_thread **thread, struct dio_error *error)
{
	struct dio_camera_thread *made = calloc(1, sizeof(*made));

	if (!made)
		return dio_fail(error, DIO_NO_MEM, "no memory for the camera's thread");
	made->settings = settings;
	made->ring = ring;
	made->recording = recording;
	made->changed_fd = changed_fd;
	made->hold = settings->wish.hold;
	made->status.heartbeat_ns = dio_clock_ns();
	pthread_mutex_init(&made->lock, NULL);
	if (init_condition(&made->asked) != 0 ||
	    pthread_create(&made->thread, NULL, run, made) != 0) {
		free(made);
		return dio_fail(error, DIO_NO_MEM, "cannot make the camera's thread");
	}
	*thread = made;
	return DIO_OK;
}

void dio_camera_thread_destroy(struct dio_camera_thread *thread)
{
	if (!thread)
		return;
	pthread_mutex_lock(&thread->lock);
	thread->stop = true;
	pthread_cond_signal(&thread->asked);
	pthread_mutex_unlock(&thread->lock);
	pthread_join(thread->thread, NULL);
	dio_steady_deinit(&thread->steady);
	pthread_cond_destroy(&thread->asked);
	pthread_mutex_destroy(&thread->lock);
	free(thread);
}

void dio_camera_thread_get_status(struct dio_camera_thread *thread,
				  struct dio_capture_status *status)
{
	pthread_mutex_lock(&thread->lock);
	*status = thread->status;
	pthread_mutex_unlock(&thread->lock);
}

void dio_camera_thread_hold(struct dio_camera_thread *thread, bool hold)
{
	pthread_mutex_lock(&thread->lock);
	thread->hold_asked = true;
	thread->hold_wish = hold;
	pthread_cond_signal(&thread->asked);
	pthread_mutex_unlock(&thread->lock);
}
