/* Both daemons at work on the simulated camera, as processes under a private bus.
 *
 *   appliance figures [SECONDS]   time, memory, processor and frames lost, SECONDS a row (10)
 *   appliance soak [MINUTES]      shows a scene for so long (10); fails when a daemon grows
 *
 * The simulated camera draws its pictures within the capture daemon, so that one's processor time
 * is mostly the tracer's: a real camera needs less. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "dio/clock.h"
#include "process.h"
#include "ring/ring_client.h"
#include "stage.h"

static double amount; /* seconds a row, or minutes */

/* Both daemons at one time. */
struct pair {
	struct process_sample captured, viewd;
};

static struct pair sample(void)
{
	struct pair pair;

	if (!process_sample(stage_get_camera(), &pair.captured) ||
	    !process_sample(daemons_get_viewer(), &pair.viewd))
		fail_msg("a daemon is gone: %s", daemons_read_log());
	return pair;
}

/* Read every frame for a while as a client would: share of the camera's frames that did not come,
 * by the camera's own count. */
static double watch_frames(double seconds)
{
	const struct dio_ring_client_options options = {.path = fixture_path("run/frames"),
							.name = "appliance",
							.order = DIO_RING_IN_ORDER};
	uint64_t end_ns = dio_clock_ns() + (uint64_t)(seconds * 1e9), first = 0, last = 0;
	struct dio_ring_client *client;
	struct dio_ring_frame frame;
	struct dio_error error = {0};
	uint64_t taken = 0;

	if (dio_ring_client_open(&options, &client, &error) != DIO_OK)
		fail_msg("%s", error.text);
	while (dio_clock_ns() < end_ns) {
		if (dio_ring_client_acquire(client, &frame, 100000000, &error) != DIO_OK)
			continue;
		if (taken++ == 0)
			first = frame.frame.sequence;
		last = frame.frame.sequence;
	}
	dio_ring_client_close(client);
	assert_true(taken > 1);
	return 1 - (double)taken / (double)(last - first + 1);
}

static void print_row(const char *state, double rate)
{
	struct pair from = sample(), to;
	double dropped = watch_frames(amount), latency, p99, shown;

	to = sample();
	shown = atof(daemons_get("Fps"));
	latency = atof(daemons_get("LatencyMs"));
	p99 = atof(daemons_get("LatencyP99Ms"));
	printf("%-10s %3.0f %8.2f %% %7.1f %9.1f %7.1f %9.0f %% %6.0f %% %9.1f %7.1f\n", state,
	       rate, 100 * dropped, shown, latency, p99,
	       100 * process_share(&from.captured, &to.captured),
	       100 * process_share(&from.viewd, &to.viewd), (double)to.captured.pss_kib / 1024,
	       (double)to.viewd.pss_kib / 1024);
	fflush(stdout);
}

static void change_rate(double rate)
{
	stage_start_camera(rate);
	daemons_wait("Camera=streaming");
	sleep(1);
}

static void figures(void **state)
{
	double started_ms;

	(void)state;
	started_ms = stage_start(30);
	printf("camera 320x240 on sim, display 640x480, scene 128x96, int8, %s\n"
	       "start to the camera's first picture shown: %.0f ms\n\n"
	       "                 not     shown   latency, ms       processor        PSS, MiB\n"
	       "state      fps delivered a second  median     p99  captured  viewd  captured   "
	       "viewd\n",
	       "diorama-s", started_ms);
	print_row("idle", 30);
	change_rate(60);
	print_row("idle", 60);
	daemons_ctl("capture", NULL);
	daemons_wait("State=capture");
	print_row("tracking", 60);
	change_rate(30);
	print_row("tracking", 30);
	stage_reconstruct();
	print_row("viewing", 30);
	change_rate(60);
	daemons_wait("Source=tracked");
	print_row("viewing", 60);
}

/* One daemon through a third of the run. */
struct third {
	uint64_t *own_kib;
	size_t count;
	uint32_t descriptors, threads; /* the most */
};

