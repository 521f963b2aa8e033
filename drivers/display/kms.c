/* A bare screen: three slots, one flip in flight; off and away are states. */
#include "kms.h"

#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/epoll.h>
#include <sys/timerfd.h>
#include <unistd.h>

#include "dio/fit.h"

#define SLOTS     3
#define NO_SLOT   (-1)
#define NS_PER_S  1000000000u
#define NS_PER_MS 1000000u

/* A flip that another commit was in the way of is tried again. */
#define BUSY_NS (4 * (uint64_t)NS_PER_MS)
/* A flip not heard of for so long never comes: a driver that hangs, a screen that went. */
#define LOST_NS NS_PER_S
/* While another program has the screen: how often to ask for it. */
#define AWAY_NS NS_PER_S

struct slot {
	struct dio_kms_buffer buffer;
	uint64_t tag;
};

struct kms {
	struct dio_display base;
	const struct dio_kms_system *system;
	void *card;
	char path[64];
	struct dio_kms_wish wish;
	bool smooth;
	struct dio_kms_route route;
	struct slot slots[SLOTS];
	int pending, queued, active; /* slots */
	uint64_t cookie;             /* of the flip in flight */
	struct dio_fit fit;
	int timer;
	bool left; /* the terminal was switched away: wait for it to come back */
};

static uint64_t now_ns(const struct kms *kms)
{
	return kms->system->now_ns(kms->system->context);
}

static void arm(const struct kms *kms, uint64_t after_ns)
{
	const struct itimerspec when = {.it_value = {.tv_sec = (time_t)(after_ns / NS_PER_S),
						     .tv_nsec = (long)(after_ns % NS_PER_S)}};

	/* Cannot fail: the timer is open and the time well formed. */
	timerfd_settime(kms->timer, 0, &when, NULL);
}

static void set_state(struct kms *kms, enum dio_display_state state)
{
	struct dio_display_info *info = &kms->base.info;
	const bool on = state == DIO_DISPLAY_ON;

	info->state = state;
	info->width = on ? kms->route.mode.hdisplay : 0;
	info->height = on ? kms->route.mode.vdisplay : 0;
	info->refresh_hz = on ? dio_kms_refresh_hz(&kms->route.mode) : 0;
	snprintf(info->name, sizeof(info->name), "kms %.60s %.60s", kms->path,
		 on ? kms->route.connector_name : kms->wish.connector);
	dio_display_push_changed(&kms->base, now_ns(kms));
}

static void drop_slots(struct kms *kms)
{
	const struct dio_kms_system *system = kms->system;

	kms->base.counters.lost += (kms->pending != NO_SLOT) + (kms->queued != NO_SLOT);
	kms->pending = kms->queued = kms->active = NO_SLOT;
	/* A flip that comes in late is then nobody's. */
	kms->cookie++;
	for (int i = 0; i < SLOTS; i++) {
		if (kms->slots[i].buffer.pixels)
			system->destroy_buffer(system->context, kms->card, &kms->slots[i].buffer);
		kms->slots[i] = (struct slot){0};
	}
	dio_fit_deinit(&kms->fit);
}

/* Off with the screen that was on; what was on its way is lost. */
static void go_off(struct kms *kms, enum dio_display_state state)
{
	const struct dio_kms_system *system = kms->system;

	if (kms->base.info.state == DIO_DISPLAY_ON && state == DIO_DISPLAY_OFF)
		system->turn_off(system->context, kms->card, &kms->route);
	drop_slots(kms);
	arm(kms, state == DIO_DISPLAY_AWAY && !kms->left ? AWAY_NS : 0);
	if (kms->base.info.state != state)
		set_state(kms, state);
}

static enum dio_status make_slots(struct kms *kms, struct dio_error *error)
{
	const struct dio_kms_system *system = kms->system;
	const uint32_t width = kms->route.mode.hdisplay, height = kms->route.mode.vdisplay;
	enum dio_status status = dio_fit_init(&kms->fit, width, height, DIO_FIT_BGRX, kms->smooth);

	for (int i = 0; i < SLOTS && status == DIO_OK; i++)
		if (system->create_buffer(system->context, kms->card, width, height,
					  &kms->slots[i].buffer) < 0)
			status = dio_status_from_errno(errno);
	if (status != DIO_OK) {
		drop_slots(kms);
		return dio_fail(error, status, "display %s: no scan-out memory for %ux%u: %s",
				kms->path, width, height, dio_status_text(status));
	}
	return DIO_OK;
}

