/* The capture daemon as a process, with a camera that does what the test says. */
#include "fixture.h"

#include <fcntl.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/wait.h>
#include <unistd.h>

/* Two seconds is what a replugged camera may take until frames come again. */
#define RECOVERY_NS (2 * SECOND_NS)

static uint64_t number_of(const struct daemon *daemon)
{
	uint64_t number;

	memcpy(&number, daemon->frame.frame.data, sizeof(number));
	return number;
}

static void frames_reach_a_reader_in_order_and_bit_exact(void **state)
{
	struct daemon *daemon = *state;
	struct dio_ring_client_status status;
	uint64_t first = 0;

	daemon_start(daemon, NULL);
	daemon_read(daemon, DIO_RING_IN_ORDER);
	for (uint64_t i = 0; i < 200; i++) {
		const struct dio_frame *frame = &daemon->frame.frame;

		daemon_await_frame(daemon);
		if (i == 0)
			first = number_of(daemon);
		assert_int_equal(frame->sequence, number_of(daemon));
		assert_int_equal(frame->width, SCRIPT_SIDE);
		for (size_t at = sizeof(uint64_t); at < frame->size_bytes; at++)
			assert_int_equal(frame->data[at], 0);
		assert_true(dio_ring_client_is_whole(daemon->reader, &daemon->frame));
	}
	dio_ring_client_get_status(daemon->reader, &status);
	assert_int_equal(number_of(daemon) - first, 199 + status.dropped);
}

static void a_camera_that_is_pulled_out_twenty_times_is_back_within_two_seconds(void **state)
{
	struct daemon *daemon = *state;
	unsigned descriptors = 0, tasks = 0;
	int64_t worst = 0;

	daemon_start(daemon, NULL);
	daemon_read(daemon, DIO_RING_NEWEST);
	for (int i = 0; i < 20; i++) {
		int64_t took;

		daemon_await_state(daemon, DIO_CAPTURE_STREAMING, 5 * SECOND_NS);
		if (i == 2) {
			descriptors = daemon_count(daemon, "fd");
			tasks = daemon_count(daemon, "task");
		}
		script_set(daemon, SCRIPT_ABSENT);
		daemon_await_state(daemon, DIO_CAPTURE_UNPLUGGED, 5 * SECOND_NS);
		script_set(daemon, SCRIPT_STREAM);
		took = daemon_await_state(daemon, DIO_CAPTURE_STREAMING, 5 * SECOND_NS);
		worst = took > worst ? took : worst;
	}
	print_message("recovery: at most %d ms\n", (int)(worst / 1000000));
	assert_true(worst <= RECOVERY_NS);
	daemon_await_count(daemon, "fd", descriptors);
	daemon_await_count(daemon, "task", tasks);
	daemon_await_frame(daemon);
}

static void every_trouble_is_a_state_and_passes(void **state)
{
	static const struct {
		enum script_mode mode;
		enum dio_capture_state state;
		const char *text;
	} troubles[] = {
		{SCRIPT_SILENT, DIO_CAPTURE_STALLED, "no frame for 2000 ms (GRAY8 64x64, "},
		{SCRIPT_NO_SIGNAL, DIO_CAPTURE_NO_SIGNAL, "no signal"},
		{SCRIPT_BROKEN, DIO_CAPTURE_STALLED, "the driver reports an error"},
		{SCRIPT_ABSENT, DIO_CAPTURE_UNPLUGGED, "plugged"},
		{SCRIPT_REFUSED, DIO_CAPTURE_REFUSED, "no format"},
	};
	struct daemon *daemon = *state;

	daemon_start(daemon, NULL);
	daemon_read(daemon, DIO_RING_NEWEST);
	for (size_t i = 0; i < sizeof(troubles) / sizeof(troubles[0]); i++) {
		struct dio_ring_client_status status;

		daemon_await_state(daemon, DIO_CAPTURE_STREAMING, 5 * SECOND_NS);
		script_set(daemon, troubles[i].mode);
		daemon_await_state(daemon, troubles[i].state, 10 * SECOND_NS);
		dio_ring_client_get_status(daemon->reader, &status);
		assert_non_null(strstr(status.text, "camera script"));
		assert_non_null(strstr(status.text, troubles[i].text));
		script_set(daemon, SCRIPT_STREAM);
		assert_true(daemon_await_state(daemon, DIO_CAPTURE_STREAMING, 5 * SECOND_NS) <=
			    RECOVERY_NS);
		daemon_await_frame(daemon);
	}
}

