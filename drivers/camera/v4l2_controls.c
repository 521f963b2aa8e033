#include "v4l2_controls.h"

#include <errno.h>
#include <linux/videodev2.h>
#include <math.h>

#define US_PER_UNIT 100 /* of V4L2_CID_EXPOSURE_ABSOLUTE */
#define NONE        0u  /* no such control */

/* One thing that can be held: its automatic, how that is switched, and its value. */
struct trio {
	uint32_t lock;
	uint32_t automatic;
	int32_t automatic_on[2], automatic_off[2]; /* in the order tried */
	uint32_t value;
	uint32_t value_else; /* used where there is no `value` */
	uint32_t bit_3a;     /* of V4L2_CID_3A_LOCK */
};

static const struct trio TRIOS[] = {
	{.lock = DIO_LOCK_EXPOSURE,
	 .automatic = V4L2_CID_EXPOSURE_AUTO,
	 .automatic_on = {V4L2_EXPOSURE_AUTO, V4L2_EXPOSURE_APERTURE_PRIORITY},
	 .automatic_off = {V4L2_EXPOSURE_MANUAL, V4L2_EXPOSURE_SHUTTER_PRIORITY},
	 .value = V4L2_CID_EXPOSURE_ABSOLUTE,
	 .value_else = V4L2_CID_EXPOSURE,
	 .bit_3a = V4L2_LOCK_EXPOSURE},
	{.lock = DIO_LOCK_GAIN,
	 .automatic = V4L2_CID_AUTOGAIN,
	 .automatic_on = {1, 1},
	 .value = V4L2_CID_GAIN,
	 .value_else = V4L2_CID_ANALOGUE_GAIN},
	{.lock = DIO_LOCK_WHITE_BALANCE,
	 .automatic = V4L2_CID_AUTO_WHITE_BALANCE,
	 .automatic_on = {1, 1},
	 .value = V4L2_CID_WHITE_BALANCE_TEMPERATURE,
	 .value_else = V4L2_CID_RED_BALANCE,
	 .bit_3a = V4L2_LOCK_WHITE_BALANCE},
	{.lock = DIO_LOCK_FOCUS,
	 .automatic = V4L2_CID_FOCUS_AUTO,
	 .automatic_on = {1, 1},
	 .value = V4L2_CID_FOCUS_ABSOLUTE,
	 .value_else = V4L2_CID_FOCUS_ABSOLUTE,
	 .bit_3a = V4L2_LOCK_FOCUS},
};
#define TRIO_COUNT (sizeof(TRIOS) / sizeof(TRIOS[0]))

static bool query(const struct dio_v4l2_device *device, uint32_t id, struct v4l2_queryctrl *about)
{
	*about = (struct v4l2_queryctrl){.id = id};
	return id != NONE && dio_v4l2_ioctl(device, VIDIOC_QUERYCTRL, about) == 0 &&
	       !(about->flags & V4L2_CTRL_FLAG_DISABLED);
}

static bool has(const struct dio_v4l2_device *device, uint32_t id)
{
	struct v4l2_queryctrl about;

	return query(device, id, &about);
}

static bool get(const struct dio_v4l2_device *device, uint32_t id, int32_t *value)
{
	struct v4l2_control control = {.id = id};

	if (id == NONE || dio_v4l2_ioctl(device, VIDIOC_G_CTRL, &control) != 0)
		return false;
	*value = control.value;
	return true;
}

/* The nearest value the device can take; what became of it is read back later. */
static bool set(const struct dio_v4l2_device *device, uint32_t id, double wished)
{
	struct v4l2_control control = {.id = id};
	struct v4l2_queryctrl about;

	if (!query(device, id, &about) || (about.flags & V4L2_CTRL_FLAG_READ_ONLY))
		return false;
	control.value = (int32_t)fmin(fmax(round(wished), about.minimum), about.maximum);
	return dio_v4l2_ioctl(device, VIDIOC_S_CTRL, &control) == 0;
}

static bool set_either(const struct dio_v4l2_device *device, uint32_t id, const int32_t values[2])
{
	struct v4l2_control control = {.id = id, .value = values[0]};

	if (dio_v4l2_ioctl(device, VIDIOC_S_CTRL, &control) == 0)
		return true;
	control.value = values[1];
	return values[1] != values[0] && dio_v4l2_ioctl(device, VIDIOC_S_CTRL, &control) == 0;
}

static uint32_t value_of(const struct dio_v4l2_device *device, const struct trio *trio)
{
	if (has(device, trio->value))
		return trio->value;
	return has(device, trio->value_else) ? trio->value_else : NONE;
}

/* The wish in the device's unit; below 0: none. */
static double wished_value(const struct trio *trio, uint32_t value,
			   const struct dio_camera_wish *wish)
{
	if (value == V4L2_CID_EXPOSURE_ABSOLUTE && wish->exposure_us > 0)
		return (double)wish->exposure_us / US_PER_UNIT;
	if (trio->lock == DIO_LOCK_GAIN && value != NONE && wish->gain > 0)
		return wish->gain;
	return -1;
}

static void steer(const struct dio_v4l2_device *device, const struct trio *trio,
		  const struct dio_camera_wish *wish)
{
	const uint32_t value = value_of(device, trio);
	const double wished = wished_value(trio, value, wish);
	const bool automatic = has(device, trio->automatic);
	int32_t found;

	if (!wish->hold && wished < 0) {
		if (automatic)
			set_either(device, trio->automatic, trio->automatic_on);
		return;
	}
	/* Read before the automatic goes off, and with it what it has found. */
	if (wished >= 0)
		found = (int32_t)fmin(round(wished), INT32_MAX);
	else if (!get(device, value, &found))
		found = -1;
	if (automatic)
		set_either(device, trio->automatic, trio->automatic_off);
	if (found >= 0 && (automatic || wished >= 0))
		set(device, value, found);
}

