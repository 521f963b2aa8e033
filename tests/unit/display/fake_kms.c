#include "fake_kms.h"

#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/eventfd.h>
#include <unistd.h>

static int fail(int errno_value)
{
	errno = errno_value;
	return -1;
}

static void wake(struct fake_kms *fake)
{
	const uint64_t one = 1;

	if (write(fake->event, &one, sizeof(one)) < 0)
		abort();
}

static void calm(struct fake_kms *fake)
{
	uint64_t count;

	if (!fake->flip_count && !fake->hotplug && fake->terminal == DIO_KMS_TERMINAL_SAME &&
	    read(fake->event, &count, sizeof(count)) < 0 && errno != EAGAIN)
		abort();
}

static bool fake_list(void *context, uint32_t index, char *path, size_t path_size)
{
	struct fake_kms *fake = context;

	if (index >= fake->card_count)
		return false;
	snprintf(path, path_size, "%s", fake->cards[index].path);
	return true;
}

static int fake_open(void *context, const char *path, void **card)
{
	struct fake_kms *fake = context;

	for (uint32_t i = 0; i < fake->card_count; i++) {
		if (strcmp(fake->cards[i].path, path) != 0)
			continue;
		if (fake->cards[i].open_errno)
			return fail(fake->cards[i].open_errno);
		fake->opened++;
		*card = &fake->cards[i];
		return 0;
	}
	return fail(ENOENT);
}

static void fake_restore(void *context, void *card)
{
	struct fake_kms *fake = context;

	(void)card;
	fake->restored++;
	fake->restored_before_destroy = fake->created > fake->destroyed;
	fake->is_on = false;
}

static void fake_close(void *context, void *card)
{
	(void)card;
	((struct fake_kms *)context)->opened--;
}

static int fake_probe(void *context, void *card, struct dio_kms_outputs *outputs)
{
	(void)context;
	if (((struct fake_card *)card)->probe_errno)
		return fail(((struct fake_card *)card)->probe_errno);
	*outputs = ((struct fake_card *)card)->outputs;
	return 0;
}

static int fake_create(void *context, void *card, uint32_t width, uint32_t height,
		       struct dio_kms_buffer *buffer)
{
	struct fake_kms *fake = context;
	/* Rows are padded, as cards do. */
	const size_t pitch = 4 * (size_t)width + 64;
	uint32_t at = 0;

	(void)card;
	if (fake->create_errno && fake->created - fake->destroyed + 1 == fake->create_fails_at)
		return fail(fake->create_errno);
	while (fake->memory[at])
		at++;
	fake->memory[at] = calloc(height, pitch);
	fake->created++;
	*buffer = (struct dio_kms_buffer){.fb = at + 1,
					  .handle = at + 1,
					  .pitch_bytes = pitch,
					  .size_bytes = pitch * height,
					  .pixels = fake->memory[at]};
	return 0;
}

static void fake_destroy(void *context, void *card, struct dio_kms_buffer *buffer)
{
	struct fake_kms *fake = context;

	(void)card;
	free(fake->memory[buffer->fb - 1]);
	fake->memory[buffer->fb - 1] = NULL;
	fake->destroyed++;
	*buffer = (struct dio_kms_buffer){0};
}

static int fake_set_mode(void *context, void *card, const struct dio_kms_route *route,
			 const struct dio_kms_buffer *buffer)
{
	struct fake_kms *fake = context;

	(void)card;
	if (fake->set_mode_errno)
		return fail(fake->set_mode_errno);
	if (route->mode.hdisplay == fake->refused_width)
		return fail(EINVAL);
	fake->modes_set++;
	fake->route = *route;
	fake->is_on = true;
	fake->shown = buffer->fb;
	fake->flipping = 0;
	return 0;
}

static int fake_flip(void *context, void *card, const struct dio_kms_route *route,
		     const struct dio_kms_buffer *buffer, uint64_t cookie)
{
	struct fake_kms *fake = context;

	(void)card;
	(void)route;
	if (fake->flip_errno)
		return fail(fake->flip_errno);
	/* What the display must never do. */
	if (fake->flipping || !fake->is_on || buffer->fb == fake->shown)
		abort();
	fake->flipping = buffer->fb;
	fake->cookie = cookie;
	return 0;
}

static void fake_turn_off(void *context, void *card, const struct dio_kms_route *route)
{
	struct fake_kms *fake = context;

	(void)card;
	(void)route;
	fake->turned_off++;
	fake->is_on = false;
}

static int fake_get_fd(void *context, void *card)
{
	(void)card;
	return ((struct fake_kms *)context)->event;
}

