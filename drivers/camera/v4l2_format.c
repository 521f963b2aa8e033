#include "v4l2_format.h"

#include <errno.h>
#include <linux/videodev2.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* Drivers number their offers; a broken one must not keep us counting for ever. */
#define OFFERS_MAX 256

/* In the order of preference when size and rate are equal. */
static const struct {
	uint32_t fourcc;
	enum dio_pixel_format format;
} known[] = {
	{V4L2_PIX_FMT_YUYV, DIO_PIXEL_YUYV},   {V4L2_PIX_FMT_NV12, DIO_PIXEL_NV12},
	{V4L2_PIX_FMT_RGB24, DIO_PIXEL_RGB24}, {V4L2_PIX_FMT_GREY, DIO_PIXEL_GRAY8},
	{V4L2_PIX_FMT_MJPEG, DIO_PIXEL_MJPEG}, {V4L2_PIX_FMT_JPEG, DIO_PIXEL_MJPEG},
};
#define KNOWN_COUNT (sizeof(known) / sizeof(known[0]))

/* One of the known formats as this device offers it, and how far it is from the wish. */
struct candidate {
	size_t known;
	uint32_t width, height;
	uint32_t size_error;
	double rate_missing;
};

int dio_v4l2_ioctl(const struct dio_v4l2_device *device, unsigned long request, void *argument)
{
	return device->system->ioctl(device->system->context, device->fd, request, argument);
}

enum dio_status dio_v4l2_fail_call(const struct dio_v4l2_device *device, const char *what,
				   struct dio_error *error)
{
	int cause = errno;

	if (cause == EBUSY)
		return dio_fail(error, DIO_BUSY,
				"camera %s: in use by another process; close that one first",
				device->path);
	return dio_fail(error, dio_status_from_errno(cause), "camera %s: %s failed: %s",
			device->path, what, strerror(cause));
}

static bool is_multiplanar(const struct dio_v4l2_device *device)
{
	return device->buffer_type == V4L2_BUF_TYPE_VIDEO_CAPTURE_MPLANE;
}

static uint32_t distance(uint32_t wished, uint32_t offered)
{
	if (wished == 0)
		return 0;
	return wished > offered ? wished - offered : offered - wished;
}

/* The value of a stepwise range that is nearest to the wish. */
static uint32_t nearest_step(uint32_t wished, uint32_t min, uint32_t max, uint32_t step)
{
	if (wished <= min)
		return min;
	if (wished >= max)
		return max;
	return step > 1 ? min + (wished - min + step / 2) / step * step : wished;
}

/* The offered size nearest to the wish, from ENUM_FRAMESIZES; false when the driver lists none. */
static bool find_size(const struct dio_v4l2_device *device, uint32_t fourcc, uint32_t width,
		      uint32_t height, struct candidate *candidate)
{
	struct v4l2_frmsizeenum offer = {.pixel_format = fourcc};
	bool found = false;

	for (; offer.index < OFFERS_MAX; offer.index++) {
		uint32_t w, h, error;

		if (dio_v4l2_ioctl(device, VIDIOC_ENUM_FRAMESIZES, &offer) != 0)
			break;
		if (offer.type == V4L2_FRMSIZE_TYPE_DISCRETE) {
			w = offer.discrete.width;
			h = offer.discrete.height;
		} else {
			w = nearest_step(width, offer.stepwise.min_width, offer.stepwise.max_width,
					 offer.stepwise.step_width);
			h = nearest_step(height, offer.stepwise.min_height,
					 offer.stepwise.max_height, offer.stepwise.step_height);
		}
		error = distance(width, w) + distance(height, h);
		if (!found || error < candidate->size_error) {
			candidate->width = w;
			candidate->height = h;
			candidate->size_error = error;
		}
		found = true;
		if (offer.type != V4L2_FRMSIZE_TYPE_DISCRETE)
			break;
	}
	return found;
}

static double per_second(struct v4l2_fract interval)
{
	return interval.numerator ? (double)interval.denominator / interval.numerator : 0;
}

