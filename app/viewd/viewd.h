/* The display daemon: one event loop that holds tracker, engine, store, display and buttons
 * together. Everything here runs on the loop's thread unless it says otherwise. */
#ifndef DIO_VIEWD_VIEWD_H
#define DIO_VIEWD_VIEWD_H

#include <stdatomic.h>
#include <systemd/sd-event.h>

#include "bus/bus.h"
#include "capture/board_views.h"
#include "core/session.h"
#include "dio/calibration.h"
#include "dio/display.h"
#include "dio/gpio.h"
#include "profile/profile.h"
#include "viewd/figures.h"
#include "viewd/keyframe.h"
#include "viewd/machine.h"
#include "viewd/pace.h"
#include "viewd/page.h"
#include "viewd/screen.h"
#include "viewd/status.h"
#include "viewd/store.h"
#include "viewd/tracker.h"
#include "viewd/viewpoint.h"
#include "viewd/worker.h"

#define DIO_VIEWD_TAGS 16u

/** A rendered picture and where it was seen from. */
struct dio_viewd_shot {
	bool is_there;
	uint64_t taken_ns; /* timestamp of the camera's picture behind the pose; 0: none */
	struct dio_picture picture;
	struct dio_camera_model camera;
	struct dio_pose pose;
};

/** One picture on its way from a viewpoint to pixels; one at a time. */
struct dio_viewd_render {
	struct dio_job job;
	bool busy;
	struct dio_camera_model camera;
	struct dio_pose pose;
	uint64_t taken_ns, time_ns;
	uint32_t patch_px;
	struct dio_picture picture;
};

/** One picture on its way to the display; one at a time. */
struct dio_viewd_compose {
	struct dio_job job;
	bool busy;
	uint32_t width, height;
	bool smooth, with_overlay;
	struct dio_picture source;
	struct dio_screen screen;
	struct dio_overlay overlay;
	uint64_t taken_ns;
};

struct dio_viewd {
	const struct dio_profile *profile;
	sd_event *loop;
	bool quitting, power_off;

	/* What the camera sees. */
	char *camera_file;
	bool has_board;
	struct dio_board board;
	bool calibrated;
	struct dio_camera_model camera, pinhole; /* as captured; of the engine's pictures */
	struct dio_tracker *tracker;
	struct dio_tracked tracked; /* the newest */

	/* Calibration. */
	struct dio_board_views gathered;
	uint32_t fit_views_due; /* so many views, then a fit */
	atomic_uint fit_number; /* of the fit whose answer is waited for: others give up */

	/* Capture. */
	struct dio_store *store; /* used on the files thread once the loop runs */
	struct dio_keyframes keyframes;
	struct dio_trajectory walk; /* where the camera went while capturing */
	uint32_t walk_count;
	char *capture_folder; /* where the store keeps them; NULL before there are any */
	uint32_t views;       /* stored */
	bool views_closed;    /* see struct dio_viewd_facts */
	bool take_now;        /* the next picture with a pose is kept whatever it is worth */
	bool due_at_start;    /* a reconstruction was under way when the last run ended */

	/* The engine. */
	struct dio_worker *engine, *files, *screen;
	struct dio_session *session; /* used on the engine's thread once it is open */
	bool engine_opening, engine_ready, scene_there;
	atomic_bool cancel;
	atomic_uint progress;                 /* of 1000 */
	struct dio_camera_model scene_camera; /* of the scene's views */
	struct dio_viewpoint viewpoint;
	struct dio_pace pace;
	struct dio_viewd_render render;
	struct dio_viewd_shot shot; /* the last one rendered */
	uint64_t rendered_taken_ns, next_frame_ns;
	sd_event_source *frame_source;
	bool turned; /* a hand moved since the last picture */

	/* The display. */
	struct dio_display *display;
	struct dio_display_info display_info;
	sd_event_source *display_source;
	struct dio_viewd_compose compose;
	bool picture_waits; /* composing was busy when a picture came */
	bool composed;      /* since the last tick */
	uint64_t composed_taken_ns;
	uint64_t next_tag, tags_taken_ns[DIO_VIEWD_TAGS];
	struct dio_figures figures;

	/* Buttons, LEDs, bus, web page. */
	struct dio_buttons *buttons;
	sd_event_source *buttons_source;
	struct dio_leds *leds;
	sd_event_source *leds_source;
	struct dio_bus *bus;
	const char *bus_address;
	struct dio_viewd_page page;
	bool devices_warned[4];
	uint64_t devices_due_ns; /* look again for those that are missing */

	struct dio_viewd_machine machine;
	void (*on_event)(struct dio_viewd *viewd, enum dio_viewd_event_kind kind);
	struct dio_viewd_status status, said; /* now, and as the bus was told */
	bool news; /* the bus, and the LEDs, are to be told before the loop goes on */
};

/*
 * The files of the daemon, from the ground up: each calls what is declared above it. What is below
 * hears of events by dio_viewd_tell(), and of all that changes by the loop's turn.
 */

