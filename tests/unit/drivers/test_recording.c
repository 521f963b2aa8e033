#include "check.h"

#include <sched.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mount.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include "dio/atomic_file.h"
#include "dio/file.h"
#include "dio/recording.h"
#include "scratch.h"

#define FRAMES 5

static const struct dio_camera_info source = {.name = "A \"quoted\" camera",
					      .format = DIO_PIXEL_YUYV,
					      .width = 16,
					      .height = 12,
					      .frames_per_second = 29.97};
static const struct dio_camera_options fast = {.as_fast_as_possible = true};

/* Beyond 2^53: such a time must not pass through a double. */
static uint64_t time_of(uint64_t i)
{
	return 9007199254740993u + i * 33366667u;
}

/* Numbers 2 and 3 are missing: a gap of two. */
static uint64_t sequence_of(uint64_t i)
{
	return i < 2 ? i : i + 2;
}

static void append(struct dio_recorder *recorder, uint64_t i)
{
	struct dio_error error;
	uint8_t data[16 * 12 * 2];
	struct dio_frame frame = {.format = DIO_PIXEL_YUYV,
				  .width = 16,
				  .height = 12,
				  .pitch_bytes = 32,
				  .timestamp_ns = time_of(i),
				  .sequence = sequence_of(i),
				  .data = data,
				  .size_bytes = sizeof(data)};

	memset(data, 128 + (int)i, sizeof(data));
	assert_ok(dio_recorder_append(recorder, &frame, &error), error);
}

static struct dio_recorder *record(const char *folder, uint64_t count)
{
	struct dio_recorder *recorder;
	struct dio_error error;

	assert_ok(dio_recorder_open(folder, &source, &recorder, &error), error);
	for (uint64_t i = 0; i < count; i++)
		append(recorder, i);
	return recorder;
}

static void record_whole(const char *folder, uint64_t count)
{
	struct dio_error error;

	assert_ok(dio_recorder_close(record(folder, count), &error), error);
}

static struct dio_camera *start(const char *folder)
{
	struct dio_camera *camera;
	struct dio_error error;

	assert_ok(dio_camera_open(folder, &fast, &camera, &error), error);
	assert_ok(dio_camera_start(camera, &error), error);
	return camera;
}

static void assert_frame(struct dio_camera *camera, uint64_t i)
{
	struct dio_picture picture = {0};
	struct dio_frame frame;
	struct dio_error error;
	uint8_t data[4], expected[3];

	memset(data, 128 + (int)i, sizeof(data));
	assert_ok(dio_camera_acquire(camera, &frame, 0, &error), error);
	assert_int_equal(frame.timestamp_ns, time_of(i));
	assert_int_equal(frame.sequence, sequence_of(i));
	assert_int_equal(frame.width, 16);
	assert_int_equal(frame.height, 12);
	struct dio_frame two = {.format = DIO_PIXEL_YUYV,
				.width = 2,
				.height = 1,
				.pitch_bytes = 4,
				.data = data,
				.size_bytes = 4};
	assert_ok(dio_frame_to_rgb(&two, &picture, &error), error);
	memcpy(expected, picture.rgb, 3);
	assert_memory_equal(frame.data, expected, 3);
	assert_memory_equal(frame.data + frame.size_bytes - 3, expected, 3);
	dio_picture_deinit(&picture);
}

static void assert_end(struct dio_camera *camera)
{
	struct dio_frame frame;
	struct dio_error error;

	assert_fails(dio_camera_acquire(camera, &frame, 0, &error), DIO_END, error, "frames");
	dio_camera_close(camera);
}

