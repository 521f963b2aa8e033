#include "fake_v4l2.h"

#include <errno.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>

#define NS_PER_MS 1000000u
#define FAKE_FD   1234

void fake_v4l2_init(struct fake_v4l2 *fake)
{
	*fake = (struct fake_v4l2){
		.caps = V4L2_CAP_VIDEO_CAPTURE | V4L2_CAP_STREAMING,
		.modes = {{V4L2_PIX_FMT_YUYV, 640, 480, 30}},
		.clock_flag = V4L2_BUF_FLAG_TIMESTAMP_MONOTONIC,
		.interval = {1, 30},
		/* Not from zero: a driver's clock has run long before. */
		.now_ns = 1000ull * NS_PER_MS,
	};
	for (uint32_t i = 0; i < FAKE_FRAMES_MAX; i++)
		fake->frames[i] = (struct fake_frame){.at_ms = 1033 + 33 * i, .sequence = i};
}

static bool is_multiplanar(const struct fake_v4l2 *fake)
{
	return fake->caps & V4L2_CAP_VIDEO_CAPTURE_MPLANE;
}

static bool is_gone(const struct fake_v4l2 *fake)
{
	return fake->unplug_at_ms && fake->now_ns >= fake->unplug_at_ms * NS_PER_MS;
}

static int fail(int errno_value)
{
	errno = errno_value;
	return -1;
}

static bool must_fail(struct fake_v4l2 *fake)
{
	return ++fake->calls == fake->fail_call;
}

static void fill(struct fake_v4l2 *fake, const struct fake_frame *frame)
{
	struct v4l2_buffer *buffer = &fake->done[fake->done_count];
	uint32_t index = fake->queue[0];

	if (fake->queue_count == 0)
		return;
	memmove(fake->queue, fake->queue + 1, --fake->queue_count * sizeof(fake->queue[0]));
	memset(fake->memory[index], (int)(frame->sequence & 0xff), fake->pix.sizeimage);
	*buffer = (struct v4l2_buffer){
		.index = index,
		.flags = frame->flags | fake->clock_flag,
		.sequence = frame->sequence,
		.bytesused = fake->pix.sizeimage - frame->bytes_less,
		.timestamp = {.tv_sec = (time_t)(frame->at_ms / 1000),
			      .tv_usec = (suseconds_t)(frame->at_ms % 1000 * 1000)},
	};
	fake->done_count++;
}

void fake_v4l2_advance(struct fake_v4l2 *fake, uint64_t to_ms)
{
	fake->now_ns = to_ms * NS_PER_MS;
	while (fake->next_frame < FAKE_FRAMES_MAX && fake->frames[fake->next_frame].at_ms &&
	       fake->frames[fake->next_frame].at_ms <= to_ms) {
		const struct fake_frame *frame = &fake->frames[fake->next_frame++];

		if (fake->is_streaming &&
		    (!fake->unplug_at_ms || frame->at_ms < fake->unplug_at_ms))
			fill(fake, frame);
	}
}

static int fake_open(void *context, const char *path, int flags)
{
	struct fake_v4l2 *fake = context;

	(void)path;
	(void)flags;
	if (must_fail(fake))
		return fail(fake->fail_errno);
	if (fake->open_errno)
		return fail(fake->open_errno);
	fake->is_open = true;
	return FAKE_FD;
}

static int fake_close(void *context, int fd)
{
	struct fake_v4l2 *fake = context;

	if (fd >= FAKE_DMABUF_FD) {
		fake->exported_count--;
		return 0;
	}
	if (fd != FAKE_FD || !fake->is_open)
		abort();
	fake->is_open = fake->is_streaming = false;
	return 0;
}

static void *fake_map(void *context, size_t size, int fd, off_t offset)
{
	struct fake_v4l2 *fake = context;

	(void)fd;
	if (must_fail(fake)) {
		errno = fake->fail_errno;
		return MAP_FAILED;
	}
	fake->memory[offset] = malloc(size);
	fake->mapped_count++;
	return fake->memory[offset];
}

static int fake_unmap(void *context, void *memory, size_t size)
{
	struct fake_v4l2 *fake = context;

	(void)size;
	fake->mapped_count--;
	free(memory);
	return 0;
}

static int enum_format(const struct fake_v4l2 *fake, struct v4l2_fmtdesc *offer)
{
	uint32_t index = 0;

	for (size_t i = 0; i < FAKE_MODES_MAX && fake->modes[i].fourcc; i++) {
		if (i > 0 && fake->modes[i].fourcc == fake->modes[i - 1].fourcc)
			continue;
		if (index++ == offer->index) {
			offer->pixelformat = fake->modes[i].fourcc;
			return 0;
		}
	}
	return fail(EINVAL);
}