static void a_driver_that_goes_on_reporting_errors_leaves_the_stream_stalled(void **state)
{
	struct daemon *daemon = *state;
	uint32_t opened;

	daemon_start(daemon, NULL);
	daemon_read(daemon, DIO_RING_NEWEST);
	daemon_await_state(daemon, DIO_CAPTURE_STREAMING, 5 * SECOND_NS);
	opened = atomic_load(&daemon->script->opened);
	script_set(daemon, SCRIPT_BROKEN);
	/* The second time it is opened it has failed once without a frame. */
	for (int64_t limit = monotonic_ns() + 10 * SECOND_NS;
	     atomic_load(&daemon->script->opened) < opened + 2;) {
		assert_true(monotonic_ns() < limit);
		dio_ring_client_acquire(daemon->reader, &daemon->frame, SECOND_NS / 10,
					&daemon->error);
	}
	daemon_await_state(daemon, DIO_CAPTURE_STALLED, 0);
}

static void a_camera_that_comes_later_or_never_delivered_is_waited_for(void **state)
{
	struct daemon *daemon = *state;
	struct dio_ring_client_status status;

	script_set(daemon, SCRIPT_ABSENT);
	daemon_start(daemon, NULL);
	daemon_read(daemon, DIO_RING_NEWEST);
	daemon_await_state(daemon, DIO_CAPTURE_UNPLUGGED, 5 * SECOND_NS);
	script_set(daemon, SCRIPT_SILENT);
	daemon_await_state(daemon, DIO_CAPTURE_NO_SIGNAL, 10 * SECOND_NS);
	dio_ring_client_get_status(daemon->reader, &status);
	assert_non_null(strstr(status.text, "no frame for 2000 ms (GRAY8 64x64, 0 frames before)"));
	script_set(daemon, SCRIPT_STREAM);
	daemon_await_state(daemon, DIO_CAPTURE_STREAMING, 5 * SECOND_NS);
	script_set(daemon, SCRIPT_END);
	daemon_await_state(daemon, DIO_CAPTURE_ENDED, 5 * SECOND_NS);
}

static void a_camera_that_comes_back_with_another_size_goes_on(void **state)
{
	struct daemon *daemon = *state;

	daemon_start(daemon, NULL);
	daemon_read(daemon, DIO_RING_NEWEST);
	for (uint32_t i = 0; i < 4; i++) {
		const uint32_t side = i % 2 ? 2 * SCRIPT_SIDE : SCRIPT_SIDE;

		atomic_store(&daemon->script->larger, i % 2);
		script_set(daemon, SCRIPT_ABSENT);
		daemon_await_state(daemon, DIO_CAPTURE_UNPLUGGED, 5 * SECOND_NS);
		script_set(daemon, SCRIPT_STREAM);
		daemon_await_state(daemon, DIO_CAPTURE_STREAMING, 5 * SECOND_NS);
		do
			daemon_await_frame(daemon);
		while (daemon->frame.frame.width != side);
		assert_int_equal(daemon->frame.frame.size_bytes, (size_t)side * side);
		assert_true(dio_ring_client_is_whole(daemon->reader, &daemon->frame));
	}
}