/* Bring the route up, black. */
static enum dio_status start_route(struct kms *kms, struct dio_error *error)
{
	const struct dio_kms_system *system = kms->system;
	enum dio_status status = make_slots(kms, error);
	int cause;

	if (status != DIO_OK)
		return status;
	if (system->set_mode(system->context, kms->card, &kms->route, &kms->slots[0].buffer) < 0) {
		cause = errno;
		drop_slots(kms);
		return dio_fail(error,
				dio_kms_is_refused(cause) ? DIO_BUSY : dio_status_from_errno(cause),
				"display %s: %s refuses %ux%u at %.2f Hz: %s", kms->path,
				kms->route.connector_name, kms->route.mode.hdisplay,
				kms->route.mode.vdisplay, dio_kms_refresh_hz(&kms->route.mode),
				strerror(cause));
	}
	kms->active = 0;
	set_state(kms, DIO_DISPLAY_ON);
	return DIO_OK;
}

static enum dio_status probe(struct kms *kms, struct dio_kms_outputs *outputs,
			     struct dio_error *error)
{
	if (kms->system->probe(kms->system->context, kms->card, outputs) < 0)
		return dio_fail(error, errno == ENODEV ? DIO_GONE : dio_status_from_errno(errno),
				"display %s: its connectors cannot be read: %s", kms->path,
				strerror(errno));
	return DIO_OK;
}

/* Come on where there is a screen. Modes that the card refuses are passed over for the next best.
 * DIO_BUSY: not master. */
static enum dio_status come_on(struct kms *kms, const struct dio_kms_outputs *outputs,
			       struct dio_error *error)
{
	enum dio_status status = DIO_NO_SIGNAL;
	uint64_t refused = 0;
	uint32_t mode;

	while (dio_kms_choose(outputs, &kms->wish, refused, &kms->route, &mode)) {
		status = start_route(kms, error);
		if (status == DIO_OK || status == DIO_BUSY || status == DIO_GONE)
			return status;
		refused |= (uint64_t)1 << mode;
	}
	return status;
}

/* Is the screen in use still there, offering what is shown? */
static bool is_route_good(const struct kms *kms, const struct dio_kms_outputs *outputs)
{
	for (uint32_t i = 0; i < outputs->connector_count; i++) {
		const struct dio_kms_connector *connector = &outputs->connectors[i];

		if (connector->id != kms->route.connector_id || !connector->connected)
			continue;
		for (uint32_t k = 0; k < connector->mode_count; k++)
			if (memcmp(&connector->modes[k], &kms->route.mode,
				   sizeof(kms->route.mode)) == 0)
				return true;
	}
	return false;
}

/* Look at what is plugged in, and follow it. */
static enum dio_status follow(struct kms *kms, struct dio_error *error)
{
	struct dio_kms_outputs outputs;
	enum dio_status status = probe(kms, &outputs, error);

	if (status != DIO_OK)
		return status;
	if (kms->base.info.state == DIO_DISPLAY_ON) {
		if (is_route_good(kms, &outputs))
			return DIO_OK;
		go_off(kms, DIO_DISPLAY_OFF);
	}
	status = come_on(kms, &outputs, error);
	if (status == DIO_BUSY) {
		go_off(kms, DIO_DISPLAY_AWAY);
	} else if (status != DIO_OK) {
		if (kms->base.info.state != DIO_DISPLAY_OFF)
			set_state(kms, DIO_DISPLAY_OFF);
		/* Without a screen there is nothing to report but the state. */
		return status == DIO_GONE ? DIO_GONE : DIO_OK;
	}
	return DIO_OK;
}

/* Send the pending slot on its way, when none is. */
static enum dio_status flip(struct kms *kms, struct dio_error *error)
{
	const struct dio_kms_system *system = kms->system;
	int cause;