static int enum_size(const struct fake_v4l2 *fake, struct v4l2_frmsizeenum *offer)
{
	uint32_t index = 0;

	if (fake->steps && offer->index == 0) {
		offer->type = V4L2_FRMSIZE_TYPE_STEPWISE;
		offer->stepwise = (struct v4l2_frmsize_stepwise){
			fake->modes[0].width,  fake->modes[1].width,  16,
			fake->modes[0].height, fake->modes[1].height, 16};
		return 0;
	}
	for (size_t i = 0; i < FAKE_MODES_MAX && !fake->steps; i++) {
		if (fake->modes[i].fourcc != offer->pixel_format || index++ != offer->index)
			continue;
		offer->type = V4L2_FRMSIZE_TYPE_DISCRETE;
		offer->discrete.width = fake->modes[i].width;
		offer->discrete.height = fake->modes[i].height;
		return 0;
	}
	return fail(EINVAL);
}

static int enum_rate(const struct fake_v4l2 *fake, struct v4l2_frmivalenum *offer)
{
	uint32_t index = 0;

	for (size_t i = 0; i < FAKE_MODES_MAX; i++) {
		const struct fake_mode *mode = &fake->modes[i];

		if (mode->fourcc != offer->pixel_format || mode->width != offer->width ||
		    mode->height != offer->height || index++ != offer->index)
			continue;
		offer->type = V4L2_FRMIVAL_TYPE_DISCRETE;
		offer->discrete = (struct v4l2_fract){1, mode->fps};
		return 0;
	}
	return fail(EINVAL);
}

/* The driver has the last word on size, pitch and format. */
static void settle(struct fake_v4l2 *fake)
{
	struct v4l2_pix_format *pix = &fake->pix;
	uint32_t bytes = pix->pixelformat == V4L2_PIX_FMT_YUYV    ? 2
			 : pix->pixelformat == V4L2_PIX_FMT_RGB24 ? 3
								  : 1;

	if (fake->force_fourcc)
		pix->pixelformat = fake->force_fourcc;
	if (fake->force_width)
		pix->width = fake->force_width;
	if (fake->force_height)
		pix->height = fake->force_height;
	if (fake->force_field)
		pix->field = fake->force_field;
	pix->bytesperline = pix->width * bytes + fake->pad_bytes;
	pix->sizeimage = pix->bytesperline * pix->height;
	if (pix->pixelformat == V4L2_PIX_FMT_NV12)
		pix->sizeimage += pix->sizeimage / 2;
	if (pix->pixelformat == V4L2_PIX_FMT_MJPEG)
		pix->bytesperline = 0;
}

static int set_format(struct fake_v4l2 *fake, struct v4l2_format *format)
{
	if (is_multiplanar(fake)) {
		fake->pix = (struct v4l2_pix_format){.width = format->fmt.pix_mp.width,
						     .height = format->fmt.pix_mp.height,
						     .pixelformat = format->fmt.pix_mp.pixelformat};
		settle(fake);
		format->fmt.pix_mp.width = fake->pix.width;
		format->fmt.pix_mp.height = fake->pix.height;
		format->fmt.pix_mp.pixelformat = fake->pix.pixelformat;
		format->fmt.pix_mp.num_planes =
			(uint8_t)(fake->force_planes ? fake->force_planes : 1);
		format->fmt.pix_mp.plane_fmt[0].bytesperline = fake->pix.bytesperline;
		format->fmt.pix_mp.plane_fmt[0].sizeimage = fake->pix.sizeimage;
		return 0;
	}
	fake->pix = format->fmt.pix;
	settle(fake);
	format->fmt.pix = fake->pix;
	return 0;
}

static int set_rate(struct fake_v4l2 *fake, struct v4l2_streamparm *parm)
{
	uint32_t wished = parm->parm.capture.timeperframe.denominator /
			  parm->parm.capture.timeperframe.numerator;
	uint32_t best = 0;

	for (size_t i = 0; i < FAKE_MODES_MAX; i++) {
		const struct fake_mode *mode = &fake->modes[i];

		if (mode->fourcc == fake->pix.pixelformat && mode->width == fake->pix.width &&
		    mode->fps > best && mode->fps <= wished)
			best = mode->fps;
	}
	if (best)
		fake->interval = (struct v4l2_fract){1, best};
	parm->parm.capture.timeperframe = fake->interval;
	fake->set_rates++;
	return 0;
}

static int query_buffer(const struct fake_v4l2 *fake, struct v4l2_buffer *buffer)
{
	if (buffer->index >= fake->buffer_count)
		return fail(EINVAL);
	if (is_multiplanar(fake)) {
		buffer->m.planes[0].length = fake->pix.sizeimage;
		buffer->m.planes[0].m.mem_offset = buffer->index;
	} else {
		buffer->length = fake->pix.sizeimage;
		buffer->m.offset = buffer->index;
	}
	return 0;
}

