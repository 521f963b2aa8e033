/* What the capture daemon knows of itself: written by the camera's thread, shown on the bus. */
#ifndef DIO_CAPTURED_STATUS_H
#define DIO_CAPTURED_STATUS_H

#include <stdbool.h>
#include <stdint.h>

#include "dio/camera.h"
#include "ring/state.h"

/** Where the holding of exposure, gain and white balance stands. */
enum dio_hold_state {
	DIO_HOLD_AUTOMATIC,   /* the camera adjusts itself */
	DIO_HOLD_SETTLING,    /* waiting until it has found its values */
	DIO_HOLD_HELD,        /* the driver confirms all that it offers to hold */
	DIO_HOLD_PARTLY,      /* the driver did not obey in all; see controls */
	DIO_HOLD_NOT_OFFERED, /* the camera has nothing that could be held */
};

/** "automatic", "settling" and so on. Never NULL. */
const char *dio_hold_state_name(enum dio_hold_state state);

struct dio_capture_status {
	enum dio_capture_state state;
	char text[512];                      /* one line about it, may be empty */
	struct dio_camera_info camera;       /* of the camera opened last; name "" before */
	struct dio_camera_counters counters; /* over all openings */
	double rate;                         /* frames a second by the driver's times; 0: none */
	enum dio_hold_state hold;
	bool settled; /* the picture had come to rest when it was held */
	struct dio_camera_controls controls;
	uint64_t recoveries;   /* times that frames came again after a failure */
	uint64_t unreadable;   /* pictures of a replay that could not be read */
	uint64_t heartbeat_ns; /* when the camera's thread last came round */
};

#endif
