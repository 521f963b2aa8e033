/* V4L2 capture by memory-mapped streaming (Linux Media userspace API, "Streaming I/O"). */
#include "backend.h"

#include <errno.h>
#include <fcntl.h>
#include <inttypes.h>
#include <linux/videodev2.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "v4l2_controls.h"
#include "v4l2_queue.h"
#include "v4l2_signal.h"

#define NS_PER_S 1000000000u
/* A starved queue whose newest frame is this many periods old holds the past: wait for a new one.
 */
#define STALE_PERIODS 4
/* How often a driver that delivers is asked whether its input has a signal at all. */
#define SIGNAL_PERIOD_NS (NS_PER_S / 2)

struct v4l2_camera {
	struct dio_camera base; /* first */
	char path[88];
	struct dio_v4l2_device device;
	struct dio_v4l2_format format;
	struct dio_v4l2_queue queue;
	bool holds;     /* a frame is lent to the caller */
	uint32_t held;  /* its buffer */
	bool gone;      /* unplugged: nothing but close works */
	bool sequenced; /* last_sequence is valid */
	uint32_t last_sequence;
	bool holding;                       /* exposure and the rest are to be held */
	bool silent;                        /* the input had no signal when looked at last */
	bool events;                        /* the driver tells of changes of the signal */
	uint64_t signal_ns;                 /* when the signal was looked at last */
	struct dio_frame_metadata metadata; /* as last read */
};

static struct v4l2_camera *self(struct dio_camera *camera)
{
	return (struct v4l2_camera *)camera;
}

static enum dio_status fail_gone(struct v4l2_camera *v4l2, struct dio_error *error)
{
	v4l2->gone = true;
	return dio_fail(error, DIO_GONE,
			"camera %s: unplugged after %" PRIu64 " frames; plug it in again",
			v4l2->path, v4l2->base.counters.delivered);
}

/* A device that is gone stays so, and the line says how far it came. */
static enum dio_status note_gone(struct v4l2_camera *v4l2, enum dio_status status,
				 struct dio_error *error)
{
	return status == DIO_GONE ? fail_gone(v4l2, error) : status;
}

static enum dio_status open_device(struct v4l2_camera *v4l2, struct dio_error *error)
{
	const struct dio_v4l2_system *system = v4l2->device.system;

	v4l2->device.fd =
		system->open(system->context, v4l2->path, O_RDWR | O_NONBLOCK | O_CLOEXEC);
	if (v4l2->device.fd >= 0)
		return DIO_OK;
	switch (errno) {
	case ENOENT:
	case ENOTDIR:
	case ENODEV:
	case ENXIO:
		return dio_fail(error, DIO_NOT_FOUND,
				"camera %s: no such device; is it plugged in?", v4l2->path);
	case EACCES:
	case EPERM:
		return dio_fail(error, DIO_IO,
				"camera %s: not permitted; add the user to the group `video`",
				v4l2->path);
	default:
		return dio_v4l2_fail_call(&v4l2->device, "open", error);
	}
}

static enum dio_status check_device(struct v4l2_camera *v4l2, struct dio_error *error)
{
	struct v4l2_capability cap = {0};
	uint32_t caps;

