/* Server and client in one thread, step by step. */
#include "fixture.h"

#include <poll.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <unistd.h>

#include "dio/clock.h"

#define SIZE 1000

struct pair {
	struct dio_ring_server *server;
	struct dio_ring_client *client;
	struct dio_ring_frame frame;
	struct dio_error error;
};

static void pair_init(struct pair *pair, enum dio_ring_order order, uint32_t slots)
{
	const char *path = ring_fixture_path("frames");

	*pair = (struct pair){0};
	pair->server = ring_fixture_server(path, slots);
	pair->client = ring_fixture_client(path, order);
	ring_fixture_await_readers(pair->server, 1);
	/* The greeting's answer: the state, and no frame yet. */
	assert_int_equal(
		dio_ring_client_acquire(pair->client, &pair->frame, SECOND_NS, &pair->error),
		DIO_AGAIN);
}

static void pair_deinit(struct pair *pair)
{
	dio_ring_client_close(pair->client);
	dio_ring_server_destroy(pair->server);
}

static void expect_frame(struct pair *pair, uint64_t number)
{
	const struct dio_frame *frame = &pair->frame.frame;

	if (dio_ring_client_acquire(pair->client, &pair->frame, 0, &pair->error) != DIO_OK)
		fail_msg("frame %d: %s", (int)number, pair->error.text);
	assert_int_equal(frame->sequence, number);
	assert_true(ring_fixture_frame_is_whole(frame->data, frame->size_bytes, number));
	assert_true(dio_ring_client_is_whole(pair->client, &pair->frame));
}

static void expect_nothing(struct pair *pair)
{
	assert_int_equal(dio_ring_client_acquire(pair->client, &pair->frame, 0, &pair->error),
			 DIO_AGAIN);
}

static void a_frame_arrives_with_all_that_is_known_of_it(void **state)
{
	struct pair pair;
	const struct dio_frame *frame = &pair.frame.frame;

	(void)state;
	pair_init(&pair, DIO_RING_NEWEST, 0);
	dio_ring_server_set_state(pair.server, DIO_CAPTURE_STREAMING, "");
	ring_fixture_publish(pair.server, SIZE, 5);
	expect_frame(&pair, 5);
	assert_int_equal(frame->format, DIO_PIXEL_GRAY8);
	assert_int_equal(frame->width, SIZE);
	assert_int_equal(frame->height, 1);
	assert_int_equal(frame->pitch_bytes, SIZE);
	assert_int_equal(frame->size_bytes, SIZE);
	assert_int_equal(frame->timestamp_ns, 5000);
	assert_int_equal(frame->metadata.exposure_us, 12);
	assert_true(frame->metadata.gain == 1.5f && frame->metadata.red_gain == 2 &&
		    frame->metadata.blue_gain == 3);
	assert_int_equal(frame->metadata.white_balance_k, 4600);
	assert_int_equal(frame->metadata.locked, DIO_LOCK_EXPOSURE);
	assert_int_equal(pair.frame.index, 0);
	assert_int_equal(pair.frame.state, DIO_CAPTURE_STREAMING);
	assert_true(pair.frame.published_ns <= dio_clock_ns());
	expect_nothing(&pair);
	pair_deinit(&pair);
}

static void the_newest_reader_passes_over_what_lies_between_and_counts_it(void **state)
{
	struct dio_ring_client_status status;
	struct pair pair;

	(void)state;
	pair_init(&pair, DIO_RING_NEWEST, 4);
	for (uint64_t i = 0; i < 20; i++)
		ring_fixture_publish(pair.server, SIZE, i);
	expect_frame(&pair, 19);
	expect_nothing(&pair);
	dio_ring_client_get_status(pair.client, &status);
	assert_int_equal(status.taken, 1);
	assert_int_equal(status.dropped, 19);
	pair_deinit(&pair);
}

