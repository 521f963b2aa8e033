#include "kms_drm.h"

#include <drm_fourcc.h>
#include <errno.h>
#include <fcntl.h>
#include <poll.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/epoll.h>
#include <sys/mman.h>
#include <unistd.h>
#include <xf86drm.h>

#include "dio/clock.h"
#include "dio/file.h"

#define EVENT_BYTES 1024

static bool list_cards(void *context, uint32_t index, char *path, size_t path_size)
{
	(void)context;
	return dio_file_match("/dev/dri/card*", index, path, path_size);
}

static void watch(const struct dio_drm_card *card, int fd)
{
	struct epoll_event event = {.events = EPOLLIN};

	/* Out of memory at worst: then it is noticed late, not wrongly. */
	epoll_ctl(card->epoll, EPOLL_CTL_ADD, fd, &event);
}

/* The kernel's own messages, not udevd's: the card is open already, so nothing else is needed, and
 * they reach a service that has no network. */
static void watch_plugs(struct dio_drm_card *card)
{
	card->udev = udev_new();
	if (!card->udev)
		return;
	card->monitor = udev_monitor_new_from_netlink(card->udev, "kernel");
	if (!card->monitor)
		return;
	if (udev_monitor_filter_add_match_subsystem_devtype(card->monitor, "drm", NULL) < 0 ||
	    udev_monitor_enable_receiving(card->monitor) < 0) {
		udev_monitor_unref(card->monitor);
		card->monitor = NULL;
		return;
	}
	watch(card, udev_monitor_get_fd(card->monitor));
}

static void close_card(void *context, void *opaque)
{
	struct dio_drm_card *card = opaque;

	(void)context;
	dio_terminal_close(card->terminal);
	udev_monitor_unref(card->monitor);
	udev_unref(card->udev);
	for (uint32_t i = 0; i < card->crtc_count; i++)
		drmModeFreeCrtc(card->found[i]);
	if (card->epoll >= 0)
		close(card->epoll);
	if (card->fd >= 0)
		close(card->fd);
	free(card);
}

static int become_master(const struct dio_drm_card *card)
{
	if (drmIsMaster(card->fd) || drmSetMaster(card->fd) == 0)
		return 0;
	/* Without the right to ask, it is refused for the same reason: somebody else is. */
	if (errno == EACCES || errno == EINVAL || errno == EPERM)
		errno = EBUSY;
	return -1;
}

static int check_abilities(struct dio_drm_card *card)
{
	uint64_t dumb = 0, monotonic = 0;

	if (drmGetCap(card->fd, DRM_CAP_DUMB_BUFFER, &dumb) < 0 || !dumb ||
	    drmGetCap(card->fd, DRM_CAP_TIMESTAMP_MONOTONIC, &monotonic) < 0 || !monotonic) {
		errno = EOPNOTSUPP;
		return -1;
	}
	card->atomic = drmSetClientCap(card->fd, DRM_CLIENT_CAP_UNIVERSAL_PLANES, 1) == 0 &&
		       drmSetClientCap(card->fd, DRM_CLIENT_CAP_ATOMIC, 1) == 0;
	return 0;
}

/* What is on the screens, to be put back. */
static int remember(struct dio_drm_card *card)
{
	drmModeRes *all = drmModeGetResources(card->fd);

	if (!all || all->count_crtcs == 0 || all->count_connectors == 0) {
		drmModeFreeResources(all);
		errno = EOPNOTSUPP;
		return -1;
	}
	for (int i = 0; i < all->count_crtcs && i < DIO_DRM_CRTCS_MAX; i++) {
		card->crtcs[i] = all->crtcs[i];
		card->found[i] = drmModeGetCrtc(card->fd, all->crtcs[i]);
		card->crtc_count++;
	}
	for (int i = 0; i < all->count_connectors && i < DIO_KMS_CONNECTORS_MAX; i++) {
		drmModeConnector *connector =
			drmModeGetConnectorCurrent(card->fd, all->connectors[i]);
		drmModeEncoder *encoder =
			connector ? drmModeGetEncoder(card->fd, connector->encoder_id) : NULL;

		card->found_connectors[card->found_count] = all->connectors[i];
		card->found_on[card->found_count++] = encoder ? encoder->crtc_id : 0;
		drmModeFreeEncoder(encoder);
		drmModeFreeConnector(connector);
	}
	drmModeFreeResources(all);
	return 0;
}