static void a_recording_comes_back_with_its_times(void **state)
{
	const char *folder = scratch_path(*state, "rec");
	struct dio_camera_counters counters;
	struct dio_camera_info info;
	struct dio_camera *camera;

	record_whole(folder, FRAMES);
	assert_int_equal(scratch_count(folder), 2); /* frames and recording.json */
	camera = start(folder);
	dio_camera_get_info(camera, &info);
	assert_string_equal(info.name, source.name);
	assert_int_equal(info.frame_count, FRAMES);
	assert_int_equal(info.width, 16);
	assert_true(info.frames_per_second == 29.97);
	for (uint64_t i = 0; i < FRAMES; i++)
		assert_frame(camera, i);
	assert_string_equal(dio_camera_get_frame_name(camera), "frames/000004.png");
	dio_camera_get_counters(camera, &counters);
	assert_int_equal(counters.lost, 2);
	assert_end(camera);
}

static void mjpeg_is_stored_as_it_came(void **state)
{
	const struct dio_camera_info info = {
		.name = "m", .format = DIO_PIXEL_MJPEG, .width = 8, .height = 8};
	const char *folder = scratch_path(*state, "rec");
	struct dio_picture picture;
	struct dio_recorder *recorder;
	struct dio_camera *camera;
	struct dio_frame frame = {.format = DIO_PIXEL_MJPEG, .width = 8, .height = 8}, back;
	struct dio_error error;
	uint8_t *bytes;
	size_t size;

	assert_int_equal(dio_picture_init(&picture, 8, 8), DIO_OK);
	assert_ok(dio_picture_encode("a.jpg", &picture, &bytes, &size, &error), error);
	frame.data = bytes;
	frame.size_bytes = size;
	assert_ok(dio_recorder_open(folder, &info, &recorder, &error), error);
	assert_ok(dio_recorder_append(recorder, &frame, &error), error);
	assert_ok(dio_recorder_close(recorder, &error), error);
	camera = start(folder);
	assert_ok(dio_camera_acquire(camera, &back, 0, &error), error);
	assert_int_equal(back.format, DIO_PIXEL_MJPEG);
	assert_int_equal(back.size_bytes, size);
	assert_memory_equal(back.data, bytes, size);
	assert_end(camera);
	free(bytes);
	dio_picture_deinit(&picture);
}

static void an_existing_recording_is_refused(void **state)
{
	const char *folder = scratch_path(*state, "rec");
	struct dio_recorder *recorder = NULL;
	struct dio_camera *camera;
	struct dio_error error;

	record_whole(folder, 1);
	assert_fails(dio_recorder_open(folder, &source, &recorder, &error), DIO_BAD_ARG, error,
		     "one already");
	assert_fails(dio_recorder_open(scratch_path(*state, "no/rec"), &source, &recorder, &error),
		     DIO_NOT_FOUND, error, "no/rec");
	assert_null(recorder);
	assert_ok(dio_recorder_close(NULL, &error), error);
	camera = start(folder);
	assert_frame(camera, 0);
	assert_end(camera);
}

/* What a killed process or a power cut leaves: no close, and at worst half a line. */
static void a_recording_that_was_cut_off_opens_with_all_whole_frames(void **state)
{
	const char *folder = scratch_path(*state, "rec"), *copy = scratch_path(*state, "cut");
	struct dio_recorder *recorder = record(folder, FRAMES);
	struct dio_camera *camera;
	struct dio_error error;
	struct stat st;
	char command[1200];

	snprintf(command, sizeof(command), "cp -r '%s' '%s'", folder, copy);
	assert_int_equal(system(command), 0);
	assert_ok(dio_recorder_close(recorder, &error), error);

	camera = start(copy);
	for (uint64_t i = 0; i < FRAMES; i++)
		assert_frame(camera, i);
	assert_end(camera);

	assert_int_equal(stat(scratch_path(copy, "recording.journal"), &st), 0);
	assert_int_equal(truncate(scratch_path(copy, "recording.journal"), st.st_size - 20), 0);
	camera = start(copy);
	for (uint64_t i = 0; i < FRAMES - 1; i++)
		assert_frame(camera, i);
	assert_end(camera);

	/* File systems may leave zeros where data never arrived. */
	assert_int_equal(truncate(scratch_path(copy, "recording.journal"), st.st_size + 5), 0);
	camera = start(copy);
	for (uint64_t i = 0; i < FRAMES - 1; i++)
		assert_frame(camera, i);
	assert_end(camera);
}

