/* org.diorama.Capture1: what the capture daemon shows and takes on the bus. */
#ifndef DIO_CAPTURED_CONTROL_H
#define DIO_CAPTURED_CONTROL_H

#include <poll.h>

#include "captured/camera_thread.h"
#include "captured/recording.h"
#include "ring/ring.h"

/** Opaque, thread-bound. */
struct dio_control;

/** What it shows and steers; borrowed. */
struct dio_control_parts {
	struct dio_camera_thread *camera;
	struct dio_recording *recording;
	struct dio_ring_server *ring;
};

/**
 * Connect, and publish the object. A bus that is not there, or does not give the name, is tried
 * again until it does: the frames flow without it.
 *
 * address  as dio_bus_open() takes it; "": its default; "none": no bus at all
 */
enum dio_status dio_control_create(const char *address, const struct dio_control_parts *parts,
				   struct dio_control **control, struct dio_error *error);
/** NULL is fine. */
void dio_control_destroy(struct dio_control *control);

/** What to wait for; fd->fd is -1 while there is no bus. `timeout_ms` -1: no limit. */
void dio_control_prepare(const struct dio_control *control, struct pollfd *fd, int *timeout_ms);

/** Answer calls; look for the bus when it is away. */
void dio_control_process(struct dio_control *control);

/** Signal what has changed. `counters`: the numbers that run all the time too. */
void dio_control_update(struct dio_control *control, bool counters);

#endif
