#include "check.h"

#include <errno.h>
#include <string.h>

#include "fake_v4l2.h"

#define SECOND_NS 1000000000ll

/* A device, the camera on it, and whatever the last calls gave. */
struct rig {
	struct fake_v4l2 fake;
	struct dio_v4l2_system system;
	struct dio_camera_options options;
	struct dio_camera *camera;
	struct dio_camera_info info;
	struct dio_camera_counters counters;
	struct dio_frame frame;
	struct dio_error error;
};

static void rig_init(struct rig *rig)
{
	memset(rig, 0, sizeof(*rig));
	fake_v4l2_init(&rig->fake);
	rig->system = fake_v4l2_system(&rig->fake);
}

static enum dio_status rig_open(struct rig *rig)
{
	enum dio_status status = dio_v4l2_open_on(&rig->system, "/dev/video9", &rig->options,
						  &rig->camera, &rig->error);

	if (status == DIO_OK)
		dio_camera_get_info(rig->camera, &rig->info);
	return status;
}

static void rig_start(struct rig *rig)
{
	assert_ok(rig_open(rig), rig->error);
	assert_ok(dio_camera_start(rig->camera, &rig->error), rig->error);
}

static enum dio_status rig_acquire(struct rig *rig, int64_t timeout_ns)
{
	enum dio_status status =
		dio_camera_acquire(rig->camera, &rig->frame, timeout_ns, &rig->error);

	dio_camera_get_counters(rig->camera, &rig->counters);
	return status;
}

/* Everything that was opened and mapped is given back. */
static void rig_close(struct rig *rig)
{
	dio_camera_close(rig->camera);
	rig->camera = NULL;
	assert_false(rig->fake.is_open);
	assert_false(rig->fake.is_streaming);
	assert_int_equal(rig->fake.mapped_count, 0);
}

static void open_tells_absent_busy_and_forbidden_apart(void **state)
{
	static const struct {
		int cause;
		enum dio_status status;
		const char *word;
	} cases[] = {
		{ENOENT, DIO_NOT_FOUND, "plugged in"}, {ENODEV, DIO_NOT_FOUND, "plugged in"},
		{ENXIO, DIO_NOT_FOUND, "plugged in"},  {EBUSY, DIO_BUSY, "another process"},
		{EACCES, DIO_IO, "group `video`"},     {EMFILE, DIO_IO, "open failed"},
	};
	struct rig rig;

	(void)state;
	for (size_t i = 0; i < sizeof(cases) / sizeof(cases[0]); i++) {
		rig_init(&rig);
		rig.fake.open_errno = cases[i].cause;
		assert_fails(rig_open(&rig), cases[i].status, rig.error, cases[i].word);
		assert_non_null(strstr(rig.error.text, "/dev/video9"));
		rig_close(&rig);
	}
}

static void open_says_busy_when_another_process_streams(void **state)
{
	const unsigned requests[] = {VIDIOC_S_FMT, VIDIOC_REQBUFS};
	struct rig rig;

	(void)state;
	for (int i = 0; i < 2; i++) {
		rig_init(&rig);
		rig.fake.fail_ioctl = requests[i];
		rig.fake.fail_errno = EBUSY;
		assert_fails(rig_open(&rig), DIO_BUSY, rig.error, "another process");
		rig_close(&rig);
	}
}

static void open_refuses_nodes_that_capture_nothing(void **state)
{
	struct rig rig;

	(void)state;
	rig_init(&rig);
	rig.fake.caps = V4L2_CAP_META_CAPTURE | V4L2_CAP_STREAMING;
	assert_fails(rig_open(&rig), DIO_UNSUPPORTED, rig.error, "captures no video");
	rig_close(&rig);
	rig_init(&rig);
	rig.fake.caps = V4L2_CAP_VIDEO_CAPTURE | V4L2_CAP_READWRITE;
	assert_fails(rig_open(&rig), DIO_UNSUPPORTED, rig.error, "stream");
	rig_close(&rig);
	rig_init(&rig);
	rig.fake.fail_ioctl = VIDIOC_QUERYCAP;
	rig.fake.fail_errno = ENOTTY;
	assert_fails(rig_open(&rig), DIO_UNSUPPORTED, rig.error, "not a V4L2 device");
	rig_close(&rig);
}

