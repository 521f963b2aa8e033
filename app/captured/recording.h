/* Recording to disk beside the stream: in a thread of its own, so that no disk delays a frame. */
#ifndef DIO_CAPTURED_RECORDING_H
#define DIO_CAPTURED_RECORDING_H

#include <stdbool.h>
#include <stdint.h>

#include "dio/camera.h"
#include "dio/frame.h"
#include "dio/status.h"

/**
 * Opaque. offer() is the camera thread's, the rest the main thread's. One recording at a time.
 *
 * While one runs, FOLDER/.current holds its name, so that a daemon that was killed goes on with it
 * when it is started again.
 */
struct dio_recording;

struct dio_recording_status {
	bool active;
	char path[400];   /* of the recording under way or the last one; "" before */
	char text[512];   /* why the last one ended by itself; "" when it did not */
	uint64_t frames;  /* written, those of before a resumption too */
	uint64_t dropped; /* frames that came while the disk was behind */
};

/**
 * folder       where recordings go; made when the first one starts
 * reserve_mib  free space that stays free
 * changed_fd   an eventfd that is written when a recording ends by itself
 */
enum dio_status dio_recording_create(const char *folder, uint32_t reserve_mib, int changed_fd,
				     struct dio_recording **recording, struct dio_error *error);
/** Ends what runs in good order, to be gone on with at the next start. NULL is fine. */
void dio_recording_destroy(struct dio_recording *recording);

/**
 * Start a recording, or go on with one of that name.
 *
 * name  letters, digits, dot, dash and underscore, no dot in front; "": made from date and time
 *
 * DIO_BAD_ARG   the name; DIO_BUSY  one is under way; DIO_NO_SPACE  the disk would not hold a
 * minute of it above the reserve; DIO_BAD_FILE  the recording that is there is damaged
 */
enum dio_status dio_recording_start(struct dio_recording *recording, const char *name,
				    const struct dio_camera_info *camera, struct dio_error *error);

/** Write what is queued, close. DIO_NOT_FOUND: none is under way. */
enum dio_status dio_recording_stop(struct dio_recording *recording, struct dio_error *error);

/** The name of a recording that was cut off, or "": go on with it once frames come. */
void dio_recording_get_interrupted(struct dio_recording *recording, char *name, size_t size);

/** Queue a copy of the frame when one is under way; never waits. */
void dio_recording_offer(struct dio_recording *recording, const struct dio_frame *frame);

void dio_recording_get_status(struct dio_recording *recording, struct dio_recording_status *status);

#endif
