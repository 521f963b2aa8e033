/* What a libcamera camera is told of exposure, gain, colours and flicker, and what it confirms. */
#include "libcamera_session.h"

#include <libcamera/version.h>

#include "libcamera_values.h"

namespace c = libcamera::controls;

/* Flicker controls came with 0.1. */
#define HAS_FLICKER (LIBCAMERA_VERSION_MAJOR > 0 || LIBCAMERA_VERSION_MINOR >= 1)

namespace dio_libcamera
{

/* Frames that a wish may take until it shows in their metadata, and the longest wait for one. */
constexpr int CONFIRM_FRAMES = 15;
constexpr int64_t CONFIRM_WAIT_NS = 500000000;
constexpr uint32_t ALL_3A = DIO_LOCK_EXPOSURE | DIO_LOCK_GAIN | DIO_LOCK_WHITE_BALANCE;

static uint32_t list_offered(const session &own)
{
	uint32_t offered = 0;

	if (offers(own, c::AeEnable) && offers(own, c::ExposureTime))
		offered |= DIO_LOCK_EXPOSURE;
	if (offers(own, c::AeEnable) && offers(own, c::AnalogueGain))
		offered |= DIO_LOCK_GAIN;
	if (offers(own, c::AwbEnable))
		offered |= DIO_LOCK_WHITE_BALANCE;
	return offered;
}

/* Exposure and gain have one automatic: a wish about either makes both manual. */
static void wish_exposure(session &own, const dio_camera_wish &wish, uint32_t offered,
			  dio_frame_metadata *target)
{
	const bool manual = wish.hold || wish.exposure_us > 0 || wish.gain > 0;

	if (!offers(own, c::AeEnable))
		return;
	own.pending.set(c::AeEnable, !manual);
	if (!manual)
		return;
	target->exposure_us = wish.exposure_us > 0 ? wish.exposure_us : own.metadata.exposure_us;
	target->gain = wish.gain > 0 ? static_cast<float>(wish.gain) : own.metadata.gain;
	if ((offered & DIO_LOCK_EXPOSURE) && target->exposure_us > 0 &&
	    target->exposure_us <= INT32_MAX)
		own.pending.set(c::ExposureTime, static_cast<int32_t>(target->exposure_us));
	if ((offered & DIO_LOCK_GAIN) && target->gain > 0)
		own.pending.set(c::AnalogueGain, target->gain);
}

static void wish_colours(session &own, const dio_camera_wish &wish, dio_frame_metadata *target)
{

	if (!offers(own, c::AwbEnable))
		return;
	own.pending.set(c::AwbEnable, !wish.hold);
	target->red_gain = own.metadata.red_gain;
	target->blue_gain = own.metadata.blue_gain;
	if (wish.hold && offers(own, c::ColourGains) && target->red_gain > 0 &&
	    target->blue_gain > 0)
		own.pending.set(c::ColourGains, {target->red_gain, target->blue_gain});
}

static dio_camera_flicker wish_flicker(session &own, dio_camera_flicker flicker)
{
#if HAS_FLICKER
	const int32_t period_us = dio_libcamera_flicker_period_us(flicker);

	if (flicker == DIO_CAMERA_FLICKER_KEEP || !offers(own, c::AeFlickerMode))
		return DIO_CAMERA_FLICKER_KEEP;
	if (period_us > 0 && offers(own, c::AeFlickerPeriod)) {
		own.pending.set(c::AeFlickerMode, static_cast<int32_t>(c::FlickerManual));
		own.pending.set(c::AeFlickerPeriod, period_us);
		return flicker;
	}
	own.pending.set(c::AeFlickerMode,
			static_cast<int32_t>(flicker == DIO_CAMERA_FLICKER_AUTO ? c::FlickerAuto
										: c::FlickerOff));
	return flicker == DIO_CAMERA_FLICKER_AUTO ? flicker : DIO_CAMERA_FLICKER_OFF;
#else
	(void)own;
	(void)flicker;
	return DIO_CAMERA_FLICKER_KEEP;
#endif
}

/* What the last frame's metadata confirms of the target. */
static uint32_t confirmed(const session &own, const dio_frame_metadata &target, uint32_t offered)
{
	uint32_t held = 0;

	if (own.said_exposure && target.exposure_us > 0 &&
	    dio_libcamera_is_near(target.exposure_us, own.metadata.exposure_us))
		held |= DIO_LOCK_EXPOSURE;
	if (own.said_gain && target.gain > 0 &&
	    dio_libcamera_is_near(target.gain, own.metadata.gain))
		held |= DIO_LOCK_GAIN;
	if (own.said_colours && target.red_gain > 0 &&
	    dio_libcamera_is_near(target.red_gain, own.metadata.red_gain) &&
	    dio_libcamera_is_near(target.blue_gain, own.metadata.blue_gain))
		held |= DIO_LOCK_WHITE_BALANCE;
	return held & offered;
}

/* Controls take effect some frames later: go on until the metadata show it. */
static dio_status confirm(libcamera_camera *camera, const dio_frame_metadata &target,
			  uint32_t wanted, dio_error *error)
{
	session &own = *camera->own;
	dio_status status = give_back(camera, error);

	for (int i = 0; i < CONFIRM_FRAMES && status == DIO_OK; i++) {
		lc::Request *request;

		status = take(camera, CONFIRM_WAIT_NS, &request, error);
		if (status != DIO_OK)
			break;
		camera->base.counters.drained++;
		own.metadata.locked = confirmed(own, target, wanted);
		status = queue(camera, request, error);
		/* Two frames at least: the first may have been exposed before. */
		if (own.metadata.locked == wanted && i >= 1)
			break;
	}
	return status == DIO_AGAIN ? DIO_OK : status;
}

dio_status control(libcamera_camera *camera, const dio_camera_wish *wish,
		   dio_camera_controls *controls, dio_error *error)
{
	session &own = *camera->own;
	const uint32_t offered = list_offered(own) & ALL_3A;
	dio_frame_metadata target = {};
	dio_status status = DIO_OK;

	controls->offered = offered;
	if (wish) {
		controls->flicker = wish_flicker(own, wish->flicker);
		wish_exposure(own, *wish, offered, &target);
		wish_colours(own, *wish, &target);
		own.holding = wish->hold;
		own.metadata.locked = 0;
		if (camera->base.started && wish->hold && offered)
			status = confirm(camera, target, offered, error);
	}
	controls->metadata = own.metadata;
	return status;
}

} /* namespace dio_libcamera */