static void a_failure_at_any_call_unwinds_what_was_opened(void **state)
{
	struct rig rig;
	unsigned total;

	(void)state;
	rig_init(&rig);
	rig_start(&rig);
	total = rig.fake.calls;
	rig_close(&rig);
	assert_true(total > 10);
	for (unsigned n = 1; n <= total; n++) {
		enum dio_status status;

		rig_init(&rig);
		rig.fake.fail_call = n;
		rig.fake.fail_errno = ENOMEM;
		status = rig_open(&rig);
		if (status == DIO_OK) {
			status = dio_camera_start(rig.camera, &rig.error);
			/* Where only a wish or an offer could not be read, all goes on. */
			if (status == DIO_OK)
				assert_int_equal(rig_acquire(&rig, SECOND_NS), DIO_OK);
		}
		if (status != DIO_OK)
			assert_non_null(strstr(rig.error.text, "/dev/video9"));
		rig_close(&rig);
	}
}

static void start_after_a_failed_start_works(void **state)
{
	struct rig rig;

	(void)state;
	rig_init(&rig);
	assert_ok(rig_open(&rig), rig.error);
	rig.fake.fail_ioctl = VIDIOC_STREAMON;
	rig.fake.fail_errno = ENOSPC;
	assert_fails(dio_camera_start(rig.camera, &rig.error), DIO_BUSY, rig.error, "bandwidth");
	assert_fails(rig_acquire(&rig, 0), DIO_BAD_ARG, rig.error, "not started");
	rig.fake.fail_ioctl = 0;
	assert_ok(dio_camera_start(rig.camera, &rig.error), rig.error);
	assert_ok(rig_acquire(&rig, SECOND_NS), rig.error);
	rig_close(&rig);
}

static void formats_that_cost_less_are_preferred_when_all_fit(void **state)
{
	struct rig rig;

	(void)state;
	rig_init(&rig);
	rig.fake.modes[0] = (struct fake_mode){V4L2_PIX_FMT_MJPEG, 640, 480, 30};
	rig.fake.modes[1] = (struct fake_mode){V4L2_PIX_FMT_RGB24, 640, 480, 30};
	rig.fake.modes[2] = (struct fake_mode){V4L2_PIX_FMT_NV12, 640, 480, 30};
	rig.options =
		(struct dio_camera_options){.width = 640, .height = 480, .frames_per_second = 30};
	assert_ok(rig_open(&rig), rig.error);
	assert_int_equal(rig.info.format, DIO_PIXEL_NV12);
	assert_string_equal(rig.info.name, "Scripted camera (/dev/video9)");
	rig_close(&rig);
}

static void mjpeg_is_taken_when_only_it_reaches_size_or_rate(void **state)
{
	struct rig rig;

	(void)state;
	rig_init(&rig);
	rig.fake.modes[0] = (struct fake_mode){V4L2_PIX_FMT_YUYV, 640, 480, 30};
	rig.fake.modes[1] = (struct fake_mode){V4L2_PIX_FMT_YUYV, 1280, 720, 10};
	rig.fake.modes[2] = (struct fake_mode){V4L2_PIX_FMT_MJPEG, 640, 480, 30};
	rig.fake.modes[3] = (struct fake_mode){V4L2_PIX_FMT_MJPEG, 1280, 720, 30};
	rig.fake.modes[4] = (struct fake_mode){V4L2_PIX_FMT_MJPEG, 1920, 1080, 30};
	rig.options = (struct dio_camera_options){
		.width = 1280, .height = 720, .frames_per_second = 29.97};
	assert_ok(rig_open(&rig), rig.error);
	assert_int_equal(rig.info.format, DIO_PIXEL_MJPEG);
	assert_int_equal(rig.info.width, 1280);
	rig_close(&rig);

	rig.options.frames_per_second = 10;
	assert_ok(rig_open(&rig), rig.error);
	assert_int_equal(rig.info.format, DIO_PIXEL_YUYV);
	assert_true(rig.info.frames_per_second == 10);
	rig_close(&rig);

	rig.options = (struct dio_camera_options){.width = 2000, .height = 1000};
	assert_ok(rig_open(&rig), rig.error);
	assert_int_equal(rig.info.format, DIO_PIXEL_MJPEG);
	assert_int_equal(rig.info.width, 1920);
	rig_close(&rig);
}