static int fake_read_flip(void *context, void *card, struct dio_kms_flip *flip)
{
	struct fake_kms *fake = context;

	(void)card;
	if (fake->read_errno)
		return fail(fake->read_errno);
	if (!fake->flip_count)
		return 0;
	*flip = fake->flips[0];
	memmove(fake->flips, fake->flips + 1, --fake->flip_count * sizeof(*flip));
	calm(fake);
	return 1;
}

static bool fake_read_hotplug(void *context, void *card)
{
	struct fake_kms *fake = context;
	bool news = fake->hotplug;

	(void)card;
	fake->hotplug = false;
	calm(fake);
	return news;
}

static enum dio_kms_terminal fake_read_terminal(void *context, void *card)
{
	struct fake_kms *fake = context;
	enum dio_kms_terminal news = fake->terminal;

	(void)card;
	fake->terminal = DIO_KMS_TERMINAL_SAME;
	calm(fake);
	return news;
}

static void fake_release(void *context, void *card)
{
	(void)card;
	((struct fake_kms *)context)->released++;
}

static int fake_reclaim(void *context, void *card)
{
	struct fake_kms *fake = context;

	(void)card;
	if (fake->reclaim_errno)
		return fail(fake->reclaim_errno);
	fake->reclaimed++;
	return 0;
}

static uint64_t fake_now_ns(void *context)
{
	(void)context;
	return 1;
}

drmModeModeInfo fake_kms_mode(uint16_t width, uint16_t height, uint32_t hz, bool preferred)
{
	drmModeModeInfo mode = {.hdisplay = width,
				.vdisplay = height,
				.htotal = (uint16_t)(width + 200),
				.vtotal = (uint16_t)(height + 100),
				.vrefresh = hz,
				.type = preferred ? DRM_MODE_TYPE_PREFERRED : 0};

	mode.clock = (uint32_t)mode.htotal * mode.vtotal * hz / 1000;
	return mode;
}

void fake_kms_init(struct fake_kms *fake)
{
	struct dio_kms_connector *connector;

	*fake = (struct fake_kms){
		.card_count = 1,
		.cards = {{.path = "/dev/dri/card0"}, {.path = "/dev/dri/card1"}},
		.event = eventfd(0, EFD_NONBLOCK | EFD_CLOEXEC),
		.system = {.list = fake_list,
			   .open = fake_open,
			   .restore = fake_restore,
			   .close = fake_close,
			   .probe = fake_probe,
			   .create_buffer = fake_create,
			   .destroy_buffer = fake_destroy,
			   .set_mode = fake_set_mode,
			   .flip = fake_flip,
			   .turn_off = fake_turn_off,
			   .get_fd = fake_get_fd,
			   .read_flip = fake_read_flip,
			   .read_hotplug = fake_read_hotplug,
			   .read_terminal = fake_read_terminal,
			   .release = fake_release,
			   .reclaim = fake_reclaim,
			   .now_ns = fake_now_ns},
	};
	fake->system.context = fake;
	for (int i = 0; i < FAKE_CARDS; i++) {
		fake->cards[i].outputs =
			(struct dio_kms_outputs){.connector_count = 1, .crtc_count = 2};
		connector = &fake->cards[i].outputs.connectors[0];
		*connector = (struct dio_kms_connector){.id = 30,
							.name = "HDMI-A-1",
							.connected = true,
							.possible_crtcs = 3,
							.current_crtc = -1,
							.mode_count = 2};
		connector->modes[0] = fake_kms_mode(128, 72, 60, false);
		connector->modes[1] = fake_kms_mode(192, 108, 60, true);
	}
}

void fake_kms_deinit(struct fake_kms *fake)
{
	close(fake->event);
	for (int i = 0; i < FAKE_BUFFERS; i++)
		free(fake->memory[i]);
}

void fake_kms_vblank(struct fake_kms *fake, uint64_t time_ns)
{
	if (!fake->flipping)
		return;
	fake->shown = fake->flipping;
	fake->flipping = 0;
	fake->flips[fake->flip_count++] =
		(struct dio_kms_flip){.cookie = fake->cookie, .time_ns = time_ns};
	wake(fake);
}

void fake_kms_plug(struct fake_kms *fake, bool connected)
{
	fake->cards[0].outputs.connectors[0].connected = connected;
	fake->hotplug = true;
	wake(fake);
}

void fake_kms_switch(struct fake_kms *fake, enum dio_kms_terminal terminal)
{
	fake->terminal = terminal;
	wake(fake);
}

uint32_t fake_kms_pixel(const struct fake_kms *fake)
{
	uint32_t pixel;

	memcpy(&pixel, fake->memory[fake->shown - 1], sizeof(pixel));
	return pixel;
}