static int queue_buffer(struct fake_v4l2 *fake, const struct v4l2_buffer *buffer)
{
	if (is_gone(fake))
		return fail(ENODEV);
	for (uint32_t i = 0; i < fake->queue_count; i++) {
		if (fake->queue[i] == buffer->index)
			return fail(EINVAL);
	}
	fake->queue[fake->queue_count++] = buffer->index;
	return 0;
}

static int dequeue_buffer(struct fake_v4l2 *fake, struct v4l2_buffer *buffer)
{
	struct v4l2_plane *planes = buffer->m.planes;
	struct v4l2_buffer done = fake->done[0];

	if (is_gone(fake))
		return fail(ENODEV);
	if (fake->done_count == 0)
		return fail(EAGAIN);
	memmove(fake->done, fake->done + 1, --fake->done_count * sizeof(done));
	done.type = buffer->type;
	if (is_multiplanar(fake)) {
		planes[0].bytesused = done.bytesused;
		done.m.planes = planes;
	}
	*buffer = done;
	return 0;
}

static int stream_on(struct fake_v4l2 *fake)
{
	if (is_gone(fake))
		return fail(ENODEV);
	fake->is_streaming = true;
	return 0;
}

static int stream_off(struct fake_v4l2 *fake)
{
	fake->is_streaming = false;
	fake->queue_count = fake->done_count = 0;
	return 0;
}

static int query_capabilities(const struct fake_v4l2 *fake, struct v4l2_capability *cap)
{
	memcpy(cap->card, "Scripted camera", 16);
	/* The device as a whole can more than this node. */
	cap->capabilities = V4L2_CAP_DEVICE_CAPS | V4L2_CAP_VIDEO_CAPTURE | V4L2_CAP_STREAMING;
	cap->device_caps = fake->caps;
	return 0;
}

static struct fake_control *find_control(struct fake_v4l2 *fake, uint32_t id)
{
	for (size_t i = 0; i < FAKE_CONTROLS_MAX; i++)
		if (id && fake->controls[i].id == id)
			return &fake->controls[i];
	errno = is_gone(fake) ? ENODEV : EINVAL;
	return NULL;
}

static int query_control(struct fake_v4l2 *fake, struct v4l2_queryctrl *about)
{
	const struct fake_control *control = find_control(fake, about->id);

	if (!control)
		return -1;
	about->minimum = control->min;
	about->maximum = control->max;
	return 0;
}

static int get_control(struct fake_v4l2 *fake, struct v4l2_control *answer)
{
	const struct fake_control *control = find_control(fake, answer->id);

	if (!control)
		return -1;
	answer->value = control->value;
	return 0;
}

static int set_control(struct fake_v4l2 *fake, const struct v4l2_control *wished)
{
	struct fake_control *control = find_control(fake, wished->id);

	if (!control)
		return -1;
	if (wished->value < control->min || wished->value > control->max)
		return fail(ERANGE);
	if (control->menu && !(control->menu & 1u << wished->value))
		return fail(EINVAL);
	if (control->deaf)
		return 0;
	control->value = wished->value;
	for (size_t i = 0; i < FAKE_CONTROLS_MAX && control->forgets; i++)
		if (fake->controls[i].max > 10)
			fake->controls[i].value = fake->controls[i].min;
	return 0;
}

static int about_signal(struct fake_v4l2 *fake, unsigned long request, void *argument)
{
	struct v4l2_dv_timings *timings = argument;
	struct v4l2_input *input = argument;
	struct v4l2_event *event = argument;

	if (!fake->has_input)
		return fail(ENOTTY);
	switch (request) {
	case VIDIOC_G_INPUT:
		*(int *)argument = 0;
		return 0;
	case VIDIOC_ENUMINPUT:
		memcpy(input->name, "HDMI 0", 7);
		input->status = fake->input_status;
		input->capabilities = fake->has_timings ? V4L2_IN_CAP_DV_TIMINGS : 0;
		return 0;
	}
	if (!fake->has_timings)
		return fail(ENOTTY);
	switch (request) {
	case VIDIOC_QUERY_DV_TIMINGS:
		if (fake->input_status)
			return fail(ENOLINK);
		timings->bt.width = fake->signal_width;
		timings->bt.height = fake->signal_height;
		return 0;
	case VIDIOC_G_DV_TIMINGS:
		timings->bt = fake->timings;
		return 0;
	case VIDIOC_S_DV_TIMINGS:
		fake->timings = timings->bt;
		fake->modes[0].width = timings->bt.width;
		fake->modes[0].height = timings->bt.height;
		return 0;
	case VIDIOC_SUBSCRIBE_EVENT:
		fake->is_subscribed = true;
		return 0;
	default:
		if (!fake->change_waits)
			return fail(ENOENT);
		fake->change_waits = false;
		event->type = V4L2_EVENT_SOURCE_CHANGE;
		event->u.src_change.changes = V4L2_EVENT_SRC_CH_RESOLUTION;
		return 0;
	}
}

