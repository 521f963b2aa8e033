/* The shared memory: what a holder of its descriptor cannot do, and what a client checks. */
#include "fixture.h"

#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <string.h>
#include <sys/mman.h>
#include <unistd.h>

#include "ring/memory.h"

#define SLOTS 4
#define BYTES 5000

static struct dio_ring_memory make(void)
{
	struct dio_ring_memory memory = {.fd = -1};
	struct dio_error error;

	if (dio_ring_memory_create(&memory, SLOTS, BYTES, 0, &error) != DIO_OK)
		fail_msg("%s", error.text);
	return memory;
}

static void nobody_who_holds_the_descriptor_can_write(void **state)
{
	struct dio_ring_memory memory = make();
	char path[64], byte = 1;
	void *map;
	int fd;

	(void)state;
	assert_ptr_equal(mmap(NULL, memory.bytes, PROT_READ | PROT_WRITE, MAP_SHARED, memory.fd, 0),
			 MAP_FAILED);
	map = mmap(NULL, memory.bytes, PROT_READ, MAP_SHARED, memory.fd, 0);
	assert_ptr_not_equal(map, MAP_FAILED);
	assert_int_equal(mprotect(map, memory.bytes, PROT_READ | PROT_WRITE), -1);
	assert_int_equal(pwrite(memory.fd, &byte, 1, 0), -1);
	assert_int_equal(ftruncate(memory.fd, 0), -1);
	assert_int_equal(ftruncate(memory.fd, 1 << 20), -1);
	assert_int_equal(fallocate(memory.fd, FALLOC_FL_PUNCH_HOLE | FALLOC_FL_KEEP_SIZE, 0, 4096),
			 -1);
	assert_int_equal(fcntl(memory.fd, F_ADD_SEALS, F_SEAL_WRITE), -1);
	/* Nor by opening the file anew. */
	snprintf(path, sizeof(path), "/proc/self/fd/%d", memory.fd);
	fd = open(path, O_RDWR | O_CLOEXEC);
	if (fd >= 0) {
		assert_ptr_equal(mmap(NULL, memory.bytes, PROT_WRITE, MAP_SHARED, fd, 0),
				 MAP_FAILED);
		assert_int_equal(pwrite(fd, &byte, 1, 0), -1);
		close(fd);
	}
	/* The server itself still can. */
	memory.header->first = 9;
	assert_int_equal(((const struct dio_ring_header *)map)->first, 9);
	munmap(map, memory.bytes);
	dio_ring_memory_close(&memory);
}

/* What a dishonest server might hand over: a header of ours, altered, in memory of any size. */
static enum dio_status open_forged(const struct dio_ring_header *header, size_t bytes, int seals)
{
	struct dio_ring_memory opened = {.fd = -1};
	struct dio_error error;
	enum dio_status status;
	int fd = memfd_create("forged", MFD_CLOEXEC | MFD_ALLOW_SEALING);

	assert_true(fd >= 0);
	assert_int_equal(ftruncate(fd, (off_t)bytes), 0);
	assert_true(pwrite(fd, header, bytes < sizeof(*header) ? bytes : sizeof(*header), 0) > 0);
	assert_int_equal(fcntl(fd, F_ADD_SEALS, seals), 0);
	status = dio_ring_memory_open(&opened, fd, &error);
	if (status == DIO_OK)
		dio_ring_memory_close(&opened);
	else
		close(fd);
	return status;
}

#define ALL_SEALS (F_SEAL_SHRINK | F_SEAL_GROW | F_SEAL_FUTURE_WRITE | F_SEAL_SEAL)