static void the_reader_in_order_gets_every_frame_the_ring_still_holds(void **state)
{
	struct dio_ring_client_status status;
	struct pair pair;

	(void)state;
	pair_init(&pair, DIO_RING_IN_ORDER, 4);
	for (uint64_t i = 0; i < 3; i++)
		ring_fixture_publish(pair.server, SIZE, i);
	for (uint64_t i = 0; i < 3; i++)
		expect_frame(&pair, i);
	for (uint64_t i = 3; i < 13; i++)
		ring_fixture_publish(pair.server, SIZE, i);
	/* One of four slots is always the writer's. */
	for (uint64_t i = 10; i < 13; i++)
		expect_frame(&pair, i);
	expect_nothing(&pair);
	dio_ring_client_get_status(pair.client, &status);
	assert_int_equal(status.taken, 6);
	assert_int_equal(status.dropped, 7);
	pair_deinit(&pair);
}

static void a_reader_that_was_overtaken_knows_it(void **state)
{
	struct dio_ring_client_status status;
	uint8_t copy[SIZE];
	struct pair pair;

	(void)state;
	pair_init(&pair, DIO_RING_NEWEST, 3);
	ring_fixture_publish(pair.server, SIZE, 0);
	expect_frame(&pair, 0);
	ring_fixture_publish(pair.server, SIZE, 1);
	ring_fixture_publish(pair.server, SIZE, 2);
	assert_true(dio_ring_client_is_whole(pair.client, &pair.frame));
	ring_fixture_publish(pair.server, SIZE, 3);
	assert_false(dio_ring_client_is_whole(pair.client, &pair.frame));
	assert_int_equal(
		dio_ring_client_copy(pair.client, &pair.frame, copy, sizeof(copy), &pair.error),
		DIO_AGAIN);
	dio_ring_client_get_status(pair.client, &status);
	assert_int_equal(status.overtaken, 2);
	pair_deinit(&pair);
}

static void a_copy_stays_when_the_ring_goes_on(void **state)
{
	uint8_t copy[SIZE];
	struct pair pair;

	(void)state;
	pair_init(&pair, DIO_RING_NEWEST, 3);
	ring_fixture_publish(pair.server, SIZE, 0);
	expect_frame(&pair, 0);
	assert_int_equal(
		dio_ring_client_copy(pair.client, &pair.frame, copy, SIZE - 1, &pair.error),
		DIO_BAD_ARG);
	assert_int_equal(dio_ring_client_copy(pair.client, &pair.frame, copy, SIZE, &pair.error),
			 DIO_OK);
	for (uint64_t i = 1; i < 9; i++)
		ring_fixture_publish(pair.server, SIZE, i);
	assert_ptr_equal(pair.frame.frame.data, copy);
	assert_true(ring_fixture_frame_is_whole(copy, SIZE, 0));
	pair_deinit(&pair);
}

static void a_larger_frame_gets_larger_memory_and_no_frame_is_confused(void **state)
{
	struct dio_ring_counters counters;
	struct pair pair;

	(void)state;
	pair_init(&pair, DIO_RING_IN_ORDER, 4);
	ring_fixture_publish(pair.server, SIZE, 0);
	expect_frame(&pair, 0);
	ring_fixture_publish(pair.server, 40 * SIZE, 1);
	ring_fixture_publish(pair.server, SIZE, 2);
	expect_frame(&pair, 1);
	assert_int_equal(pair.frame.frame.size_bytes, 40 * SIZE);
	expect_frame(&pair, 2);
	dio_ring_server_get_counters(pair.server, &counters);
	assert_true(counters.memory_bytes >= 4 * 40 * SIZE);
	pair_deinit(&pair);
}

static void every_state_arrives_with_its_line_and_wakes_the_reader(void **state)
{
	struct dio_ring_client_status status;
	struct pair pair;

	(void)state;
	pair_init(&pair, DIO_RING_NEWEST, 0);
	for (int s = DIO_CAPTURE_STREAMING; s < DIO_CAPTURE_ABSENT; s++) {
		const enum dio_capture_state now = (enum dio_capture_state)s;
		struct pollfd fd = {.fd = dio_ring_client_get_fd(pair.client), .events = POLLIN};

		assert_int_equal(poll(&fd, 1, 0), 0);
		dio_ring_server_set_state(pair.server, now, dio_capture_state_name(now));
		assert_int_equal(poll(&fd, 1, 1000), 1);
		/* It returns at once, though a minute is granted: the state has changed. */
		assert_int_equal(dio_ring_client_acquire(pair.client, &pair.frame, 60 * SECOND_NS,
							 &pair.error),
				 DIO_AGAIN);
		dio_ring_client_get_status(pair.client, &status);
		assert_int_equal(status.state, now);
		assert_string_equal(status.text, dio_capture_state_name(now));
		/* The same again is no news. */
		dio_ring_server_set_state(pair.server, now, dio_capture_state_name(now));
		assert_int_equal(poll(&fd, 1, 0), 0);
	}
	pair_deinit(&pair);
}