static int export_buffer(struct fake_v4l2 *fake, struct v4l2_exportbuffer *wanted)
{
	if (!fake->exports)
		return fail(EINVAL);
	wanted->fd = FAKE_DMABUF_FD + (int)wanted->index;
	fake->exported_count++;
	return 0;
}

static int fake_ioctl(void *context, int fd, unsigned long request, void *argument)
{
	struct fake_v4l2 *fake = context;

	if (fd != FAKE_FD || !fake->is_open)
		abort();
	if (must_fail(fake) || (fake->fail_ioctl && request == fake->fail_ioctl))
		return fail(fake->fail_errno);
	switch (request) {
	case VIDIOC_QUERYCAP:
		return query_capabilities(fake, argument);
	case VIDIOC_ENUM_FMT:
		return enum_format(fake, argument);
	case VIDIOC_ENUM_FRAMESIZES:
		return enum_size(fake, argument);
	case VIDIOC_ENUM_FRAMEINTERVALS:
		return enum_rate(fake, argument);
	case VIDIOC_G_FMT:
		((struct v4l2_format *)argument)->fmt.pix.width = fake->modes[0].width;
		((struct v4l2_format *)argument)->fmt.pix.height = fake->modes[0].height;
		return 0;
	case VIDIOC_S_FMT:
		return set_format(fake, argument);
	case VIDIOC_G_PARM:
		((struct v4l2_streamparm *)argument)->parm.capture.capability =
			V4L2_CAP_TIMEPERFRAME;
		((struct v4l2_streamparm *)argument)->parm.capture.timeperframe = fake->interval;
		return 0;
	case VIDIOC_S_PARM:
		return set_rate(fake, argument);
	case VIDIOC_REQBUFS:
		fake->buffer_count = fake->buffers_given
					     ? fake->buffers_given
					     : ((struct v4l2_requestbuffers *)argument)->count;
		((struct v4l2_requestbuffers *)argument)->count = fake->buffer_count;
		return 0;
	case VIDIOC_QUERYBUF:
		return query_buffer(fake, argument);
	case VIDIOC_QBUF:
		return queue_buffer(fake, argument);
	case VIDIOC_DQBUF:
		return dequeue_buffer(fake, argument);
	case VIDIOC_STREAMON:
		return stream_on(fake);
	case VIDIOC_STREAMOFF:
		return stream_off(fake);
	case VIDIOC_QUERYCTRL:
		return query_control(fake, argument);
	case VIDIOC_G_CTRL:
		return get_control(fake, argument);
	case VIDIOC_S_CTRL:
		return set_control(fake, argument);
	case VIDIOC_EXPBUF:
		return export_buffer(fake, argument);
	case VIDIOC_G_INPUT:
	case VIDIOC_ENUMINPUT:
	case VIDIOC_QUERY_DV_TIMINGS:
	case VIDIOC_G_DV_TIMINGS:
	case VIDIOC_S_DV_TIMINGS:
	case VIDIOC_SUBSCRIBE_EVENT:
	case VIDIOC_DQEVENT:
		return about_signal(fake, request, argument);
	default:
		return fail(ENOTTY);
	}
}

/* Time passes in steps of a millisecond until something is to be told. */
static int fake_poll(void *context, struct pollfd *fd, int timeout_ms)
{
	struct fake_v4l2 *fake = context;
	uint64_t now = fake->now_ns / NS_PER_MS, until = now + (uint64_t)timeout_ms;

	if (must_fail(fake))
		return fail(fake->fail_errno);
	if (fake->interruptions > 0) {
		fake->interruptions--;
		return fail(EINTR);
	}
	for (;; now++) {
		fake_v4l2_advance(fake, now);
		fd->revents = 0;
		if (fake->done_count)
			fd->revents |= POLLIN;
		if (fake->is_subscribed && fake->change_waits)
			fd->revents |= POLLPRI;
		if (is_gone(fake))
			fd->revents = POLLERR | POLLHUP;
		if (fake->poll_error)
			fd->revents |= POLLERR;
		if (fd->revents)
			return 1;
		if (now >= until)
			return 0;
	}
}

static uint64_t fake_now_ns(void *context)
{
	return ((struct fake_v4l2 *)context)->now_ns;
}

struct dio_v4l2_system fake_v4l2_system(struct fake_v4l2 *fake)
{
	return (struct dio_v4l2_system){fake,     fake_open,  fake_close, fake_ioctl,
					fake_map, fake_unmap, fake_poll,  fake_now_ns};
}
