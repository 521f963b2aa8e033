#include "captured/daemon.h"

#include <errno.h>
#include <inttypes.h>
#include <poll.h>
#include <signal.h>
#include <stdio.h>
#include <string.h>
#include <sys/eventfd.h>
#include <sys/signalfd.h>
#include <systemd/sd-daemon.h>
#include <unistd.h>

#include "captured/camera_thread.h"
#include "captured/control.h"
#include "captured/recording.h"
#include "core/log.h"
#include "dio/clock.h"
#include "ring/ring.h"

#define NS_PER_S 1000000000ull
#define TICK_NS  NS_PER_S

struct daemon {
	const struct dio_captured_settings *settings;
	int signals, changed;
	struct dio_ring_server *ring;
	struct dio_recording *recording;
	struct dio_camera_thread *camera;
	struct dio_control *control;
	char interrupted[64]; /* recording to go on with; "": none */
	uint64_t watchdog_ns; /* feed so often; 0: nobody asks */
	uint64_t fed_ns, tick_ns;
	uint32_t readers;
	char told[600]; /* the status line systemd has */
};

/* Signals come through a descriptor; blocked before any thread starts, they reach none. */
static enum dio_status open_descriptors(struct daemon *daemon, struct dio_error *error)
{
	sigset_t set;

	sigemptyset(&set);
	sigaddset(&set, SIGTERM);
	sigaddset(&set, SIGINT);
	pthread_sigmask(SIG_BLOCK, &set, NULL);
	/* A write to a recording beyond a file size limit is an error, not the end. */
	signal(SIGXFSZ, SIG_IGN);
	signal(SIGPIPE, SIG_IGN);
	daemon->signals = signalfd(-1, &set, SFD_CLOEXEC | SFD_NONBLOCK);
	daemon->changed = eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK);
	if (daemon->signals < 0 || daemon->changed < 0)
		return dio_fail(error, DIO_IO, "out of descriptors: %s", strerror(errno));
	return DIO_OK;
}

/* systemd hands the listening socket over when a socket unit made it. */
static enum dio_status open_ring(struct daemon *daemon, struct dio_error *error)
{
	struct dio_ring_server_options options = {
		.path = daemon->settings->socket,
		.listen_fd = -1,
		.slot_count = daemon->settings->ring_slots,
	};
	int handed = sd_listen_fds(1);

	if (handed > 1)
		return dio_fail(error, DIO_BAD_ARG, "systemd hands over %d sockets; one is wanted",
				handed);
	if (handed == 1)
		options.listen_fd = SD_LISTEN_FDS_START;
	return dio_ring_server_create(&options, &daemon->ring, error);
}

static enum dio_status open_parts(struct daemon *daemon, struct dio_error *error)
{
	const struct dio_captured_settings *settings = daemon->settings;
	enum dio_status status = open_descriptors(daemon, error);

	if (status == DIO_OK)
		status = open_ring(daemon, error);
	if (status == DIO_OK)
		status = dio_recording_create(settings->recordings, settings->reserve_mib,
					      daemon->changed, &daemon->recording, error);
	if (status == DIO_OK)
		status = dio_camera_thread_create(settings, daemon->ring, daemon->recording,
						  daemon->changed, &daemon->camera, error);
	if (status == DIO_OK) {
		const struct dio_control_parts parts = {daemon->camera, daemon->recording,
							daemon->ring};

		status = dio_control_create(settings->bus, &parts, &daemon->control, error);
	}
	return status;
}

static void close_parts(struct daemon *daemon)
{
	dio_control_destroy(daemon->control);
	dio_camera_thread_destroy(daemon->camera);
	dio_recording_destroy(daemon->recording);
	dio_ring_server_destroy(daemon->ring);
	if (daemon->changed >= 0)
		close(daemon->changed);
	if (daemon->signals >= 0)
		close(daemon->signals);
}

/* A recording that a kill or a power cut ended goes on as soon as there are frames. */
static void go_on_recording(struct daemon *daemon, const struct dio_capture_status *status)
{
	struct dio_error error;

	if (!daemon->interrupted[0] || status->state != DIO_CAPTURE_STREAMING)
		return;
	if (dio_recording_start(daemon->recording, daemon->interrupted, &status->camera, &error) !=
	    DIO_OK)
		dio_log_error("%s", error.text);
	daemon->interrupted[0] = '\0';
}

/* A recording that ended by itself is closed here, where it is safe to wait for the disk. */
static void close_ended_recording(struct daemon *daemon)
{
	struct dio_recording_status status;
	struct dio_error error;

	dio_recording_get_status(daemon->recording, &status);
	if (status.active && status.text[0] &&
	    dio_recording_stop(daemon->recording, &error) != DIO_OK)
		dio_log_error("%s", error.text);
}

