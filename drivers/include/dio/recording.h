/* A recording: a folder with frames/NNNNNN.{png,jpg} and recording.json (camera; timestamp,
 * sequence, checksum of each frame, exposure, gain and white balance where the camera says). */
#ifndef DIO_RECORDING_H
#define DIO_RECORDING_H

#include <stdint.h>

#include "dio/camera.h"
#include "dio/frame.h"
#include "dio/status.h"

#ifdef __cplusplus
extern "C" {
#endif

/** Opaque, thread-bound. */
struct dio_recorder;

/**
 * Start a recording in a new folder (made; an existing recording is refused with DIO_BAD_ARG).
 * MJPEG frames are stored as they came, others as PNG. Each frame is written beside and renamed,
 * then a line with its time and checksum goes to recording.journal; closing folds the journal into
 * recording.json. Replay reads both, so a power cut loses at most the frame in flight.
 */
enum dio_status dio_recorder_open(const char *folder, const struct dio_camera_info *camera,
				  struct dio_recorder **recorder, struct dio_error *error);

/**
 * Go on with a recording, closed or cut off: frames are added behind those it has. At every moment
 * of this the folder is a whole recording of the same frames.
 *
 * frames  NULL, or receives how many there are
 *
 * DIO_NOT_FOUND  there is none; DIO_BAD_FILE  it is damaged
 */
enum dio_status dio_recorder_resume(const char *folder, const struct dio_camera_info *camera,
				    struct dio_recorder **recorder, uint64_t *frames,
				    struct dio_error *error);
enum dio_status dio_recorder_append(struct dio_recorder *recorder, const struct dio_frame *frame,
				    struct dio_error *error);

/** Write the index, release. NULL is fine. The status is that of the last write. */
enum dio_status dio_recorder_close(struct dio_recorder *recorder, struct dio_error *error);

#ifdef __cplusplus
}
#endif
#endif
