/* What a V4L2 device is told of exposure, and what it made of it; its signal; its DMABUFs. */
#include "check.h"

#include <errno.h>
#include <string.h>

#include "v4l2_rig.h"

#define ALL_LOCKS (DIO_LOCK_EXPOSURE | DIO_LOCK_GAIN | DIO_LOCK_WHITE_BALANCE | DIO_LOCK_FOCUS)

/* A webcam whose automatics have found 12 ms, gain 40, 4600 K and a focus of 30, and which falls
 * back to its least values when an automatic is switched. */
static const struct fake_control WEBCAM[] = {
	{.id = V4L2_CID_EXPOSURE_AUTO,
	 .max = 3,
	 .value = 3,
	 .menu = 1 << 1 | 1 << 3,
	 .forgets = true},
	{.id = V4L2_CID_EXPOSURE_AUTO_PRIORITY, .max = 1, .value = 1},
	{.id = V4L2_CID_EXPOSURE_ABSOLUTE, .min = 3, .max = 2047, .value = 120},
	{.id = V4L2_CID_GAIN, .max = 255, .value = 40},
	{.id = V4L2_CID_AUTO_WHITE_BALANCE, .max = 1, .value = 1},
	{.id = V4L2_CID_WHITE_BALANCE_TEMPERATURE, .min = 2000, .max = 7500, .value = 4600},
	{.id = V4L2_CID_FOCUS_AUTO, .max = 1, .value = 1},
	{.id = V4L2_CID_FOCUS_ABSOLUTE, .max = 250, .value = 30},
	{.id = V4L2_CID_POWER_LINE_FREQUENCY, .max = 2, .value = 2},
};

static void rig_start_webcam(struct rig *rig)
{
	rig_init(rig);
	memcpy(rig->fake.controls, WEBCAM, sizeof(WEBCAM));
	rig_start(rig);
}

static int32_t value_of(const struct rig *rig, uint32_t id)
{
	for (size_t i = 0; i < FAKE_CONTROLS_MAX; i++)
		if (rig->fake.controls[i].id == id)
			return rig->fake.controls[i].value;
	fail_msg("no control %x", id);
	return 0;
}

static void tell(struct rig *rig, struct dio_camera_wish wish)
{
	assert_ok(dio_camera_set_controls(rig->camera, &wish, &rig->controls, &rig->error),
		  rig->error);
}

static void holding_keeps_what_the_automatic_has_found(void **state)
{
	struct rig rig;

	(void)state;
	rig_start_webcam(&rig);
	tell(&rig, (struct dio_camera_wish){.hold = true});
	assert_int_equal(rig.controls.offered, ALL_LOCKS);
	assert_int_equal(rig.controls.metadata.locked, ALL_LOCKS);
	assert_int_equal(value_of(&rig, V4L2_CID_EXPOSURE_AUTO), V4L2_EXPOSURE_MANUAL);
	assert_int_equal(value_of(&rig, V4L2_CID_EXPOSURE_AUTO_PRIORITY), 0);
	assert_int_equal(value_of(&rig, V4L2_CID_EXPOSURE_ABSOLUTE), 120);
	assert_int_equal(value_of(&rig, V4L2_CID_AUTO_WHITE_BALANCE), 0);
	assert_int_equal(value_of(&rig, V4L2_CID_FOCUS_AUTO), 0);
	assert_int_equal(rig.controls.metadata.exposure_us, 12000);
	rig_close(&rig);
}

static void frames_carry_what_was_read(void **state)
{
	struct rig rig;

	(void)state;
	rig_start_webcam(&rig);
	tell(&rig, (struct dio_camera_wish){.hold = true, .exposure_us = 5000, .gain = 7});
	assert_ok(dio_camera_acquire(rig.camera, &rig.frame, SECOND_NS, &rig.error), rig.error);
	assert_int_equal(rig.frame.metadata.exposure_us, 5000);
	assert_true(rig.frame.metadata.gain == 7);
	assert_int_equal(rig.frame.metadata.locked, ALL_LOCKS);
	assert_ok(dio_camera_get_controls(rig.camera, &rig.controls, &rig.error), rig.error);
	assert_int_equal(rig.controls.metadata.locked, ALL_LOCKS);
	rig_close(&rig);
}

static void letting_go_switches_the_automatics_on_again(void **state)
{
	struct rig rig;

	(void)state;
	rig_start_webcam(&rig);
	tell(&rig, (struct dio_camera_wish){.hold = true});
	tell(&rig, (struct dio_camera_wish){0});
	/* Its menu has aperture priority for automatic. */
	assert_int_equal(value_of(&rig, V4L2_CID_EXPOSURE_AUTO), V4L2_EXPOSURE_APERTURE_PRIORITY);
	assert_int_equal(value_of(&rig, V4L2_CID_AUTO_WHITE_BALANCE), 1);
	assert_int_equal(value_of(&rig, V4L2_CID_FOCUS_AUTO), 1);
	assert_int_equal(rig.controls.metadata.locked, 0);
	assert_int_equal(rig.controls.offered, ALL_LOCKS);
	rig_close(&rig);
}