static void sizes_offered_in_steps_are_met_to_a_step(void **state)
{
	struct rig rig;

	(void)state;
	rig_init(&rig);
	rig.fake.steps = true;
	rig.fake.modes[0] = (struct fake_mode){V4L2_PIX_FMT_YUYV, 32, 32, 30};
	rig.fake.modes[1] = (struct fake_mode){V4L2_PIX_FMT_YUYV, 1920, 1088, 30};
	rig.options = (struct dio_camera_options){.width = 801, .height = 4000};
	assert_ok(rig_open(&rig), rig.error);
	assert_int_equal(rig.info.width, 800);
	assert_int_equal(rig.info.height, 1088);
	rig_close(&rig);
}

static void wishes_left_open_keep_what_the_device_has(void **state)
{
	struct rig rig;

	(void)state;
	rig_init(&rig);
	assert_ok(rig_open(&rig), rig.error);
	assert_int_equal(rig.info.width, 640);
	assert_true(rig.info.frames_per_second == 30);
	assert_int_equal(rig.fake.set_rates, 0);
	rig_close(&rig);
}

static void foreign_formats_are_refused_by_name(void **state)
{
	struct rig rig;

	(void)state;
	rig_init(&rig);
	rig.fake.modes[0].fourcc = V4L2_PIX_FMT_H264;
	rig.fake.modes[1] = (struct fake_mode){V4L2_PIX_FMT_SRGGB8, 640, 480, 30};
	assert_fails(rig_open(&rig), DIO_UNSUPPORTED, rig.error, "H264, RGGB");
	rig_close(&rig);
	rig_init(&rig);
	rig.fake.force_fourcc = V4L2_PIX_FMT_H264;
	assert_fails(rig_open(&rig), DIO_UNSUPPORTED, rig.error, "unknown format");
	rig_close(&rig);
	rig_init(&rig);
	rig.fake.force_field = V4L2_FIELD_ALTERNATE;
	assert_fails(rig_open(&rig), DIO_UNSUPPORTED, rig.error, "fields");
	rig_close(&rig);
	rig_init(&rig);
	rig.fake.force_width = 100000;
	assert_fails(rig_open(&rig), DIO_UNSUPPORTED, rig.error, "100000x480");
	rig_close(&rig);
}

static void the_driver_has_the_last_word_on_size_and_pitch(void **state)
{
	struct rig rig;

	(void)state;
	rig_init(&rig);
	rig.options = (struct dio_camera_options){.width = 640, .height = 480};
	rig.fake.force_width = 632;
	rig.fake.force_height = 472;
	rig.fake.pad_bytes = 64;
	rig_start(&rig);
	assert_ok(rig_acquire(&rig, SECOND_NS), rig.error);
	assert_int_equal(rig.info.width, 632);
	assert_int_equal(rig.frame.width, 632);
	assert_int_equal(rig.frame.height, 472);
	assert_int_equal(rig.frame.pitch_bytes, 2 * 632 + 64);
	assert_int_equal(rig.frame.size_bytes, (2 * 632 + 64) * 472);
	rig_close(&rig);
}

static void too_few_buffers_are_refused(void **state)
{
	struct rig rig;

	(void)state;
	rig_init(&rig);
	rig.fake.buffers_given = 1;
	assert_fails(rig_open(&rig), DIO_NO_MEM, rig.error, "1 buffers");
	rig_close(&rig);
}

static void acquire_waits_for_the_next_frame(void **state)
{
	struct rig rig;

	(void)state;
	rig_init(&rig);
	rig.fake.interruptions = 3;
	rig_start(&rig);
	for (uint32_t i = 0; i < 20; i++) {
		assert_ok(rig_acquire(&rig, SECOND_NS), rig.error);
		assert_int_equal(rig.frame.sequence, i);
		assert_int_equal(rig.frame.timestamp_ns, (1033 + 33 * i) * 1000000ull);
		assert_int_equal(rig.frame.data[0], i);
	}
	assert_int_equal(rig.counters.delivered, 20);
	assert_int_equal(rig.counters.drained + rig.counters.lost + rig.counters.broken, 0);
	rig_close(&rig);
}

static void acquire_drains_to_the_newest_frame(void **state)
{
	struct rig rig;

	(void)state;
	rig_init(&rig);
	rig_start(&rig);
	fake_v4l2_advance(&rig.fake, 1033 + 2 * 33);
	assert_ok(rig_acquire(&rig, 0), rig.error);
	assert_int_equal(rig.frame.sequence, 2);
	assert_int_equal(rig.frame.data[0], 2);
	assert_int_equal(rig.counters.drained, 2);
	assert_int_equal(rig.counters.lost, 0);
	rig_close(&rig);
}

