/* A reader of the capture daemon's ring.
 *
 * vm_ring match SOCKET FILE FRAME_BYTES SECONDS LAST
 *     Compare every frame with those of FILE, until frame LAST came, and print runs, "TIMES INDEX"
 * a line: so often in a row came frame INDEX, -1 for one that is none of them, byte for byte. Then
 * "dropped N", "overtaken N", "gaps N" (in the driver's count) and "backwards N". vm_ring watch
 * SOCKET SECONDS Print "TIME state NAME" when the camera's state changes, and "TIME frame" for the
 * first frame after that or from another daemon; TIME in seconds of CLOCK_MONOTONIC. */
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "dio/clock.h"
#include "ring/ring_client.h"

#define SECOND_NS INT64_C(1000000000)

struct source {
	unsigned char *frames;
	size_t frame_bytes, count;
};

static int load_source(const char *path, size_t frame_bytes, struct source *source)
{
	FILE *file = fopen(path, "rb");
	long size = -1;

	if (file && fseek(file, 0, SEEK_END) == 0)
		size = ftell(file);
	*source = (struct source){NULL, frame_bytes, size > 0 ? (size_t)size / frame_bytes : 0};
	if (source->count > 0)
		source->frames = malloc(source->count * frame_bytes);
	if (source->frames && fseek(file, 0, SEEK_SET) == 0 &&
	    fread(source->frames, frame_bytes, source->count, file) == source->count) {
		fclose(file);
		return 0;
	}
	fprintf(stderr, "vm_ring: %s cannot be read\n", path);
	return 1;
}

/* Which frame it is; the one before and its successor are looked at first. */
static long find(const struct source *source, const unsigned char *data, long last)
{
	for (size_t i = 0; i < source->count; i++) {
		size_t at = ((size_t)(last > 0 ? last : 0) + i) % source->count;

		if (memcmp(source->frames + at * source->frame_bytes, data, source->frame_bytes) ==
		    0)
			return (long)at;
	}
	return -1;
}

static int match(struct dio_ring_client *client, const struct source *source, double seconds,
		 long end)
{
	const uint64_t end_ns = dio_clock_ns() + (uint64_t)(seconds * (double)SECOND_NS);
	unsigned char *copy = malloc(source->frame_bytes);
	struct dio_ring_client_status status;
	struct dio_ring_frame frame;
	struct dio_error error;
	long last = -2;
	uint64_t times = 0, gaps = 0, backwards = 0, sequence = 0;

	while (copy && last != end && dio_clock_ns() < end_ns) {
		long now = -1;

		if (dio_ring_client_acquire(client, &frame, SECOND_NS / 10, &error) != DIO_OK)
			continue;
		if (frame.frame.size_bytes == source->frame_bytes &&
		    dio_ring_client_copy(client, &frame, copy, source->frame_bytes, &error) !=
			    DIO_OK)
			continue;
		if (frame.frame.size_bytes == source->frame_bytes)
			now = find(source, copy, last);
		if (sequence > 0 && frame.frame.sequence > sequence)
			gaps += frame.frame.sequence - sequence;
		backwards += frame.frame.sequence < sequence;
		sequence = frame.frame.sequence + 1;
		if (now != last && times > 0)
			printf("%" PRIu64 " %ld\n", times, last);
		times = now == last ? times + 1 : 1;
		last = now;
	}
	if (times > 0)
		printf("%" PRIu64 " %ld\n", times, last);
	dio_ring_client_get_status(client, &status);
	printf("dropped %" PRIu64 "\novertaken %" PRIu64 "\ngaps %" PRIu64 "\nbackwards %" PRIu64
	       "\n",
	       status.dropped, status.overtaken, gaps, backwards);
	free(copy);
	return 0;
}

static int watch(struct dio_ring_client *client, double seconds)
{
	const uint64_t end_ns = dio_clock_ns() + (uint64_t)(seconds * (double)SECOND_NS);
	enum dio_capture_state before = DIO_CAPTURE_ABSENT;
	struct dio_ring_client_status status;
	struct dio_ring_frame frame;
	struct dio_error error;
	uint32_t connections = 0;
	bool is_new = true;

	while (dio_clock_ns() < end_ns) {
		enum dio_status got =
			dio_ring_client_acquire(client, &frame, SECOND_NS / 20, &error);
		double now = (double)dio_clock_ns() * 1e-9;

		dio_ring_client_get_status(client, &status);
		if (status.state != before)
			printf("%.3f state %s\n", now, dio_capture_state_name(status.state));
		is_new = is_new || status.state != before || status.connections != connections;
		if (got == DIO_OK && is_new)
			printf("%.3f frame\n", now);
		is_new = is_new && got != DIO_OK;
		before = status.state;
		connections = status.connections;
		fflush(stdout);
	}
	return 0;
}

int main(int argc, char **argv)
{
	const bool matches = argc == 7 && strcmp(argv[1], "match") == 0;
	struct dio_ring_client_options options = {.name = "vm_ring", .order = DIO_RING_IN_ORDER};
	struct dio_ring_client *client;
	struct source source = {0};
	struct dio_error error;
	int result;

	if (!matches && !(argc == 4 && strcmp(argv[1], "watch") == 0)) {
		fprintf(stderr, "usage: vm_ring match SOCKET FILE FRAME_BYTES SECONDS LAST\n"
				"       vm_ring watch SOCKET SECONDS\n");
		return 2;
	}
	if (matches && load_source(argv[3], strtoul(argv[4], NULL, 10), &source) != 0)
		return 1;
	options.path = argv[2];
	if (dio_ring_client_open(&options, &client, &error) != DIO_OK) {
		fprintf(stderr, "vm_ring: %s\n", error.text);
		return 1;
	}
	result = matches ? match(client, &source, strtod(argv[5], NULL), strtol(argv[6], NULL, 10))
			 : watch(client, strtod(argv[3], NULL));
	dio_ring_client_close(client);
	free(source.frames);
	return result;
}