static void a_value_that_is_wished_is_manual_while_the_rest_stays_automatic(void **state)
{
	struct rig rig;

	(void)state;
	rig_start_webcam(&rig);
	tell(&rig, (struct dio_camera_wish){.exposure_us = 900000000});
	assert_int_equal(value_of(&rig, V4L2_CID_EXPOSURE_ABSOLUTE), 2047);
	assert_int_equal(rig.controls.metadata.exposure_us, 204700);
	assert_int_equal(rig.controls.metadata.locked, DIO_LOCK_EXPOSURE);
	assert_int_equal(value_of(&rig, V4L2_CID_AUTO_WHITE_BALANCE), 1);
	rig_close(&rig);
}

static void a_driver_that_does_not_obey_is_found_out(void **state)
{
	struct rig rig;

	(void)state;
	rig_init(&rig);
	memcpy(rig.fake.controls, WEBCAM, sizeof(WEBCAM));
	rig.fake.controls[4].deaf = true; /* automatic white balance */
	rig_start(&rig);
	tell(&rig, (struct dio_camera_wish){.hold = true});
	assert_int_equal(rig.controls.offered, ALL_LOCKS);
	assert_int_equal(rig.controls.metadata.locked, ALL_LOCKS & ~DIO_LOCK_WHITE_BALANCE);
	rig_close(&rig);
}

static void a_camera_without_controls_offers_nothing(void **state)
{
	struct rig rig;

	(void)state;
	rig_init(&rig);
	rig_start(&rig);
	tell(&rig, (struct dio_camera_wish){.hold = true, .flicker = DIO_CAMERA_FLICKER_50HZ});
	assert_int_equal(rig.controls.offered, 0);
	assert_int_equal(rig.controls.metadata.locked, 0);
	assert_int_equal(rig.controls.flicker, DIO_CAMERA_FLICKER_KEEP);
	rig_close(&rig);
}

static void a_device_that_locks_all_at_once_is_asked_that_way(void **state)
{
	struct rig rig;

	(void)state;
	rig_init(&rig);
	rig.fake.controls[0] = (struct fake_control){
		.id = V4L2_CID_3A_LOCK, .max = V4L2_LOCK_EXPOSURE | V4L2_LOCK_WHITE_BALANCE};
	rig_start(&rig);
	tell(&rig, (struct dio_camera_wish){.hold = true});
	assert_int_equal(rig.controls.offered, DIO_LOCK_EXPOSURE | DIO_LOCK_WHITE_BALANCE);
	assert_int_equal(rig.controls.metadata.locked, rig.controls.offered);
	tell(&rig, (struct dio_camera_wish){0});
	assert_int_equal(value_of(&rig, V4L2_CID_3A_LOCK), 0);
	assert_int_equal(rig.controls.metadata.locked, 0);
	rig_close(&rig);
}

static void flicker_is_fitted_where_the_menu_has_it(void **state)
{
	struct rig rig;

	(void)state;
	rig_start_webcam(&rig);
	tell(&rig, (struct dio_camera_wish){.flicker = DIO_CAMERA_FLICKER_50HZ});
	assert_int_equal(rig.controls.flicker, DIO_CAMERA_FLICKER_50HZ);
	/* This device has no "auto": it stays at what it was. */
	tell(&rig, (struct dio_camera_wish){.flicker = DIO_CAMERA_FLICKER_AUTO});
	assert_int_equal(rig.controls.flicker, DIO_CAMERA_FLICKER_50HZ);
	tell(&rig, (struct dio_camera_wish){.flicker = DIO_CAMERA_FLICKER_OFF});
	assert_int_equal(rig.controls.flicker, DIO_CAMERA_FLICKER_OFF);
	tell(&rig, (struct dio_camera_wish){.flicker = DIO_CAMERA_FLICKER_KEEP});
	assert_int_equal(rig.controls.flicker, DIO_CAMERA_FLICKER_OFF);
	rig_close(&rig);
}

static void controls_of_an_unplugged_camera_say_that_it_is_gone(void **state)
{
	const struct dio_camera_wish wish = {.hold = true};
	struct rig rig;

	(void)state;
	rig_start_webcam(&rig);
	memset(rig.fake.controls, 0, sizeof(rig.fake.controls));
	rig.fake.unplug_at_ms = 1;
	assert_fails(dio_camera_set_controls(rig.camera, &wish, &rig.controls, &rig.error),
		     DIO_GONE, rig.error, "unplugged");
	assert_fails(dio_camera_acquire(rig.camera, &rig.frame, 0, &rig.error), DIO_GONE, rig.error,
		     "unplugged after 0 frames");
	rig_close(&rig);
}

