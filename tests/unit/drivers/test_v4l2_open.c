/* Opening a V4L2 device: what is refused and why, and the format that is agreed on. */
#include "check.h"

#include <errno.h>
#include <string.h>

#include "v4l2_rig.h"

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
		cmocka_unit_test(specifications_name_a_device),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
