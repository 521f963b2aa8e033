/* Frames of a V4L2 device that streams: which one is lent, what is counted, how it ends. */
#include "check.h"

#include <errno.h>
#include <string.h>

#include "v4l2_rig.h"

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

int main(void)
{
	const struct CMUnitTest tests[] = {
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
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
