/* The thread that owns the camera: opens it, feeds the ring, and starts anew when it fails. */
#ifndef DIO_CAPTURED_CAMERA_THREAD_H
#define DIO_CAPTURED_CAMERA_THREAD_H

#include "captured/recording.h"
#include "captured/settings.h"
#include "captured/status.h"
#include "ring/ring.h"

/** Opaque. Its functions may be called from any thread. */
struct dio_camera_thread;

/**
 * Start the thread. It never gives up: a camera that is absent, refused or stalled is tried again,
 * at first at once, then with pauses that double up to half a second.
 *
 * settings, ring, recording  borrowed until destroy
 * changed_fd                 an eventfd that is written when more than counters has changed
 *
 * DIO_NO_MEM  also when no thread can be made
 */
enum dio_status dio_camera_thread_create(const struct dio_captured_settings *settings,
					 struct dio_ring_server *ring,
					 struct dio_recording *recording, int changed_fd,
					 struct dio_camera_thread **thread,
					 struct dio_error *error);

/** Stop, close the camera, join. NULL is fine. */
void dio_camera_thread_destroy(struct dio_camera_thread *thread);

void dio_camera_thread_get_status(struct dio_camera_thread *thread,
				  struct dio_capture_status *status);

/** Settle and hold exposure, gain and white balance, or let them go. Returns at once. */
void dio_camera_thread_hold(struct dio_camera_thread *thread, bool hold);

#endif
