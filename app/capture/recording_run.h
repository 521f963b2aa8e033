/* Recording from a camera, as `diorama capture` and the demo run it. */
#ifndef DIO_CAPTURE_RECORDING_RUN_H
#define DIO_CAPTURE_RECORDING_RUN_H

#include <signal.h>
#include <stdint.h>

#include "dio/camera.h"
#include "dio/status.h"

struct dio_recording_options {
	struct dio_camera_options camera;  /* wishes about size and rate */
	uint64_t frames;                   /* 0: no limit */
	double seconds;                    /* by the frames' timestamps; 0: no limit */
	const volatile sig_atomic_t *stop; /* NULL, or set from outside to end the recording */
};

/** What was recorded. */
struct dio_recording_result {
	struct dio_camera_info camera;
	struct dio_camera_counters counters;
	uint64_t frames; /* stored */
	uint32_t unreadable;
	double seconds; /* from the first to the last frame */
};

/**
 * Record frames of a camera (or any input) into a new folder.
 *
 * result  filled on failure too: what it counts is stored
 *
 * DIO_GONE, DIO_NO_SIGNAL, DIO_NO_SPACE  the text says how many frames are kept
 */
enum dio_status dio_recording_run(const char *camera, const char *folder,
				  const struct dio_recording_options *options,
				  struct dio_recording_result *result, struct dio_error *error);

#endif
