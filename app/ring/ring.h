/* The frame ring's writing end: newest frames in sealed shared memory, any number of readers. */
#ifndef DIO_RING_RING_H
#define DIO_RING_RING_H

#include <stddef.h>
#include <stdint.h>
#include <sys/types.h>

#include "dio/frame.h"
#include "dio/status.h"
#include "ring/state.h"

/**
 * Opaque. publish() and set_state() may be called from another thread than dispatch() and the
 * rest, each of the two groups from one thread at a time. Nothing here waits for a reader.
 */
struct dio_ring_server;

struct dio_ring_server_options {
	const char *path;    /* of the socket to make; not used when listen_fd is given */
	int listen_fd;       /* -1, or a listening SOCK_SEQPACKET socket (systemd), taken over */
	mode_t mode;         /* of the socket file; 0: 0660 */
	uint32_t slot_count; /* 0: 8. A reader has slot_count - 1 frame times to use a frame */
};

struct dio_ring_counters {
	uint64_t published; /* frames handed out */
	uint64_t missed;    /* wake-ups that readers could not be sent */
	uint64_t refused;   /* connections refused: too many, wrong version, rubbish, silence */
	uint32_t readers;   /* connected and greeted */
	uint64_t memory_bytes;
};

/** One connected reader. */
struct dio_ring_reader {
	char name[32]; /* as it calls itself, unprintable letters replaced */
	pid_t pid;
	uint64_t missed;
};

/**
 * Make the socket. A socket file that nobody listens behind is replaced.
 *
 * DIO_BUSY  another daemon listens there; DIO_BAD_ARG  the path is too long, or slot_count
 */
enum dio_status dio_ring_server_create(const struct dio_ring_server_options *options,
				       struct dio_ring_server **server, struct dio_error *error);
/** Removes the socket file it made. NULL is fine. */
void dio_ring_server_destroy(struct dio_ring_server *server);

/** Readable when dispatch() has something to do. Owned by the server. */
int dio_ring_server_get_fd(const struct dio_ring_server *server);

/** Greet, refuse and forget readers, a bounded number a call; never waits. */
void dio_ring_server_dispatch(struct dio_ring_server *server);

/**
 * Copy a frame into the oldest slot and wake the readers. Memory is made on the first frame and
 * again when a frame is larger than any before; readers get the new one with their next wake-up.
 *
 * DIO_BAD_ARG  a frame without data or beyond the ring's bounds; DIO_NO_MEM
 */
enum dio_status dio_ring_server_publish(struct dio_ring_server *server,
					const struct dio_frame *frame, struct dio_error *error);

/** Tell the readers a state and one line about it ("" for none). No change: nothing is sent. */
void dio_ring_server_set_state(struct dio_ring_server *server, enum dio_capture_state state,
			       const char *text);

void dio_ring_server_get_counters(struct dio_ring_server *server,
				  struct dio_ring_counters *counters);

/** Up to `max` readers; returns how many. */
size_t dio_ring_server_list_readers(struct dio_ring_server *server, struct dio_ring_reader *readers,
				    size_t max);

#endif
