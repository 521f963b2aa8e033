/* Choosing a V4L2 device's pixel format, size and rate. */
#ifndef DIO_CAMERA_V4L2_FORMAT_H
#define DIO_CAMERA_V4L2_FORMAT_H

#include <stdbool.h>

#include "v4l2_system.h"

/** One open device, as far as the format is concerned. */
struct dio_v4l2_device {
	const struct dio_v4l2_system *system;
	const char *path; /* for messages */
	int fd;
	uint32_t buffer_type; /* V4L2_BUF_TYPE_VIDEO_CAPTURE or ..._MPLANE */
};

/** What the driver agreed to; it may differ from what was wished. */
struct dio_v4l2_format {
	enum dio_pixel_format format;
	uint32_t width, height, pitch_bytes;
	size_t frame_bytes_min;   /* fewer in a buffer: a damaged frame. 1 for MJPEG */
	double frames_per_second; /* 0: the driver does not say */
};

int dio_v4l2_ioctl(const struct dio_v4l2_device *device, unsigned long request, void *argument);

/** The failure of a call, from errno: DIO_GONE, DIO_BUSY and so on. */
enum dio_status dio_v4l2_fail_call(const struct dio_v4l2_device *device, const char *what,
				   struct dio_error *error);

/**
 * Agree with the driver on the format nearest to the wish: first the size, then the rate, then
 * the cheaper to convert (YUYV, NV12, RGB24, GRAY8, and MJPEG last, which must be decoded).
 *
 * DIO_UNSUPPORTED  no format in common, or half pictures only (interlaced fields)
 * DIO_BUSY         another process holds the device
 */
enum dio_status dio_v4l2_format_negotiate(const struct dio_v4l2_device *device,
					  const struct dio_camera_options *wish,
					  struct dio_v4l2_format *format, struct dio_error *error);

#endif