static int open_card(void *context, const char *path, void **opened)
{
	struct dio_drm_card *card = calloc(1, sizeof(*card));
	int cause;

	if (!card)
		return -1;
	card->epoll = -1;
	card->fd = open(path, O_RDWR | O_CLOEXEC | O_NONBLOCK);
	if (card->fd >= 0)
		card->epoll = epoll_create1(EPOLL_CLOEXEC);
	if (card->epoll < 0 || check_abilities(card) < 0 || remember(card) < 0 ||
	    become_master(card) < 0) {
		cause = errno;
		close_card(context, card);
		errno = cause;
		return -1;
	}
	watch(card, card->fd);
	watch_plugs(card);
	card->terminal = dio_terminal_open();
	if (card->terminal)
		watch(card, dio_terminal_get_fd(card->terminal));
	*opened = card;
	return 0;
}

static void put_back(const struct dio_drm_card *card, uint32_t index)
{
	drmModeCrtc *found = card->found[index];
	uint32_t connectors[DIO_KMS_CONNECTORS_MAX];
	int count = 0;

	for (uint32_t i = 0; i < card->found_count; i++)
		if (card->found_on[i] == card->crtcs[index])
			connectors[count++] = card->found_connectors[i];
	if (found && found->mode_valid && found->buffer_id && count)
		drmModeSetCrtc(card->fd, found->crtc_id, found->buffer_id, found->x, found->y,
			       connectors, count, &found->mode);
	else
		drmModeSetCrtc(card->fd, card->crtcs[index], 0, 0, 0, NULL, 0, NULL);
}

/* The old call does for atomic drivers too. What cannot be put back stays: the card's next user
 * sets it up as it likes. */
static void restore(void *context, void *opaque)
{
	struct dio_drm_card *card = opaque;

	(void)context;
	for (uint32_t i = 0; i < card->crtc_count; i++)
		if (card->touched >> i & 1)
			put_back(card, i);
	card->touched = 0;
}

static int number_of_crtc(const struct dio_drm_card *card, uint32_t id)
{
	for (uint32_t i = 0; i < card->crtc_count; i++)
		if (card->crtcs[i] == id)
			return (int)i;
	return -1;
}

static void describe(const struct dio_drm_card *card, const drmModeConnector *from,
		     struct dio_kms_connector *to)
{
	const char *type = drmModeGetConnectorTypeName(from->connector_type);

	*to = (struct dio_kms_connector){
		.id = from->connector_id,
		.connected = from->connection == DRM_MODE_CONNECTED && from->count_modes > 0,
		.current_crtc = -1,
	};
	snprintf(to->name, sizeof(to->name), "%s-%u", type ? type : "Unknown",
		 from->connector_type_id);
	for (int i = 0; i < from->count_encoders; i++) {
		drmModeEncoder *encoder = drmModeGetEncoder(card->fd, from->encoders[i]);

		if (encoder)
			to->possible_crtcs |= encoder->possible_crtcs;
		if (encoder && encoder->encoder_id == from->encoder_id)
			to->current_crtc = number_of_crtc(card, encoder->crtc_id);
		drmModeFreeEncoder(encoder);
	}
	for (int i = 0; i < from->count_modes && i < DIO_KMS_MODES_MAX; i++)
		to->modes[to->mode_count++] = from->modes[i];
}

