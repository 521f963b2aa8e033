#include "ring/memory.h"

#include <errno.h>
#include <fcntl.h>
#include <inttypes.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>

#define ALIGNMENT    64u
#define SEALS_NEEDED (F_SEAL_SHRINK | F_SEAL_GROW | F_SEAL_FUTURE_WRITE | F_SEAL_SEAL)

static uint64_t align(uint64_t bytes)
{
	return (bytes + ALIGNMENT - 1) / ALIGNMENT * ALIGNMENT;
}

static enum dio_status fail_call(const char *what, struct dio_error *error)
{
	int cause = errno;

	return dio_fail(error, cause == ENOMEM ? DIO_NO_MEM : DIO_IO, "frame ring: %s: %s", what,
			strerror(cause));
}

enum dio_status dio_ring_memory_create(struct dio_ring_memory *memory, uint32_t slot_count,
				       size_t data_bytes, uint64_t first, struct dio_error *error)
{
	const uint64_t offset = align(sizeof(struct dio_ring_header));
	struct dio_ring_memory made = {.fd = -1};
	enum dio_status status;
	uint64_t slot_bytes;
	void *map;

	if (data_bytes == 0 || data_bytes > DIO_RING_BYTES_MAX / slot_count)
		return dio_fail(error, DIO_NO_MEM,
				"frame ring: %u frames of %zu bytes are too much", slot_count,
				data_bytes);
	slot_bytes = align(sizeof(struct dio_ring_slot) + data_bytes);
	made.bytes = offset + slot_bytes * slot_count;
	made.fd = memfd_create("diorama-frames", MFD_CLOEXEC | MFD_ALLOW_SEALING);
	if (made.fd < 0)
		return fail_call("memfd_create", error);
	if (ftruncate(made.fd, (off_t)made.bytes) != 0) {
		status = fail_call("cannot size the shared memory", error);
		goto fail;
	}
	map = mmap(NULL, made.bytes, PROT_READ | PROT_WRITE, MAP_SHARED, made.fd, 0);
	if (map == MAP_FAILED) {
		status = fail_call("cannot map the shared memory", error);
		goto fail;
	}
	made.header = map;
	if (fcntl(made.fd, F_ADD_SEALS, SEALS_NEEDED) != 0) {
		status = fail_call("cannot seal the shared memory (Linux 5.1 is needed)", error);
		goto fail;
	}
	made.header->magic = DIO_RING_MAGIC;
	made.header->version = DIO_RING_VERSION;
	made.header->slot_count = slot_count;
	made.header->slot_offset = (uint32_t)offset;
	made.header->slot_bytes = slot_bytes;
	made.header->data_bytes = data_bytes;
	made.header->first = first;
	atomic_init(&made.header->published, first);
	*memory = made;
	return DIO_OK;
fail:
	dio_ring_memory_close(&made);
	return status;
}

static enum dio_status check_header(const struct dio_ring_header *header, uint64_t bytes,
				    struct dio_error *error)
{
	if (header->magic != DIO_RING_MAGIC)
		return dio_fail(error, DIO_BAD_FILE, "frame ring: not a ring of frames");
	if (header->version != DIO_RING_VERSION)
		return dio_fail(error, DIO_UNSUPPORTED,
				"frame ring: of version %u, this program knows %u; install both "
				"from one release",
				header->version, DIO_RING_VERSION);
	if (header->slot_count < DIO_RING_SLOTS_MIN || header->slot_count > DIO_RING_SLOTS_MAX ||
	    header->slot_offset < sizeof(*header) || header->slot_offset % ALIGNMENT != 0 ||
	    header->slot_offset > bytes || header->slot_bytes % ALIGNMENT != 0 ||
	    header->slot_bytes < sizeof(struct dio_ring_slot) ||
	    header->data_bytes > header->slot_bytes - sizeof(struct dio_ring_slot) ||
	    header->slot_bytes > (bytes - header->slot_offset) / header->slot_count)
		return dio_fail(error, DIO_BAD_FILE,
				"frame ring: %" PRIu64 " bytes contradict %u slots of %" PRIu64
				" bytes",
				bytes, header->slot_count, header->slot_bytes);
	return DIO_OK;
}

enum dio_status dio_ring_memory_open(struct dio_ring_memory *memory, int fd,
				     struct dio_error *error)
{
	struct dio_ring_memory made = {.fd = -1};
	enum dio_status status;
	struct stat st;
	int seals;
	void *map;

	seals = fcntl(fd, F_GET_SEALS);
	if (seals < 0 || (seals & SEALS_NEEDED) != SEALS_NEEDED)
		return dio_fail(error, DIO_BAD_FILE, "frame ring: the memory is not sealed");
	if (fstat(fd, &st) != 0)
		return fail_call("fstat", error);
	if (st.st_size < (off_t)sizeof(struct dio_ring_header) ||
	    (uint64_t)st.st_size > 2 * DIO_RING_BYTES_MAX)
		return dio_fail(error, DIO_BAD_FILE, "frame ring: memory of %lld bytes",
				(long long)st.st_size);
	made.bytes = (size_t)st.st_size;
	map = mmap(NULL, made.bytes, PROT_READ, MAP_SHARED, fd, 0);
	if (map == MAP_FAILED)
		return fail_call("cannot map the shared memory", error);
	made.header = map;
	status = check_header(made.header, made.bytes, error);
	if (status != DIO_OK) {
		dio_ring_memory_close(&made);
		return status;
	}
	made.fd = fd;
	*memory = made;
	return DIO_OK;
}

void dio_ring_memory_close(struct dio_ring_memory *memory)
{
	if (memory->header)
		munmap(memory->header, memory->bytes);
	if (memory->fd >= 0)
		close(memory->fd);
	*memory = (struct dio_ring_memory){.fd = -1};
}

struct dio_ring_slot *dio_ring_memory_slot(const struct dio_ring_memory *memory, uint64_t index)
{
	const struct dio_ring_header *header = memory->header;
	uint8_t *start = (uint8_t *)memory->header + header->slot_offset;

	/* Both terms are multiples of 64. */
	return (struct dio_ring_slot *)(void *)(start +
						index % header->slot_count * header->slot_bytes);
}

/* The thread sanitizer does not follow fences, and gcc says so; it need not here, since writer and
 * reader look at the memory through mappings of their own. */
#if defined(__GNUC__) && !defined(__clang__)
#pragma GCC diagnostic ignored "-Wtsan"
#endif

void dio_ring_slot_begin(struct dio_ring_slot *slot, uint64_t index)
{
	atomic_store_explicit(&slot->version, 2 * index + 1, memory_order_relaxed);
	/* No byte of the frame is written before the mark is. */
	atomic_thread_fence(memory_order_release);
}

void dio_ring_slot_end(struct dio_ring_slot *slot, uint64_t index)
{
	atomic_store_explicit(&slot->version, 2 * index + 2, memory_order_release);
}

bool dio_ring_slot_holds(const struct dio_ring_slot *slot, uint64_t index)
{
	return atomic_load_explicit(&slot->version, memory_order_acquire) == 2 * index + 2;
}

bool dio_ring_slot_still_holds(const struct dio_ring_slot *slot, uint64_t index)
{
	/* No byte of the frame is read after the mark is. */
	atomic_thread_fence(memory_order_acquire);
	return atomic_load_explicit(&slot->version, memory_order_relaxed) == 2 * index + 2;
}
