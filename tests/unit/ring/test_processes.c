/* Readers in other processes and threads, while frames come as fast as they can. */
#include "fixture.h"

#include <pthread.h>
#include <signal.h>
#include <stdlib.h>
#include <sys/wait.h>
#include <unistd.h>

#include "dio/clock.h"

#define SIZE   60000
#define FRAMES 1500u

enum { CHILD_GOOD, CHILD_TORN, CHILD_BACKWARDS, CHILD_SILENCE, CHILD_GAP, CHILD_NO_CLIENT };

/* Read until frame `last` is there. No asserts: this runs in processes and threads of its own. */
static int read_until(const char *path, enum dio_ring_order order, uint64_t last, bool gapless)
{
	const struct dio_ring_client_options options = {
		.path = path, .name = "child", .order = order};
	const uint64_t deadline = dio_clock_ns() + 60 * SECOND_NS;
	struct dio_ring_client *client;
	struct dio_ring_frame frame;
	struct dio_error error;
	uint8_t *copy = malloc(SIZE);
	uint64_t seen = 0;
	int result = CHILD_SILENCE;

	if (!copy || dio_ring_client_open(&options, &client, &error) != DIO_OK) {
		free(copy);
		return CHILD_NO_CLIENT;
	}
	while (dio_clock_ns() < deadline) {
		if (dio_ring_client_acquire(client, &frame, SECOND_NS, &error) != DIO_OK)
			continue;
		if (frame.frame.sequence < seen) {
			result = CHILD_BACKWARDS;
			break;
		}
		if (gapless && frame.frame.sequence != seen) {
			result = CHILD_GAP;
			break;
		}
		seen = frame.frame.sequence + 1;
		if (dio_ring_client_copy(client, &frame, copy, SIZE, &error) == DIO_OK &&
		    !ring_fixture_frame_is_whole(copy, SIZE, frame.frame.sequence)) {
			result = CHILD_TORN;
			break;
		}
		if (seen == last + 1) {
			result = CHILD_GOOD;
			break;
		}
	}
	dio_ring_client_close(client);
	free(copy);
	return result;
}

static pid_t start_child(const char *path, enum dio_ring_order order, uint64_t last, bool gapless)
{
	pid_t pid = fork();

	assert_true(pid >= 0);
	if (pid == 0)
		_exit(read_until(path, order, last, gapless));
	return pid;
}

static void expect_child(pid_t pid, int result)
{
	int status;

	assert_int_equal(waitpid(pid, &status, 0), pid);
	assert_true(WIFEXITED(status));
	assert_int_equal(WEXITSTATUS(status), result);
}

static void every_reader_in_order_gets_every_frame_unbroken(void **state)
{
	const char *path = ring_fixture_path("frames");
	struct dio_ring_server *server = ring_fixture_server(path, 64);
	pid_t children[3];

	(void)state;
	for (size_t i = 0; i < 3; i++)
		children[i] = start_child(path, DIO_RING_IN_ORDER, 59, true);
	ring_fixture_await_readers(server, 3);
	/* As many as the ring holds: none can be lost, however slow the reader is. */
	for (uint64_t i = 0; i < 60; i++)
		ring_fixture_publish(server, SIZE, i);
	for (size_t i = 0; i < 3; i++)
		expect_child(children[i], CHILD_GOOD);
	ring_fixture_await_readers(server, 0);
	dio_ring_server_destroy(server);
}

static void a_copy_that_counts_as_whole_is_never_torn(void **state)
{
	const char *path = ring_fixture_path("frames");
	struct dio_ring_server *server = ring_fixture_server(path, 3);
	pid_t newest, in_order;

	(void)state;
	newest = start_child(path, DIO_RING_NEWEST, FRAMES - 1, false);
	in_order = start_child(path, DIO_RING_IN_ORDER, FRAMES - 1, false);
	ring_fixture_await_readers(server, 2);
	for (uint64_t i = 0; i < FRAMES; i++) {
		ring_fixture_publish(server, SIZE, i);
		dio_ring_server_dispatch(server);
	}
	expect_child(newest, CHILD_GOOD);
	expect_child(in_order, CHILD_GOOD);
	dio_ring_server_destroy(server);
}

static void readers_that_are_killed_leave_nothing_behind(void **state)
{
	const char *path = ring_fixture_path("frames");
	struct dio_ring_server *server = ring_fixture_server(path, 3);

	(void)state;
	for (unsigned round = 0; round < 20; round++) {
		pid_t pid = start_child(path, DIO_RING_NEWEST, UINT64_MAX - 1, false);
		int status;

		ring_fixture_await_readers(server, 1);
		ring_fixture_publish(server, SIZE, round);
		assert_int_equal(kill(pid, SIGKILL), 0);
		assert_int_equal(waitpid(pid, &status, 0), pid);
		ring_fixture_publish(server, SIZE, round);
		ring_fixture_await_readers(server, 0);
	}
	dio_ring_server_destroy(server);
}

static void *thread_run(void *path)
{
	return (void *)(intptr_t)read_until(path, DIO_RING_NEWEST, FRAMES - 1, false);
}

static void one_thread_publishes_while_another_serves(void **state)
{
	const char *path = ring_fixture_path("frames");
	struct dio_ring_server *server = ring_fixture_server(path, 4);
	struct ring_pump *pump = ring_pump_start(server);
	const uint64_t deadline = dio_clock_ns() + 5 * SECOND_NS;
	struct dio_ring_counters counters = {0};
	struct dio_ring_reader readers[4];
	char own_path[100];
	pthread_t threads[2];
	void *result;

	(void)state;
	for (size_t i = 0; i < sizeof(own_path); i++)
		own_path[i] = path[i];
	for (size_t i = 0; i < 2; i++)
		assert_int_equal(pthread_create(&threads[i], NULL, thread_run, own_path), 0);
	while (counters.readers < 2 && dio_clock_ns() < deadline)
		dio_ring_server_get_counters(server, &counters);
	assert_int_equal(counters.readers, 2);
	for (uint64_t i = 0; i < FRAMES; i++) {
		dio_ring_server_set_state(server,
					  i % 2 ? DIO_CAPTURE_STREAMING : DIO_CAPTURE_STARTING, "");
		ring_fixture_publish(server, SIZE, i);
		assert_true(dio_ring_server_list_readers(server, readers, 4) <= 2);
	}
	for (size_t i = 0; i < 2; i++) {
		assert_int_equal(pthread_join(threads[i], &result), 0);
		assert_int_equal((intptr_t)result, CHILD_GOOD);
	}
	dio_ring_server_get_counters(server, &counters);
	assert_int_equal(counters.published, FRAMES);
	ring_pump_stop(pump);
	dio_ring_server_destroy(server);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(every_reader_in_order_gets_every_frame_unbroken),
		cmocka_unit_test(a_copy_that_counts_as_whole_is_never_torn),
		cmocka_unit_test(readers_that_are_killed_leave_nothing_behind),
		cmocka_unit_test(one_thread_publishes_while_another_serves),
	};

	return cmocka_run_group_tests(tests, ring_fixture_setup, ring_fixture_teardown);
}