static void record_until_killed(const char *folder)
{
	struct dio_recorder *recorder;
	uint8_t data[16 * 12 * 2] = {0};
	struct dio_frame frame = {.format = DIO_PIXEL_YUYV,
				  .width = 16,
				  .height = 12,
				  .pitch_bytes = 32,
				  .data = data,
				  .size_bytes = sizeof(data)};

	if (dio_recorder_open(folder, &source, &recorder, NULL) != DIO_OK)
		_exit(1);
	for (;; frame.sequence++) {
		frame.timestamp_ns += 1000000;
		if (dio_recorder_append(recorder, &frame, NULL) != DIO_OK)
			_exit(1);
	}
}

static void a_killed_recorder_leaves_only_whole_frames(void **state)
{
	for (int round = 0; round < 5; round++) {
		char name[16];
		const char *folder, *third;
		struct dio_camera *camera;
		struct dio_camera_info info;
		struct dio_frame frame;
		struct dio_error error;
		int status;
		pid_t child;

		snprintf(name, sizeof(name), "rec%d", round);
		folder = scratch_path(*state, name);
		third = scratch_path(folder, "frames/000003.png");
		child = fork();
		if (child == 0)
			record_until_killed(folder);
		/* Not before there is something to lose. */
		for (int i = 0; i < 1000 && access(third, F_OK); i++)
			usleep(10000);
		usleep((useconds_t)(round * 1700));
		assert_int_equal(kill(child, SIGKILL), 0);
		assert_int_equal(waitpid(child, &status, 0), child);
		assert_true(WIFSIGNALED(status));

		camera = start(folder);
		dio_camera_get_info(camera, &info);
		assert_true(info.frame_count >= 3);
		for (uint64_t i = 0; i < info.frame_count; i++) {
			assert_ok(dio_camera_acquire(camera, &frame, 0, &error), error);
			assert_int_equal(frame.sequence, i);
		}
		assert_end(camera);
	}
}

/* In a child with a mount namespace of its own: exits 0, or 77 when nothing may be mounted. */
static int record_onto_a_small_disk(const char *disk)
{
	static uint8_t noise[256 * 256];
	struct dio_frame frame = {.format = DIO_PIXEL_GRAY8,
				  .width = 256,
				  .height = 256,
				  .pitch_bytes = 256,
				  .data = noise,
				  .size_bytes = sizeof(noise)};
	const char *folder = scratch_path(disk, "rec");
	struct dio_recorder *recorder;
	struct dio_camera *camera;
	struct dio_error error = {{0}};
	enum dio_status status;
	uint64_t count = 0;

	if ((unshare(CLONE_NEWNS) != 0 && unshare(CLONE_NEWUSER | CLONE_NEWNS) != 0) ||
	    mount("none", "/", NULL, MS_REC | MS_PRIVATE, NULL) != 0 ||
	    mount("tmpfs", disk, "tmpfs", 0, "size=1m") != 0)
		return 77;
	for (uint32_t i = 0, x = 1; i < sizeof(noise); i++, x = x * 1664525 + 1013904223)
		noise[i] = (uint8_t)(x >> 24);
	if (dio_recorder_open(folder, &source, &recorder, &error) != DIO_OK)
		return 1;
	while ((status = dio_recorder_append(recorder, &frame, &error)) == DIO_OK)
		frame.sequence = ++count;
	if (status != DIO_NO_SPACE || !strstr(error.text, "disk is full") || count < 2)
		return 2;
	dio_recorder_close(recorder, &error);
	if (dio_camera_open(folder, &fast, &camera, &error) != DIO_OK ||
	    dio_camera_start(camera, &error) != DIO_OK)
		return 3;
	for (uint64_t i = 0; i < count; i++) {
		if (dio_camera_acquire(camera, &frame, 0, &error) != DIO_OK || frame.sequence != i)
			return 4;
	}
	status = dio_camera_acquire(camera, &frame, 0, &error);
	dio_camera_close(camera);
	return status == DIO_END ? 0 : 5;
}

