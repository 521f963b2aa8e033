/* Display, buttons, LEDs and web page. Each may be missing, busy or go away: that is said once, and
 * tried again, while everything else goes on. */
#include <stdio.h>
#include <string.h>

#include "viewd/viewd.h"

enum device { DISPLAY, BUTTONS, LEDS, PAGE };

/* Say what is wrong with a device, once until it works again. */
static void complain(struct dio_viewd *viewd, enum device device, const struct dio_error *why)
{
	if (!viewd->devices_warned[device])
		dio_viewd_say(viewd, true, "%s", why->text);
	viewd->devices_warned[device] = true;
}

static void drop_source(sd_event_source **source)
{
	sd_event_source_disable_unref(*source);
	*source = NULL;
}

static void close_display(struct dio_viewd *viewd)
{
	struct dio_error why = {""};

	drop_source(&viewd->display_source);
	if (dio_display_close(viewd->display, &why) != DIO_OK)
		dio_viewd_say(viewd, true, "%s", why.text);
	viewd->display = NULL;
	viewd->display_info = (struct dio_display_info){.state = DIO_DISPLAY_OFF};
}

static void close_buttons(struct dio_viewd *viewd)
{
	drop_source(&viewd->buttons_source);
	dio_buttons_close(viewd->buttons);
	viewd->buttons = NULL;
}

static void close_leds(struct dio_viewd *viewd)
{
	drop_source(&viewd->leds_source);
	dio_leds_close(viewd->leds);
	viewd->leds = NULL;
}

static void take_flip(struct dio_viewd *viewd, const struct dio_display_event *event)
{
	uint64_t oldest = viewd->next_tag > DIO_VIEWD_TAGS ? viewd->next_tag - DIO_VIEWD_TAGS : 0;

	uint64_t taken_ns;

	if (event->tag < oldest || event->tag >= viewd->next_tag)
		return;
	taken_ns = viewd->tags_taken_ns[event->tag % DIO_VIEWD_TAGS];
	dio_figures_note(&viewd->figures, taken_ns, event->time_ns);
	if (taken_ns != 0 && viewd->status.first_shown_us == 0)
		viewd->status.first_shown_us = event->time_ns / 1000;
}

static int on_display(sd_event_source *source, int fd, uint32_t events, void *context)
{
	struct dio_viewd *viewd = context;
	struct dio_display_event event;
	struct dio_error why = {""};
	enum dio_status status;
	bool changed = false;

	(void)source;
	(void)fd;
	(void)events;
	while ((status = dio_display_poll(viewd->display, 0, &event, &why)) == DIO_OK) {
		if (event.kind == DIO_DISPLAY_FLIPPED)
			take_flip(viewd, &event);
		else if (event.kind == DIO_DISPLAY_CHANGED)
			changed = true;
		else if (event.kind == DIO_DISPLAY_KEY && viewd->buttons)
			dio_buttons_feed_key(viewd->buttons, event.key, event.pressed,
					     event.time_ns);
		else if (event.kind == DIO_DISPLAY_QUIT)
			sd_event_exit(viewd->loop, 0);
	}
	if (status != DIO_AGAIN) {
		complain(viewd, DISPLAY, &why);
		close_display(viewd);
	} else if (changed) {
		dio_display_get_info(viewd->display, &viewd->display_info);
		dio_viewd_show_again(viewd);
	}
	return 0;
}

static int on_buttons(sd_event_source *source, int fd, uint32_t events, void *context)
{
	struct dio_viewd *viewd = context;
	struct dio_button_event event;
	struct dio_error why = {""};
	enum dio_status status;

	(void)source;
	(void)fd;
	(void)events;
	while ((status = dio_buttons_read(viewd->buttons, &event, &why)) == DIO_OK) {
		enum dio_action action = dio_profile_get_action(viewd->profile, &event);

		if (action == DIO_ACTION_SAVE) {
			if (dio_viewd_ask(viewd, action, NULL) == DIO_OK)
				dio_viewd_save(viewd, "", NULL);
		} else {
			dio_viewd_ask(viewd, action, NULL);
		}
	}
	if (status != DIO_AGAIN) {
		complain(viewd, BUTTONS, &why);
		close_buttons(viewd);
	}
	return 0;
}

