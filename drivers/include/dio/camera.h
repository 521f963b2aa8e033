/* Cameras behind one small interface: V4L2, libcamera, replay of files, the simulated camera. */
#ifndef DIO_CAMERA_H
#define DIO_CAMERA_H

#include <stdbool.h>
#include <stdint.h>

#include "dio/frame.h"
#include "dio/status.h"

#ifdef __cplusplus
extern "C" {
#endif

/** Opaque, thread-bound. */
struct dio_camera;

/** What is wished of a camera; 0 leaves a thing to the device. */
struct dio_camera_options {
	uint32_t width, height;
	double frames_per_second;
	bool as_fast_as_possible; /* replay and sim: no pacing; replay of a recording: ignore its
				     pace */
	bool every_frame;         /* deliver in order instead of draining to the newest */
};

struct dio_camera_info {
	char name[128];
	enum dio_pixel_format format;
	uint32_t width, height;
	double frames_per_second; /* 0: unknown */
	uint64_t frame_count;     /* 0: endless */
};

struct dio_camera_counters {
	uint64_t delivered;
	uint64_t drained; /* older frames passed over for the newest */
	uint64_t lost;    /* gaps in the driver's sequence */
	uint64_t broken;  /* frames the driver flagged as damaged */
};

/** What mains light the exposure is fitted to, so that it does not flicker. */
enum dio_camera_flicker {
	DIO_CAMERA_FLICKER_KEEP, /* as it is */
	DIO_CAMERA_FLICKER_AUTO,
	DIO_CAMERA_FLICKER_OFF,
	DIO_CAMERA_FLICKER_50HZ,
	DIO_CAMERA_FLICKER_60HZ,
};

/** Wishes about exposure, gain, white balance and focus; all zero: automatic. */
struct dio_camera_wish {
	bool hold; /* keep each of them still from now on: at the value wished, else as it is */
	uint32_t exposure_us; /* 0: no wish */
	double gain;          /* in the device's unit, libcamera: times; 0: no wish */
	enum dio_camera_flicker flicker;
};

/** What the driver really did, read back from it. */
struct dio_camera_controls {
	uint32_t offered; /* enum dio_camera_lock bits: what this device can be told to hold */
	struct dio_frame_metadata metadata; /* with `locked`: what of it is held */
	enum dio_camera_flicker flicker;    /* in force; KEEP: the device has no such control */
};

/**
 * Open a camera.
 *
 * spec   `v4l2:/dev/video0` or `/dev/video0`; `libcamera:0` or `libcamera:IDENTITY`;
 * `sim:table?seed=7&width=640&...`; `replay:PATH`, or a PATH to a folder of pictures or to a
 * recording
 *
 * DIO_NOT_FOUND, DIO_BUSY, DIO_BAD_ARG (a specification that cannot be read; the text says which
 * word), DIO_UNSUPPORTED (no format in common)
 */
enum dio_status dio_camera_open(const char *spec, const struct dio_camera_options *options,
				struct dio_camera **camera, struct dio_error *error);

/** Accepts NULL and a camera whose device is gone. */
void dio_camera_close(struct dio_camera *camera);

enum dio_status dio_camera_start(struct dio_camera *camera, struct dio_error *error);
enum dio_status dio_camera_stop(struct dio_camera *camera, struct dio_error *error);

/**
 * Take the next frame: the newest one of a device (older ones are counted as drained).
 *
 * frame       valid until the next acquire, stop or close
 * timeout_ns  longest wait
 *
 * DIO_AGAIN  no frame in time; DIO_END  no more; DIO_GONE  unplugged;
 * DIO_NO_SIGNAL  the device's input has no signal, which is no fault: go on asking;
 * DIO_REFUSED  the signal has changed its size: close, and open again;
 * DIO_BAD_FILE  a picture of a folder cannot be read: the text names it, the next call goes on
 */
enum dio_status dio_camera_acquire(struct dio_camera *camera, struct dio_frame *frame,
				   int64_t timeout_ns, struct dio_error *error);

/** File name behind the last frame (replay), or "" (devices). Owned by the camera. */
const char *dio_camera_get_frame_name(const struct dio_camera *camera);

/**
 * The memory behind the frame acquired last as a DMABUF descriptor that can only be read, for a
 * display or an encoder to import; -1 where the camera offers none. Owned by the camera, good until
 * it is closed; what it holds is the frame's until the next acquire.
 */
int dio_camera_get_dmabuf(struct dio_camera *camera);

void dio_camera_get_info(const struct dio_camera *camera, struct dio_camera_info *info);
void dio_camera_get_counters(const struct dio_camera *camera, struct dio_camera_counters *counters);

/**
 * Tell the camera how to expose. What a device does not offer is no failure: `done` says what was
 * offered and what is held now. Frames acquired from now on carry the new metadata.
 *
 * DIO_UNSUPPORTED  this kind of camera has no controls (replay); DIO_GONE  unplugged
 */
enum dio_status dio_camera_set_controls(struct dio_camera *camera,
					const struct dio_camera_wish *wish,
					struct dio_camera_controls *done, struct dio_error *error);

/** Read them from the device, which may take milliseconds; statuses as above. */
enum dio_status dio_camera_get_controls(struct dio_camera *camera, struct dio_camera_controls *now,
					struct dio_error *error);

#ifdef __cplusplus
}
#endif
#endif
