/* What a camera backend provides; camera.c calls it behind the public interface. */
#ifndef DIO_CAMERA_BACKEND_H
#define DIO_CAMERA_BACKEND_H

#include <stdint.h>

#include "dio/camera.h"

#ifdef __cplusplus
extern "C" {
#endif

/**
 * One backend. Started and stopped states, counting of deliveries and NULL checks are camera.c's;
 * the contract of each function is that of its public namesake in dio/camera.h.
 */
struct dio_camera_ops {
	enum dio_status (*start)(struct dio_camera *camera, struct dio_error *error);
	enum dio_status (*stop)(struct dio_camera *camera, struct dio_error *error);
	enum dio_status (*acquire)(struct dio_camera *camera, struct dio_frame *frame,
				   int64_t timeout_ns, struct dio_error *error);
	void (*close)(struct dio_camera *camera); /* releases the object itself too */
	/* NULL: no controls. `wish` NULL: only read. */
	enum dio_status (*control)(struct dio_camera *camera, const struct dio_camera_wish *wish,
				   struct dio_camera_controls *controls, struct dio_error *error);
	int (*dmabuf)(struct dio_camera *camera); /* NULL: none */
};

/** Embedded as the first member of each backend's own object. */
struct dio_camera {
	const struct dio_camera_ops *ops;
	struct dio_camera_info info;
	struct dio_camera_counters counters;
	struct dio_camera_options options;
	const char *frame_name; /* the backend's memory; never NULL once open */
	bool started;
};

enum dio_status dio_v4l2_open(const char *path, const struct dio_camera_options *options,
			      struct dio_camera **camera, struct dio_error *error);
enum dio_status dio_replay_open(const char *path, const struct dio_camera_options *options,
				struct dio_camera **camera, struct dio_error *error);
/** `words` is what follows "sim:". */
enum dio_status dio_sim_open(const char *words, const struct dio_camera_options *options,
			     struct dio_camera **camera, struct dio_error *error);
/** `id` is what follows "libcamera:": a number, or the identity that `cam --list` prints. */
enum dio_status dio_libcamera_open(const char *id, const struct dio_camera_options *options,
				   struct dio_camera **camera, struct dio_error *error);

#ifdef __cplusplus
}
#endif
#endif