static void a_full_disk_ends_a_recording_that_still_plays(void **state)
{
	pid_t child = fork();
	int status;

	if (child == 0)
		_exit(record_onto_a_small_disk(*state));
	assert_int_equal(waitpid(child, &status, 0), child);
	assert_true(WIFEXITED(status));
	if (WEXITSTATUS(status) == 77) {
		print_message("no tmpfs may be mounted here\n");
		skip();
	}
	assert_int_equal(WEXITSTATUS(status), 0);
}

static void damaged_frames_are_named_and_the_others_play(void **state)
{
	const char *folder = scratch_path(*state, "rec");
	const char *flipped = scratch_path(folder, "frames/000001.png");
	struct dio_camera_counters counters;
	struct dio_camera *camera;
	struct dio_frame frame;
	struct dio_error error;
	uint8_t *bytes;
	size_t size;

	record_whole(folder, FRAMES);
	assert_ok(dio_file_read(flipped, 100000, &bytes, &size, &error), error);
	bytes[size / 2] ^= 1;
	scratch_write(flipped, bytes, size);
	free(bytes);
	assert_int_equal(truncate(scratch_path(folder, "frames/000003.png"), 30), 0);
	assert_int_equal(remove(scratch_path(folder, "frames/000004.png")), 0);

	camera = start(folder);
	assert_frame(camera, 0);
	assert_fails(dio_camera_acquire(camera, &frame, 0, &error), DIO_BAD_FILE, error,
		     "000001.png: its checksum");
	assert_frame(camera, 2);
	assert_fails(dio_camera_acquire(camera, &frame, 0, &error), DIO_BAD_FILE, error,
		     "000003.png: 30 bytes");
	assert_fails(dio_camera_acquire(camera, &frame, 0, &error), DIO_BAD_FILE, error,
		     "000004.png");
	dio_camera_get_counters(camera, &counters);
	assert_int_equal(counters.broken, 3);
	assert_end(camera);
}

static void damaged_indexes_are_refused_by_name(void **state)
{
	static const struct {
		const char *text;
		enum dio_status status;
		const char *word;
	} bad[] = {
		{"", DIO_BAD_FILE, "recording.json"},
		{"{", DIO_BAD_FILE, "recording.json"},
		{"[]", DIO_BAD_FILE, "not the index"},
		{"{\"format\":\"diorama-recording\",\"version\":2,\"camera\":{\"name\":\"\","
		 "\"pixel_format\":\"YUYV\",\"width\":1,\"height\":1,\"frames_per_second\":0},"
		 "\"frames\":[]}",
		 DIO_UNSUPPORTED, "another release"},
		{"{\"format\":\"diorama-recording\",\"version\":1,\"camera\":{\"name\":\"\","
		 "\"pixel_format\":\"YUYV\",\"width\":1e9,\"height\":1,\"frames_per_second\":0},"
		 "\"frames\":[]}",
		 DIO_BAD_FILE, "damaged"},
		{"{\"format\":\"diorama-recording\",\"version\":1,\"camera\":{\"name\":\"\","
		 "\"pixel_format\":\"YUYV\",\"width\":1,\"height\":1,\"frames_per_second\":0},"
		 "\"frames\":[{\"file\":\"frames/../../secret.png\",\"timestamp_ns\":\"1\","
		 "\"sequence\":\"1\",\"size_bytes\":\"1\",\"crc32\":\"0\"}]}",
		 DIO_BAD_FILE, "frame 0"},
		{"{\"format\":\"diorama-recording\",\"version\":1,\"camera\":{\"name\":\"\","
		 "\"pixel_format\":\"YUYV\",\"width\":1,\"height\":1,\"frames_per_second\":0},"
		 "\"frames\":[{\"file\":\"frames/..\",\"timestamp_ns\":\"1\","
		 "\"sequence\":\"1\",\"size_bytes\":\"1\",\"crc32\":\"0\"}]}",
		 DIO_BAD_FILE, "frame 0"},
		{"{\"format\":\"diorama-recording\",\"version\":1,\"camera\":{\"name\":\"\","
		 "\"pixel_format\":\"YUYV\",\"width\":1,\"height\":1,\"frames_per_second\":0},"
		 "\"frames\":[{\"file\":\"frames/0.png\",\"timestamp_ns\":\"-1\","
		 "\"sequence\":\"1\",\"size_bytes\":\"1\",\"crc32\":\"0\"}]}",
		 DIO_BAD_FILE, "frame 0"},
	};
	struct dio_camera *camera = NULL;
	struct dio_error error;

	for (size_t i = 0; i < sizeof(bad) / sizeof(bad[0]); i++) {
		scratch_write(scratch_path(*state, "recording.json"), bad[i].text,
			      strlen(bad[i].text));
		assert_fails(dio_camera_open(*state, &fast, &camera, &error), bad[i].status, error,
			     bad[i].word);
	}
	assert_null(camera);
}