	if (dio_v4l2_ioctl(&v4l2->device, VIDIOC_QUERYCAP, &cap) != 0) {
		if (errno != ENOTTY && errno != EINVAL)
			return dio_v4l2_fail_call(&v4l2->device, "VIDIOC_QUERYCAP", error);
		return dio_fail(error, DIO_UNSUPPORTED, "camera %s: not a V4L2 device", v4l2->path);
	}
	/* `capabilities` speaks of the whole device, `device_caps` of this node. */
	caps = cap.capabilities & V4L2_CAP_DEVICE_CAPS ? cap.device_caps : cap.capabilities;
	if (caps & V4L2_CAP_VIDEO_CAPTURE)
		v4l2->device.buffer_type = V4L2_BUF_TYPE_VIDEO_CAPTURE;
	else if (caps & V4L2_CAP_VIDEO_CAPTURE_MPLANE)
		v4l2->device.buffer_type = V4L2_BUF_TYPE_VIDEO_CAPTURE_MPLANE;
	else
		return dio_fail(error, DIO_UNSUPPORTED,
				"camera %s: this node captures no video; try another /dev/video*",
				v4l2->path);
	if (!(caps & V4L2_CAP_STREAMING))
		return dio_fail(error, DIO_UNSUPPORTED, "camera %s: does not stream", v4l2->path);
	snprintf(v4l2->base.info.name, sizeof(v4l2->base.info.name), "%.31s (%s)",
		 (const char *)cap.card, v4l2->path);
	return DIO_OK;
}

static void count_gap(struct v4l2_camera *v4l2, uint32_t sequence)
{
	/* Modulo 2^32; a step back means that the driver began anew. */
	uint32_t step = sequence - v4l2->last_sequence;

	if (v4l2->sequenced && step > 1 && step < UINT32_MAX / 2)
		v4l2->base.counters.lost += step - 1;
	v4l2->sequenced = true;
	v4l2->last_sequence = sequence;
}

static bool is_broken(const struct v4l2_camera *v4l2, const struct dio_v4l2_taken *taken)
{
	size_t room = v4l2->queue.buffers[taken->index].size;

	return (taken->flags & V4L2_BUF_FLAG_ERROR) || taken->bytes > room ||
	       taken->offset > taken->bytes ||
	       taken->bytes - taken->offset < v4l2->format.frame_bytes_min;
}

/*
 * Take what is filled: the newest good frame, or the oldest when every frame is wished. At most
 * one round of the buffers, so that a camera faster than us cannot hold us here.
 *
 * starved  set when the driver had no buffer left to fill
 */
static enum dio_status take_ready(struct v4l2_camera *v4l2, struct dio_v4l2_taken *newest,
				  bool *starved, struct dio_error *error)
{
	enum dio_status status = DIO_OK;
	bool found = false;

	*starved = false;
	for (uint32_t round = 0; round < v4l2->queue.count; round++) {
		struct dio_v4l2_taken taken;

		status = dio_v4l2_queue_take(&v4l2->queue, &taken, error);
		if (status != DIO_OK)
			break;
		/* All were filled but the one the caller gave back just now. */
		*starved = round + 2 >= v4l2->queue.count;
		count_gap(v4l2, taken.sequence);
		if (is_broken(v4l2, &taken)) {
			v4l2->base.counters.broken++;
			status = dio_v4l2_queue_put(&v4l2->queue, taken.index, error);
		} else if (found) {
			v4l2->base.counters.drained++;
			status = dio_v4l2_queue_put(&v4l2->queue, newest->index, error);
			*newest = taken;
		} else {
			found = true;
			*newest = taken;
		}
		if (status != DIO_OK || (found && v4l2->base.options.every_frame))
			break;
	}
	if (found && (status == DIO_OK || status == DIO_AGAIN || status == DIO_END))
		return DIO_OK;
	return status == DIO_OK ? DIO_AGAIN : status;
}

/* After a pause the queue holds old frames, and the driver had nowhere to put new ones. */
static bool is_stale(const struct v4l2_camera *v4l2, const struct dio_v4l2_taken *newest,
		     bool starved)
{
	const struct dio_v4l2_system *system = v4l2->device.system;
	double fps = v4l2->format.frames_per_second;
	uint64_t limit = (uint64_t)(STALE_PERIODS * NS_PER_S / (fps >= 1 ? fps : 30.0));
	uint64_t now = system->now_ns(system->context);

	return starved && !v4l2->base.options.every_frame && now > newest->timestamp_ns &&
	       now - newest->timestamp_ns > limit;
}