static void readers_survive_a_daemon_that_is_killed_twenty_times(void **state)
{
	struct daemon *daemon = *state;
	struct dio_ring_client_status status;

	daemon_start(daemon, NULL);
	daemon_read(daemon, DIO_RING_NEWEST);
	for (int i = 0; i < 20; i++) {
		daemon_await_state(daemon, DIO_CAPTURE_STREAMING, 10 * SECOND_NS);
		daemon_await_frame(daemon);
		assert_true(WIFSIGNALED(daemon_end(daemon, SIGKILL)));
		/* The frame in hand stays readable. */
		assert_int_equal(number_of(daemon), daemon->frame.frame.sequence);
		daemon_await_state(daemon, DIO_CAPTURE_ABSENT, 5 * SECOND_NS);
		daemon_start(daemon, NULL);
	}
	daemon_await_state(daemon, DIO_CAPTURE_STREAMING, 10 * SECOND_NS);
	dio_ring_client_get_status(daemon->reader, &status);
	assert_int_equal(status.connections, 21);
}

static void a_signal_ends_it_in_good_order_in_any_state(void **state)
{
	static const enum script_mode modes[] = {SCRIPT_STREAM, SCRIPT_ABSENT, SCRIPT_SILENT,
						 SCRIPT_NO_SIGNAL, SCRIPT_END};
	struct daemon *daemon = *state;
	char notice[256];

	daemon_open_notify(daemon);
	for (size_t i = 0; i < 2 * sizeof(modes) / sizeof(modes[0]); i++) {
		int status;

		script_set(daemon, modes[i / 2]);
		daemon_start(daemon, NULL);
		do
			assert_true(daemon_next_notice(daemon, notice, sizeof(notice), 10000));
		while (strcmp(notice, "READY=1") != 0);
		status = daemon_end(daemon, i % 2 ? SIGTERM : SIGINT);
		assert_true(WIFEXITED(status));
		assert_int_equal(WEXITSTATUS(status), 0);
		assert_int_equal(access(daemon_path(daemon, "frames"), F_OK), -1);
	}
}

static void systemd_is_told_what_goes_on(void **state)
{
	struct daemon *daemon = *state;
	char notice[512];

	daemon_open_notify(daemon);
	daemon_start(daemon, NULL);
	do
		assert_true(daemon_next_notice(daemon, notice, sizeof(notice), 10000));
	while (!strstr(notice, "STATUS=streaming 64x64 GRAY8 from scripted camera"));
	script_set(daemon, SCRIPT_ABSENT);
	do
		assert_true(daemon_next_notice(daemon, notice, sizeof(notice), 10000));
	while (strcmp(notice, "STATUS=unplugged: camera script: is it plugged in?") != 0);
	daemon_end(daemon, SIGTERM);
	do
		assert_true(daemon_next_notice(daemon, notice, sizeof(notice), 1000));
	while (strcmp(notice, "STOPPING=1") != 0);
}

/* WATCHDOG=1 within the time. */
static bool is_fed(struct daemon *daemon, int within_ms)
{
	const int64_t limit = monotonic_ns() + within_ms * 1000000ll;
	char notice[512];

	while (monotonic_ns() < limit)
		if (daemon_next_notice(daemon, notice, sizeof(notice), within_ms) &&
		    strcmp(notice, "WATCHDOG=1") == 0)
			return true;
	return false;
}

static void the_watchdog_is_fed_until_the_camera_hangs_in_its_driver(void **state)
{
	struct daemon *daemon = *state;
	int64_t hung;

	daemon_open_notify(daemon);
	setenv("WATCHDOG_USEC", "1200000", 1);
	daemon_start(daemon, NULL);
	unsetenv("WATCHDOG_USEC");
	for (int i = 0; i < 6; i++)
		assert_true(is_fed(daemon, 5000));
	script_set(daemon, SCRIPT_HANGING);
	hung = monotonic_ns();
	while (is_fed(daemon, 1500))
		assert_true(monotonic_ns() < hung + 10 * SECOND_NS);
	/* Readers are served all the same. */
	daemon_read(daemon, DIO_RING_NEWEST);
	daemon_await_state(daemon, DIO_CAPTURE_STREAMING, 5 * SECOND_NS);
}