static void tell_systemd(struct daemon *daemon, const struct dio_capture_status *status,
			 const struct dio_ring_counters *ring)
{
	char line[sizeof(daemon->told)] = "";

	if (status->state == DIO_CAPTURE_STREAMING)
		snprintf(line, sizeof(line), "streaming %ux%u %s from %s to %u readers",
			 status->camera.width, status->camera.height,
			 dio_pixel_format_name(status->camera.format), status->camera.name,
			 ring->readers);
	else
		snprintf(line, sizeof(line), "%s%s%s", dio_capture_state_name(status->state),
			 status->text[0] ? ": " : "", status->text);
	if (strcmp(line, daemon->told) == 0)
		return;
	memcpy(daemon->told, line, sizeof(line));
	sd_notifyf(0, "STATUS=%s", line);
}

static uint64_t feed_period(const struct daemon *daemon)
{
	return daemon->watchdog_ns / 4;
}

/* The watchdog is fed from the loop that serves the readers, and only while the camera's thread
 * comes round too: one that has not for half the time hangs in its driver. */
static void feed_watchdog(struct daemon *daemon, const struct dio_capture_status *status)
{
	const uint64_t now = dio_clock_ns();

	if (daemon->watchdog_ns == 0 || now < daemon->fed_ns + feed_period(daemon) ||
	    now > status->heartbeat_ns + daemon->watchdog_ns / 2)
		return;
	daemon->fed_ns = now;
	sd_notify(0, "WATCHDOG=1");
}

static void look_after(struct daemon *daemon, bool changed)
{
	const bool tick = dio_clock_ns() >= daemon->tick_ns;
	struct dio_capture_status status;
	struct dio_ring_counters ring;

	dio_camera_thread_get_status(daemon->camera, &status);
	dio_ring_server_get_counters(daemon->ring, &ring);
	feed_watchdog(daemon, &status);
	if (ring.readers != daemon->readers)
		changed = true;
	daemon->readers = ring.readers;
	if (!changed && !tick)
		return;
	if (tick)
		daemon->tick_ns = dio_clock_ns() + TICK_NS;
	go_on_recording(daemon, &status);
	close_ended_recording(daemon);
	tell_systemd(daemon, &status, &ring);
	dio_control_update(daemon->control, tick);
}

/* The longest wait: until the next tick or feeding, or what the bus wants. */
static int timeout_of(const struct daemon *daemon, int bus_ms)
{
	uint64_t until = daemon->tick_ns, now = dio_clock_ns();
	int ms;

	if (daemon->watchdog_ns && daemon->fed_ns + feed_period(daemon) < until)
		until = daemon->fed_ns + feed_period(daemon);
	/* At least some milliseconds: a watchdog that may not be fed must not make us spin. */
	ms = until > now ? (int)((until - now + 999999) / 1000000) : 20;
	return bus_ms >= 0 && bus_ms < ms ? bus_ms : ms;
}

static void loop(struct daemon *daemon)
{
	enum { SIGNALS, CHANGED, RING, BUS, COUNT };
	struct pollfd fds[COUNT] = {
		[SIGNALS] = {.fd = daemon->signals, .events = POLLIN},
		[CHANGED] = {.fd = daemon->changed, .events = POLLIN},
		[RING] = {.fd = dio_ring_server_get_fd(daemon->ring), .events = POLLIN},
	};
	uint64_t changes;
	int bus_ms;

	for (;;) {
		dio_control_prepare(daemon->control, &fds[BUS], &bus_ms);
		if (poll(fds, COUNT, timeout_of(daemon, bus_ms)) < 0 && errno != EINTR) {
			dio_log_error("poll: %s", strerror(errno));
			return;
		}
		if (fds[SIGNALS].revents)
			return;
		if (fds[RING].revents)
			dio_ring_server_dispatch(daemon->ring);
		dio_control_process(daemon->control);
		look_after(daemon, read(daemon->changed, &changes, sizeof(changes)) > 0);
	}
}

enum dio_status dio_captured_run(const struct dio_captured_settings *settings,
				 struct dio_error *error)
{
	struct daemon daemon = {.settings = settings, .signals = -1, .changed = -1};
	enum dio_status status = open_parts(&daemon, error);
	uint64_t watchdog_us = 0;

	if (status == DIO_OK) {
		dio_recording_get_interrupted(daemon.recording, daemon.interrupted,
					      sizeof(daemon.interrupted));
		if (sd_watchdog_enabled(0, &watchdog_us) > 0)
			daemon.watchdog_ns = watchdog_us * 1000;
		sd_notify(0, "READY=1");
		loop(&daemon);
		sd_notify(0, "STOPPING=1");
	}
	close_parts(&daemon);
	return status;
}