static void every_frame_comes_in_order_when_wished(void **state)
{
	struct rig rig;

	(void)state;
	rig_init(&rig);
	rig.options.every_frame = true;
	rig_start(&rig);
	fake_v4l2_advance(&rig.fake, 1033 + 2 * 33);
	for (uint32_t i = 0; i < 10; i++) {
		assert_ok(rig_acquire(&rig, SECOND_NS), rig.error);
		assert_int_equal(rig.frame.sequence, i);
	}
	assert_int_equal(rig.counters.drained, 0);
	rig_close(&rig);
}

static void the_lent_frame_stays_while_newer_ones_arrive(void **state)
{
	struct rig rig;

	(void)state;
	rig_init(&rig);
	rig_start(&rig);
	assert_ok(rig_acquire(&rig, SECOND_NS), rig.error);
	fake_v4l2_advance(&rig.fake, 1033 + 30 * 33);
	assert_int_equal(rig.frame.data[0], 0);
	rig_close(&rig);
}

static void frames_that_grew_old_in_a_starved_queue_are_passed_over(void **state)
{
	struct rig rig;

	(void)state;
	rig_init(&rig);
	rig_start(&rig);
	assert_ok(rig_acquire(&rig, SECOND_NS), rig.error);
	/* Half a second passes; frames 1 to 3 fill what is free, the others are dropped. */
	fake_v4l2_advance(&rig.fake, 1033 + 15 * 33 + 1);
	assert_ok(rig_acquire(&rig, SECOND_NS), rig.error);
	assert_true(rig.frame.sequence >= 15);
	assert_int_equal(rig.counters.delivered, 2);
	assert_int_equal(rig.counters.delivered + rig.counters.drained + rig.counters.lost,
			 rig.frame.sequence + 1);
	rig_close(&rig);
}

static void gaps_in_the_sequence_are_counted_as_lost(void **state)
{
	struct rig rig;

	(void)state;
	rig_init(&rig);
	rig.fake.frames[3].sequence = 5; /* 3 and 4 are missing */
	rig.fake.frames[4].sequence = 6;
	rig.fake.frames[5].sequence = 0; /* the driver began anew: no gap */
	rig.fake.frames[6].sequence = 1;
	rig.fake.frames[7].sequence = UINT32_MAX - 1;
	rig.fake.frames[8].sequence = 1; /* past the wrap: MAX and 0 are missing */
	rig_start(&rig);
	for (uint32_t i = 0; i < 7; i++)
		assert_ok(rig_acquire(&rig, SECOND_NS), rig.error);
	assert_int_equal(rig.counters.lost, 2);
	assert_ok(rig_acquire(&rig, SECOND_NS), rig.error);
	assert_ok(rig_acquire(&rig, SECOND_NS), rig.error);
	assert_int_equal(rig.counters.lost, 4);
	rig_close(&rig);
}

static void flagged_and_short_frames_are_counted_as_broken(void **state)
{
	struct rig rig;

	(void)state;
	rig_init(&rig);
	rig.fake.frames[0].flags = V4L2_BUF_FLAG_ERROR;
	rig.fake.frames[1].bytes_less = 1;
	rig.fake.frames[3].bytes_less = 640 * 480 * 2;
	rig_start(&rig);
	assert_ok(rig_acquire(&rig, SECOND_NS), rig.error);
	assert_int_equal(rig.frame.sequence, 2);
	assert_int_equal(rig.counters.broken, 2);
	assert_ok(rig_acquire(&rig, SECOND_NS), rig.error);
	assert_int_equal(rig.frame.sequence, 4);
	assert_int_equal(rig.counters.broken, 3);
	assert_int_equal(rig.counters.delivered, 2);
	assert_int_equal(rig.counters.lost, 0);
	rig_close(&rig);
}

static void a_stalled_camera_times_out_and_goes_on_later(void **state)
{
	struct rig rig;

	(void)state;
	rig_init(&rig);
	for (uint32_t i = 5; i < FAKE_FRAMES_MAX; i++)
		rig.fake.frames[i].at_ms += 10000;
	rig_start(&rig);
	for (uint32_t i = 0; i < 5; i++)
		assert_ok(rig_acquire(&rig, SECOND_NS), rig.error);
	assert_fails(rig_acquire(&rig, 2 * SECOND_NS), DIO_AGAIN, rig.error,
		     "no frame for 2000 ms (YUYV 640x480, 5 frames before");
	assert_fails(rig_acquire(&rig, 0), DIO_AGAIN, rig.error, "no frame for 0 ms");
	assert_ok(rig_acquire(&rig, 20 * SECOND_NS), rig.error);
	assert_int_equal(rig.frame.sequence, 5);
	rig_close(&rig);
}

