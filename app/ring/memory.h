/* The ring's shared memory: made and sealed by the server, checked and mapped by a client. */
#ifndef DIO_RING_MEMORY_H
#define DIO_RING_MEMORY_H

#include "dio/frame.h"
#include "dio/status.h"
#include "ring/wire.h"

/** One mapping; all zero but fd = -1 is none. */
struct dio_ring_memory {
	int fd;
	size_t bytes;
	struct dio_ring_header *header; /* the mapping's start; a client's is read-only */
};

/**
 * Make memory for slots that hold `data_bytes` each, map it writable, seal it.
 *
 * first  index of the first frame that will be written
 *
 * DIO_NO_MEM  also for sizes beyond DIO_RING_BYTES_MAX
 */
enum dio_status dio_ring_memory_create(struct dio_ring_memory *memory, uint32_t slot_count,
				       size_t data_bytes, uint64_t first, struct dio_error *error);

/**
 * Map what a server sent, read-only, after checking seals, size and every number of its header.
 *
 * fd  taken over on success
 *
 * DIO_UNSUPPORTED  of another version; DIO_BAD_FILE  not sealed, or it contradicts itself
 */
enum dio_status dio_ring_memory_open(struct dio_ring_memory *memory, int fd,
				     struct dio_error *error);

/** Unmap and close; one that holds nothing is fine. */
void dio_ring_memory_close(struct dio_ring_memory *memory);

/** Where frame `index` lies. */
struct dio_ring_slot *dio_ring_memory_slot(const struct dio_ring_memory *memory, uint64_t index);

/** Begin to overwrite a slot; dio_ring_slot_end() declares it whole. */
void dio_ring_slot_begin(struct dio_ring_slot *slot, uint64_t index);
void dio_ring_slot_end(struct dio_ring_slot *slot, uint64_t index);

/** Whether the slot holds frame `index`, whole: before reading, and after. */
bool dio_ring_slot_holds(const struct dio_ring_slot *slot, uint64_t index);
bool dio_ring_slot_still_holds(const struct dio_ring_slot *slot, uint64_t index);

#endif
