/* Displays without a screen: pictures become due one after another, into a video file or nowhere.
 */
#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/timerfd.h>
#include <unistd.h>

#include "backend.h"
#include "dio/clock.h"
#include "dio/fit.h"
#include "dio/video.h"

#define NS_PER_S 1000000000u

struct paced {
	struct dio_display base;
	uint64_t period_ns, begin_ns;
	bool pending; /* a picture waits for the next tick */
	uint64_t tag, due_ns;
	struct dio_video *video; /* NULL: shown nowhere */
	struct dio_fit fit;
	struct dio_picture frame; /* what is pending, as the file will have it */
};

static enum dio_status paced_close(struct dio_display *base, struct dio_error *error)
{
	struct paced *paced = (struct paced *)base;
	enum dio_status status = DIO_OK;

	/* A video without pictures is no file. */
	if (paced->video && base->counters.shown)
		status = dio_video_close(paced->video, error);
	else
		dio_video_discard(paced->video);
	dio_fit_deinit(&paced->fit);
	dio_picture_deinit(&paced->frame);
	if (base->fd >= 0)
		close(base->fd);
	free(paced);
	return status;
}

/* The first tick of the display's clock that is not past. */
static uint64_t next_tick_ns(const struct paced *paced)
{
	const uint64_t elapsed_ns = dio_clock_ns() - paced->begin_ns;

	return paced->begin_ns + (elapsed_ns / paced->period_ns + 1) * paced->period_ns;
}

static enum dio_status paced_show(struct dio_display *base, const struct dio_picture *picture,
				  uint64_t tag, struct dio_error *error)
{
	struct paced *paced = (struct paced *)base;
	struct itimerspec when = {0};

	if (paced->video)
		dio_fit_draw(&paced->fit, picture, paced->frame.rgb, (size_t)3 * base->info.width);
	paced->tag = tag;
	if (paced->pending) {
		base->counters.replaced++;
		return DIO_OK;
	}
	paced->due_ns = next_tick_ns(paced);
	when.it_value.tv_sec = (time_t)(paced->due_ns / NS_PER_S);
	when.it_value.tv_nsec = (long)(paced->due_ns % NS_PER_S);
	if (timerfd_settime(base->fd, TFD_TIMER_ABSTIME, &when, NULL) < 0)
		return dio_fail(error, DIO_IO, "display %s: no timer: %s", base->info.name,
				strerror(errno));
	paced->pending = true;
	return DIO_OK;
}

static enum dio_status paced_dispatch(struct dio_display *base, struct dio_error *error)
{
	struct paced *paced = (struct paced *)base;
	struct dio_display_event event = {.kind = DIO_DISPLAY_FLIPPED};
	enum dio_status status = DIO_OK;
	uint64_t ticks;

	if (read(base->fd, &ticks, sizeof(ticks)) != sizeof(ticks) || !paced->pending)
		return DIO_OK;
	paced->pending = false;
	if (paced->video)
		status = dio_video_append(paced->video, &paced->frame, error);
	if (status != DIO_OK)
		return status;
	base->counters.shown++;
	event.time_ns = paced->due_ns;
	event.tag = paced->tag;
	dio_display_push(base, &event);
	return DIO_OK;
}

static const struct dio_display_ops PACED = {
	.show = paced_show,
	.dispatch = paced_dispatch,
	.close = paced_close,
};

static enum dio_status set_up(struct paced *paced, const char *path,
			      const struct dio_display_options *options, struct dio_error *error)
{
	struct dio_display_info *info = &paced->base.info;
	enum dio_status status;

	paced->base.fd = timerfd_create(CLOCK_MONOTONIC, TFD_NONBLOCK | TFD_CLOEXEC);
	if (paced->base.fd < 0)
		return dio_fail(error, dio_status_from_errno(errno), "display %s: no timer: %s",
				info->name, strerror(errno));
	if (!path)
		return DIO_OK;
	status = dio_fit_init(&paced->fit, info->width, info->height, DIO_FIT_RGB, options->smooth);
	if (status == DIO_OK)
		status = dio_picture_init(&paced->frame, info->width, info->height);
	if (status != DIO_OK)
		return dio_fail(error, status, "display %s: no memory for %ux%u", info->name,
				info->width, info->height);
	return dio_video_open(path, info->width, info->height, info->refresh_hz, &paced->video,
			      error);
}

enum dio_status dio_display_open_paced(const char *path, const struct dio_display_mode *mode,
				       const struct dio_display_options *options,
				       struct dio_display **display, struct dio_error *error)
{
	struct paced *paced = calloc(1, sizeof(*paced));
	struct dio_display_info *info;
	enum dio_status status;

	if (!paced)
		return dio_fail(error, DIO_NO_MEM, "display: out of memory");
	info = &paced->base.info;
	paced->base.ops = &PACED;
	info->state = DIO_DISPLAY_ON;
	info->width = mode->width ? mode->width : DIO_DISPLAY_WIDTH;
	info->height = mode->height ? mode->height : DIO_DISPLAY_HEIGHT;
	info->refresh_hz = options->frames_per_second > 0 ? options->frames_per_second
			   : mode->refresh_hz > 0         ? mode->refresh_hz
							  : DIO_DISPLAY_HZ;
	snprintf(info->name, sizeof(info->name), path ? "file %s" : "none", path);
	paced->period_ns = (uint64_t)(NS_PER_S / info->refresh_hz);
	paced->begin_ns = dio_clock_ns();
	status = set_up(paced, path, options, error);
	if (status != DIO_OK) {
		paced_close(&paced->base, NULL);
		return status;
	}
	*display = &paced->base;
	return DIO_OK;
}
