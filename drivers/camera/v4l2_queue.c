#include "v4l2_queue.h"

#include <errno.h>
#include <fcntl.h>
#include <linux/videodev2.h>
#include <string.h>
#include <sys/mman.h>

#define BUFFERS_WISHED 4
#define BUFFERS_MIN    2
#define NS_PER_S       1000000000u

static bool is_multiplanar(const struct dio_v4l2_queue *queue)
{
	return queue->device->buffer_type == V4L2_BUF_TYPE_VIDEO_CAPTURE_MPLANE;
}

/* A zeroed v4l2_buffer; the plane array stands in for the single plane of a multi-planar device. */
static void buffer_init(const struct dio_v4l2_queue *queue, struct v4l2_buffer *buffer,
			struct v4l2_plane *plane, uint32_t index)
{
	memset(buffer, 0, sizeof(*buffer));
	memset(plane, 0, sizeof(*plane));
	buffer->type = queue->device->buffer_type;
	buffer->memory = V4L2_MEMORY_MMAP;
	buffer->index = index;
	if (is_multiplanar(queue)) {
		buffer->m.planes = plane;
		buffer->length = 1;
	}
}

static enum dio_status map_buffer(struct dio_v4l2_queue *queue, uint32_t index,
				  size_t frame_bytes_min, struct dio_error *error)
{
	const struct dio_v4l2_device *device = queue->device;
	const struct dio_v4l2_system *system = device->system;
	struct dio_v4l2_buffer *made = &queue->buffers[index];
	struct v4l2_plane plane;
	struct v4l2_buffer buffer;
	off_t offset;

	buffer_init(queue, &buffer, &plane, index);
	if (dio_v4l2_ioctl(device, VIDIOC_QUERYBUF, &buffer) != 0)
		return dio_v4l2_fail_call(device, "VIDIOC_QUERYBUF", error);
	made->dmabuf = -1;
	made->size = is_multiplanar(queue) ? plane.length : buffer.length;
	offset = is_multiplanar(queue) ? plane.m.mem_offset : buffer.m.offset;
	if (made->size < frame_bytes_min)
		return dio_fail(error, DIO_UNSUPPORTED,
				"camera %s: buffers of %zu bytes, a frame takes %zu", device->path,
				made->size, frame_bytes_min);
	made->memory = system->map(system->context, made->size, device->fd, offset);
	if (made->memory == MAP_FAILED)
		return dio_v4l2_fail_call(device, "mmap", error);
	queue->count = index + 1;
	return DIO_OK;
}

enum dio_status dio_v4l2_queue_map(struct dio_v4l2_queue *queue,
				   const struct dio_v4l2_device *device, size_t frame_bytes_min,
				   struct dio_error *error)
{
	struct v4l2_requestbuffers request = {
		.count = BUFFERS_WISHED,
		.type = device->buffer_type,
		.memory = V4L2_MEMORY_MMAP,
	};

	queue->device = device;
	if (dio_v4l2_ioctl(device, VIDIOC_REQBUFS, &request) != 0)
		return dio_v4l2_fail_call(device, "VIDIOC_REQBUFS", error);
	if (request.count < BUFFERS_MIN)
		return dio_fail(error, DIO_NO_MEM, "camera %s: got %u buffers, %u are needed",
				device->path, request.count, BUFFERS_MIN);
	if (request.count > DIO_V4L2_BUFFERS_MAX)
		request.count = DIO_V4L2_BUFFERS_MAX;
	for (uint32_t i = 0; i < request.count; i++) {
		enum dio_status status = map_buffer(queue, i, frame_bytes_min, error);

		if (status != DIO_OK)
			return status;
	}
	return DIO_OK;
}

void dio_v4l2_queue_unmap(struct dio_v4l2_queue *queue)
{
	for (uint32_t i = 0; i < queue->count; i++) {
		const struct dio_v4l2_system *system = queue->device->system;
		const struct dio_v4l2_buffer *buffer = &queue->buffers[i];

		if (buffer->dmabuf >= 0)
			system->close(system->context, buffer->dmabuf);
		system->unmap(system->context, buffer->memory, buffer->size);
	}
	queue->count = 0;
}

enum dio_status dio_v4l2_queue_put(struct dio_v4l2_queue *queue, uint32_t index,
				   struct dio_error *error)
{
	struct v4l2_plane plane;
	struct v4l2_buffer buffer;

	buffer_init(queue, &buffer, &plane, index);
	if (dio_v4l2_ioctl(queue->device, VIDIOC_QBUF, &buffer) != 0)
		return dio_v4l2_fail_call(queue->device, "VIDIOC_QBUF", error);
	return DIO_OK;
}

enum dio_status dio_v4l2_queue_take(struct dio_v4l2_queue *queue, struct dio_v4l2_taken *taken,
				    struct dio_error *error)
{
	const struct dio_v4l2_system *system = queue->device->system;
	struct v4l2_plane plane;
	struct v4l2_buffer buffer;

	buffer_init(queue, &buffer, &plane, 0);
	if (dio_v4l2_ioctl(queue->device, VIDIOC_DQBUF, &buffer) != 0) {
		if (errno == EAGAIN)
			return DIO_AGAIN;
		if (errno == EPIPE)
			return DIO_END;
		return dio_v4l2_fail_call(queue->device, "VIDIOC_DQBUF", error);
	}
	if (buffer.index >= queue->count)
		return dio_fail(error, DIO_IO, "camera %s: the driver handed out buffer %u of %u",
				queue->device->path, buffer.index, queue->count);
	*taken = (struct dio_v4l2_taken){
		.index = buffer.index,
		.flags = buffer.flags,
		.sequence = buffer.sequence,
		.offset = is_multiplanar(queue) ? plane.data_offset : 0,
		.bytes = is_multiplanar(queue) ? plane.bytesused : buffer.bytesused,
	};
	if ((buffer.flags & V4L2_BUF_FLAG_TIMESTAMP_MASK) == V4L2_BUF_FLAG_TIMESTAMP_MONOTONIC)
		taken->timestamp_ns = (uint64_t)buffer.timestamp.tv_sec * NS_PER_S +
				      (uint64_t)buffer.timestamp.tv_usec * 1000;
	else
		taken->timestamp_ns = system->now_ns(system->context);
	return DIO_OK;
}

int dio_v4l2_queue_export(struct dio_v4l2_queue *queue, uint32_t index)
{
	struct v4l2_exportbuffer wanted = {
		.type = queue->device->buffer_type, .index = index, .flags = O_CLOEXEC | O_RDONLY};
	struct dio_v4l2_buffer *buffer = &queue->buffers[index];

	if (buffer->dmabuf < 0 && dio_v4l2_ioctl(queue->device, VIDIOC_EXPBUF, &wanted) == 0)
		buffer->dmabuf = wanted.fd;
	return buffer->dmabuf;
}