static int probe(void *context, void *opaque, struct dio_kms_outputs *outputs)
{
	struct dio_drm_card *card = opaque;
	drmModeRes *all = drmModeGetResources(card->fd);

	(void)context;
	if (!all)
		return -1;
	*outputs = (struct dio_kms_outputs){.crtc_count = card->crtc_count};
	for (int i = 0; i < all->count_connectors; i++) {
		drmModeConnector *connector = drmModeGetConnector(card->fd, all->connectors[i]);

		if (connector && connector->connector_type != DRM_MODE_CONNECTOR_WRITEBACK &&
		    outputs->connector_count < DIO_KMS_CONNECTORS_MAX)
			describe(card, connector, &outputs->connectors[outputs->connector_count++]);
		drmModeFreeConnector(connector);
	}
	drmModeFreeResources(all);
	return 0;
}

static void destroy_buffer(void *context, void *opaque, struct dio_kms_buffer *buffer)
{
	struct dio_drm_card *card = opaque;

	(void)context;
	if (buffer->pixels)
		munmap(buffer->pixels, buffer->size_bytes);
	if (buffer->fb)
		drmModeRmFB(card->fd, buffer->fb);
	if (buffer->handle)
		drmModeDestroyDumbBuffer(card->fd, buffer->handle);
	*buffer = (struct dio_kms_buffer){0};
}

static int map_buffer(const struct dio_drm_card *card, struct dio_kms_buffer *buffer)
{
	uint64_t offset;
	void *memory;
	int result = drmModeMapDumbBuffer(card->fd, buffer->handle, &offset);

	if (result < 0) {
		errno = -result;
		return -1;
	}
	memory = mmap(NULL, buffer->size_bytes, PROT_READ | PROT_WRITE, MAP_SHARED, card->fd,
		      (off_t)offset);
	if (memory == MAP_FAILED)
		return -1;
	buffer->pixels = memory;
	/* New memory may hold an older picture. */
	memset(memory, 0, buffer->size_bytes);
	return 0;
}

static int create_buffer(void *context, void *opaque, uint32_t width, uint32_t height,
			 struct dio_kms_buffer *buffer)
{
	struct dio_drm_card *card = opaque;
	struct dio_kms_buffer made = {0};
	uint32_t pitch = 0;
	uint64_t size = 0;
	int result = drmModeCreateDumbBuffer(card->fd, width, height, 32, 0, &made.handle, &pitch,
					     &size);

	if (result == 0) {
		const uint32_t handles[4] = {made.handle}, pitches[4] = {pitch}, offsets[4] = {0};

		made.pitch_bytes = pitch;
		made.size_bytes = size;
		result = drmModeAddFB2(card->fd, width, height, DRM_FORMAT_XRGB8888, handles,
				       pitches, offsets, &made.fb, 0);
	}
	if (result < 0)
		errno = -result;
	else
		result = map_buffer(card, &made);
	if (result < 0) {
		int cause = errno;

		destroy_buffer(context, card, &made);
		errno = cause;
		return -1;
	}
	*buffer = made;
	return 0;
}

/* libdrm's older calls return a negative errno, as the newer do. */
static int as_errno(int result)
{
	if (result == 0)
		return 0;
	errno = -result;
	return -1;
}

static int set_mode(void *context, void *opaque, const struct dio_kms_route *route,
		    const struct dio_kms_buffer *buffer)
{
	struct dio_drm_card *card = opaque;
	drmModeModeInfo mode = route->mode;
	uint32_t connector = route->connector_id;

	(void)context;
	card->touched |= (uint32_t)1 << route->crtc;
	if (card->atomic)
		return dio_drm_atomic_set_mode(card, route, buffer->fb);
	return as_errno(drmModeSetCrtc(card->fd, card->crtcs[route->crtc], buffer->fb, 0, 0,
				       &connector, 1, &mode));
}

static int flip(void *context, void *opaque, const struct dio_kms_route *route,
		const struct dio_kms_buffer *buffer, uint64_t cookie)
{
	struct dio_drm_card *card = opaque;
	/* The kernel hands the cookie back as it is: it is no pointer to it. */
	/* NOLINTNEXTLINE(performance-no-int-to-ptr) */
	void *const data = (void *)(uintptr_t)cookie;

	(void)context;
	if (card->atomic)
		return dio_drm_atomic_flip(card, buffer->fb, cookie);
	return as_errno(drmModePageFlip(card->fd, card->crtcs[route->crtc], buffer->fb,
					DRM_MODE_PAGE_FLIP_EVENT, data));
}

