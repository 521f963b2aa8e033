/* Readers that misbehave: the daemon goes on, and so do the other readers. */
#include "fixture.h"

#include <dirent.h>
#include <fcntl.h>
#include <poll.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <unistd.h>

#include "ring/readers.h"
#include "ring/wire.h"

#define SIZE 1000

/* A server with one well-behaved reader, which must get every frame whatever else happens. */
struct scene {
	const char *path;
	struct dio_ring_server *server;
	struct dio_ring_client *client;
	uint64_t number;
};

static void scene_init(struct scene *scene)
{
	*scene = (struct scene){.path = ring_fixture_path("frames")};
	scene->server = ring_fixture_server(scene->path, 0);
	scene->client = ring_fixture_client(scene->path, DIO_RING_IN_ORDER);
	ring_fixture_await_readers(scene->server, 1);
}

/* One more frame reaches the good reader. */
static void expect_service(struct scene *scene)
{
	struct dio_ring_frame frame;
	struct dio_error error;
	enum dio_status status;

	ring_fixture_publish(scene->server, SIZE, scene->number);
	do
		status = dio_ring_client_acquire(scene->client, &frame, 0, &error);
	while (status == DIO_OK && frame.frame.sequence < scene->number);
	assert_int_equal(status, DIO_OK);
	assert_int_equal(frame.frame.sequence, scene->number++);
}

static void scene_deinit(struct scene *scene)
{
	expect_service(scene);
	dio_ring_client_close(scene->client);
	dio_ring_server_destroy(scene->server);
}

static void dispatch_often(struct scene *scene)
{
	for (unsigned i = 0; i < 20; i++)
		dio_ring_server_dispatch(scene->server);
}

static struct dio_ring_hello good_hello(void)
{
	return (struct dio_ring_hello){
		.magic = DIO_RING_MAGIC, .version = DIO_RING_VERSION, .bytes = 44, .name = "rude"};
}

/* The next message of a plain socket; false when the server has hung up. */
static bool next_message(int fd, struct dio_ring_message *message)
{
	struct pollfd ready = {.fd = fd, .events = POLLIN};

	assert_int_equal(poll(&ready, 1, 5000), 1);
	return recv(fd, message, sizeof(*message), 0) == (ssize_t)sizeof(*message);
}

static void expect_refusal(struct scene *scene, int fd, const char *words)
{
	struct dio_ring_message message;

	dispatch_often(scene);
	do
		assert_true(next_message(fd, &message));
	while (message.kind != DIO_RING_MESSAGE_REFUSED);
	if (!strstr(message.text, words))
		fail_msg("'%s' does not say '%s'", message.text, words);
	assert_false(next_message(fd, &message));
	close(fd);
}

static void rubbish_instead_of_a_greeting_is_refused(void **state)
{
	static const size_t sizes[] = {1, 11, 12, 43, 45, 100, 5000, 100000};
	static uint8_t rubbish[100000];
	struct dio_ring_hello hello;
	struct scene scene;

	(void)state;
	scene_init(&scene);
	memset(rubbish, 0xa5, sizeof(rubbish));
	for (size_t i = 0; i < sizeof(sizes) / sizeof(sizes[0]); i++) {
		int fd = ring_fixture_connect(scene.path);

		assert_int_equal(send(fd, rubbish, sizes[i], MSG_NOSIGNAL), sizes[i]);
		expect_refusal(&scene, fd, "not a greeting");
		expect_service(&scene);
	}
	hello = good_hello();
	hello.bytes = 43;
	for (int i = 0; i < 2; i++) {
		int fd = ring_fixture_connect(scene.path);

		send(fd, &hello, sizeof(hello), MSG_NOSIGNAL);
		if (i == 0) {
			expect_refusal(&scene, fd, "not a greeting");
			hello = good_hello();
			hello.version = 77;
		} else {
			expect_refusal(&scene, fd, "this program 77");
		}
	}
	scene_deinit(&scene);
}

static void who_goes_on_talking_after_its_greeting_is_put_out(void **state)
{
	const struct dio_ring_hello hello = good_hello();
	struct scene scene;
	int fd;

	(void)state;
	scene_init(&scene);
	fd = ring_fixture_connect(scene.path);
	for (int i = 0; i < 2; i++)
		assert_int_equal(send(fd, &hello, sizeof(hello), MSG_NOSIGNAL), sizeof(hello));
	expect_refusal(&scene, fd, "nothing to say");
	scene_deinit(&scene);
}

