#include "fixture.h"

#include <poll.h>
#include <pthread.h>
#include <stdatomic.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <time.h>
#include <unistd.h>

#include "dio/clock.h"

static char folder[64];

int ring_fixture_setup(void **state)
{
	const char *base = getenv("TMPDIR");

	(void)state;
	/* Socket addresses are short: a long TMPDIR would not fit. */
	if (!base || strlen(base) > 30)
		base = "/tmp";
	snprintf(folder, sizeof(folder), "%s/dio-ring-XXXXXX", base);
	return mkdtemp(folder) ? 0 : -1;
}

int ring_fixture_teardown(void **state)
{
	(void)state;
	return rmdir(folder);
}

const char *ring_fixture_path(const char *name)
{
	static char path[100];

	snprintf(path, sizeof(path), "%s/%s", folder, name);
	return path;
}

struct dio_ring_server *ring_fixture_server(const char *path, uint32_t slot_count)
{
	const struct dio_ring_server_options options = {
		.path = path, .listen_fd = -1, .slot_count = slot_count};
	struct dio_ring_server *server = NULL;
	struct dio_error error;

	if (dio_ring_server_create(&options, &server, &error) != DIO_OK)
		fail_msg("%s", error.text);
	return server;
}

struct dio_ring_client *ring_fixture_client(const char *path, enum dio_ring_order order)
{
	const struct dio_ring_client_options options = {
		.path = path, .name = "test", .order = order};
	struct dio_ring_client *client = NULL;
	struct dio_error error;

	if (dio_ring_client_open(&options, &client, &error) != DIO_OK)
		fail_msg("%s", error.text);
	return client;
}

struct ring_pump {
	pthread_t thread;
	struct dio_ring_server *server;
	atomic_bool stop;
};

static void *pump_run(void *context)
{
	struct ring_pump *pump = context;

	while (!atomic_load(&pump->stop)) {
		struct pollfd fd = {.fd = dio_ring_server_get_fd(pump->server), .events = POLLIN};

		poll(&fd, 1, 10);
		dio_ring_server_dispatch(pump->server);
	}
	return NULL;
}

struct ring_pump *ring_pump_start(struct dio_ring_server *server)
{
	struct ring_pump *pump = calloc(1, sizeof(*pump));

	assert_non_null(pump);
	pump->server = server;
	assert_int_equal(pthread_create(&pump->thread, NULL, pump_run, pump), 0);
	return pump;
}

void ring_pump_stop(struct ring_pump *pump)
{
	atomic_store(&pump->stop, true);
	pthread_join(pump->thread, NULL);
	free(pump);
}

void ring_fixture_frame(struct dio_frame *frame, uint8_t *data, size_t size, uint64_t number)
{
	memset(data, (int)(number % 251), size);
	*frame = (struct dio_frame){
		.format = DIO_PIXEL_GRAY8,
		.width = (uint32_t)size,
		.height = 1,
		.pitch_bytes = (uint32_t)size,
		.timestamp_ns = 1000 * number,
		.sequence = number,
		.data = data,
		.size_bytes = size,
		.metadata = {.exposure_us = (uint32_t)number + 7,
			     .gain = 1.5f,
			     .red_gain = 2,
			     .blue_gain = 3,
			     .white_balance_k = 4600,
			     .locked = DIO_LOCK_EXPOSURE},
	};
}

bool ring_fixture_frame_is_whole(const uint8_t *data, size_t size, uint64_t number)
{
	for (size_t i = 0; i < size; i++)
		if (data[i] != number % 251)
			return false;
	return true;
}

void ring_fixture_publish(struct dio_ring_server *server, size_t size, uint64_t number)
{
	uint8_t *data = malloc(size);
	struct dio_frame frame;
	struct dio_error error;

	assert_non_null(data);
	ring_fixture_frame(&frame, data, size, number);
	if (dio_ring_server_publish(server, &frame, &error) != DIO_OK)
		fail_msg("%s", error.text);
	free(data);
}

int ring_fixture_connect(const char *path)
{
	struct sockaddr_un address = {.sun_family = AF_UNIX};
	int fd = socket(AF_UNIX, SOCK_SEQPACKET | SOCK_CLOEXEC, 0);

	assert_true(fd >= 0);
	snprintf(address.sun_path, sizeof(address.sun_path), "%s", path);
	assert_int_equal(connect(fd, (const struct sockaddr *)&address, sizeof(address)), 0);
	return fd;
}

void ring_fixture_await_readers(struct dio_ring_server *server, uint32_t readers)
{
	const uint64_t deadline = dio_clock_ns() + 5 * SECOND_NS;
	struct dio_ring_counters counters;

	for (;;) {
		struct pollfd fd = {.fd = dio_ring_server_get_fd(server), .events = POLLIN};

		dio_ring_server_dispatch(server);
		dio_ring_server_get_counters(server, &counters);
		if (counters.readers == readers)
			return;
		if (dio_clock_ns() > deadline)
			fail_msg("%u readers, %u were expected", counters.readers, readers);
		poll(&fd, 1, 100);
	}
}