static void an_unplugged_camera_is_gone_until_it_is_closed(void **state)
{
	struct rig rig;

	(void)state;
	rig_init(&rig);
	rig.fake.unplug_at_ms = 1200;
	rig_start(&rig);
	for (uint32_t i = 0; i < 5; i++)
		assert_ok(rig_acquire(&rig, SECOND_NS), rig.error);
	/* Unplugged while waiting, then asked again, stopped and started. */
	rig.fake.unplug_at_ms = 1190;
	assert_fails(rig_acquire(&rig, SECOND_NS), DIO_GONE, rig.error,
		     "/dev/video9: unplugged after 5 frames");
	assert_fails(rig_acquire(&rig, SECOND_NS), DIO_GONE, rig.error, "unplugged");
	assert_ok(dio_camera_stop(rig.camera, &rig.error), rig.error);
	assert_fails(dio_camera_start(rig.camera, &rig.error), DIO_GONE, rig.error, "unplugged");
	rig_close(&rig);
}

static void a_camera_unplugged_between_frames_is_gone(void **state)
{
	struct rig rig;

	(void)state;
	rig_init(&rig);
	rig_start(&rig);
	assert_ok(rig_acquire(&rig, SECOND_NS), rig.error);
	rig.fake.unplug_at_ms = 1034;
	fake_v4l2_advance(&rig.fake, 1040);
	assert_fails(rig_acquire(&rig, 0), DIO_GONE, rig.error, "unplugged after 1 frames");
	rig_close(&rig);
}

static void a_driver_error_ends_the_wait(void **state)
{
	struct rig rig;

	(void)state;
	rig_init(&rig);
	rig_start(&rig);
	rig.fake.poll_error = true;
	assert_fails(rig_acquire(&rig, SECOND_NS), DIO_IO, rig.error, "stop and start");
	rig.fake.poll_error = false;
	rig.fake.fail_ioctl = VIDIOC_DQBUF;
	rig.fake.fail_errno = EIO;
	assert_fails(rig_acquire(&rig, SECOND_NS), DIO_IO, rig.error, "VIDIOC_DQBUF");
	rig_close(&rig);
}

static void timestamps_of_other_clocks_are_replaced_by_the_time_of_arrival(void **state)
{
	struct rig rig;

	(void)state;
	rig_init(&rig);
	rig.fake.clock_flag = V4L2_BUF_FLAG_TIMESTAMP_UNKNOWN;
	rig.fake.frames[0].at_ms = 1005;
	rig_start(&rig);
	fake_v4l2_advance(&rig.fake, 1007);
	assert_ok(rig_acquire(&rig, SECOND_NS), rig.error);
	assert_int_equal(rig.frame.timestamp_ns, 1007 * 1000000ull);
	rig_close(&rig);
}

static void a_multiplanar_device_delivers_the_same(void **state)
{
	struct rig rig;

	(void)state;
	rig_init(&rig);
	rig.fake.caps = V4L2_CAP_VIDEO_CAPTURE_MPLANE | V4L2_CAP_STREAMING;
	rig.fake.modes[0].fourcc = V4L2_PIX_FMT_NV12;
	rig.fake.pad_bytes = 32;
	rig_start(&rig);
	for (uint32_t i = 0; i < 8; i++) {
		assert_ok(rig_acquire(&rig, SECOND_NS), rig.error);
		assert_int_equal(rig.frame.sequence, i);
	}
	assert_int_equal(rig.frame.format, DIO_PIXEL_NV12);
	assert_int_equal(rig.frame.pitch_bytes, 672);
	assert_int_equal(rig.frame.size_bytes, 672 * 480 * 3 / 2);
	rig_close(&rig);
	rig_init(&rig);
	rig.fake.caps = V4L2_CAP_VIDEO_CAPTURE_MPLANE | V4L2_CAP_STREAMING;
	rig.fake.force_planes = 2;
	assert_fails(rig_open(&rig), DIO_UNSUPPORTED, rig.error, "2 planes");
	rig_close(&rig);
}

