/* The capture daemon on the bus: what it shows, holds and records. */
#include "fixture.h"

#include <errno.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/wait.h>
#include <unistd.h>

#include "dio/camera.h"

static enum dio_status call(struct daemon *daemon, const char *method, const char *types,
			    const char *argument)
{
	return dio_bus_call(daemon->bus, &DIO_BUS_CAPTURE, method, 0, NULL, &daemon->error, types,
			    argument);
}

static void expect_call(struct daemon *daemon, const char *method, const char *types,
			const char *argument)
{
	if (call(daemon, method, types, argument) != DIO_OK)
		fail_msg("%s: %s", method, daemon->error.text);
}

/* The daemon with further arguments, on its bus, with frames. */
static void start_streaming(struct daemon *daemon, const char *option, const char *value)
{
	daemon_start(daemon, option, value, NULL);
	daemon_need_bus(daemon);
	daemon_await_text(daemon, "State", "streaming");
}

static void the_bus_shows_the_camera(void **state)
{
	struct daemon *daemon = *state;
	double rate = 0;

	start_streaming(daemon, NULL, NULL);
	daemon_await_text(daemon, "Camera", "scripted camera");
	daemon_await_text(daemon, "Format", "GRAY8");
	daemon_await_text(daemon, "StateText", "");
	daemon_await_number(daemon, "Frames", 1);
	assert_true(sd_bus_get_property_trivial(dio_bus_get_connection(daemon->bus),
						DIO_BUS_CAPTURE.name, DIO_BUS_CAPTURE.path,
						DIO_BUS_CAPTURE.name, "NominalRate", NULL, 'd',
						&rate) >= 0);
	assert_true(rate == 100);
	script_set(daemon, SCRIPT_ABSENT);
	daemon_await_text(daemon, "State", "unplugged");
	daemon_await_text(daemon, "StateText", "camera script: is it plugged in?");
	script_set(daemon, SCRIPT_STREAM);
	daemon_await_text(daemon, "State", "streaming");
	daemon_await_number(daemon, "Recoveries", 1);
	assert_int_equal(daemon_get_number(daemon, "Recoveries"), 1);
}

static int on_change(sd_bus_message *message, void *context, sd_bus_error *error)
{
	const char *interface, *name;
	bool *seen = context;

	(void)error;
	if (sd_bus_message_read(message, "s", &interface) < 0 ||
	    sd_bus_message_enter_container(message, 'a', "{sv}") < 0)
		return 0;
	while (sd_bus_message_enter_container(message, 'e', "sv") > 0) {
		if (sd_bus_message_read(message, "s", &name) > 0 && strcmp(name, "State") == 0)
			*seen = true;
		sd_bus_message_skip(message, "v");
		sd_bus_message_exit_container(message);
	}
	return 0;
}

static void a_change_of_state_is_signalled(void **state)
{
	struct daemon *daemon = *state;
	const int64_t limit = monotonic_ns() + 10 * SECOND_NS;
	bool seen = false;
	sd_bus *bus;

	start_streaming(daemon, NULL, NULL);
	bus = dio_bus_get_connection(daemon->bus);
	assert_true(sd_bus_match_signal(bus, NULL, DIO_BUS_CAPTURE.name, DIO_BUS_CAPTURE.path,
					"org.freedesktop.DBus.Properties", "PropertiesChanged",
					on_change, &seen) >= 0);
	script_set(daemon, SCRIPT_ABSENT);
	while (!seen && monotonic_ns() < limit) {
		if (sd_bus_process(bus, NULL) == 0)
			sd_bus_wait(bus, 100000);
	}
	assert_true(seen);
}