static void an_overlong_line_about_the_state_is_cut_and_no_news_twice(void **state)
{
	struct dio_ring_client_status status;
	char line[600];
	struct pair pair;

	(void)state;
	memset(line, 'x', sizeof(line) - 1);
	line[sizeof(line) - 1] = '\0';
	pair_init(&pair, DIO_RING_NEWEST, 0);
	for (int i = 0; i < 2; i++) {
		dio_ring_server_set_state(pair.server, DIO_CAPTURE_REFUSED, line);
		expect_nothing(&pair);
	}
	dio_ring_client_get_status(pair.client, &status);
	assert_int_equal(strlen(status.text), sizeof(status.text) - 1);
	pair_deinit(&pair);
}

static void a_late_reader_gets_frames_from_its_arrival_on(void **state)
{
	struct pair pair;
	struct dio_ring_client *late;

	(void)state;
	pair_init(&pair, DIO_RING_NEWEST, 0);
	for (uint64_t i = 0; i < 5; i++)
		ring_fixture_publish(pair.server, SIZE, i);
	late = ring_fixture_client(ring_fixture_path("frames"), DIO_RING_IN_ORDER);
	ring_fixture_await_readers(pair.server, 2);
	assert_int_equal(dio_ring_client_acquire(late, &pair.frame, 0, &pair.error), DIO_AGAIN);
	ring_fixture_publish(pair.server, SIZE, 5);
	assert_int_equal(dio_ring_client_acquire(late, &pair.frame, 0, &pair.error), DIO_OK);
	assert_int_equal(pair.frame.frame.sequence, 5);
	dio_ring_client_close(late);
	ring_fixture_await_readers(pair.server, 1);
	pair_deinit(&pair);
}

static void a_client_finds_the_daemon_when_it_comes_and_when_it_comes_back(void **state)
{
	const char *path = ring_fixture_path("frames");
	struct dio_ring_client *client = ring_fixture_client(path, DIO_RING_NEWEST);
	struct dio_ring_client_status status;
	struct dio_ring_frame frame;
	struct dio_error error;

	(void)state;
	assert_int_equal(dio_ring_client_acquire(client, &frame, 0, &error), DIO_AGAIN);
	dio_ring_client_get_status(client, &status);
	assert_int_equal(status.state, DIO_CAPTURE_ABSENT);
	assert_non_null(strstr(status.text, "is diorama-captured running?"));
	for (uint32_t round = 1; round <= 3; round++) {
		struct dio_ring_server *server = ring_fixture_server(path, 0);
		struct ring_pump *pump = ring_pump_start(server);
		const uint64_t deadline = dio_clock_ns() + 2 * SECOND_NS;

		do {
			dio_ring_client_acquire(client, &frame, SECOND_NS, &error);
			dio_ring_client_get_status(client, &status);
			assert_true(dio_clock_ns() < deadline);
		} while (status.state == DIO_CAPTURE_ABSENT);
		assert_int_equal(status.connections, round);
		ring_fixture_publish(server, SIZE * round, round);
		assert_int_equal(dio_ring_client_acquire(client, &frame, SECOND_NS, &error),
				 DIO_OK);
		assert_int_equal(frame.frame.sequence, round);
		ring_pump_stop(pump);
		dio_ring_server_destroy(server);
		/* What was acquired stays readable. */
		assert_true(ring_fixture_frame_is_whole(frame.frame.data, SIZE * round, round));
		assert_int_equal(dio_ring_client_acquire(client, &frame, SECOND_NS, &error),
				 DIO_AGAIN);
		dio_ring_client_get_status(client, &status);
		assert_int_equal(status.state, DIO_CAPTURE_ABSENT);
	}
	dio_ring_client_close(client);
}