/* daemon.c */

/** The line that overlay and bus show, also logged. */
__attribute__((format(printf, 3, 4))) void dio_viewd_say(struct dio_viewd *viewd, bool alarm,
							 const char *format, ...);
/** Something happened that the machine wants to know of; returns when its orders are carried out.
 */
void dio_viewd_tell(struct dio_viewd *viewd, enum dio_viewd_event_kind kind);
/** Does somebody look at the web page? */
bool dio_viewd_page_is_watched(const struct dio_viewd *viewd);

/* jobs.c, jobs_views.c: work on the engine's and the files' thread. */

void dio_viewd_open_engine(struct dio_viewd *viewd);
/** Bytes that the scene's file will take. */
uint64_t dio_viewd_scene_bytes(const struct dio_viewd *viewd);
void dio_viewd_begin_views(struct dio_viewd *viewd);
/** Keep the picture of viewd->tracked. */
void dio_viewd_store_view(struct dio_viewd *viewd);
void dio_viewd_reconstruct(struct dio_viewd *viewd);
/** call: NULL, or the method call that waits for the folder's name. */
void dio_viewd_save(struct dio_viewd *viewd, const char *name, sd_bus_message *call);

/* calibrate.c */

/** Adopt a camera model; NULL: there is none. */
enum dio_status dio_viewd_set_camera(struct dio_viewd *viewd, const struct dio_camera_model *camera,
				     enum dio_board_layout layout, struct dio_error *error);
/** Forget the views of the board. */
void dio_viewd_begin_gather(struct dio_viewd *viewd);
/** Offer the corners of viewd->tracked. */
void dio_viewd_gather(struct dio_viewd *viewd);
/** Fit the camera to the views of the board, on the engine's thread. */
void dio_viewd_fit(struct dio_viewd *viewd);

/* show.c: the display loop. */

/** Bring the next picture on its way, if one is due. */
void dio_viewd_show(struct dio_viewd *viewd);
/** Compose the last picture anew: the display is another, or was not there when it came. */
void dio_viewd_show_again(struct dio_viewd *viewd);
/** Called four times a second: the overlay goes on when no picture comes. */
void dio_viewd_show_tick(struct dio_viewd *viewd);
/** The camera's newest picture is there. */
void dio_viewd_show_camera(struct dio_viewd *viewd);
/** Turn the scene by hand; DIO_REFUSED: none is shown. */
enum dio_status dio_viewd_turn(struct dio_viewd *viewd, double azimuth, double elevation,
			       double notches, struct dio_error *error);
enum dio_status dio_viewd_follow(struct dio_viewd *viewd, struct dio_error *error);
/** The picture that the state shows, before scaling and overlay; NULL: none. Good until the loop
 * goes on. */
const struct dio_picture *dio_viewd_get_shown(const struct dio_viewd *viewd);
/** Into a zero-initialised picture or one of an earlier call; false: memory is short. */
bool dio_viewd_copy_picture(const struct dio_picture *from, struct dio_picture *to);
void dio_viewd_release_pictures(struct dio_viewd *viewd);

/* look.c: what is made of the tracker's results. */

void dio_viewd_look(struct dio_viewd *viewd);

/* steps.c: the machine, and carrying out its orders. */

/** A button or a caller asks for something. Statuses as dio_viewd_machine_step(). */
enum dio_status dio_viewd_ask(struct dio_viewd *viewd, enum dio_action action,
			      struct dio_error *error);
/** What dio_viewd_tell() leads to. */
void dio_viewd_take_event(struct dio_viewd *viewd, enum dio_viewd_event_kind kind);
/** Say what to do next. */
void dio_viewd_greet(struct dio_viewd *viewd);

/* devices.c (and page.c): display, buttons, LEDs and web page, which come and go. */

/** Open what is not open; called again and again. */
void dio_viewd_open_devices(struct dio_viewd *viewd);
void dio_viewd_close_devices(struct dio_viewd *viewd);
void dio_viewd_set_leds(struct dio_viewd *viewd);

/* control.c: the bus. */

enum dio_status dio_viewd_open_bus(struct dio_viewd *viewd, struct dio_error *error);
/** Find the bus again where it went away; called again and again. */
void dio_viewd_keep_bus(struct dio_viewd *viewd);
/** Bring viewd->status up to date and tell the bus what changed. */
void dio_viewd_publish(struct dio_viewd *viewd);
/** Ask the system to power off. */
void dio_viewd_power_off(struct dio_viewd *viewd);

/* viewd.c */

struct dio_viewd_options {
	const struct dio_profile *profile;
	const char *bus; /* as dio_bus_open() takes it; "none": no bus */
};

/** Set everything up; the loop is the caller's and runs afterwards. */
enum dio_status dio_viewd_open(const struct dio_viewd_options *options, sd_event *loop,
			       struct dio_viewd *viewd, struct dio_error *error);
/** Waits for the jobs that run. */
void dio_viewd_close(struct dio_viewd *viewd);

#endif