static enum dio_status wait_ready(struct v4l2_camera *v4l2, uint64_t deadline_ns,
				  struct dio_error *error)
{
	const struct dio_v4l2_system *system = v4l2->device.system;
	struct pollfd fd = {.fd = v4l2->device.fd,
			    .events = (short)(v4l2->events ? POLLIN | POLLPRI : POLLIN)};
	uint64_t now = system->now_ns(system->context);
	uint64_t left_ms = now < deadline_ns ? (deadline_ns - now + 999999) / 1000000 : 0;
	int n;

	if (left_ms == 0)
		return DIO_AGAIN;
	n = system->poll(system->context, &fd, left_ms > INT32_MAX ? INT32_MAX : (int)left_ms);
	if (n < 0)
		return errno == EINTR ? DIO_OK : dio_v4l2_fail_call(&v4l2->device, "poll", error);
	if (n > 0 && (fd.revents & POLLPRI) && dio_v4l2_signal_has_changed(&v4l2->device))
		return dio_fail(error, DIO_REFUSED,
				"camera %s: the signal has changed its size; open it again",
				v4l2->path);
	if (n > 0 && !(fd.revents & (POLLIN | POLLPRI))) {
		/* POLLERR or POLLHUP: the next DQBUF knows why; when it does not, stop here. */
		struct dio_v4l2_taken taken;
		enum dio_status status = dio_v4l2_queue_take(&v4l2->queue, &taken, error);

		if (status == DIO_OK)
			return dio_v4l2_queue_put(&v4l2->queue, taken.index, error);
		if (status != DIO_AGAIN)
			return status;
		if (fd.revents & POLLHUP)
			return fail_gone(v4l2, error);
		return dio_fail(error, DIO_IO,
				"camera %s: the driver reports an error; stop and start it",
				v4l2->path);
	}
	return DIO_OK;
}

static enum dio_status fail_timeout(const struct v4l2_camera *v4l2, int64_t timeout_ns,
				    struct dio_error *error)
{
	return dio_fail(error, DIO_AGAIN,
			"camera %s: no frame for %" PRId64 " ms (%s %ux%u, %" PRIu64
			" frames before, %" PRIu64 " broken): is the cable in?",
			v4l2->path, timeout_ns / 1000000,
			dio_pixel_format_name(v4l2->format.format), v4l2->format.width,
			v4l2->format.height, v4l2->base.counters.delivered,
			v4l2->base.counters.broken);
}

static void lend(struct v4l2_camera *v4l2, const struct dio_v4l2_taken *taken,
		 struct dio_frame *frame)
{
	const uint8_t *memory = v4l2->queue.buffers[taken->index].memory;

	v4l2->holds = true;
	v4l2->held = taken->index;
	*frame = (struct dio_frame){
		.format = v4l2->format.format,
		.width = v4l2->format.width,
		.height = v4l2->format.height,
		.pitch_bytes = v4l2->format.pitch_bytes,
		.timestamp_ns = taken->timestamp_ns,
		.sequence = taken->sequence,
		.data = memory + taken->offset,
		.size_bytes = taken->bytes - taken->offset,
		.metadata = v4l2->metadata,
	};
}

/* Give back what was lent, then wait for a frame. */
static enum dio_status wait_frame(struct v4l2_camera *v4l2, struct dio_frame *frame,
				  uint64_t deadline_ns, struct dio_error *error)
{
	enum dio_status status = DIO_OK;

	if (v4l2->holds)
		status = dio_v4l2_queue_put(&v4l2->queue, v4l2->held, error);
	v4l2->holds = false;
	while (status == DIO_OK) {
		struct dio_v4l2_taken newest = {0};
		bool starved;

		status = take_ready(v4l2, &newest, &starved, error);
		if (status == DIO_OK && is_stale(v4l2, &newest, starved)) {
			v4l2->base.counters.drained++;
			status = dio_v4l2_queue_put(&v4l2->queue, newest.index, error);
			if (status != DIO_OK)
				return status;
			status = DIO_AGAIN;
		}
		if (status == DIO_OK) {
			lend(v4l2, &newest, frame);
			return DIO_OK;
		}
		if (status == DIO_AGAIN)
			status = wait_ready(v4l2, deadline_ns, error);
	}
	return status;
}