static void the_server_takes_a_socket_that_was_made_for_it(void **state)
{
	const char *path = ring_fixture_path("handed");
	struct dio_ring_server_options options = {.listen_fd = -1};
	struct dio_ring_server *server = NULL;
	struct dio_ring_server *first;
	struct dio_error error;
	int ends[2];

	(void)state;
	assert_int_equal(socketpair(AF_UNIX, SOCK_SEQPACKET, 0, ends), 0);
	options.listen_fd = ends[0];
	assert_int_equal(dio_ring_server_create(&options, &server, &error), DIO_BAD_ARG);
	close(ends[0]);
	close(ends[1]);
	/* Two daemons never share a socket. */
	first = ring_fixture_server(path, 0);
	options = (struct dio_ring_server_options){.path = path, .listen_fd = -1};
	assert_int_equal(dio_ring_server_create(&options, &server, &error), DIO_BUSY);
	assert_non_null(strstr(error.text, path));
	dio_ring_server_destroy(first);
	assert_int_equal(access(path, F_OK), -1);
}

static void the_socket_has_the_mode_that_was_asked(void **state)
{
	const char *path = ring_fixture_path("mode");
	const struct dio_ring_server_options options = {
		.path = path, .listen_fd = -1, .mode = 0600};
	struct dio_ring_server *server;
	struct dio_error error;
	struct stat st;

	(void)state;
	assert_int_equal(dio_ring_server_create(&options, &server, &error), DIO_OK);
	assert_int_equal(stat(path, &st), 0);
	assert_int_equal(st.st_mode & 0777, 0600);
	dio_ring_server_destroy(server);
}

static void frames_and_options_out_of_bounds_are_refused(void **state)
{
	struct dio_ring_server_options options = {
		.path = ring_fixture_path("frames"), .listen_fd = -1, .slot_count = 2};
	struct dio_frame frame = {.width = 1, .height = 1};
	struct dio_ring_server *server = NULL;
	struct dio_error error;
	uint8_t byte = 0;
	char path[200];

	(void)state;
	assert_int_equal(dio_ring_server_create(&options, &server, &error), DIO_BAD_ARG);
	options.slot_count = 65;
	assert_int_equal(dio_ring_server_create(&options, &server, &error), DIO_BAD_ARG);
	memset(path, 'p', sizeof(path) - 1);
	path[sizeof(path) - 1] = '\0';
	options = (struct dio_ring_server_options){.path = path, .listen_fd = -1};
	assert_int_equal(dio_ring_server_create(&options, &server, &error), DIO_BAD_ARG);
	server = ring_fixture_server(ring_fixture_path("frames"), 0);
	assert_int_equal(dio_ring_server_publish(server, &frame, &error), DIO_BAD_ARG);
	frame.data = &byte;
	frame.size_bytes = (size_t)3 << 30;
	assert_int_equal(dio_ring_server_publish(server, &frame, &error), DIO_BAD_ARG);
	frame.size_bytes = (size_t)1 << 30;
	assert_int_equal(dio_ring_server_publish(server, &frame, &error), DIO_NO_MEM);
	dio_ring_server_destroy(server);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(a_frame_arrives_with_all_that_is_known_of_it),
		cmocka_unit_test(the_newest_reader_passes_over_what_lies_between_and_counts_it),
		cmocka_unit_test(the_reader_in_order_gets_every_frame_the_ring_still_holds),
		cmocka_unit_test(a_reader_that_was_overtaken_knows_it),
		cmocka_unit_test(a_copy_stays_when_the_ring_goes_on),
		cmocka_unit_test(a_larger_frame_gets_larger_memory_and_no_frame_is_confused),
		cmocka_unit_test(every_state_arrives_with_its_line_and_wakes_the_reader),
		cmocka_unit_test(an_overlong_line_about_the_state_is_cut_and_no_news_twice),
		cmocka_unit_test(a_late_reader_gets_frames_from_its_arrival_on),
		cmocka_unit_test(a_client_finds_the_daemon_when_it_comes_and_when_it_comes_back),
		cmocka_unit_test(the_server_takes_a_socket_that_was_made_for_it),
		cmocka_unit_test(the_socket_has_the_mode_that_was_asked),
		cmocka_unit_test(frames_and_options_out_of_bounds_are_refused),
	};

	return cmocka_run_group_tests(tests, ring_fixture_setup, ring_fixture_teardown);
}