static void an_input_without_signal_is_a_state_and_frames_come_after_it(void **state)
{
	struct rig rig;

	(void)state;
	rig_init(&rig);
	rig.fake.has_input = true;
	rig.fake.input_status = V4L2_IN_ST_NO_SIGNAL;
	rig_start(&rig);
	for (int i = 0; i < 3; i++)
		assert_fails(dio_camera_acquire(rig.camera, &rig.frame, SECOND_NS, &rig.error),
			     DIO_NO_SIGNAL, rig.error, "input HDMI 0");
	rig.fake.input_status = 0;
	assert_ok(dio_camera_acquire(rig.camera, &rig.frame, SECOND_NS, &rig.error), rig.error);
	/* Gone again while the driver goes on delivering blue pictures: noticed within a second. */
	rig.fake.input_status = V4L2_IN_ST_NO_SIGNAL;
	for (int i = 0; i < 30; i++)
		if (dio_camera_acquire(rig.camera, &rig.frame, SECOND_NS, &rig.error) ==
		    DIO_NO_SIGNAL)
			break;
	assert_int_equal(dio_camera_acquire(rig.camera, &rig.frame, SECOND_NS, &rig.error),
			 DIO_NO_SIGNAL);
	rig_close(&rig);
}

static void a_receiver_takes_over_the_size_of_the_signal_and_tells_when_it_changes(void **state)
{
	struct rig rig;

	(void)state;
	rig_init(&rig);
	rig.fake.has_input = rig.fake.has_timings = true;
	rig.fake.signal_width = 1280;
	rig.fake.signal_height = 720;
	rig_start(&rig);
	assert_ok(dio_camera_acquire(rig.camera, &rig.frame, SECOND_NS, &rig.error), rig.error);
	assert_int_equal(rig.frame.width, 1280);
	assert_int_equal(rig.frame.height, 720);
	/* An event without a change is nothing. */
	rig.fake.change_waits = true;
	assert_ok(dio_camera_acquire(rig.camera, &rig.frame, SECOND_NS, &rig.error), rig.error);
	rig.fake.change_waits = true;
	rig.fake.signal_width = 1920;
	assert_fails(dio_camera_acquire(rig.camera, &rig.frame, SECOND_NS, &rig.error), DIO_REFUSED,
		     rig.error, "changed its size");
	rig_close(&rig);
}

static void buffers_are_exported_where_the_driver_offers_it(void **state)
{
	struct rig rig;
	int first;

	(void)state;
	rig_init(&rig);
	rig_start(&rig);
	assert_int_equal(dio_camera_get_dmabuf(rig.camera), -1);
	assert_ok(dio_camera_acquire(rig.camera, &rig.frame, SECOND_NS, &rig.error), rig.error);
	assert_int_equal(dio_camera_get_dmabuf(rig.camera), -1);
	rig.fake.exports = true;
	first = dio_camera_get_dmabuf(rig.camera);
	assert_true(first >= FAKE_DMABUF_FD);
	assert_int_equal(dio_camera_get_dmabuf(rig.camera), first);
	assert_ok(dio_camera_acquire(rig.camera, &rig.frame, SECOND_NS, &rig.error), rig.error);
	assert_int_not_equal(dio_camera_get_dmabuf(rig.camera), first);
	assert_int_equal(rig.fake.exported_count, 2);
	rig_close(&rig);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(holding_keeps_what_the_automatic_has_found),
		cmocka_unit_test(frames_carry_what_was_read),
		cmocka_unit_test(letting_go_switches_the_automatics_on_again),
		cmocka_unit_test(a_value_that_is_wished_is_manual_while_the_rest_stays_automatic),
		cmocka_unit_test(a_driver_that_does_not_obey_is_found_out),
		cmocka_unit_test(a_camera_without_controls_offers_nothing),
		cmocka_unit_test(a_device_that_locks_all_at_once_is_asked_that_way),
		cmocka_unit_test(flicker_is_fitted_where_the_menu_has_it),
		cmocka_unit_test(controls_of_an_unplugged_camera_say_that_it_is_gone),
		cmocka_unit_test(an_input_without_signal_is_a_state_and_frames_come_after_it),
		cmocka_unit_test(
			a_receiver_takes_over_the_size_of_the_signal_and_tells_when_it_changes),
		cmocka_unit_test(buffers_are_exported_where_the_driver_offers_it),
	};

	return cmocka_run_group_tests(tests, NULL, NULL);
}