/* How much the fastest offered rate falls short of the wish; 0 when the driver does not say. */
static double find_rate_missing(const struct dio_v4l2_device *device, uint32_t fourcc,
				uint32_t width, uint32_t height, double wished)
{
	struct v4l2_frmivalenum offer = {.pixel_format = fourcc, .width = width, .height = height};
	double fastest = 0;

	for (; offer.index < OFFERS_MAX; offer.index++) {
		bool discrete;

		if (dio_v4l2_ioctl(device, VIDIOC_ENUM_FRAMEINTERVALS, &offer) != 0)
			break;
		discrete = offer.type == V4L2_FRMIVAL_TYPE_DISCRETE;
		fastest = fmax(fastest, per_second(discrete ? offer.discrete : offer.stepwise.min));
		if (!discrete)
			break;
	}
	/* 29.97 is what one means by 30. */
	return fastest > 0 && fastest < 0.99 * wished ? wished - fastest : 0;
}

static bool is_better(const struct candidate *a, const struct candidate *b)
{
	if (a->size_error != b->size_error)
		return a->size_error < b->size_error;
	if (a->rate_missing != b->rate_missing)
		return a->rate_missing < b->rate_missing;
	return a->known < b->known;
}

static void append_fourcc(char *list, size_t size, uint32_t fourcc)
{
	size_t n = strlen(list);

	snprintf(list + n, size - n, "%s%c%c%c%c", n ? ", " : "", fourcc & 0x7f, fourcc >> 8 & 0x7f,
		 fourcc >> 16 & 0x7f, fourcc >> 24 & 0x7f);
}

static size_t find_known(uint32_t fourcc)
{
	size_t k = 0;

	while (k < KNOWN_COUNT && known[k].fourcc != fourcc)
		k++;
	return k;
}

static enum dio_status choose(const struct dio_v4l2_device *device,
			      const struct dio_camera_options *wish, uint32_t width,
			      uint32_t height, struct candidate *best, struct dio_error *error)
{
	struct v4l2_fmtdesc offer = {.type = device->buffer_type};
	char offered[128] = "";
	bool found = false;

	for (; offer.index < OFFERS_MAX; offer.index++) {
		struct candidate candidate = {.width = width, .height = height};

		if (dio_v4l2_ioctl(device, VIDIOC_ENUM_FMT, &offer) != 0)
			break;
		append_fourcc(offered, sizeof(offered), offer.pixelformat);
		candidate.known = find_known(offer.pixelformat);
		if (candidate.known == KNOWN_COUNT)
			continue;
		find_size(device, offer.pixelformat, width, height, &candidate);
		candidate.rate_missing =
			find_rate_missing(device, offer.pixelformat, candidate.width,
					  candidate.height, wish->frames_per_second);
		if (!found || is_better(&candidate, best))
			*best = candidate;
		found = true;
	}
	if (!found)
		return dio_fail(error, DIO_UNSUPPORTED,
				"camera %s: offers %s; YUYV, NV12, RGB3, GREY or MJPG is needed",
				device->path, offered[0] ? offered : "no pixel format");
	return DIO_OK;
}

/* The driver's present format, single- and multi-planar alike, in single-planar words. */
static void to_single(const struct dio_v4l2_device *device, const struct v4l2_format *format,
		      struct v4l2_pix_format *pix)
{
	if (!is_multiplanar(device)) {
		*pix = format->fmt.pix;
		return;
	}
	*pix = (struct v4l2_pix_format){
		.width = format->fmt.pix_mp.width,
		.height = format->fmt.pix_mp.height,
		.pixelformat = format->fmt.pix_mp.pixelformat,
		.field = format->fmt.pix_mp.field,
		.bytesperline = format->fmt.pix_mp.plane_fmt[0].bytesperline,
		.sizeimage = format->fmt.pix_mp.plane_fmt[0].sizeimage,
	};
}

static enum dio_status set_format(const struct dio_v4l2_device *device,
				  const struct candidate *chosen, struct v4l2_pix_format *pix,
				  struct dio_error *error)
{
	struct v4l2_format format = {.type = device->buffer_type};
	uint32_t planes = 1;

