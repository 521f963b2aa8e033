#include "v4l2_signal.h"

#include <linux/videodev2.h>

/* A driver that never runs out of events must not keep us here. */
#define EVENTS_MAX 64

static bool find_input(const struct dio_v4l2_device *device, struct v4l2_input *input)
{
	int index;

	if (dio_v4l2_ioctl(device, VIDIOC_G_INPUT, &index) != 0 || index < 0)
		return false;
	*input = (struct v4l2_input){.index = (uint32_t)index};
	return dio_v4l2_ioctl(device, VIDIOC_ENUMINPUT, input) == 0;
}

/* The timings of the signal that is there, when they are not those in force. */
static bool query_other_timings(const struct dio_v4l2_device *device, struct v4l2_dv_timings *there)
{
	struct v4l2_dv_timings in_force = {0};

	*there = (struct v4l2_dv_timings){0};
	return dio_v4l2_ioctl(device, VIDIOC_QUERY_DV_TIMINGS, there) == 0 &&
	       (dio_v4l2_ioctl(device, VIDIOC_G_DV_TIMINGS, &in_force) != 0 ||
		there->bt.width != in_force.bt.width || there->bt.height != in_force.bt.height ||
		there->bt.pixelclock != in_force.bt.pixelclock);
}

void dio_v4l2_signal_adopt(const struct dio_v4l2_device *device, bool *events)
{
	struct v4l2_event_subscription wanted = {.type = V4L2_EVENT_SOURCE_CHANGE};
	struct v4l2_dv_timings there;
	struct v4l2_input input;

	*events = false;
	if (!find_input(device, &input))
		return;
	if ((input.capabilities & V4L2_IN_CAP_DV_TIMINGS) && query_other_timings(device, &there))
		dio_v4l2_ioctl(device, VIDIOC_S_DV_TIMINGS, &there);
	wanted.id = input.index;
	*events = dio_v4l2_ioctl(device, VIDIOC_SUBSCRIBE_EVENT, &wanted) == 0;
}

enum dio_status dio_v4l2_signal_check(const struct dio_v4l2_device *device, struct dio_error *error)
{
	struct v4l2_input input;

	if (!find_input(device, &input) ||
	    !(input.status & (V4L2_IN_ST_NO_POWER | V4L2_IN_ST_NO_SIGNAL | V4L2_IN_ST_NO_SYNC |
			      V4L2_IN_ST_NO_H_LOCK)))
		return DIO_OK;
	return dio_fail(error, DIO_NO_SIGNAL,
			"camera %s: no signal at input %.31s; is its source on?", device->path,
			(const char *)input.name);
}

bool dio_v4l2_signal_has_changed(const struct dio_v4l2_device *device)
{
	struct v4l2_dv_timings there;
	bool told = false;

	for (unsigned i = 0; i < EVENTS_MAX; i++) {
		struct v4l2_event event = {0};

		if (dio_v4l2_ioctl(device, VIDIOC_DQEVENT, &event) != 0)
			break;
		told = told || (event.type == V4L2_EVENT_SOURCE_CHANGE &&
				(event.u.src_change.changes & V4L2_EVENT_SRC_CH_RESOLUTION));
	}
	/* A signal that went away is no other signal: that is what the check is for. */
	return told && query_other_timings(device, &there);
}
