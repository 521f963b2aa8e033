#include "profile/profile.h"

void dio_profile_init(struct dio_profile *profile)
{
	*profile = (struct dio_profile){
		.name = "unnamed",
		.camera = {.source = "v4l2:/dev/video0", .lock = true, .settle_ms = 2000},
		.capture = {.ring_slots = 8,
			    .stalled_ms = 2000,
			    .views_min = 4,
			    .views_max = 16,
			    .new_view_deg = 8,
			    .reserve_mib = 256},
		.display = {.output = "none", .smooth = true, .overlay = true},
		.engine = {.render_width = 256, .render_height = 256},
		.paths = {.state = "/var/lib/diorama", .runtime = "/run/diorama"},
		.web = {.address = "127.0.0.1", .port = 8080},
	};
}

enum dio_action dio_profile_get_action(const struct dio_profile *profile,
				       const struct dio_button_event *event)
{
	const struct dio_profile_presses *presses = &profile->presses[event->button];

	switch (event->press) {
	case DIO_PRESS_SHORT:
		return presses->short_press;
	case DIO_PRESS_LONG:
		return presses->long_press;
	case DIO_PRESS_DOUBLE:
		return presses->double_press;
	}
	return DIO_ACTION_NONE;
}

struct dio_buttons_options dio_profile_get_buttons(const struct dio_profile *profile)
{
	return (struct dio_buttons_options){.buttons = profile->buttons,
					    .count = profile->button_count,
					    .keyboard = profile->keyboard};
}

struct dio_display_options dio_profile_get_display(const struct dio_profile *profile)
{
	return (struct dio_display_options){
		.connector = profile->display.connector,
		.mode = profile->display.mode,
		.title = "Diorama",
		.frames_per_second = profile->display.frames_per_second,
		.smooth = profile->display.smooth,
	};
}