/* Receivers deliver noise or a blue picture where there is no signal: those are no frames. */
static enum dio_status check_signal(struct v4l2_camera *v4l2, bool got_frame,
				    struct dio_error *error)
{
	const struct dio_v4l2_system *system = v4l2->device.system;
	uint64_t now = system->now_ns(system->context);

	if (got_frame && !v4l2->silent && now < v4l2->signal_ns + SIGNAL_PERIOD_NS)
		return DIO_OK;
	v4l2->signal_ns = now;
	v4l2->silent = dio_v4l2_signal_check(&v4l2->device, error) == DIO_NO_SIGNAL;
	return v4l2->silent ? DIO_NO_SIGNAL : DIO_OK;
}

static enum dio_status v4l2_acquire(struct dio_camera *camera, struct dio_frame *frame,
				    int64_t timeout_ns, struct dio_error *error)
{
	struct v4l2_camera *v4l2 = self(camera);
	const struct dio_v4l2_system *system = v4l2->device.system;
	uint64_t deadline_ns = system->now_ns(system->context) + (uint64_t)timeout_ns;
	struct dio_frame taken = {0};
	enum dio_status status;

	if (v4l2->gone)
		return fail_gone(v4l2, error);
	status = wait_frame(v4l2, &taken, deadline_ns, error);
	if (status != DIO_OK && status != DIO_AGAIN)
		return note_gone(v4l2, status, error);
	if (check_signal(v4l2, status == DIO_OK, error) == DIO_NO_SIGNAL)
		return DIO_NO_SIGNAL;
	if (status == DIO_AGAIN)
		return fail_timeout(v4l2, timeout_ns, error);
	*frame = taken;
	return DIO_OK;
}

static enum dio_status v4l2_control(struct dio_camera *camera, const struct dio_camera_wish *wish,
				    struct dio_camera_controls *controls, struct dio_error *error)
{
	struct v4l2_camera *v4l2 = self(camera);
	enum dio_status status;

	if (v4l2->gone)
		return fail_gone(v4l2, error);
	if (wish)
		v4l2->holding = wish->hold;
	status = dio_v4l2_control(&v4l2->device, wish, v4l2->holding, controls, error);
	if (status == DIO_OK)
		v4l2->metadata = controls->metadata;
	return note_gone(v4l2, status, error);
}

static int v4l2_dmabuf(struct dio_camera *camera)
{
	struct v4l2_camera *v4l2 = self(camera);

	return v4l2->holds ? dio_v4l2_queue_export(&v4l2->queue, v4l2->held) : -1;
}

static enum dio_status v4l2_start(struct dio_camera *camera, struct dio_error *error)
{
	struct v4l2_camera *v4l2 = self(camera);
	int type = (int)v4l2->device.buffer_type;
	enum dio_status status = DIO_OK;

	if (v4l2->gone)
		return fail_gone(v4l2, error);
	v4l2->sequenced = false;
	for (uint32_t i = 0; i < v4l2->queue.count && status == DIO_OK; i++)
		status = dio_v4l2_queue_put(&v4l2->queue, i, error);
	if (status != DIO_OK)
		return note_gone(v4l2, status, error);
	if (dio_v4l2_ioctl(&v4l2->device, VIDIOC_STREAMON, &type) == 0)
		return DIO_OK;
	if (errno == ENOSPC)
		status = dio_fail(
			error, DIO_BUSY,
			"camera %s: not enough USB bandwidth for %s %ux%u; ask for a smaller "
			"picture, or unplug other cameras of that bus",
			v4l2->path, dio_pixel_format_name(v4l2->format.format), v4l2->format.width,
			v4l2->format.height);
	else
		status = dio_v4l2_fail_call(&v4l2->device, "VIDIOC_STREAMON", error);
	/* Takes the buffers back, so that a later start can queue them again. */
	dio_v4l2_ioctl(&v4l2->device, VIDIOC_STREAMOFF, &type);
	return note_gone(v4l2, status, error);
}

