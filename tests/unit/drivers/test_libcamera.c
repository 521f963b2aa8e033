/* What libcamera's numbers mean; the driver itself needs a camera. */
#include "check.h"

#include <string.h>

#include "dio/camera.h"
#include "libcamera_values.h"

#define S 1000000000ull

static uint32_t fourcc(const char *code)
{
	return (uint32_t)code[0] | (uint32_t)code[1] << 8 | (uint32_t)code[2] << 16 |
	       (uint32_t)code[3] << 24;
}

static void formats_are_ours_by_their_bytes_in_memory(void **state)
{
	static const struct {
		const char *code;
		enum dio_pixel_format format;
	} known[] = {
		/* BG24 is DRM's BGR888: R first in memory. */
		{"YUYV", DIO_PIXEL_YUYV},  {"NV12", DIO_PIXEL_NV12},  {"BG24", DIO_PIXEL_RGB24},
		{"R8  ", DIO_PIXEL_GRAY8}, {"MJPG", DIO_PIXEL_MJPEG},
	};
	static const char *const unknown[] = {"RG24", "XR24", "NV21", "RGGB", "YU12"};
	enum dio_pixel_format format;
	uint32_t rank, last = 0;

	(void)state;
	for (size_t i = 0; i < sizeof(known) / sizeof(known[0]); i++) {
		assert_true(dio_libcamera_format(fourcc(known[i].code), &format, &rank));
		assert_int_equal(format, known[i].format);
		assert_true(i == 0 || rank > last);
		last = rank;
	}
	for (size_t i = 0; i < sizeof(unknown) / sizeof(unknown[0]); i++)
		assert_false(dio_libcamera_format(fourcc(unknown[i]), &format, &rank));
}

static void frame_sizes_agree_with_rows_and_refuse_nonsense(void **state)
{
	(void)state;
	assert_int_equal(dio_libcamera_frame_bytes(DIO_PIXEL_RGB24, 30, 10, 4), 120);
	assert_int_equal(dio_libcamera_frame_bytes(DIO_PIXEL_RGB24, 32, 10, 4), 3 * 32 + 30);
	assert_int_equal(dio_libcamera_frame_bytes(DIO_PIXEL_YUYV, 20, 10, 4), 80);
	assert_int_equal(dio_libcamera_frame_bytes(DIO_PIXEL_NV12, 10, 10, 4), 60);
	assert_int_equal(dio_libcamera_frame_bytes(DIO_PIXEL_NV12, 10, 10, 5), 80);
	assert_int_equal(dio_libcamera_frame_bytes(DIO_PIXEL_GRAY8, 16, 10, 1), 10);
	assert_int_equal(dio_libcamera_frame_bytes(DIO_PIXEL_MJPEG, 0, 0, 0), 1);
	assert_int_equal(dio_libcamera_frame_bytes(DIO_PIXEL_RGB24, 29, 10, 4), 0);
	assert_int_equal(dio_libcamera_frame_bytes(DIO_PIXEL_YUYV, 20, 10, 0), 0);
	assert_int_equal(dio_libcamera_frame_bytes(DIO_PIXEL_GRAY8, 16385, 16385, 4), 0);
	assert_int_equal(dio_libcamera_frame_bytes(DIO_PIXEL_GRAY8, 0xffffffffu, 10, 16384), 0);
	assert_int_equal(dio_libcamera_frame_bytes(DIO_PIXEL_RGB24, 1u << 20, 16384, 16384),
			 ((size_t)1 << 20) * 16383 + 16384 * 3);
}

static void times_are_taken_from_whoever_speaks_of_this_clock(void **state)
{
	const uint64_t now = 1000 * S, slept = 500 * S;

	(void)state;
	/* The sensor's, whether it is monotonic already or counts the sleep too. */
	assert_int_equal(dio_libcamera_time(now - S, now - 1, now, slept), now - S);
	assert_int_equal(dio_libcamera_time(now - S + slept, now - 1, now, slept), now - S);
	assert_int_equal(dio_libcamera_time(now - S, now - 1, now, 0), now - S);
	/* Else the buffer's, else now. */
	assert_int_equal(dio_libcamera_time(0, now - 5, now, slept), now - 5);
	assert_int_equal(dio_libcamera_time(3 * S, now - 5, now, slept), now - 5);
	assert_int_equal(dio_libcamera_time(now + 9 * S, now + 1, now, 0), now);
	assert_int_equal(dio_libcamera_time(0, 0, now, slept), now);
	assert_int_equal(dio_libcamera_time(0, now - 11 * S, now, slept), now);
}

static void what_sensors_round_counts_as_set(void **state)
{
	(void)state;
	assert_true(dio_libcamera_is_near(10000, 9990));
	assert_true(dio_libcamera_is_near(10000, 10400));
	assert_false(dio_libcamera_is_near(10000, 11000));
	assert_false(dio_libcamera_is_near(1, 2));
	assert_true(dio_libcamera_is_near(2, 2));
}

static void flicker_has_the_period_of_the_light(void **state)
{
	(void)state;
	assert_int_equal(dio_libcamera_flicker_period_us(DIO_CAMERA_FLICKER_50HZ), 10000);
	assert_int_equal(dio_libcamera_flicker_period_us(DIO_CAMERA_FLICKER_60HZ), 8333);
	assert_int_equal(dio_libcamera_flicker_period_us(DIO_CAMERA_FLICKER_AUTO), 0);
	assert_int_equal(dio_libcamera_flicker_period_us(DIO_CAMERA_FLICKER_OFF), 0);
	assert_int_equal(dio_libcamera_flicker_period_us(DIO_CAMERA_FLICKER_KEEP), 0);
}

static void a_camera_that_is_not_there_is_named(void **state)
{
	struct dio_camera *camera = NULL;
	struct dio_error error;
	enum dio_status status;

	(void)state;
	/* Twice: the second manager must start as the first did. */
	for (int i = 0; i < 2; i++) {
		status = dio_camera_open("libcamera:no such camera", NULL, &camera, &error);
		assert_true(status == DIO_NOT_FOUND || status == DIO_UNSUPPORTED);
		assert_non_null(strstr(error.text, "no such camera"));
		assert_null(camera);
	}
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(formats_are_ours_by_their_bytes_in_memory),
		cmocka_unit_test(frame_sizes_agree_with_rows_and_refuse_nonsense),
		cmocka_unit_test(times_are_taken_from_whoever_speaks_of_this_clock),
		cmocka_unit_test(what_sensors_round_counts_as_set),
		cmocka_unit_test(flicker_has_the_period_of_the_light),
		cmocka_unit_test(a_camera_that_is_not_there_is_named),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
