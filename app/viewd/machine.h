/* What the appliance does next: idle, calibrate, capture, reconstruct, view, play. No devices here:
 * events and facts go in, orders come out. */
#ifndef DIO_VIEWD_MACHINE_H
#define DIO_VIEWD_MACHINE_H

#include <stdbool.h>
#include <stdint.h>

#include "dio/status.h"
#include "profile/profile.h"

enum dio_viewd_state {
	DIO_VIEWD_IDLE,        /* the camera's picture is shown */
	DIO_VIEWD_CALIBRATE,   /* views of the board are gathered, then the camera is fitted */
	DIO_VIEWD_CAPTURE,     /* posed views are gathered */
	DIO_VIEWD_RECONSTRUCT, /* the engine makes a scene of them */
	DIO_VIEWD_VIEW,        /* the scene is shown from the tracked viewpoint */
	DIO_VIEWD_PLAY,        /* the scene is shown along a path */
	DIO_VIEWD_STATE_COUNT,
};

/** "idle", "calibrate" and so on. */
const char *dio_viewd_state_name(enum dio_viewd_state state);

enum dio_viewd_event_kind {
	DIO_VIEWD_STARTED,       /* the store is open: facts say what it holds */
	DIO_VIEWD_ASKED,         /* a button or a caller asks for `action` */
	DIO_VIEWD_GATHERED,      /* there are enough views of the board for a fit */
	DIO_VIEWD_FITTED,        /* the camera is calibrated, and the file is written */
	DIO_VIEWD_FIT_REFUSED,   /* the views are too poor: more are needed */
	DIO_VIEWD_VIEWS_FULL,    /* as many views as a reconstruction takes */
	DIO_VIEWD_STORE_FAILED,  /* a view could not be kept */
	DIO_VIEWD_RECONSTRUCTED, /* the scene is there, and its file is written */
	DIO_VIEWD_CANCELLED,     /* the engine stopped as asked */
	DIO_VIEWD_ENGINE_FAILED, /* reconstruction or rendering failed */
	DIO_VIEWD_EVENT_COUNT,
};

struct dio_viewd_event {
	enum dio_viewd_event_kind kind;
	enum dio_action action; /* of ASKED */
};

/** What is so at the time of an event. */
struct dio_viewd_facts {
	bool board_known;      /* the profile names a board */
	bool calibrated;       /* there is a camera model */
	bool engine_opening;   /* a model is being opened */
	bool engine_ready;     /* a model is open */
	bool camera_streaming; /* pictures come */
	bool pose_known;       /* the newest picture shows the board well enough */
	bool scene_there;      /* a scene is open */
	bool views_closed;     /* the stored views have their scene, or are of another camera */
	bool reconstruct_due;  /* a reconstruction was under way when the power went */
	bool space_for_views;  /* the disk has room for a capture */
	bool space_for_scene;  /* the disk has room for the scene's file */
	uint32_t gathered;     /* views of the board */
	uint32_t views, views_min;
};

/** Orders, or-ed: what the caller has to do after a step, in this sequence. */
enum dio_viewd_order {
	DIO_VIEWD_CANCEL_ENGINE = 1 << 0,
	DIO_VIEWD_BEGIN_GATHER = 1 << 1, /* forget the views of the board, gather anew */
	DIO_VIEWD_FIT = 1 << 2,          /* fit the camera to the views of the board */
	DIO_VIEWD_BEGIN_VIEWS = 1 << 3,  /* begin a new set of views */
	DIO_VIEWD_TAKE_VIEW = 1 << 4,    /* keep the newest view whatever the chooser says */
	DIO_VIEWD_RECONSTRUCT_NOW = 1 << 5,
	DIO_VIEWD_SAVE_NOW = 1 << 6,
	DIO_VIEWD_QUIT = 1 << 7,
};

/** Zero-initialised: idle. */
struct dio_viewd_machine {
	enum dio_viewd_state state;
	bool fitting;    /* a fit is under way */
	bool cancelling; /* the engine was told to stop and has not yet */
	bool failed;     /* the last thing asked for went wrong; until the next action */
};

/**
 * Take an event.
 *
 * orders  receives what to do, 0 for nothing
 * why     NULL, or says why an action was refused
 *
 * DIO_REFUSED   the action makes no sense here or lacks something; nothing changed
 * DIO_BUSY      the engine is at work: cancel first
 * DIO_NO_SPACE  the disk has no room for what would come
 */
enum dio_status dio_viewd_machine_step(struct dio_viewd_machine *machine,
				       const struct dio_viewd_event *event,
				       const struct dio_viewd_facts *facts, uint32_t *orders,
				       struct dio_error *why);

/** What the LEDs show. */
enum dio_led_state dio_viewd_machine_led(const struct dio_viewd_machine *machine);

#endif