static enum dio_status v4l2_stop(struct dio_camera *camera, struct dio_error *error)
{
	struct v4l2_camera *v4l2 = self(camera);
	int type = (int)v4l2->device.buffer_type;

	v4l2->holds = false;
	if (v4l2->gone)
		return DIO_OK;
	if (dio_v4l2_ioctl(&v4l2->device, VIDIOC_STREAMOFF, &type) != 0)
		return note_gone(v4l2, dio_v4l2_fail_call(&v4l2->device, "VIDIOC_STREAMOFF", error),
				 error);
	return DIO_OK;
}

/* Accepts a camera at any stage of its opening. */
static void v4l2_close(struct dio_camera *camera)
{
	struct v4l2_camera *v4l2 = self(camera);
	const struct dio_v4l2_system *system = v4l2->device.system;

	dio_v4l2_queue_unmap(&v4l2->queue);
	if (v4l2->device.fd >= 0)
		system->close(system->context, v4l2->device.fd);
	free(v4l2);
}

static const struct dio_camera_ops ops = {
	.start = v4l2_start,
	.stop = v4l2_stop,
	.acquire = v4l2_acquire,
	.close = v4l2_close,
	.control = v4l2_control,
	.dmabuf = v4l2_dmabuf,
};

static enum dio_status set_up(struct v4l2_camera *v4l2, struct dio_error *error)
{
	struct dio_camera_info *info = &v4l2->base.info;
	enum dio_status status = open_device(v4l2, error);

	if (status == DIO_OK)
		status = check_device(v4l2, error);
	if (status == DIO_OK)
		dio_v4l2_signal_adopt(&v4l2->device, &v4l2->events);
	if (status == DIO_OK)
		status = dio_v4l2_format_negotiate(&v4l2->device, &v4l2->base.options,
						   &v4l2->format, error);
	if (status == DIO_OK)
		status = dio_v4l2_queue_map(&v4l2->queue, &v4l2->device,
					    v4l2->format.frame_bytes_min, error);
	info->format = v4l2->format.format;
	info->width = v4l2->format.width;
	info->height = v4l2->format.height;
	info->frames_per_second = v4l2->format.frames_per_second;
	return status;
}

enum dio_status dio_v4l2_open_on(const struct dio_v4l2_system *system, const char *path,
				 const struct dio_camera_options *options,
				 struct dio_camera **camera, struct dio_error *error)
{
	struct v4l2_camera *v4l2;
	enum dio_status status;

	if (strlen(path) == 0 || strlen(path) >= sizeof(v4l2->path))
		return dio_fail(error, DIO_BAD_ARG,
				"camera v4l2:%s: a device path such as /dev/video0 is needed",
				path);
	v4l2 = calloc(1, sizeof(*v4l2));
	if (!v4l2)
		return dio_fail(error, DIO_NO_MEM, "camera %s: out of memory", path);
	snprintf(v4l2->path, sizeof(v4l2->path), "%s", path);
	v4l2->base.ops = &ops;
	v4l2->base.options = *options;
	v4l2->base.frame_name = "";
	v4l2->device = (struct dio_v4l2_device){.system = system, .path = v4l2->path, .fd = -1};
	status = set_up(v4l2, error);
	if (status != DIO_OK) {
		v4l2_close(&v4l2->base);
		return status;
	}
	*camera = &v4l2->base;
	return DIO_OK;
}

enum dio_status dio_v4l2_open(const char *path, const struct dio_camera_options *options,
			      struct dio_camera **camera, struct dio_error *error)
{
	return dio_v4l2_open_on(&dio_v4l2_kernel, path, options, camera, error);
}
