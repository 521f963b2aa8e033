/* The system calls the V4L2 backend makes, as a table: tests put a scripted device behind it. */
#ifndef DIO_CAMERA_V4L2_SYSTEM_H
#define DIO_CAMERA_V4L2_SYSTEM_H

#include <poll.h>
#include <stddef.h>
#include <stdint.h>
#include <sys/types.h>

#include "dio/camera.h"

/** Each behaves as its namesake of libc and sets errno; `context` is handed through. */
struct dio_v4l2_system {
	void *context;
	int (*open)(void *context, const char *path, int flags);
	int (*close)(void *context, int fd);
	int (*ioctl)(void *context, int fd, unsigned long request, void *argument);
	void *(*map)(void *context, size_t size, int fd, off_t offset);
	int (*unmap)(void *context, void *memory, size_t size);
	int (*poll)(void *context, struct pollfd *fd, int timeout_ms);
	uint64_t (*now_ns)(void *context); /* CLOCK_MONOTONIC */
};

/** The kernel. */
extern const struct dio_v4l2_system dio_v4l2_kernel;

/** dio_v4l2_open() over a system of the caller's choice, which must outlive the camera. */
enum dio_status dio_v4l2_open_on(const struct dio_v4l2_system *system, const char *path,
				 const struct dio_camera_options *options,
				 struct dio_camera **camera, struct dio_error *error);

#endif
