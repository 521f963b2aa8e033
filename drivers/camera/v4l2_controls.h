/* Exposure, gain, white balance, focus and mains flicker of a V4L2 device. */
#ifndef DIO_CAMERA_V4L2_CONTROLS_H
#define DIO_CAMERA_V4L2_CONTROLS_H

#include "v4l2_format.h"

/**
 * Tell the device the wish (NULL: only read), then read everything back.
 *
 * A value is held by reading what the automatic has found, switching that off, and writing the
 * value again, since many devices fall back to the last manual one. Held counts what reads as
 * manual afterwards, whatever the calls said; a device without an automatic holds by nature.
 * Readings: EXPOSURE_ABSOLUTE in units of 100 us, WHITE_BALANCE_TEMPERATURE in kelvin (Linux Media
 * userspace API, "Camera Control Reference", "User Controls").
 *
 * holding  what the last wish said: of a device without an automatic nothing else tells
 *
 * DIO_GONE  unplugged
 */
enum dio_status dio_v4l2_control(const struct dio_v4l2_device *device,
				 const struct dio_camera_wish *wish, bool holding,
				 struct dio_camera_controls *controls, struct dio_error *error);

#endif