	if (kms->pending == NO_SLOT || kms->queued != NO_SLOT)
		return DIO_OK;
	if (system->flip(system->context, kms->card, &kms->route, &kms->slots[kms->pending].buffer,
			 kms->cookie + 1) == 0) {
		kms->cookie++;
		kms->queued = kms->pending;
		kms->pending = NO_SLOT;
		arm(kms, LOST_NS);
		return DIO_OK;
	}
	cause = errno;
	if (cause == EBUSY) {
		arm(kms, BUSY_NS);
		return DIO_OK;
	}
	if (dio_kms_is_refused(cause)) {
		go_off(kms, DIO_DISPLAY_AWAY);
		return DIO_OK;
	}
	if (cause == ENODEV)
		return dio_fail(error, DIO_GONE, "display %s: the card was removed", kms->path);
	/* The crtc is off, or was set up by someone else: start again from what is plugged in. */
	go_off(kms, DIO_DISPLAY_OFF);
	return follow(kms, error);
}

static int find_free_slot(const struct kms *kms)
{
	for (int i = 0; i < SLOTS; i++)
		if (i != kms->pending && i != kms->queued && i != kms->active)
			return i;
	return NO_SLOT;
}

static enum dio_status kms_show(struct dio_display *base, const struct dio_picture *picture,
				uint64_t tag, struct dio_error *error)
{
	struct kms *kms = (struct kms *)base;
	enum dio_status status;
	struct slot *slot;

	if (kms->pending == NO_SLOT)
		kms->pending = find_free_slot(kms);
	else
		base->counters.replaced++;
	slot = &kms->slots[kms->pending];
	dio_fit_draw(&kms->fit, picture, slot->buffer.pixels, slot->buffer.pitch_bytes);
	slot->tag = tag;
	status = flip(kms, error);
	/* A change found out here must wake who waits for events; a flip in flight will. */
	if (base->event_count && kms->queued == NO_SLOT)
		arm(kms, 1);
	return status == DIO_OK && base->info.state != DIO_DISPLAY_ON ? DIO_NO_SIGNAL : status;
}

static void take_flip(struct kms *kms, const struct dio_kms_flip *done)
{
	struct dio_display_event event = {.kind = DIO_DISPLAY_FLIPPED, .time_ns = done->time_ns};

	if (kms->queued == NO_SLOT || done->cookie != kms->cookie)
		return;
	kms->active = kms->queued;
	kms->queued = NO_SLOT;
	kms->base.counters.shown++;
	event.tag = kms->slots[kms->active].tag;
	arm(kms, 0);
	dio_display_push(&kms->base, &event);
}

static enum dio_status take_terminal(struct kms *kms, struct dio_error *error)
{
	const struct dio_kms_system *system = kms->system;

	switch (system->read_terminal(system->context, kms->card)) {
	case DIO_KMS_TERMINAL_SAME:
		return DIO_OK;
	case DIO_KMS_TERMINAL_LEAVES:
		kms->left = true;
		go_off(kms, DIO_DISPLAY_AWAY);
		system->release(system->context, kms->card);
		return DIO_OK;
	case DIO_KMS_TERMINAL_COMES:
		kms->left = false;
		break;
	}
	if (system->reclaim(system->context, kms->card) < 0) {
		arm(kms, AWAY_NS);
		return DIO_OK;
	}
	return follow(kms, error);
}

/* The timer: a flip to try again, one that never came, a screen to ask for. */
static enum dio_status take_time(struct kms *kms, struct dio_error *error)
{
	const struct dio_kms_system *system = kms->system;
	uint64_t ticks;

	if (read(kms->timer, &ticks, sizeof(ticks)) != sizeof(ticks))
		return DIO_OK;
	if (kms->base.info.state == DIO_DISPLAY_ON && kms->queued != NO_SLOT) {
		go_off(kms, DIO_DISPLAY_OFF);
		return follow(kms, error);
	}
	if (kms->base.info.state == DIO_DISPLAY_ON)
		return flip(kms, error);
	if (kms->base.info.state != DIO_DISPLAY_AWAY || kms->left)
		return DIO_OK;
	if (system->reclaim(system->context, kms->card) < 0) {
		arm(kms, AWAY_NS);
		return DIO_OK;
	}
	return follow(kms, error);
}

static enum dio_status kms_dispatch(struct dio_display *base, struct dio_error *error)
{
	struct kms *kms = (struct kms *)base;
	const struct dio_kms_system *system = kms->system;
	enum dio_status status = DIO_OK;
	struct dio_kms_flip done;
	int got;

