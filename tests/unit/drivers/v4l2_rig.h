/* A scripted V4L2 device, the camera on it, and whatever the last calls gave. */
#ifndef V4L2_RIG_H
#define V4L2_RIG_H

#include "dio/camera.h"
#include "fake_v4l2.h"

#define SECOND_NS 1000000000ll

struct rig {
	struct fake_v4l2 fake;
	struct dio_v4l2_system system;
	struct dio_camera_options options;
	struct dio_camera *camera;
	struct dio_camera_info info;
	struct dio_camera_controls controls;
	struct dio_camera_counters counters;
	struct dio_frame frame;
	struct dio_error error;
};

/** The webcam of fake_v4l2_init(), not open yet, and no wishes. */
void rig_init(struct rig *rig);

/** Open /dev/video9; `info` follows where that works. */
enum dio_status rig_open(struct rig *rig);

/** Open and start, or fail the test. */
void rig_start(struct rig *rig);

/** Acquire into `frame`; `counters` follow. */
enum dio_status rig_acquire(struct rig *rig, int64_t timeout_ns);

/** Close; fails the test unless all that was opened, mapped and exported is given back. */
void rig_close(struct rig *rig);

#endif
