/* V4L2 capture by memory-mapped streaming (Linux Media userspace API, "Streaming I/O"). */
#include "backend.h"

#include <errno.h>
#include <fcntl.h>
#include <inttypes.h>
#include <linux/videodev2.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>

#include "v4l2_format.h"

#define BUFFERS_WISHED 4
#define BUFFERS_MIN    2
#define BUFFERS_MAX    32
#define NS_PER_S       1000000000u
/* A starved queue whose newest frame is this many periods old holds the past: wait for a new one.
 */
#define STALE_PERIODS 4

struct mapping {
	void *memory;
	size_t size;
};

/* A filled buffer taken from the driver, single- and multi-planar alike. */
struct taken {
	uint32_t index, flags, sequence;
	size_t offset, bytes;
	uint64_t timestamp_ns;
};

struct v4l2_camera {
	struct dio_camera base; /* first */
	char path[88];
	struct dio_v4l2_device device;
	struct dio_v4l2_format format;
	struct mapping buffers[BUFFERS_MAX];
	uint32_t buffer_count; /* mapped so far: a half-open camera closes like any other */
	bool holds;            /* a frame is lent to the caller */
	uint32_t held;         /* its buffer */
	bool gone;             /* unplugged: nothing but close works */
	bool sequenced;        /* last_sequence is valid */
	uint32_t last_sequence;
};

static struct v4l2_camera *self(struct dio_camera *camera)
{
	return (struct v4l2_camera *)camera;
}

static bool is_multiplanar(const struct v4l2_camera *v4l2)
{
	return v4l2->device.buffer_type == V4L2_BUF_TYPE_VIDEO_CAPTURE_MPLANE;
}

static enum dio_status fail_gone(struct v4l2_camera *v4l2, struct dio_error *error)
{
	v4l2->gone = true;
	return dio_fail(error, DIO_GONE,
			"camera %s: unplugged after %" PRIu64 " frames; plug it in again",
			v4l2->path, v4l2->base.counters.delivered);
}

static enum dio_status fail_call(struct v4l2_camera *v4l2, const char *what,
				 struct dio_error *error)
{
	int cause = errno;

	if (cause == ENODEV)
		return fail_gone(v4l2, error);
	if (cause == EBUSY)
		return dio_fail(error, DIO_BUSY,
				"camera %s: in use by another process; close that one first",
				v4l2->path);
	return dio_fail(error, dio_status_from_errno(cause), "camera %s: %s failed: %s", v4l2->path,
			what, strerror(cause));
}

/* A zeroed v4l2_buffer; the plane array stands in for the single plane of a multi-planar device. */
static void buffer_init(const struct v4l2_camera *v4l2, struct v4l2_buffer *buffer,
			struct v4l2_plane *plane, uint32_t index)
{
	memset(buffer, 0, sizeof(*buffer));
	memset(plane, 0, sizeof(*plane));
	buffer->type = v4l2->device.buffer_type;
	buffer->memory = V4L2_MEMORY_MMAP;
	buffer->index = index;
	if (is_multiplanar(v4l2)) {
		buffer->m.planes = plane;
		buffer->length = 1;
	}
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
		return fail_call(v4l2, "open", error);
	}
}

static enum dio_status check_device(struct v4l2_camera *v4l2, struct dio_error *error)
{
	struct v4l2_capability cap = {0};
	uint32_t caps;

