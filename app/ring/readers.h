/* The readers of a ring: their connections, and what they are told. */
#ifndef DIO_RING_READERS_H
#define DIO_RING_READERS_H

#include <pthread.h>

#include "ring/ring.h"
#include "ring/wire.h"

/** Connections at a time, and those of one process, so that none can take all. */
#define DIO_RING_READERS_MAX 32
#define DIO_RING_PER_PROCESS 4

struct dio_ring_connection {
	int fd; /* -1: free */
	pid_t pid;
	bool greeted;
	bool owed;            /* its socket was full: to be told the status once it drains */
	uint64_t deadline_ns; /* until then it must have said hello */
	uint64_t memory_sent; /* number of the memory it has */
	uint64_t missed;
	char name[DIO_RING_NAME_BYTES];
};

struct dio_ring_readers {
	pthread_mutex_t lock; /* guards all below but the descriptors, which stay the same */
	int listener, epoll, timer;
	char path[108]; /* of the socket file to remove; "" when it is not ours */
	bool paused;    /* the system is out of descriptors: nobody is let in for a moment */
	struct dio_ring_connection table[DIO_RING_READERS_MAX];
	struct dio_ring_message status;
	int memory_fd; /* borrowed; -1 before the first frame */
	uint64_t memory_number;
	uint64_t missed, refused;
};

enum dio_status dio_ring_readers_init(struct dio_ring_readers *readers,
				      const struct dio_ring_server_options *options,
				      struct dio_error *error);
/** Accepts one whose init failed. */
void dio_ring_readers_deinit(struct dio_ring_readers *readers);

void dio_ring_readers_dispatch(struct dio_ring_readers *readers);

/** Another memory from now on: each reader gets its descriptor with the next message. */
void dio_ring_readers_set_memory(struct dio_ring_readers *readers, int memory_fd);

/** Tell all readers that frames up to `published` are there. */
void dio_ring_readers_wake(struct dio_ring_readers *readers, uint64_t published);

/** Tell all readers a state; nothing is sent when it is the present one. */
void dio_ring_readers_set_state(struct dio_ring_readers *readers, enum dio_capture_state state,
				const char *text);

#endif