static void a_reader_that_never_reads_stalls_nothing_and_learns_the_end_of_it(void **state)
{
	const struct dio_ring_hello hello = good_hello();
	struct dio_ring_counters counters;
	struct dio_ring_reader readers[4];
	struct dio_ring_message message = {0};
	struct scene scene;
	int fd;

	(void)state;
	scene_init(&scene);
	fd = ring_fixture_connect(scene.path);
	send(fd, &hello, sizeof(hello), MSG_NOSIGNAL);
	ring_fixture_await_readers(scene.server, 2);
	for (unsigned i = 0; i < 2000; i++)
		expect_service(&scene);
	dio_ring_server_get_counters(scene.server, &counters);
	assert_true(counters.missed > 1500);
	assert_int_equal(dio_ring_server_list_readers(scene.server, readers, 4), 2);
	assert_int_equal(readers[0].missed, 0);
	assert_string_equal(readers[1].name, "rude");
	assert_int_equal(readers[1].pid, getpid());
	assert_int_equal(readers[1].missed, counters.missed);
	/* The last thing it is told is true, though the message was not sent when it became so. */
	dio_ring_server_set_state(scene.server, DIO_CAPTURE_UNPLUGGED, "gone");
	while (message.state != DIO_CAPTURE_UNPLUGGED) {
		assert_true(next_message(fd, &message));
		dispatch_often(&scene);
	}
	assert_string_equal(message.text, "gone");
	assert_int_equal(message.published, 2000);
	assert_true(message.missed >= counters.missed);
	close(fd);
	scene_deinit(&scene);
}

static void who_hangs_up_in_the_middle_of_its_greeting_is_forgotten(void **state)
{
	const struct dio_ring_hello hello = good_hello();
	struct scene scene;

	(void)state;
	scene_init(&scene);
	for (unsigned i = 0; i < 200; i++) {
		int fd = ring_fixture_connect(scene.path);

		if (i % 3 == 1)
			send(fd, &hello, 5, MSG_NOSIGNAL);
		if (i % 3 == 2)
			send(fd, &hello, sizeof(hello), MSG_NOSIGNAL);
		if (i % 2)
			dio_ring_server_dispatch(scene.server);
		close(fd);
		if (i % 10 == 0)
			expect_service(&scene);
		dispatch_often(&scene);
	}
	ring_fixture_await_readers(scene.server, 1);
	scene_deinit(&scene);
}

static unsigned count_descriptors(void)
{
	DIR *folder = opendir("/proc/self/fd");
	unsigned n = 0;

	assert_non_null(folder);
	while (readdir(folder))
		n++;
	closedir(folder);
	return n;
}

static void a_thousand_connections_are_turned_away_and_leak_nothing(void **state)
{
	struct dio_ring_counters counters;
	struct scene scene;
	unsigned before;

	(void)state;
	scene_init(&scene);
	expect_service(&scene); /* the memory is there from now on */
	before = count_descriptors();
	for (unsigned i = 0; i < 100; i++) {
		int fds[10];

		for (size_t k = 0; k < 10; k++)
			fds[k] = ring_fixture_connect(scene.path);
		dispatch_often(&scene);
		expect_service(&scene);
		for (size_t k = 0; k < 10; k++)
			close(fds[k]);
		dispatch_often(&scene);
	}
	assert_int_equal(count_descriptors(), before);
	dio_ring_server_get_counters(scene.server, &counters);
	assert_true(counters.refused >= 700);
	scene_deinit(&scene);
}