static void turn_off(void *context, void *opaque, const struct dio_kms_route *route)
{
	struct dio_drm_card *card = opaque;

	(void)context;
	if (card->atomic)
		dio_drm_atomic_off(card, route);
	else
		drmModeSetCrtc(card->fd, card->crtcs[route->crtc], 0, 0, 0, NULL, 0, NULL);
}

static int get_fd(void *context, void *opaque)
{
	struct dio_drm_card *card = opaque;

	(void)context;
	return card->epoll;
}

static void keep_flip(struct dio_drm_card *card, const struct drm_event_vblank *event)
{
	if (card->flip_count == DIO_DRM_FLIPS_MAX)
		return;
	card->flips[(card->flip_first + card->flip_count++) % DIO_DRM_FLIPS_MAX] =
		(struct dio_kms_flip){
			.cookie = event->user_data,
			.time_ns = (uint64_t)event->tv_sec * 1000000000u +
				   (uint64_t)event->tv_usec * 1000u,
		};
}

static int read_events(struct dio_drm_card *card)
{
	_Alignas(struct drm_event_vblank) char bytes[EVENT_BYTES];
	ssize_t size = read(card->fd, bytes, sizeof(bytes));

	if (size < 0)
		return errno == EAGAIN || errno == EINTR ? 0 : -1;
	for (ssize_t at = 0; at + (ssize_t)sizeof(struct drm_event) <= size;) {
		struct drm_event_vblank event = {0};

		memcpy(&event.base, bytes + at, sizeof(event.base));
		if (event.base.length < sizeof(event.base) ||
		    at + (ssize_t)event.base.length > size)
			break;
		if (event.base.type == DRM_EVENT_FLIP_COMPLETE &&
		    event.base.length >= sizeof(event)) {
			memcpy(&event, bytes + at, sizeof(event));
			keep_flip(card, &event);
		}
		at += (ssize_t)event.base.length;
	}
	return 0;
}

static int read_flip(void *context, void *opaque, struct dio_kms_flip *done)
{
	struct dio_drm_card *card = opaque;

	(void)context;
	if (card->flip_count == 0 && read_events(card) < 0)
		return -1;
	if (card->flip_count == 0)
		return 0;
	*done = card->flips[card->flip_first];
	card->flip_first = (card->flip_first + 1) % DIO_DRM_FLIPS_MAX;
	card->flip_count--;
	return 1;
}

static bool read_hotplug(void *context, void *opaque)
{
	struct dio_drm_card *card = opaque;
	struct udev_device *device;
	bool some = false;

	(void)context;
	while (card->monitor && (device = udev_monitor_receive_device(card->monitor))) {
		some = true;
		udev_device_unref(device);
	}
	return some;
}

static enum dio_kms_terminal read_terminal(void *context, void *opaque)
{
	struct dio_drm_card *card = opaque;

	(void)context;
	return card->terminal ? dio_terminal_read(card->terminal) : DIO_KMS_TERMINAL_SAME;
}

static void release(void *context, void *opaque)
{
	struct dio_drm_card *card = opaque;

	(void)context;
	drmDropMaster(card->fd);
	if (card->terminal)
		dio_terminal_leave(card->terminal);
}

static int reclaim(void *context, void *opaque)
{
	(void)context;
	return become_master(opaque);
}

static uint64_t now_ns(void *context)
{
	(void)context;
	return dio_clock_ns();
}

const struct dio_kms_system dio_kms_kernel = {
	.list = list_cards,
	.open = open_card,
	.restore = restore,
	.close = close_card,
	.probe = probe,
	.create_buffer = create_buffer,
	.destroy_buffer = destroy_buffer,
	.set_mode = set_mode,
	.flip = flip,
	.turn_off = turn_off,
	.get_fd = get_fd,
	.read_flip = read_flip,
	.read_hotplug = read_hotplug,
	.read_terminal = read_terminal,
	.release = release,
	.reclaim = reclaim,
	.now_ns = now_ns,
};