	while ((got = system->read_flip(system->context, kms->card, &done)) > 0)
		take_flip(kms, &done);
	if (got < 0)
		return dio_fail(error, errno == ENODEV ? DIO_GONE : dio_status_from_errno(errno),
				"display %s: cannot be read: %s", kms->path, strerror(errno));
	if (base->info.state == DIO_DISPLAY_ON)
		status = flip(kms, error);
	if (status == DIO_OK)
		status = take_terminal(kms, error);
	if (status == DIO_OK && system->read_hotplug(system->context, kms->card) &&
	    base->info.state != DIO_DISPLAY_AWAY)
		status = follow(kms, error);
	return status == DIO_OK ? take_time(kms, error) : status;
}

static enum dio_status kms_close(struct dio_display *base, struct dio_error *error)
{
	struct kms *kms = (struct kms *)base;
	const struct dio_kms_system *system = kms->system;

	(void)error;
	if (kms->card) {
		/* Buffers go when nothing shows them any more: no flash of black between. */
		if (base->info.state != DIO_DISPLAY_AWAY)
			system->restore(system->context, kms->card);
		drop_slots(kms);
		system->close(system->context, kms->card);
	}
	if (kms->timer >= 0)
		close(kms->timer);
	if (base->fd >= 0)
		close(base->fd);
	free(kms);
	return DIO_OK;
}

static const struct dio_display_ops KMS = {
	.show = kms_show,
	.dispatch = kms_dispatch,
	.close = kms_close,
};

static enum dio_status watch(const struct kms *kms, int fd, struct dio_error *error)
{
	struct epoll_event event = {.events = EPOLLIN};

	if (fd < 0 || epoll_ctl(kms->base.fd, EPOLL_CTL_ADD, fd, &event) < 0)
		return dio_fail(error, dio_status_from_errno(errno),
				"display %s: cannot be waited for: %s", kms->path, strerror(errno));
	return DIO_OK;
}

static enum dio_status open_card(struct kms *kms, const char *card, struct dio_error *error)
{
	const struct dio_kms_system *system = kms->system;
	struct dio_kms_outputs outputs;
	enum dio_status status = dio_kms_open_card(system, card, &kms->wish, &kms->card, kms->path,
						   sizeof(kms->path), &outputs, error);

	if (status != DIO_OK)
		return status;
	status = watch(kms, system->get_fd(system->context, kms->card), error);
	if (status == DIO_OK)
		status = come_on(kms, &outputs, error);
	if (status == DIO_NO_SIGNAL) {
		set_state(kms, DIO_DISPLAY_OFF);
		status = DIO_OK;
	}
	/* What it is from the beginning is no change. */
	kms->base.event_count = 0;
	return status;
}

enum dio_status dio_display_open_kms_on(const struct dio_kms_system *system, const char *card,
					const struct dio_display_mode *mode,
					const struct dio_display_options *options,
					struct dio_display **display, struct dio_error *error)
{
	struct kms *kms = calloc(1, sizeof(*kms));
	enum dio_status status;

	if (!kms)
		return dio_fail(error, DIO_NO_MEM, "display kms: out of memory");
	kms->base.ops = &KMS;
	kms->base.info.state = DIO_DISPLAY_OFF;
	kms->system = system;
	kms->wish.mode = *mode;
	kms->smooth = options->smooth;
	kms->pending = kms->queued = kms->active = NO_SLOT;
	snprintf(kms->wish.connector, sizeof(kms->wish.connector), "%s",
		 options->connector ? options->connector : "");
	kms->base.fd = epoll_create1(EPOLL_CLOEXEC);
	kms->timer = timerfd_create(CLOCK_MONOTONIC, TFD_NONBLOCK | TFD_CLOEXEC);
	status = watch(kms, kms->timer, error);
	if (status == DIO_OK)
		status = open_card(kms, card, error);
	if (status != DIO_OK) {
		kms_close(&kms->base, NULL);
		return status;
	}
	*display = &kms->base;
	return DIO_OK;
}

enum dio_status dio_display_open_kms(const char *card, const struct dio_display_mode *mode,
				     const struct dio_display_options *options,
				     struct dio_display **display, struct dio_error *error)
{
	return dio_display_open_kms_on(&dio_kms_kernel, card, mode, options, display, error);
}