	if (is_multiplanar(device)) {
		format.fmt.pix_mp.width = chosen->width;
		format.fmt.pix_mp.height = chosen->height;
		format.fmt.pix_mp.pixelformat = known[chosen->known].fourcc;
		format.fmt.pix_mp.field = V4L2_FIELD_NONE;
		format.fmt.pix_mp.num_planes = 1;
	} else {
		format.fmt.pix.width = chosen->width;
		format.fmt.pix.height = chosen->height;
		format.fmt.pix.pixelformat = known[chosen->known].fourcc;
		format.fmt.pix.field = V4L2_FIELD_NONE;
	}
	if (dio_v4l2_ioctl(device, VIDIOC_S_FMT, &format) != 0) {
		if (errno == EBUSY)
			return dio_v4l2_fail_call(device, "VIDIOC_S_FMT", error);
		return dio_fail(error, dio_status_from_errno(errno),
				"camera %s: cannot set %s %ux%u: %s", device->path,
				dio_pixel_format_name(known[chosen->known].format), chosen->width,
				chosen->height, strerror(errno));
	}
	if (is_multiplanar(device))
		planes = format.fmt.pix_mp.num_planes;
	if (planes != 1)
		return dio_fail(error, DIO_UNSUPPORTED,
				"camera %s: delivers a picture in %u planes; one is supported",
				device->path, planes);
	to_single(device, &format, pix);
	return DIO_OK;
}

static bool is_half_picture(uint32_t field)
{
	return field == V4L2_FIELD_TOP || field == V4L2_FIELD_BOTTOM ||
	       field == V4L2_FIELD_ALTERNATE || field == V4L2_FIELD_SEQ_TB ||
	       field == V4L2_FIELD_SEQ_BT;
}

/* Row and frame size from what the driver says; a pitch of 0 means rows without padding. */
static void measure(struct dio_v4l2_format *format, uint32_t bytesperline)
{
	size_t row = format->width, rows = format->height;

	format->frame_bytes_min = 1;
	format->pitch_bytes = 0;
	if (format->format == DIO_PIXEL_MJPEG)
		return;
	if (format->format == DIO_PIXEL_RGB24)
		row *= 3;
	if (format->format == DIO_PIXEL_YUYV)
		row *= 2;
	if (format->format == DIO_PIXEL_NV12)
		rows += rows / 2;
	format->pitch_bytes = bytesperline < row ? (uint32_t)row : bytesperline;
	format->frame_bytes_min = (size_t)format->pitch_bytes * (rows - 1) + row;
}

/* Ask for a rate when one is wished, and learn the one in force. */
static double set_rate(const struct dio_v4l2_device *device, double wished)
{
	struct v4l2_streamparm parm = {.type = device->buffer_type};

	if (dio_v4l2_ioctl(device, VIDIOC_G_PARM, &parm) != 0)
		return 0;
	if (wished > 0 && (parm.parm.capture.capability & V4L2_CAP_TIMEPERFRAME)) {
		struct v4l2_streamparm asked = {.type = device->buffer_type};

		asked.parm.capture.timeperframe.numerator = 1000;
		asked.parm.capture.timeperframe.denominator = (uint32_t)lround(wished * 1000);
		if (dio_v4l2_ioctl(device, VIDIOC_S_PARM, &asked) == 0)
			parm = asked;
	}
	return per_second(parm.parm.capture.timeperframe);
}

enum dio_status dio_v4l2_format_negotiate(const struct dio_v4l2_device *device,
					  const struct dio_camera_options *wish,
					  struct dio_v4l2_format *format, struct dio_error *error)
{
	struct v4l2_format present = {.type = device->buffer_type};
	struct v4l2_pix_format pix = {0};
	struct candidate chosen = {0};
	enum dio_status status;
	size_t k;

	/* What is left to the device starts from its present format. */
	if (dio_v4l2_ioctl(device, VIDIOC_G_FMT, &present) == 0)
		to_single(device, &present, &pix);
	status = choose(device, wish, wish->width ? wish->width : pix.width,
			wish->height ? wish->height : pix.height, &chosen, error);
	if (status != DIO_OK)
		return status;
	status = set_format(device, &chosen, &pix, error);
	if (status != DIO_OK)
		return status;
	k = find_known(pix.pixelformat);
	if (k == KNOWN_COUNT || is_half_picture(pix.field))
		return dio_fail(error, DIO_UNSUPPORTED, "camera %s: asked for %s it set %s instead",
				device->path, dio_pixel_format_name(known[chosen.known].format),
				k == KNOWN_COUNT ? "an unknown format" : "half pictures (fields)");
	if (pix.width == 0 || pix.height == 0 || pix.width > 16384 || pix.height > 16384)
		return dio_fail(error, DIO_UNSUPPORTED, "camera %s: set a size of %ux%u",
				device->path, pix.width, pix.height);
	format->format = known[k].format;
	format->width = pix.width;
	format->height = pix.height;
	measure(format, pix.bytesperline);
	format->frames_per_second = set_rate(device, wish->frames_per_second);
	return DIO_OK;
}