static void every_truncation_of_the_index_is_refused(void **state)
{
	const char *folder = scratch_path(*state, "rec"),
		   *path = scratch_path(folder, "recording.json");
	struct dio_camera *camera = NULL;
	struct dio_error error;
	uint8_t *bytes;
	size_t size;

	record_whole(folder, 2);
	assert_ok(dio_file_read(path, 100000, &bytes, &size, &error), error);
	for (size_t cut = 0; cut < size - 1; cut++) {
		scratch_write(path, bytes, cut);
		assert_fails(dio_camera_open(folder, &fast, &camera, &error), DIO_BAD_FILE, error,
			     "recording.json");
	}
	free(bytes);
	assert_null(camera);
}

static void a_recording_keeps_its_own_pace(void **state)
{
	const struct dio_camera_options options = {.every_frame = true};
	const char *folder = scratch_path(*state, "rec");
	struct dio_camera *camera;
	struct dio_frame frame;
	struct dio_error error;

	record_whole(folder, 3);
	assert_ok(dio_camera_open(folder, &options, &camera, &error), error);
	assert_ok(dio_camera_start(camera, &error), error);
	assert_ok(dio_camera_acquire(camera, &frame, 0, &error), error);
	assert_int_equal(dio_camera_acquire(camera, &frame, 1000000, &error), DIO_AGAIN);
	assert_ok(dio_camera_acquire(camera, &frame, 1000000000, &error), error);
	assert_int_equal(frame.timestamp_ns, time_of(1));
	/* Half-way it is stopped: the pace goes on from there. */
	assert_ok(dio_camera_stop(camera, &error), error);
	assert_int_equal(dio_camera_acquire(camera, &frame, 0, &error), DIO_BAD_ARG);
	assert_ok(dio_camera_start(camera, &error), error);
	assert_ok(dio_camera_acquire(camera, &frame, 0, &error), error);
	assert_int_equal(frame.timestamp_ns, time_of(2));
	assert_end(camera);
}

static void assert_frames(const char *folder, uint64_t count)
{
	struct dio_camera *camera = start(folder);

	for (uint64_t i = 0; i < count; i++)
		assert_frame(camera, i);
	assert_end(camera);
}

