/* The buffers of a V4L2 device: mapped into memory, queued, taken, exported. */
#ifndef DIO_CAMERA_V4L2_QUEUE_H
#define DIO_CAMERA_V4L2_QUEUE_H

#include "v4l2_format.h"

#define DIO_V4L2_BUFFERS_MAX 32

struct dio_v4l2_buffer {
	void *memory;
	size_t size;
	int dmabuf; /* -1: not exported */
};

/** Zero-initialise. */
struct dio_v4l2_queue {
	const struct dio_v4l2_device *device;
	struct dio_v4l2_buffer buffers[DIO_V4L2_BUFFERS_MAX];
	uint32_t count; /* mapped so far: a half-mapped queue is unmapped like any other */
};

/** A filled buffer taken from the driver, single- and multi-planar alike. */
struct dio_v4l2_taken {
	uint32_t index, flags, sequence;
	size_t offset, bytes;
	uint64_t timestamp_ns;
};

/** Ask for buffers and map them. DIO_UNSUPPORTED: they are too small for a frame. */
enum dio_status dio_v4l2_queue_map(struct dio_v4l2_queue *queue,
				   const struct dio_v4l2_device *device, size_t frame_bytes_min,
				   struct dio_error *error);
void dio_v4l2_queue_unmap(struct dio_v4l2_queue *queue);

/** Give a buffer to the driver. */
enum dio_status dio_v4l2_queue_put(struct dio_v4l2_queue *queue, uint32_t index,
				   struct dio_error *error);

/** Take the oldest filled one. DIO_AGAIN: none is; DIO_END: the driver has ended the stream. */
enum dio_status dio_v4l2_queue_take(struct dio_v4l2_queue *queue, struct dio_v4l2_taken *taken,
				    struct dio_error *error);

/** The buffer as a DMABUF descriptor that can only be read, made on the first call and owned by
 * the queue; -1 where the driver offers none. */
int dio_v4l2_queue_export(struct dio_v4l2_queue *queue, uint32_t index);

#endif