static void exposure_is_held_once_the_picture_has_come_to_rest(void **state)
{
	struct daemon *daemon = *state;

	/* It drifts for as long as the test likes; the profile's two seconds are not over. */
	atomic_store(&daemon->script->drift, 1);
	start_streaming(daemon, "--hold", "yes");
	daemon_await_text(daemon, "Hold", "settling");
	assert_int_equal(atomic_load(&daemon->script->held), 0);
	atomic_store(&daemon->script->drift, 0);
	daemon_await_text(daemon, "Hold", "held");
	assert_int_equal(atomic_load(&daemon->script->held), 1);
	daemon_await_text(daemon, "Held", "exposure gain white-balance");
	expect_call(daemon, "Unlock", NULL, NULL);
	daemon_await_text(daemon, "Hold", "automatic");
	daemon_await_text(daemon, "Held", "");
	assert_int_equal(atomic_load(&daemon->script->held), 0);
	expect_call(daemon, "Lock", NULL, NULL);
	daemon_await_text(daemon, "Hold", "held");
	/* It stays a wish: a camera that comes back is held again. */
	script_set(daemon, SCRIPT_ABSENT);
	daemon_await_text(daemon, "State", "unplugged");
	script_set(daemon, SCRIPT_STREAM);
	daemon_await_text(daemon, "State", "streaming");
	daemon_await_text(daemon, "Hold", "held");
}

static void a_picture_that_never_rests_is_held_in_the_end(void **state)
{
	struct daemon *daemon = *state;

	atomic_store(&daemon->script->drift, 1);
	start_streaming(daemon, "--hold", "yes");
	daemon_await_text(daemon, "Hold", "held");
}

static void what_the_driver_does_not_hold_is_shown(void **state)
{
	struct daemon *daemon = *state;

	atomic_store(&daemon->script->deaf, 1);
	start_streaming(daemon, "--hold", "yes");
	daemon_await_text(daemon, "Hold", "partly held");
	daemon_await_text(daemon, "Held", "exposure gain");
	daemon_await_text(daemon, "HoldOffered", "exposure gain white-balance");
}

/* How many frames of a recording replay whole, their numbers rising. */
static uint64_t play_back(const struct daemon *daemon, const char *name)
{
	const struct dio_camera_options fast = {.as_fast_as_possible = true, .every_frame = true};
	struct dio_camera *camera;
	struct dio_frame frame;
	struct dio_error error;
	char path[160];
	uint64_t frames = 0, last = 0;
	enum dio_status status;

	snprintf(path, sizeof(path), "%s/recordings/%s", daemon->folder, name);
	if (dio_camera_open(path, &fast, &camera, &error) != DIO_OK ||
	    dio_camera_start(camera, &error) != DIO_OK)
		fail_msg("%s", error.text);
	while ((status = dio_camera_acquire(camera, &frame, 0, &error)) == DIO_OK) {
		assert_true(frames == 0 || frame.sequence > last);
		assert_int_equal(frame.width, SCRIPT_SIDE);
		assert_int_equal(frame.metadata.exposure_us, 8000);
		last = frame.sequence;
		frames++;
	}
	assert_int_equal(status, DIO_END);
	dio_camera_close(camera);
	return frames;
}

static void await_recorded(struct daemon *daemon, uint64_t frames)
{
	const int64_t limit = monotonic_ns() + 20 * SECOND_NS;

	while (daemon_get_number(daemon, "Recorded") < frames)
		if (monotonic_ns() > limit)
			fail_msg("%d frames recorded", (int)daemon_get_number(daemon, "Recorded"));
}

static void a_recording_is_made_and_plays_back(void **state)
{
	struct daemon *daemon = *state;
	uint64_t recorded;
	char *path;

	start_streaming(daemon, NULL, NULL);
	expect_call(daemon, "StartRecording", "s", "walk");
	path = daemon_get_text(daemon, "Recording");
	assert_non_null(strstr(path, "recordings/walk"));
	free(path);
	assert_int_equal(call(daemon, "StartRecording", "s", "other"), DIO_BUSY);
	await_recorded(daemon, 10);
	expect_call(daemon, "StopRecording", NULL, NULL);
	recorded = daemon_get_number(daemon, "Recorded");
	assert_int_equal(play_back(daemon, "walk"), recorded);
	daemon_await_text(daemon, "Recording", "");
	assert_int_equal(call(daemon, "StopRecording", NULL, NULL), DIO_NOT_FOUND);
	/* The same name goes on with it. */
	expect_call(daemon, "StartRecording", "s", "walk");
	await_recorded(daemon, recorded + 5);
	expect_call(daemon, "StopRecording", NULL, NULL);
	assert_int_equal(play_back(daemon, "walk"), daemon_get_number(daemon, "Recorded"));
}