static void a_recording_goes_on_whether_it_was_closed_or_cut_off(void **state)
{
	const char *folder = scratch_path(*state, "on");
	struct dio_recorder *recorder;
	struct dio_error error;
	uint64_t frames;

	assert_fails(dio_recorder_resume(folder, &source, &recorder, &frames, &error),
		     DIO_NOT_FOUND, error, "on");
	record_whole(folder, 2);
	for (uint64_t have = 2; have < 8; have += 2) {
		pid_t child;

		assert_ok(dio_recorder_resume(folder, &source, &recorder, &frames, &error), error);
		assert_int_equal(frames, have);
		append(recorder, have);
		assert_ok(dio_recorder_close(recorder, &error), error);
		/* Killed with one more frame written: the next round finds it. */
		child = fork();
		if (child == 0) {
			if (dio_recorder_resume(folder, &source, &recorder, NULL, &error) == DIO_OK)
				append(recorder, have + 1);
			raise(SIGKILL);
		}
		assert_int_equal(waitpid(child, NULL, 0), child);
		assert_frames(folder, have + 2);
	}
}

static void what_the_camera_says_of_a_frame_comes_back(void **state)
{
	const char *folder = scratch_path(*state, "said");
	const struct dio_frame_metadata said = {.exposure_us = 12345,
						.gain = 1.25f,
						.white_balance_k = 4600,
						.red_gain = 1.5f,
						.blue_gain = 2.75f,
						.locked = DIO_LOCK_EXPOSURE | DIO_LOCK_FOCUS};
	struct dio_recorder *recorder;
	struct dio_camera *camera;
	struct dio_error error;
	uint8_t data[16 * 12] = {0};
	struct dio_frame frame = {.format = DIO_PIXEL_GRAY8,
				  .width = 16,
				  .height = 12,
				  .pitch_bytes = 16,
				  .data = data,
				  .size_bytes = sizeof(data)};

	assert_ok(dio_recorder_open(folder, &source, &recorder, &error), error);
	assert_ok(dio_recorder_append(recorder, &frame, &error), error);
	frame.metadata = said;
	assert_ok(dio_recorder_append(recorder, &frame, &error), error);
	assert_ok(dio_recorder_close(recorder, &error), error);
	camera = start(folder);
	assert_ok(dio_camera_acquire(camera, &frame, 0, &error), error);
	assert_int_equal(frame.metadata.exposure_us, 0);
	assert_true(frame.metadata.gain == 0);
	assert_ok(dio_camera_acquire(camera, &frame, 0, &error), error);
	assert_memory_equal(&frame.metadata, &said, sizeof(said));
	dio_camera_close(camera);
}

static void a_frame_that_does_not_convert_spoils_nothing(void **state)
{
	const char *folder = scratch_path(*state, "rec");
	struct dio_recorder *recorder = record(folder, 2);
	struct dio_frame bad = {.format = DIO_PIXEL_YUYV, .width = 16, .height = 12};
	struct dio_camera *camera;
	struct dio_error error;

	assert_fails(dio_recorder_append(recorder, &bad, &error), DIO_BAD_ARG, error, "pitch");
	assert_ok(dio_recorder_close(recorder, &error), error);
	camera = start(folder);
	assert_frame(camera, 0);
	assert_frame(camera, 1);
	assert_end(camera);
}

#define scratch_test(function)                                                                     \
	cmocka_unit_test_setup_teardown(function, scratch_make, scratch_remove)

int main(void)
{
	const struct CMUnitTest tests[] = {
		scratch_test(a_recording_comes_back_with_its_times),
		scratch_test(mjpeg_is_stored_as_it_came),
		scratch_test(an_existing_recording_is_refused),
		scratch_test(a_recording_that_was_cut_off_opens_with_all_whole_frames),
		scratch_test(a_killed_recorder_leaves_only_whole_frames),
		scratch_test(a_full_disk_ends_a_recording_that_still_plays),
		scratch_test(damaged_frames_are_named_and_the_others_play),
		scratch_test(damaged_indexes_are_refused_by_name),
		scratch_test(every_truncation_of_the_index_is_refused),
		scratch_test(a_recording_keeps_its_own_pace),
		scratch_test(a_recording_goes_on_whether_it_was_closed_or_cut_off),
		scratch_test(what_the_camera_says_of_a_frame_comes_back),
		scratch_test(a_frame_that_does_not_convert_spoils_nothing),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