static void a_client_opens_only_what_is_sealed_and_agrees_with_itself(void **state)
{
	struct dio_ring_memory memory = make();
	struct dio_ring_header good, bad;

	(void)state;
	memcpy(&good, memory.header, sizeof(good));
	assert_int_equal(open_forged(&good, memory.bytes, ALL_SEALS), DIO_OK);
	assert_int_equal(open_forged(&good, memory.bytes, F_SEAL_GROW), DIO_BAD_FILE);
	assert_int_equal(open_forged(&good, memory.bytes, ALL_SEALS & ~F_SEAL_SHRINK),
			 DIO_BAD_FILE);
	assert_int_equal(open_forged(&good, memory.bytes - 1, ALL_SEALS), DIO_BAD_FILE);
	assert_int_equal(open_forged(&good, 8, ALL_SEALS), DIO_BAD_FILE);
#define FORGE(field, value, status)                                                                \
	do {                                                                                       \
		memcpy(&bad, &good, sizeof(bad));                                                  \
		bad.field = value;                                                                 \
		assert_int_equal(open_forged(&bad, memory.bytes, ALL_SEALS), status);              \
	} while (0)
	FORGE(magic, 1, DIO_BAD_FILE);
	FORGE(version, DIO_RING_VERSION + 1, DIO_UNSUPPORTED);
	FORGE(slot_count, 0, DIO_BAD_FILE);
	FORGE(slot_count, 0xffffffffu, DIO_BAD_FILE);
	FORGE(slot_count, SLOTS + 1, DIO_BAD_FILE);
	FORGE(slot_offset, 0, DIO_BAD_FILE);
	FORGE(slot_offset, 65, DIO_BAD_FILE);
	FORGE(slot_offset, 0xffffffc0u, DIO_BAD_FILE);
	FORGE(slot_bytes, 0, DIO_BAD_FILE);
	FORGE(slot_bytes, good.slot_bytes + 64, DIO_BAD_FILE);
	FORGE(slot_bytes, ~(uint64_t)63, DIO_BAD_FILE);
	FORGE(slot_bytes, (uint64_t)1 << 62, DIO_BAD_FILE);
	FORGE(data_bytes, good.slot_bytes, DIO_BAD_FILE);
	FORGE(data_bytes, ~(uint64_t)0, DIO_BAD_FILE);
	dio_ring_memory_close(&memory);
}

static void slots_lie_apart_and_a_mark_tells_which_frame_they_hold(void **state)
{
	struct dio_ring_memory memory = make();

	(void)state;
	for (uint64_t i = 0; i < SLOTS; i++) {
		struct dio_ring_slot *slot = dio_ring_memory_slot(&memory, i);

		assert_false(dio_ring_slot_holds(slot, i));
		dio_ring_slot_begin(slot, i);
		assert_false(dio_ring_slot_holds(slot, i));
		memset(slot->data, (int)i, BYTES);
		dio_ring_slot_end(slot, i);
	}
	for (uint64_t i = 0; i < SLOTS; i++) {
		struct dio_ring_slot *slot = dio_ring_memory_slot(&memory, i + 7 * SLOTS);

		assert_true(dio_ring_slot_holds(slot, i));
		assert_false(dio_ring_slot_holds(slot, i + SLOTS));
		for (size_t b = 0; b < BYTES; b++)
			assert_int_equal(slot->data[b], i);
		dio_ring_slot_begin(slot, i + SLOTS);
		assert_false(dio_ring_slot_still_holds(slot, i));
	}
	dio_ring_memory_close(&memory);
	dio_ring_memory_close(&memory);
}

static void sizes_that_overflow_are_refused(void **state)
{
	struct dio_ring_memory memory = {.fd = -1};
	struct dio_error error;

	(void)state;
	assert_int_equal(dio_ring_memory_create(&memory, SLOTS, 0, 0, &error), DIO_NO_MEM);
	assert_int_equal(dio_ring_memory_create(&memory, SLOTS, SIZE_MAX, 0, &error), DIO_NO_MEM);
	assert_int_equal(dio_ring_memory_create(&memory, SLOTS, (size_t)1 << 30, 0, &error),
			 DIO_NO_MEM);
	assert_int_equal(memory.fd, -1);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(nobody_who_holds_the_descriptor_can_write),
		cmocka_unit_test(a_client_opens_only_what_is_sealed_and_agrees_with_itself),
		cmocka_unit_test(slots_lie_apart_and_a_mark_tells_which_frame_they_hold),
		cmocka_unit_test(sizes_that_overflow_are_refused),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