static void note(struct third *third, const struct process_sample *s)
{
	third->own_kib[third->count++] = s->own_kib;
	third->descriptors =
		s->descriptors > third->descriptors ? s->descriptors : third->descriptors;
	third->threads = s->threads > third->threads ? s->threads : third->threads;
}

static int compare(const void *a, const void *b)
{
	uint64_t x = *(const uint64_t *)a, y = *(const uint64_t *)b;

	return (x > y) - (x < y);
}

static uint64_t median(struct third *third)
{
	qsort(third->own_kib, third->count, sizeof *third->own_kib, compare);
	return third->own_kib[third->count / 2];
}

/* Beyond what the allocator's habits move: one picture of the camera lost in five hundred is more
 * within five minutes. */
#define GROWTH_KIB 512

static bool has_grown(const char *daemon, struct third *first, struct third *last)
{
	uint64_t before = median(first), after = median(last);
	bool grown = after > before + GROWTH_KIB || last->descriptors > first->descriptors ||
		     last->threads > first->threads;

	printf("%-8s memory %.1f -> %.1f MiB, descriptors %u -> %u, threads %u -> %u: %s\n", daemon,
	       (double)before / 1024, (double)after / 1024, first->descriptors, last->descriptors,
	       first->threads, last->threads, grown ? "GROWS" : "steady");
	return grown;
}

/* What a hand at the buttons does, one thing after another. */
static void press(unsigned count)
{
	switch (count % 4) {
	case 0:
		daemons_ctl("play", NULL);
		daemons_wait("State=play");
		break;
	case 1:
		daemons_ctl("play", NULL);
		daemons_wait("State=view");
		break;
	case 2:
		daemons_ctl("follow", NULL);
		break;
	default:
		daemons_ctl("save", NULL);
		break;
	}
}

static void soak(void **state)
{
	enum { SAMPLE_S = 2, PRESS_SAMPLES = 5 };
	/* A fifth to warm up, then three thirds. */
	size_t count = (size_t)(amount * 60 * 0.8 / SAMPLE_S), third = count / 3;
	struct third captured[3] = {0}, viewd[3] = {0};
	uint64_t *room = calloc(6 * (third + 1), sizeof *room);
	bool grown;

	(void)state;
	assert_non_null(room);
	for (size_t i = 0; i < 3; i++) {
		captured[i].own_kib = room + i * third;
		viewd[i].own_kib = room + (i + 3) * third;
	}
	stage_start(30);
	daemons_ctl("capture", NULL);
	stage_reconstruct();
	for (unsigned i = 0; i < 4; i++) /* everything has happened once */
		press(i);
	sleep((unsigned)(amount * 60 * 0.2));
	for (size_t i = 0; i < 3 * third; i++) {
		struct pair now = sample();

		note(&captured[i / third], &now.captured);
		note(&viewd[i / third], &now.viewd);
		if (i % PRESS_SAMPLES == 0)
			press((unsigned)(i / PRESS_SAMPLES));
		sleep(SAMPLE_S);
	}
	printf("%.3g minutes, %zu samples, the first third beside the last\n", amount, 3 * third);
	grown = has_grown("captured", &captured[0], &captured[2]);
	grown |= has_grown("viewd", &viewd[0], &viewd[2]);
	free(room);
	assert_false(grown);
}

int main(int argc, char **argv)
{
	const struct CMUnitTest soaking[] = {cmocka_unit_test(soak)};
	const struct CMUnitTest measuring[] = {cmocka_unit_test(figures)};
	bool soaks = argc > 1 && strcmp(argv[1], "soak") == 0;
	char *end = NULL;

	amount = argc > 2 ? strtod(argv[2], &end) : 10;
	if (argc < 2 || argc > 3 || (!soaks && strcmp(argv[1], "figures") != 0) || (end && *end) ||
	    !(amount >= 1 && amount <= 10000)) {
		fprintf(stderr,
			"usage: appliance figures [SECONDS] | soak [MINUTES], of 1 to 10000\n");
		return 2;
	}
	return soaks ? cmocka_run_group_tests(soaking, stage_setup, stage_teardown)
		     : cmocka_run_group_tests(measuring, stage_setup, stage_teardown);
}