static void a_camera_starts_again_after_a_stop(void **state)
{
	struct rig rig;

	(void)state;
	rig_init(&rig);
	rig_start(&rig);
	assert_ok(rig_acquire(&rig, SECOND_NS), rig.error);
	assert_ok(dio_camera_stop(rig.camera, &rig.error), rig.error);
	fake_v4l2_advance(&rig.fake, 1033 + 20 * 33);
	assert_ok(dio_camera_start(rig.camera, &rig.error), rig.error);
	assert_ok(rig_acquire(&rig, SECOND_NS), rig.error);
	assert_int_equal(rig.frame.sequence, 21);
	assert_int_equal(rig.counters.lost, 0);
	rig_close(&rig);
}

static void frames_convert_to_pictures(void **state)
{
	struct dio_picture picture = {0};
	struct rig rig;

	(void)state;
	rig_init(&rig);
	rig_start(&rig);
	/* Frame 128: all bytes 128, the grey of that luma. */
	rig.fake.frames[0].sequence = 128;
	assert_ok(rig_acquire(&rig, SECOND_NS), rig.error);
	assert_ok(dio_frame_to_rgb(&rig.frame, &picture, &rig.error), rig.error);
	assert_int_equal(picture.rgb[0], 130);
	assert_int_equal(picture.rgb[3 * 640 * 480 - 1], 130);
	dio_picture_deinit(&picture);
	rig_close(&rig);
}

static void specifications_name_a_device(void **state)
{
	const struct dio_camera_options options = {0};
	struct dio_camera *camera;
	struct dio_error error;

	(void)state;
	assert_fails(dio_camera_open("v4l2:/dev/no-such-video", &options, &camera, &error),
		     DIO_NOT_FOUND, error, "/dev/no-such-video");
	assert_fails(dio_camera_open("/dev/no-such-video", NULL, &camera, &error), DIO_NOT_FOUND,
		     error, "plugged in");
	assert_fails(dio_camera_open("/dev/null", NULL, &camera, &error), DIO_UNSUPPORTED, error,
		     "not a V4L2 device");
	assert_fails(dio_camera_open("v4l2:", NULL, &camera, &error), DIO_BAD_ARG, error,
		     "/dev/video0");
	dio_camera_close(NULL);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(open_tells_absent_busy_and_forbidden_apart),
		cmocka_unit_test(open_says_busy_when_another_process_streams),
		cmocka_unit_test(open_refuses_nodes_that_capture_nothing),
		cmocka_unit_test(a_failure_at_any_call_unwinds_what_was_opened),
		cmocka_unit_test(start_after_a_failed_start_works),
		cmocka_unit_test(formats_that_cost_less_are_preferred_when_all_fit),
		cmocka_unit_test(mjpeg_is_taken_when_only_it_reaches_size_or_rate),
		cmocka_unit_test(sizes_offered_in_steps_are_met_to_a_step),
		cmocka_unit_test(wishes_left_open_keep_what_the_device_has),
		cmocka_unit_test(foreign_formats_are_refused_by_name),
		cmocka_unit_test(the_driver_has_the_last_word_on_size_and_pitch),
		cmocka_unit_test(too_few_buffers_are_refused),
		cmocka_unit_test(acquire_waits_for_the_next_frame),
		cmocka_unit_test(acquire_drains_to_the_newest_frame),
		cmocka_unit_test(every_frame_comes_in_order_when_wished),
		cmocka_unit_test(the_lent_frame_stays_while_newer_ones_arrive),
		cmocka_unit_test(frames_that_grew_old_in_a_starved_queue_are_passed_over),
		cmocka_unit_test(gaps_in_the_sequence_are_counted_as_lost),
		cmocka_unit_test(flagged_and_short_frames_are_counted_as_broken),
		cmocka_unit_test(a_stalled_camera_times_out_and_goes_on_later),
		cmocka_unit_test(an_unplugged_camera_is_gone_until_it_is_closed),
		cmocka_unit_test(a_camera_unplugged_between_frames_is_gone),
		cmocka_unit_test(a_driver_error_ends_the_wait),
		cmocka_unit_test(timestamps_of_other_clocks_are_replaced_by_the_time_of_arrival),
		cmocka_unit_test(a_multiplanar_device_delivers_the_same),
		cmocka_unit_test(a_camera_starts_again_after_a_stop),
		cmocka_unit_test(frames_convert_to_pictures),
		cmocka_unit_test(specifications_name_a_device),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
