#include "ring/ring.h"

#include <stdatomic.h>
#include <stdlib.h>
#include <string.h>

#include "dio/clock.h"
#include "ring/memory.h"
#include "ring/readers.h"

#define SLOTS_DEFAULT 8
/* JPEG pictures differ in size: room for twice the first spares most changes of the memory. */
#define JPEG_MARGIN 2

struct dio_ring_server {
	struct dio_ring_readers readers;
	struct dio_ring_memory memory; /* the publishing thread's */
	uint32_t slot_count;
	uint64_t next; /* index of the frame to come */
	_Atomic uint64_t memory_bytes;
	_Atomic uint32_t state;
};

enum dio_status dio_ring_server_create(const struct dio_ring_server_options *options,
				       struct dio_ring_server **server, struct dio_error *error)
{
	const uint32_t slots = options->slot_count ? options->slot_count : SLOTS_DEFAULT;
	struct dio_ring_server *made;
	enum dio_status status;

	if (slots < DIO_RING_SLOTS_MIN || slots > DIO_RING_SLOTS_MAX)
		return dio_fail(error, DIO_BAD_ARG, "frame ring: %u slots; %u to %u can be", slots,
				DIO_RING_SLOTS_MIN, DIO_RING_SLOTS_MAX);
	made = calloc(1, sizeof(*made));
	if (!made)
		return dio_fail(error, DIO_NO_MEM, "frame ring: out of memory");
	made->memory.fd = -1;
	made->slot_count = slots;
	status = dio_ring_readers_init(&made->readers, options, error);
	if (status != DIO_OK) {
		dio_ring_readers_deinit(&made->readers);
		free(made);
		return status;
	}
	*server = made;
	return DIO_OK;
}

void dio_ring_server_destroy(struct dio_ring_server *server)
{
	if (!server)
		return;
	dio_ring_readers_deinit(&server->readers);
	dio_ring_memory_close(&server->memory);
	free(server);
}

int dio_ring_server_get_fd(const struct dio_ring_server *server)
{
	return server->readers.epoll;
}

void dio_ring_server_dispatch(struct dio_ring_server *server)
{
	dio_ring_readers_dispatch(&server->readers);
}

/* Larger memory, when the frame needs it; the readers keep the former until they have the new. */
static enum dio_status make_room(struct dio_ring_server *server, const struct dio_frame *frame,
				 struct dio_error *error)
{
	const bool varies = frame->format == DIO_PIXEL_MJPEG;
	struct dio_ring_memory made;
	enum dio_status status;

	if (server->memory.header && frame->size_bytes <= server->memory.header->data_bytes)
		return DIO_OK;
	if (frame->size_bytes > DIO_RING_BYTES_MAX / JPEG_MARGIN)
		return dio_fail(error, DIO_BAD_ARG, "frame ring: a frame of %zu bytes",
				frame->size_bytes);
	status = dio_ring_memory_create(&made, server->slot_count,
					frame->size_bytes * (varies ? JPEG_MARGIN : 1),
					server->next, error);
	if (status != DIO_OK)
		return status;
	dio_ring_readers_set_memory(&server->readers, made.fd);
	dio_ring_memory_close(&server->memory);
	server->memory = made;
	atomic_store(&server->memory_bytes, made.bytes);
	return DIO_OK;
}

static void write_slot(struct dio_ring_slot *slot, const struct dio_frame *frame, uint32_t state)
{
	slot->sequence = frame->sequence;
	slot->timestamp_ns = frame->timestamp_ns;
	slot->published_ns = dio_clock_ns();
	slot->size_bytes = frame->size_bytes;
	slot->format = (uint32_t)frame->format;
	slot->width = frame->width;
	slot->height = frame->height;
	slot->pitch_bytes = frame->pitch_bytes;
	slot->state = state;
	slot->exposure_us = frame->metadata.exposure_us;
	slot->gain = frame->metadata.gain;
	slot->white_balance_k = frame->metadata.white_balance_k;
	slot->red_gain = frame->metadata.red_gain;
	slot->blue_gain = frame->metadata.blue_gain;
	slot->locked = frame->metadata.locked;
	memcpy(slot->data, frame->data, frame->size_bytes);
}

enum dio_status dio_ring_server_publish(struct dio_ring_server *server,
					const struct dio_frame *frame, struct dio_error *error)
{
	struct dio_ring_slot *slot;
	enum dio_status status;

	if (!frame->data || frame->size_bytes == 0)
		return dio_fail(error, DIO_BAD_ARG, "frame ring: a frame without data");
	status = make_room(server, frame, error);
	if (status != DIO_OK)
		return status;
	slot = dio_ring_memory_slot(&server->memory, server->next);
	dio_ring_slot_begin(slot, server->next);
	write_slot(slot, frame, atomic_load(&server->state));
	dio_ring_slot_end(slot, server->next);
	server->next++;
	atomic_store_explicit(&server->memory.header->published, server->next,
			      memory_order_release);
	dio_ring_readers_wake(&server->readers, server->next);
	return DIO_OK;
}

void dio_ring_server_set_state(struct dio_ring_server *server, enum dio_capture_state state,
			       const char *text)
{
	atomic_store(&server->state, (uint32_t)state);
	dio_ring_readers_set_state(&server->readers, state, text);
}

void dio_ring_server_get_counters(struct dio_ring_server *server,
				  struct dio_ring_counters *counters)
{
	struct dio_ring_readers *readers = &server->readers;

	pthread_mutex_lock(&readers->lock);
	*counters = (struct dio_ring_counters){
		.published = readers->status.published,
		.missed = readers->missed,
		.refused = readers->refused,
		.memory_bytes = atomic_load(&server->memory_bytes),
	};
	for (size_t i = 0; i < DIO_RING_READERS_MAX; i++)
		counters->readers += readers->table[i].fd >= 0 && readers->table[i].greeted;
	pthread_mutex_unlock(&readers->lock);
}

size_t dio_ring_server_list_readers(struct dio_ring_server *server, struct dio_ring_reader *list,
				    size_t max)
{
	struct dio_ring_readers *readers = &server->readers;
	size_t n = 0;

	pthread_mutex_lock(&readers->lock);
	for (size_t i = 0; i < DIO_RING_READERS_MAX && n < max; i++) {
		const struct dio_ring_connection *connection = &readers->table[i];

		if (connection->fd < 0 || !connection->greeted)
			continue;
		list[n].pid = connection->pid;
		list[n].missed = connection->missed;
		memcpy(list[n].name, connection->name, sizeof(list[n].name));
		n++;
	}
	pthread_mutex_unlock(&readers->lock);
	return n;
}