static void descriptors_that_come_along_are_not_kept(void **state)
{
	struct dio_ring_hello hello = good_hello();
	struct iovec part = {&hello, sizeof(hello)};
	char control[CMSG_SPACE(sizeof(int))] __attribute__((aligned(8))) = {0};
	struct msghdr envelope = {.msg_iov = &part,
				  .msg_iovlen = 1,
				  .msg_control = control,
				  .msg_controllen = sizeof(control)};
	struct cmsghdr *header = CMSG_FIRSTHDR(&envelope);
	struct scene scene;
	unsigned before;
	int fd;

	(void)state;
	scene_init(&scene);
	expect_service(&scene);
	fd = ring_fixture_connect(scene.path);
	header->cmsg_level = SOL_SOCKET;
	header->cmsg_type = SCM_RIGHTS;
	header->cmsg_len = CMSG_LEN(sizeof(int));
	memcpy(CMSG_DATA(header), &fd, sizeof(int));
	before = count_descriptors();
	assert_int_equal(sendmsg(fd, &envelope, MSG_NOSIGNAL), sizeof(hello));
	ring_fixture_await_readers(scene.server, 2);
	/* The server's end of the connection, and nothing else. */
	assert_int_equal(count_descriptors(), before + 1);
	close(fd);
	ring_fixture_await_readers(scene.server, 1);
	scene_deinit(&scene);
}

static void silence_after_connecting_ends_the_connection(void **state)
{
	struct ring_pump *pump;
	struct scene scene;
	int fd;

	(void)state;
	scene_init(&scene);
	fd = ring_fixture_connect(scene.path);
	pump = ring_pump_start(scene.server);
	expect_refusal(&scene, fd, "no greeting came in time");
	ring_pump_stop(pump);
	scene_deinit(&scene);
}

/* Hold as many connections as one process may, until the parent closes the pipe. */
static void hold_places(const char *path, int until_closed)
{
	const struct dio_ring_hello hello = good_hello();
	char byte;

	for (unsigned i = 0; i < DIO_RING_PER_PROCESS; i++) {
		int fd = ring_fixture_connect(path);

		send(fd, &hello, sizeof(hello), MSG_NOSIGNAL);
	}
	while (read(until_closed, &byte, 1) > 0)
		;
}

static uint64_t count_refused(const struct scene *scene)
{
	struct dio_ring_counters counters;

	dio_ring_server_dispatch(scene->server);
	dio_ring_server_get_counters(scene->server, &counters);
	return counters.refused;
}

static void no_more_readers_than_there_are_places(void **state)
{
	enum { CROWD = DIO_RING_READERS_MAX / DIO_RING_PER_PROCESS };
	struct scene scene;
	pid_t crowd[CROWD];
	int ends[2];

	(void)state;
	scene_init(&scene);
	assert_int_equal(pipe2(ends, O_CLOEXEC), 0);
	for (size_t i = 0; i < CROWD; i++) {
		crowd[i] = fork();
		assert_true(crowd[i] >= 0);
		if (crowd[i] == 0) {
			close(ends[1]);
			hold_places(scene.path, ends[0]);
			_exit(0);
		}
		/* The good reader has one place: the last process gets one less. */
		ring_fixture_await_readers(
			scene.server, i + 1 < CROWD ? 1 + DIO_RING_PER_PROCESS * ((uint32_t)i + 1)
						    : DIO_RING_READERS_MAX);
	}
	/* Its last connection may come late, but comes. */
	while (count_refused(&scene) < 1)
		usleep(1000);
	expect_refusal(&scene, ring_fixture_connect(scene.path), "too many readers");
	expect_service(&scene);
	close(ends[0]);
	close(ends[1]);
	for (size_t i = 0; i < CROWD; i++)
		assert_int_equal(waitpid(crowd[i], NULL, 0), crowd[i]);
	ring_fixture_await_readers(scene.server, 1);
	assert_int_equal(count_refused(&scene), 2);
	scene_deinit(&scene);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(rubbish_instead_of_a_greeting_is_refused),
		cmocka_unit_test(who_goes_on_talking_after_its_greeting_is_put_out),
		cmocka_unit_test(a_reader_that_never_reads_stalls_nothing_and_learns_the_end_of_it),
		cmocka_unit_test(who_hangs_up_in_the_middle_of_its_greeting_is_forgotten),
		cmocka_unit_test(a_thousand_connections_are_turned_away_and_leak_nothing),
		cmocka_unit_test(descriptors_that_come_along_are_not_kept),
		cmocka_unit_test(silence_after_connecting_ends_the_connection),
		cmocka_unit_test(no_more_readers_than_there_are_places),
	};

	return cmocka_run_group_tests(tests, ring_fixture_setup, ring_fixture_teardown);
}