static int run_program(const struct daemon *daemon, const char *option, const char *value)
{
	char program[256], *arguments[4] = {program};
	char copies[2][128];
	int status;
	pid_t pid;

	(void)daemon;
	snprintf(program, sizeof(program), "%s/diorama-captured", getenv("DIO_BIN_DIR"));
	for (int i = 0; i < 2; i++) {
		const char *from = i ? value : option;

		snprintf(copies[i], sizeof(copies[i]), "%s", from ? from : "");
		arguments[i + 1] = from ? copies[i] : NULL;
	}
	pid = fork();
	assert_true(pid >= 0);
	if (pid == 0) {
		int null = open("/dev/null", O_WRONLY);

		dup2(null, STDOUT_FILENO);
		dup2(null, STDERR_FILENO);
		execv(program, arguments);
		_exit(127);
	}
	assert_int_equal(waitpid(pid, &status, 0), pid);
	assert_true(WIFEXITED(status));
	return WEXITSTATUS(status);
}

static void wrong_options_and_profiles_are_refused(void **state)
{
	static const char *const wrong[][2] = {
		{"--size", "640"},  {"--size", "99999x2"}, {"--fps", "-1"},
		{"--fps", "nan"},   {"--hold", "perhaps"}, {"--no-such", NULL},
		{"argument", NULL}, {"--camera", NULL},
	};
	struct daemon *daemon = *state;
	FILE *profile = fopen(daemon_path(daemon, "bad.ini"), "w");

	assert_int_equal(run_program(daemon, "--help", NULL), 0);
	assert_int_equal(run_program(daemon, "--version", NULL), 0);
	for (size_t i = 0; i < sizeof(wrong) / sizeof(wrong[0]); i++)
		assert_int_equal(run_program(daemon, wrong[i][0], wrong[i][1]), 2);
	assert_non_null(profile);
	fputs("[camera]\nsorce = x\n", profile);
	fclose(profile);
	assert_int_equal(run_program(daemon, "--profile", daemon_path(daemon, "bad.ini")), 1);
	assert_int_equal(run_program(daemon, "--profile", daemon_path(daemon, "absent.ini")), 1);
	assert_int_equal(run_program(daemon, "--socket", "/no/such/folder/frames"), 1);
}

static void a_second_daemon_on_the_same_socket_is_refused(void **state)
{
	struct daemon *daemon = *state;

	daemon_start(daemon, NULL);
	daemon_read(daemon, DIO_RING_NEWEST);
	daemon_await_state(daemon, DIO_CAPTURE_STREAMING, 10 * SECOND_NS);
	assert_int_equal(run_program(daemon, "--socket", daemon_path(daemon, "frames")), 1);
	daemon_await_frame(daemon);
}

#define daemon_test(function)                                                                      \
	cmocka_unit_test_setup_teardown(function, daemon_setup, daemon_teardown)

int main(void)
{
	const struct CMUnitTest tests[] = {
		daemon_test(frames_reach_a_reader_in_order_and_bit_exact),
		daemon_test(a_camera_that_is_pulled_out_twenty_times_is_back_within_two_seconds),
		daemon_test(every_trouble_is_a_state_and_passes),
		daemon_test(a_driver_that_goes_on_reporting_errors_leaves_the_stream_stalled),
		daemon_test(a_camera_that_comes_later_or_never_delivered_is_waited_for),
		daemon_test(a_camera_that_comes_back_with_another_size_goes_on),
		daemon_test(readers_survive_a_daemon_that_is_killed_twenty_times),
		daemon_test(a_signal_ends_it_in_good_order_in_any_state),
		daemon_test(systemd_is_told_what_goes_on),
		daemon_test(the_watchdog_is_fed_until_the_camera_hangs_in_its_driver),
		daemon_test(wrong_options_and_profiles_are_refused),
		daemon_test(a_second_daemon_on_the_same_socket_is_refused),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