	if (dio_v4l2_ioctl(&v4l2->device, VIDIOC_QUERYCAP, &cap) != 0) {
		if (errno != ENOTTY && errno != EINVAL)
			return fail_call(v4l2, "VIDIOC_QUERYCAP", error);
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

static enum dio_status map_buffer(struct v4l2_camera *v4l2, uint32_t index, struct dio_error *error)
{
	const struct dio_v4l2_system *system = v4l2->device.system;
	struct mapping *mapping = &v4l2->buffers[index];
	struct v4l2_plane plane;
	struct v4l2_buffer buffer;
	off_t offset;

	buffer_init(v4l2, &buffer, &plane, index);
	if (dio_v4l2_ioctl(&v4l2->device, VIDIOC_QUERYBUF, &buffer) != 0)
		return fail_call(v4l2, "VIDIOC_QUERYBUF", error);
	mapping->size = is_multiplanar(v4l2) ? plane.length : buffer.length;
	offset = is_multiplanar(v4l2) ? plane.m.mem_offset : buffer.m.offset;
	if (mapping->size < v4l2->format.frame_bytes_min)
		return dio_fail(error, DIO_UNSUPPORTED,
				"camera %s: buffers of %zu bytes, a frame takes %zu", v4l2->path,
				mapping->size, v4l2->format.frame_bytes_min);
	mapping->memory = system->map(system->context, mapping->size, v4l2->device.fd, offset);
	if (mapping->memory == MAP_FAILED)
		return fail_call(v4l2, "mmap", error);
	v4l2->buffer_count = index + 1;
	return DIO_OK;
}

static enum dio_status map_buffers(struct v4l2_camera *v4l2, struct dio_error *error)
{
	struct v4l2_requestbuffers request = {
		.count = BUFFERS_WISHED,
		.type = v4l2->device.buffer_type,
		.memory = V4L2_MEMORY_MMAP,
	};

	if (dio_v4l2_ioctl(&v4l2->device, VIDIOC_REQBUFS, &request) != 0)
		return fail_call(v4l2, "VIDIOC_REQBUFS", error);
	if (request.count < BUFFERS_MIN)
		return dio_fail(error, DIO_NO_MEM, "camera %s: got %u buffers, %u are needed",
				v4l2->path, request.count, BUFFERS_MIN);
	if (request.count > BUFFERS_MAX)
		request.count = BUFFERS_MAX;
	for (uint32_t i = 0; i < request.count; i++) {
		enum dio_status status = map_buffer(v4l2, i, error);

		if (status != DIO_OK)
			return status;
	}
	return DIO_OK;
}

static enum dio_status enqueue(struct v4l2_camera *v4l2, uint32_t index, struct dio_error *error)
{
	struct v4l2_plane plane;
	struct v4l2_buffer buffer;

	buffer_init(v4l2, &buffer, &plane, index);
	if (dio_v4l2_ioctl(&v4l2->device, VIDIOC_QBUF, &buffer) != 0)
		return fail_call(v4l2, "VIDIOC_QBUF", error);
	return DIO_OK;
}

/* DIO_AGAIN when no buffer is filled. */
static enum dio_status dequeue(struct v4l2_camera *v4l2, struct taken *taken,
			       struct dio_error *error)
{
	const struct dio_v4l2_system *system = v4l2->device.system;
	struct v4l2_plane plane;
	struct v4l2_buffer buffer;

	buffer_init(v4l2, &buffer, &plane, 0);
	if (dio_v4l2_ioctl(&v4l2->device, VIDIOC_DQBUF, &buffer) != 0) {
		if (errno == EAGAIN)
			return DIO_AGAIN;
		if (errno == EPIPE)
			return DIO_END;
		return fail_call(v4l2, "VIDIOC_DQBUF", error);
	}
	if (buffer.index >= v4l2->buffer_count)
		return dio_fail(error, DIO_IO, "camera %s: the driver handed out buffer %u of %u",
				v4l2->path, buffer.index, v4l2->buffer_count);
	*taken = (struct taken){
		.index = buffer.index,
		.flags = buffer.flags,
		.sequence = buffer.sequence,
		.offset = is_multiplanar(v4l2) ? plane.data_offset : 0,
		.bytes = is_multiplanar(v4l2) ? plane.bytesused : buffer.bytesused,
	};
	if ((buffer.flags & V4L2_BUF_FLAG_TIMESTAMP_MASK) == V4L2_BUF_FLAG_TIMESTAMP_MONOTONIC)
		taken->timestamp_ns = (uint64_t)buffer.timestamp.tv_sec * NS_PER_S +
				      (uint64_t)buffer.timestamp.tv_usec * 1000;
	else
		taken->timestamp_ns = system->now_ns(system->context);
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

static bool is_broken(const struct v4l2_camera *v4l2, const struct taken *taken)
{
	size_t room = v4l2->buffers[taken->index].size;

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
static enum dio_status take_ready(struct v4l2_camera *v4l2, struct taken *newest, bool *starved,
				  struct dio_error *error)
{
	enum dio_status status = DIO_OK;
	bool found = false;

	*starved = false;
	for (uint32_t round = 0; round < v4l2->buffer_count; round++) {
		struct taken taken;

		status = dequeue(v4l2, &taken, error);
		if (status != DIO_OK)
			break;
		/* All were filled but the one the caller gave back just now. */
		*starved = round + 2 >= v4l2->buffer_count;
		count_gap(v4l2, taken.sequence);
		if (is_broken(v4l2, &taken)) {
			v4l2->base.counters.broken++;
			status = enqueue(v4l2, taken.index, error);
		} else if (found) {
			v4l2->base.counters.drained++;
			status = enqueue(v4l2, newest->index, error);
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
static bool is_stale(const struct v4l2_camera *v4l2, const struct taken *newest, bool starved)
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
	struct pollfd fd = {.fd = v4l2->device.fd, .events = POLLIN};
	uint64_t now = system->now_ns(system->context);
	uint64_t left_ms = now < deadline_ns ? (deadline_ns - now + 999999) / 1000000 : 0;
	int n;

	if (left_ms == 0)
		return DIO_AGAIN;
	n = system->poll(system->context, &fd, left_ms > INT32_MAX ? INT32_MAX : (int)left_ms);
	if (n < 0)
		return errno == EINTR ? DIO_OK : fail_call(v4l2, "poll", error);
	if (n > 0 && !(fd.revents & POLLIN)) {
		/* POLLERR or POLLHUP: the next DQBUF knows why; when it does not, stop here. */
		struct taken taken;
		enum dio_status status = dequeue(v4l2, &taken, error);

		if (status == DIO_OK)
			return enqueue(v4l2, taken.index, error);
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

static void lend(struct v4l2_camera *v4l2, const struct taken *taken, struct dio_frame *frame)
{
	const uint8_t *memory = v4l2->buffers[taken->index].memory;

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
	};
}

static enum dio_status v4l2_acquire(struct dio_camera *camera, struct dio_frame *frame,
				    int64_t timeout_ns, struct dio_error *error)
{
	struct v4l2_camera *v4l2 = self(camera);
	const struct dio_v4l2_system *system = v4l2->device.system;
	uint64_t deadline_ns = system->now_ns(system->context) + (uint64_t)timeout_ns;
	enum dio_status status;

	if (v4l2->gone)
		return fail_gone(v4l2, error);
	if (v4l2->holds) {
		v4l2->holds = false;
		status = enqueue(v4l2, v4l2->held, error);
		if (status != DIO_OK)
			return status;
	}
	for (;;) {
		struct taken newest = {0};
		bool starved;

		status = take_ready(v4l2, &newest, &starved, error);
		if (status == DIO_OK && is_stale(v4l2, &newest, starved)) {
			camera->counters.drained++;
			status = enqueue(v4l2, newest.index, error);
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
		if (status == DIO_AGAIN)
			return fail_timeout(v4l2, timeout_ns, error);
		if (status != DIO_OK)
			return status;
	}
}

static enum dio_status v4l2_start(struct dio_camera *camera, struct dio_error *error)
{
	struct v4l2_camera *v4l2 = self(camera);
	int type = (int)v4l2->device.buffer_type;
	enum dio_status status = DIO_OK;

	if (v4l2->gone)
		return fail_gone(v4l2, error);
	v4l2->sequenced = false;
	for (uint32_t i = 0; i < v4l2->buffer_count && status == DIO_OK; i++)
		status = enqueue(v4l2, i, error);
	if (status != DIO_OK)
		return status;
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
		status = fail_call(v4l2, "VIDIOC_STREAMON", error);
	/* Takes the buffers back, so that a later start can queue them again. */
	dio_v4l2_ioctl(&v4l2->device, VIDIOC_STREAMOFF, &type);
	return status;
}

static enum dio_status v4l2_stop(struct dio_camera *camera, struct dio_error *error)
{
	struct v4l2_camera *v4l2 = self(camera);
	int type = (int)v4l2->device.buffer_type;

	v4l2->holds = false;
	if (v4l2->gone)
		return DIO_OK;
	if (dio_v4l2_ioctl(&v4l2->device, VIDIOC_STREAMOFF, &type) != 0)
		return fail_call(v4l2, "VIDIOC_STREAMOFF", error);
	return DIO_OK;
}

/* Accepts a camera at any stage of its opening. */
static void v4l2_close(struct dio_camera *camera)
{
	struct v4l2_camera *v4l2 = self(camera);
	const struct dio_v4l2_system *system = v4l2->device.system;

	for (uint32_t i = 0; i < v4l2->buffer_count; i++)
		system->unmap(system->context, v4l2->buffers[i].memory, v4l2->buffers[i].size);
	if (v4l2->device.fd >= 0)
		system->close(system->context, v4l2->device.fd);
	free(v4l2);
}

static const struct dio_camera_ops ops = {
	.start = v4l2_start,
	.stop = v4l2_stop,
	.acquire = v4l2_acquire,
	.close = v4l2_close,
};

static enum dio_status set_up(struct v4l2_camera *v4l2, struct dio_error *error)
{
	struct dio_camera_info *info = &v4l2->base.info;
	enum dio_status status = open_device(v4l2, error);

	if (status == DIO_OK)
		status = check_device(v4l2, error);
	if (status == DIO_OK)
		status = dio_v4l2_format_negotiate(&v4l2->device, &v4l2->base.options,
						   &v4l2->format, error);
	if (status == DIO_OK)
		status = map_buffers(v4l2, error);
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