static void a_recording_survives_a_killed_daemon_and_goes_on_after_it(void **state)
{
	struct daemon *daemon = *state;
	uint64_t before = 0;

	start_streaming(daemon, NULL, NULL);
	expect_call(daemon, "StartRecording", "s", "survivor");
	for (int i = 0; i < 5; i++) {
		uint64_t kept;

		await_recorded(daemon, before + 5);
		daemon_end(daemon, SIGKILL);
		kept = play_back(daemon, "survivor");
		assert_true(kept >= before + 5);
		before = kept;
		start_streaming(daemon, NULL, NULL);
	}
	await_recorded(daemon, before + 1);
	/* An orderly end does not end it either: the box is only being restarted. */
	assert_int_equal(daemon_end(daemon, SIGTERM), 0);
	before = play_back(daemon, "survivor");
	start_streaming(daemon, NULL, NULL);
	await_recorded(daemon, before + 1);
	expect_call(daemon, "StopRecording", NULL, NULL);
	daemon_end(daemon, SIGTERM);
	/* Stopped is stopped. */
	start_streaming(daemon, NULL, NULL);
	daemon_await_text(daemon, "Recording", "");
}

static void what_cannot_be_recorded_is_refused_before_it_starts(void **state)
{
	static const char *const names[] = {"../up", ".hidden", "a/b", "blank name",
					    ("0123456789012345678901234567890123456789"
					     "012345678901234567890123456789")};
	struct daemon *daemon = *state;
	FILE *profile = fopen(daemon_path(daemon, "full.ini"), "w");
	char path[160];

	assert_non_null(profile);
	fprintf(profile, "[camera]\nlock = no\n[capture]\nreserve_mib = 1048576\n");
	assert_int_equal(fclose(profile), 0);
	start_streaming(daemon, "--profile", daemon_path(daemon, "full.ini"));
	for (size_t i = 0; i < sizeof(names) / sizeof(names[0]); i++)
		assert_int_equal(call(daemon, "StartRecording", "s", names[i]), DIO_BAD_ARG);
	assert_int_equal(call(daemon, "StartRecording", "s", ""), DIO_NO_SPACE);
	assert_non_null(strstr(daemon->error.text, "MiB"));
	snprintf(path, sizeof(path), "%s/recordings/.current", daemon->folder);
	assert_int_equal(access(path, F_OK), -1);
	script_set(daemon, SCRIPT_ABSENT);
	daemon_await_text(daemon, "State", "unplugged");
	assert_int_equal(call(daemon, "StartRecording", "s", ""), DIO_NO_SIGNAL);
}

static void readers_are_listed(void **state)
{
	struct daemon *daemon = *state;
	sd_bus_message *reply = NULL;
	const char *name;
	uint32_t pid;
	uint64_t missed;

	start_streaming(daemon, NULL, NULL);
	daemon_read(daemon, DIO_RING_NEWEST);
	daemon_await_frame(daemon);
	assert_int_equal(dio_bus_call(daemon->bus, &DIO_BUS_CAPTURE, "ListReaders", 0, &reply,
				      &daemon->error, NULL),
			 DIO_OK);
	assert_true(sd_bus_message_enter_container(reply, 'a', "(sut)") > 0);
	assert_true(sd_bus_message_read(reply, "(sut)", &name, &pid, &missed) > 0);
	assert_string_equal(name, "test");
	assert_int_equal(pid, getpid());
	sd_bus_message_unref(reply);
}

#define daemon_test(function)                                                                      \
	cmocka_unit_test_setup_teardown(function, daemon_setup, daemon_teardown)

int main(void)
{
	const struct CMUnitTest tests[] = {
		daemon_test(the_bus_shows_the_camera),
		daemon_test(a_change_of_state_is_signalled),
		daemon_test(exposure_is_held_once_the_picture_has_come_to_rest),
		daemon_test(a_picture_that_never_rests_is_held_in_the_end),
		daemon_test(what_the_driver_does_not_hold_is_shown),
		daemon_test(a_recording_is_made_and_plays_back),
		daemon_test(a_recording_survives_a_killed_daemon_and_goes_on_after_it),
		daemon_test(what_cannot_be_recorded_is_refused_before_it_starts),
		daemon_test(readers_are_listed),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