static int on_leds(sd_event_source *source, int fd, uint32_t events, void *context)
{
	struct dio_viewd *viewd = context;
	struct dio_error why = {""};

	(void)source;
	(void)fd;
	(void)events;
	if (dio_leds_update(viewd->leds, &why) != DIO_OK) {
		complain(viewd, LEDS, &why);
		close_leds(viewd);
	}
	return 0;
}

/* True: the device is watched. A loop that takes no more sources is out of memory. */
static bool watch(struct dio_viewd *viewd, enum device device, sd_event_source **source, int fd,
		  sd_event_io_handler_t handler)
{
	viewd->devices_warned[device] = false;
	return sd_event_add_io(viewd->loop, source, fd, EPOLLIN, handler, viewd) >= 0;
}

static void open_display(struct dio_viewd *viewd)
{
	const struct dio_display_options options = dio_profile_get_display(viewd->profile);
	struct dio_error why = {""};

	if (dio_display_open(viewd->profile->display.output, &options, &viewd->display, &why) !=
	    DIO_OK) {
		viewd->display = NULL;
		complain(viewd, DISPLAY, &why);
		return;
	}
	dio_display_get_info(viewd->display, &viewd->display_info);
	if (!watch(viewd, DISPLAY, &viewd->display_source, dio_display_get_fd(viewd->display),
		   on_display))
		close_display(viewd);
	else
		dio_viewd_show_again(viewd);
}

static void open_buttons(struct dio_viewd *viewd)
{
	const struct dio_buttons_options options = dio_profile_get_buttons(viewd->profile);
	struct dio_error why = {""};

	if (dio_buttons_open(&options, &viewd->buttons, &why) != DIO_OK) {
		viewd->buttons = NULL;
		complain(viewd, BUTTONS, &why);
	} else if (!watch(viewd, BUTTONS, &viewd->buttons_source,
			  dio_buttons_get_fd(viewd->buttons), on_buttons)) {
		close_buttons(viewd);
	}
}

static void open_leds(struct dio_viewd *viewd)
{
	struct dio_error why = {""};

	if (dio_leds_open(viewd->profile->leds, viewd->profile->led_count, &viewd->leds, &why) !=
	    DIO_OK) {
		viewd->leds = NULL;
		complain(viewd, LEDS, &why);
	} else if (!watch(viewd, LEDS, &viewd->leds_source, dio_leds_get_fd(viewd->leds),
			  on_leds)) {
		close_leds(viewd);
	} else {
		dio_viewd_set_leds(viewd);
	}
}

static void open_page(struct dio_viewd *viewd)
{
	struct dio_error why = {""};

	if (dio_viewd_page_open(viewd, &why) != DIO_OK)
		complain(viewd, PAGE, &why);
	else
		viewd->devices_warned[PAGE] = false;
}

void dio_viewd_open_devices(struct dio_viewd *viewd)
{
	if (!viewd->display)
		open_display(viewd);
	if (!viewd->buttons && viewd->profile->button_count > 0)
		open_buttons(viewd);
	if (!viewd->leds && viewd->profile->led_count > 0)
		open_leds(viewd);
	if (!viewd->page.web && viewd->profile->web.enabled)
		open_page(viewd);
}

void dio_viewd_close_devices(struct dio_viewd *viewd)
{
	close_display(viewd);
	close_buttons(viewd);
	close_leds(viewd);
	dio_viewd_page_close(viewd);
}

void dio_viewd_set_leds(struct dio_viewd *viewd)
{
	struct dio_error why = {""};

	if (!viewd->leds)
		return;
	if (dio_leds_set_state(viewd->leds, dio_viewd_machine_led(&viewd->machine), &why) !=
	    DIO_OK) {
		complain(viewd, LEDS, &why);
		close_leds(viewd);
	}
}
