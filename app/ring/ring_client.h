/* The frame ring's reading end. It finds the daemon again by itself when that was restarted. */
#ifndef DIO_RING_RING_CLIENT_H
#define DIO_RING_RING_CLIENT_H

#include <stdbool.h>
#include <stdint.h>

#include "dio/frame.h"
#include "dio/status.h"
#include "ring/state.h"

/** Where the daemon listens unless told otherwise. */
#define DIO_RING_SOCKET_DEFAULT "/run/diorama/frames"

/** Opaque, thread-bound. */
struct dio_ring_client;

enum dio_ring_order {
	DIO_RING_NEWEST,   /* each acquire gives the newest frame; those between are passed over */
	DIO_RING_IN_ORDER, /* every frame in turn, as long as the ring still holds it */
};

struct dio_ring_client_options {
	const char *path; /* NULL: DIO_RING_SOCKET_DEFAULT */
	const char *name; /* what the daemon lists this reader as; at most 31 letters */
	enum dio_ring_order order;
};

/** A frame in the ring: read-only memory that the daemon will write again. */
struct dio_ring_frame {
	struct dio_frame frame;
	uint64_t index; /* the ring's count, from 0 since the daemon began */
	uint64_t published_ns;
	enum dio_capture_state state; /* when it was taken */
};

struct dio_ring_client_status {
	enum dio_capture_state state; /* DIO_CAPTURE_ABSENT while the daemon is away */
	char text[200];               /* one line about it, may be empty */
	uint64_t taken;               /* frames acquired */
	uint64_t dropped;             /* published while connected and not acquired */
	uint64_t overtaken;           /* acquired, and overwritten before the reader was done */
	uint32_t connections;         /* times the daemon was found */
};

/**
 * Make a client. The daemon need not be there: until it is, the state is DIO_CAPTURE_ABSENT.
 *
 * DIO_BAD_ARG  path or name too long; DIO_IO  out of descriptors; DIO_NO_MEM
 */
enum dio_status dio_ring_client_open(const struct dio_ring_client_options *options,
				     struct dio_ring_client **client, struct dio_error *error);
/** NULL is fine. */
void dio_ring_client_close(struct dio_ring_client *client);

/**
 * A descriptor for poll(): readable when a frame or a change of state may be there. Then call
 * dio_ring_client_acquire() with timeout 0 until it says DIO_AGAIN. The same descriptor for the
 * client's whole life; owned by the client.
 */
int dio_ring_client_get_fd(const struct dio_ring_client *client);

/**
 * The next frame by the client's order.
 *
 * frame       its data lie in the ring: use or copy them, then ask dio_ring_client_is_whole()
 * timeout_ns  longest wait; 0: none
 *
 * DIO_AGAIN        no frame in time; the text and dio_ring_client_get_status() say in what state
 *                  the camera is. Returned early when that state changes, so that it can be shown
 * DIO_UNSUPPORTED  the daemon is of another version, or refuses; it is tried again later
 */
enum dio_status dio_ring_client_acquire(struct dio_ring_client *client,
					struct dio_ring_frame *frame, int64_t timeout_ns,
					struct dio_error *error);

/**
 * Whether what was read of the frame's data since acquire is that frame. false: the daemon has
 * overtaken the reader; throw the result away and acquire again.
 */
bool dio_ring_client_is_whole(struct dio_ring_client *client, const struct dio_ring_frame *frame);

/**
 * Copy the data out and check: on success frame->frame.data points to `bytes`.
 *
 * bytes  room for frame->frame.size_bytes; `size` says how much there is
 *
 * DIO_AGAIN  overtaken; DIO_BAD_ARG  no room
 */
enum dio_status dio_ring_client_copy(struct dio_ring_client *client, struct dio_ring_frame *frame,
				     void *bytes, size_t size, struct dio_error *error);

void dio_ring_client_get_status(const struct dio_ring_client *client,
				struct dio_ring_client_status *status);

#endif
