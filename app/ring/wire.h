/* What passes between ring server and client: the layout of the shared memory, and the messages.
 *
 * The memory is a memfd of fixed size. Only the server can write it: it maps the memory before it
 * sets F_SEAL_FUTURE_WRITE, which refuses every later writable mapping, write() and hole, also to
 * whoever holds the descriptor. F_SEAL_SHRINK keeps a reader from SIGBUS.
 *
 * Header, then slot_count slots of slot_bytes, each a slot header and the frame's data. Frame
 * `index` (counted from 0 since the daemon began) lies in slot index % slot_count. Each slot is a
 * seqlock: its `version` is 2 * index + 1 while frame `index` is written and 2 * index + 2 once it
 * is whole, so that a reader knows which frame it holds and, asked again afterwards, whether it
 * was overtaken (Boehm, "Can seqlocks get along with programming language memory models?", 2012).
 *
 * Wake-ups are messages and no eventfd: a reader shares an eventfd's flags with us and could make
 * our write to it block, while send() with MSG_DONTWAIT on our own end cannot be made to wait.
 */
#ifndef DIO_RING_WIRE_H
#define DIO_RING_WIRE_H

#include <stdatomic.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#define DIO_RING_MAGIC      0x474e5244u /* "DRNG" */
#define DIO_RING_VERSION    1u
#define DIO_RING_NAME_BYTES 32
#define DIO_RING_TEXT_BYTES 200
#define DIO_RING_SLOTS_MIN  3u
#define DIO_RING_SLOTS_MAX  64u
#define DIO_RING_BYTES_MAX  ((uint64_t)2 << 30)

/** At the start of the memory; all but `published` is constant. */
struct dio_ring_header {
	uint32_t magic, version;
	uint32_t slot_count, slot_offset; /* of slot 0 from the start */
	uint64_t slot_bytes;              /* from one slot to the next */
	uint64_t data_bytes;              /* room for a frame's data in a slot */
	uint64_t first;                   /* index of the first frame written to this memory */
	_Atomic uint64_t published;       /* one past the newest whole frame's index */
};

/** At the start of each slot; the data follow at once. */
struct dio_ring_slot {
	_Atomic uint64_t version;
	uint64_t sequence;     /* the driver's */
	uint64_t timestamp_ns; /* CLOCK_MONOTONIC of the exposure, the driver's */
	uint64_t published_ns; /* CLOCK_MONOTONIC when the daemon handed it out */
	uint64_t size_bytes;
	uint32_t format, width, height, pitch_bytes;
	uint32_t state; /* enum dio_capture_state when it was taken */
	uint32_t exposure_us;
	float gain;
	uint32_t white_balance_k;
	float red_gain, blue_gain;
	uint32_t locked;
	uint32_t reserved[5];
	uint8_t data[];
};

/** The client's only message, sent once on connecting. */
struct dio_ring_hello {
	uint32_t magic, version, bytes;
	char name[DIO_RING_NAME_BYTES];
};

enum dio_ring_message_kind {
	DIO_RING_MESSAGE_STATUS = 1, /* something changed: look */
	DIO_RING_MESSAGE_MEMORY = 2, /* the same, and the memory's descriptor comes along */
	DIO_RING_MESSAGE_REFUSED = 3 /* no service; `text` says why; the connection ends */
};

/** All the server says: always the whole status, so that one that is missed does no harm. */
struct dio_ring_message {
	uint32_t magic, version, bytes, kind;
	uint32_t state;
	uint32_t reserved;
	uint64_t published;
	uint64_t missed; /* wake-ups this client could not be sent, its socket being full */
	char text[DIO_RING_TEXT_BYTES];
};

_Static_assert(sizeof(struct dio_ring_header) == 48, "the layout is the contract");
_Static_assert(sizeof(struct dio_ring_slot) == 104, "the layout is the contract");
_Static_assert(sizeof(struct dio_ring_hello) == 44, "the layout is the contract");
_Static_assert(sizeof(struct dio_ring_message) == 240, "the layout is the contract");
_Static_assert(ATOMIC_LLONG_LOCK_FREE == 2, "a lock cannot be shared with another process");

#endif
