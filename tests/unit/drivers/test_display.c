#include "check.h"

#include <libavcodec/avcodec.h>
#include <libavformat/avformat.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

#include "dio/video.h"
#include "dio/window.h"
#include "scratch.h"

struct watched {
	int frames, width, height;
	double frames_per_second;
	int first_luma, last_luma; /* in the middle */
};

static int middle_luma(const AVFrame *frame)
{
	return frame->data[0][frame->linesize[0] * (frame->height / 2) + frame->width / 2];
}

static void watch_frames(AVCodecContext *decoder, AVFrame *frame, struct watched *watched)
{
	while (avcodec_receive_frame(decoder, frame) == 0) {
		watched->width = frame->width;
		watched->height = frame->height;
		watched->last_luma = middle_luma(frame);
		if (watched->frames++ == 0)
			watched->first_luma = watched->last_luma;
	}
}

/* Decode a whole file as any player would. */
static void watch(const char *path, struct watched *watched)
{
	AVFormatContext *demuxer = NULL;
	AVPacket *packet = av_packet_alloc();
	AVFrame *frame = av_frame_alloc();
	const AVCodecParameters *parameters;
	AVCodecContext *decoder;

	memset(watched, 0, sizeof(*watched));
	assert_int_equal(avformat_open_input(&demuxer, path, NULL, NULL), 0);
	assert_true(avformat_find_stream_info(demuxer, NULL) >= 0);
	assert_int_equal(demuxer->nb_streams, 1);
	parameters = demuxer->streams[0]->codecpar;
	watched->frames_per_second = av_q2d(demuxer->streams[0]->avg_frame_rate);
	decoder = avcodec_alloc_context3(avcodec_find_decoder(parameters->codec_id));
	assert_true(avcodec_parameters_to_context(decoder, parameters) >= 0);
	assert_int_equal(avcodec_open2(decoder, NULL, NULL), 0);
	while (av_read_frame(demuxer, packet) == 0) {
		assert_int_equal(avcodec_send_packet(decoder, packet), 0);
		av_packet_unref(packet);
		watch_frames(decoder, frame, watched);
	}
	avcodec_send_packet(decoder, NULL);
	watch_frames(decoder, frame, watched);
	avcodec_free_context(&decoder);
	av_frame_free(&frame);
	av_packet_free(&packet);
	avformat_close_input(&demuxer);
}

/* `count` pictures from black to white. */
static enum dio_status write_fade(const char *path, uint32_t width, uint32_t height, int count,
				  struct dio_error *error)
{
	struct dio_picture picture;
	struct dio_video *video;
	enum dio_status status = dio_video_open(path, width, height, 29.97, &video, error);

	if (status != DIO_OK)
		return status;
	assert_int_equal(dio_picture_init(&picture, width, height), DIO_OK);
	for (int i = 0; i < count && status == DIO_OK; i++) {
		memset(picture.rgb, 255 * i / (count > 1 ? count - 1 : 1),
		       3 * (size_t)width * height);
		status = dio_video_append(video, &picture, error);
	}
	dio_picture_deinit(&picture);
	if (status != DIO_OK) {
		dio_video_close(video, NULL);
		return status;
	}
	return dio_video_close(video, error);
}

static void a_video_plays_with_every_frame(void **state)
{
	const char *path = scratch_path(*state, "file:a.mp4");
	struct watched watched;
	struct dio_error error;
	char url[600];

	assert_ok(write_fade(path, 64, 48, 100, &error), error);
	snprintf(url, sizeof(url), "file:%s", path);
	watch(url, &watched);
	assert_int_equal(watched.frames, 100);
	assert_int_equal(watched.width, 64);
	assert_int_equal(watched.height, 48);
	assert_true(watched.frames_per_second > 29.96 && watched.frames_per_second < 29.98);
	assert_in_range(watched.first_luma, 14, 19);
	assert_in_range(watched.last_luma, 230, 237);
	assert_int_equal(scratch_count(*state), 1);
}

static void odd_sides_are_padded_to_even(void **state)
{
	const char *path = scratch_path(*state, "a.mp4");
	struct watched watched;
	struct dio_error error;

	assert_ok(write_fade(path, 63, 47, 3, &error), error);
	watch(path, &watched);
	assert_int_equal(watched.frames, 3);
	assert_int_equal(watched.width, 64);
	assert_int_equal(watched.height, 48);
}

static void the_same_pictures_give_the_same_file(void **state)
{
	const char *a = scratch_path(*state, "a.mp4"), *b = scratch_path(*state, "b.mp4");
	struct dio_error error;
	char command[1200];

	assert_ok(write_fade(a, 320, 240, 20, &error), error);
	assert_ok(write_fade(b, 320, 240, 20, &error), error);
	snprintf(command, sizeof(command), "cmp '%s' '%s'", a, b);
	assert_int_equal(system(command), 0);
}

static void videos_that_cannot_be_written_leave_nothing(void **state)
{
	const char *path = scratch_path(*state, "a.mp4");
	struct dio_picture picture;
	struct dio_video *video;
	struct dio_error error;

	assert_fails(write_fade(scratch_path(*state, "no/a.mp4"), 64, 48, 3, &error), DIO_NOT_FOUND,
		     error, "no/a.mp4");
	assert_fails(write_fade("/dev/full", 64, 48, 3, &error), DIO_NO_SPACE, error,
		     "disk is full");
	assert_fails(write_fade(path, 64, 48, 0, &error), DIO_BAD_ARG, error, "without pictures");
	assert_fails(write_fade(path, 1, 48, 3, &error), DIO_BAD_ARG, error, "1x48");
	assert_fails(dio_video_open(path, 64, 48, 0, &video, &error), DIO_BAD_ARG, error,
		     "0 frames");
	assert_ok(dio_video_open(path, 64, 48, 30, &video, &error), error);
	assert_int_equal(dio_picture_init(&picture, 32, 48), DIO_OK);
	assert_fails(dio_video_append(video, &picture, &error), DIO_BAD_ARG, error, "32x48");
	assert_int_equal(dio_video_close(video, &error), DIO_BAD_ARG);
	assert_ok(dio_video_close(NULL, &error), error);
	assert_int_equal(scratch_count(*state), 0);
	dio_picture_deinit(&picture);
}

static void without_a_display_the_window_says_so(void **state)
{
	struct dio_window *window = NULL;
	struct dio_error error;

	(void)state;
	if (getenv("DISPLAY") || getenv("WAYLAND_DISPLAY")) {
		print_message("a display is present\n");
		skip();
	}
	unsetenv("SDL_VIDEODRIVER");
	assert_fails(dio_window_open("test", 64, 48, &window, &error), DIO_UNSUPPORTED, error,
		     "window");
	assert_null(window);
	assert_fails(dio_window_open("test", 0, 48, &window, &error),
		     strstr(error.text, "SDL2") ? DIO_UNSUPPORTED : DIO_BAD_ARG, error, "window");
	dio_window_close(NULL);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test_setup_teardown(a_video_plays_with_every_frame, scratch_make,
						scratch_remove),
		cmocka_unit_test_setup_teardown(odd_sides_are_padded_to_even, scratch_make,
						scratch_remove),
		cmocka_unit_test_setup_teardown(the_same_pictures_give_the_same_file, scratch_make,
						scratch_remove),
		cmocka_unit_test_setup_teardown(videos_that_cannot_be_written_leave_nothing,
						scratch_make, scratch_remove),
		cmocka_unit_test(without_a_display_the_window_says_so),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