/* A device that locks all at once keeps its automatic's values exactly, where those cannot even be
 * read; what is wished by value still goes the other way. */
static void lock_3a(const struct dio_v4l2_device *device, const struct dio_camera_wish *wish)
{
	struct v4l2_queryctrl about;
	uint32_t bits = 0;

	if (!query(device, V4L2_CID_3A_LOCK, &about))
		return;
	for (size_t i = 0; i < TRIO_COUNT && wish->hold; i++)
		if (wished_value(&TRIOS[i], value_of(device, &TRIOS[i]), wish) < 0)
			bits |= TRIOS[i].bit_3a & (uint32_t)about.maximum;
	set(device, V4L2_CID_3A_LOCK, bits);
}

static int32_t power_line_of(enum dio_camera_flicker flicker)
{
	switch (flicker) {
	case DIO_CAMERA_FLICKER_OFF:
		return V4L2_CID_POWER_LINE_FREQUENCY_DISABLED;
	case DIO_CAMERA_FLICKER_50HZ:
		return V4L2_CID_POWER_LINE_FREQUENCY_50HZ;
	case DIO_CAMERA_FLICKER_60HZ:
		return V4L2_CID_POWER_LINE_FREQUENCY_60HZ;
	case DIO_CAMERA_FLICKER_AUTO:
	case DIO_CAMERA_FLICKER_KEEP:
		break;
	}
	return V4L2_CID_POWER_LINE_FREQUENCY_AUTO;
}

static void steer_flicker(const struct dio_v4l2_device *device, enum dio_camera_flicker flicker)
{
	struct v4l2_control control = {.id = V4L2_CID_POWER_LINE_FREQUENCY,
				       .value = power_line_of(flicker)};

	/* Not clamped: what a device without "auto" has last in its menu is something else. */
	if (flicker != DIO_CAMERA_FLICKER_KEEP)
		dio_v4l2_ioctl(device, VIDIOC_S_CTRL, &control);
}

static enum dio_camera_flicker read_flicker(const struct dio_v4l2_device *device)
{
	int32_t value;

	if (!get(device, V4L2_CID_POWER_LINE_FREQUENCY, &value))
		return DIO_CAMERA_FLICKER_KEEP;
	for (int f = DIO_CAMERA_FLICKER_AUTO; f <= DIO_CAMERA_FLICKER_60HZ; f++)
		if (power_line_of((enum dio_camera_flicker)f) == value)
			return (enum dio_camera_flicker)f;
	return DIO_CAMERA_FLICKER_KEEP;
}

static bool is_off(const struct dio_v4l2_device *device, const struct trio *trio)
{
	int32_t now;

	return get(device, trio->automatic, &now) &&
	       (now == trio->automatic_off[0] || now == trio->automatic_off[1]);
}

/* What can be held and what is; `holding` tells a device without an automatic, which always is. */
static void read_trio(const struct dio_v4l2_device *device, const struct trio *trio, bool holding,
		      struct dio_camera_controls *controls)
{
	struct v4l2_queryctrl about;
	int32_t bits = 0;
	bool by_3a = trio->bit_3a && query(device, V4L2_CID_3A_LOCK, &about) &&
		     ((uint32_t)about.maximum & trio->bit_3a);
	bool automatic = has(device, trio->automatic), held;

	if (!by_3a && !automatic && value_of(device, trio) == NONE)
		return;
	controls->offered |= trio->lock;
	held = by_3a && get(device, V4L2_CID_3A_LOCK, &bits) && ((uint32_t)bits & trio->bit_3a);
	if (!held)
		held = automatic ? is_off(device, trio) : holding && !by_3a;
	if (held)
		controls->metadata.locked |= trio->lock;
}

static void read_values(const struct dio_v4l2_device *device, struct dio_frame_metadata *metadata)
{
	int32_t value;

	if (get(device, V4L2_CID_EXPOSURE_ABSOLUTE, &value) && value > 0 &&
	    value <= INT32_MAX / US_PER_UNIT)
		metadata->exposure_us = (uint32_t)value * US_PER_UNIT;
	if ((get(device, V4L2_CID_GAIN, &value) || get(device, V4L2_CID_ANALOGUE_GAIN, &value)) &&
	    value > 0)
		metadata->gain = (float)value;
	if (get(device, V4L2_CID_WHITE_BALANCE_TEMPERATURE, &value) && value > 0)
		metadata->white_balance_k = (uint32_t)value;
}

enum dio_status dio_v4l2_control(const struct dio_v4l2_device *device,
				 const struct dio_camera_wish *wish, bool holding,
				 struct dio_camera_controls *controls, struct dio_error *error)
{
	struct v4l2_queryctrl about = {.id = V4L2_CID_BASE};

	if (wish) {
		steer_flicker(device, wish->flicker);
		/* A rate that sinks in the dark is no steady exposure. */
		if (wish->hold)
			set(device, V4L2_CID_EXPOSURE_AUTO_PRIORITY, 0);
		lock_3a(device, wish);
		for (size_t i = 0; i < TRIO_COUNT; i++)
			steer(device, &TRIOS[i], wish);
	}
	*controls = (struct dio_camera_controls){.flicker = read_flicker(device)};
	for (size_t i = 0; i < TRIO_COUNT; i++)
		read_trio(device, &TRIOS[i], holding, controls);
	read_values(device, &controls->metadata);
	if (dio_v4l2_ioctl(device, VIDIOC_QUERYCTRL, &about) != 0 && errno == ENODEV)
		return dio_fail(error, DIO_GONE, "camera %s: unplugged; plug it in again",
				device->path);
	return DIO_OK;
}
