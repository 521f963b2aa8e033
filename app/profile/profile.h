/* A board's profile: which camera, display, buttons and LEDs a box has and how it is to run. */
#ifndef DIO_APP_PROFILE_H
#define DIO_APP_PROFILE_H

#include <stdbool.h>
#include <stdint.h>

#include "dio/display.h"
#include "dio/gpio.h"
#include "dio/status.h"
#include "profile/report.h"

#define DIO_PROFILE_TEXT_MAX 256

enum dio_profile_flicker {
	DIO_FLICKER_AUTO,
	DIO_FLICKER_OFF,
	DIO_FLICKER_50HZ,
	DIO_FLICKER_60HZ,
};

enum dio_profile_precision {
	DIO_PRECISION_FLOAT32,
	DIO_PRECISION_BFLOAT16,
	DIO_PRECISION_INT8,
};

/** Whether steps between patches of rendered pictures are evened out. */
enum dio_profile_deblock {
	DIO_PROFILE_DEBLOCK_AUTO, /* as the model's card asks */
	DIO_PROFILE_DEBLOCK_ON,
	DIO_PROFILE_DEBLOCK_OFF,
};

/** What a press asks for. */
enum dio_action {
	DIO_ACTION_NONE,
	DIO_ACTION_CALIBRATE,
	DIO_ACTION_CAPTURE,
	DIO_ACTION_RECONSTRUCT,
	DIO_ACTION_PLAY,
	DIO_ACTION_SAVE,
	DIO_ACTION_CANCEL,
	DIO_ACTION_SHUTDOWN,
};

/** "none", "calibrate" and so on. */
const char *dio_action_name(enum dio_action action);

struct dio_profile_camera {
	char source[DIO_PROFILE_TEXT_MAX];      /* as dio_camera_open() takes it */
	uint32_t width, height;                 /* 0: the device's choice */
	double frames_per_second;               /* 0: the device's choice */
	char calibration[DIO_PROFILE_TEXT_MAX]; /* "": STATE/camera.yaml */
	bool lock;            /* settle, then hold exposure, gain and white balance */
	uint32_t settle_ms;   /* longest wait for that */
	uint32_t exposure_us; /* 0: the camera's automatic */
	double gain;          /* 0: the camera's automatic */
	enum dio_profile_flicker flicker;
};

struct dio_profile_capture {
	char board[DIO_PROFILE_TEXT_MAX]; /* as dio_board_parse() takes it; "": none */
	uint32_t ring_slots;              /* frames that clients can see */
	uint32_t stalled_ms;              /* no frame for so long is "no signal" */
	uint32_t views_min, views_max;    /* keyframes of a reconstruction */
	double new_view_deg;  /* a keyframe looks from at least so far beside the others */
	uint32_t reserve_mib; /* disk space never filled */
};

struct dio_profile_display {
	char output[DIO_PROFILE_TEXT_MAX]; /* as dio_display_open() takes it */
	char connector[64], mode[64];
	double frames_per_second; /* of a video file, and the pace of none */
	bool smooth;
	bool overlay; /* state, progress, rates over the picture */
};

struct dio_profile_engine {
	char model[DIO_PROFILE_TEXT_MAX]; /* "": the shipped one */
	enum dio_profile_precision precision;
	uint32_t threads;                     /* 0: all the process may use */
	uint32_t render_width, render_height; /* of rendered viewpoints */
	uint32_t patch_recon, patch_render;   /* pixels; 0: chosen from the picture's size */
	enum dio_profile_deblock deblock;
};

/** What a button's presses ask for; lines and times are in `buttons` at the same index. */
struct dio_profile_presses {
	enum dio_action short_press, long_press, double_press;
};

struct dio_profile_paths {
	char state[DIO_PROFILE_TEXT_MAX];   /* calibration, recordings, scenes: kept */
	char runtime[DIO_PROFILE_TEXT_MAX]; /* sockets: gone at boot */
};

struct dio_profile_web {
	bool enabled;
	char address[64];
	uint32_t port;
	char token_file[DIO_PROFILE_TEXT_MAX]; /* "": STATE/web-token */
};

struct dio_profile {
	char name[64];
	struct dio_profile_camera camera;
	struct dio_profile_capture capture;
	struct dio_profile_display display;
	struct dio_profile_engine engine;
	char keyboard[DIO_PROFILE_TEXT_MAX]; /* as dio_buttons_options takes it */
	uint32_t button_count, led_count;
	struct dio_button_options buttons[DIO_BUTTONS_MAX];
	struct dio_profile_presses presses[DIO_BUTTONS_MAX];
	struct dio_led_options leds[DIO_LEDS_MAX];
	struct dio_profile_paths paths;
	struct dio_profile_web web;
};

/** What a profile that says nothing means. */
void dio_profile_init(struct dio_profile *profile);

/**
 * Read a profile. Keys that are absent keep what dio_profile_init() gives them.
 *
 * report  NULL, or receives every fault with its line; release with dio_profile_report_deinit()
 *
 * DIO_BAD_FILE  there are faults: the text has the first and their number, `profile` is untouched;
 * DIO_NOT_FOUND, DIO_IO
 */
enum dio_status dio_profile_read(const char *path, struct dio_profile *profile,
				 struct dio_profile_report *report, struct dio_error *error);

/** The profile of the board that this is, where an owner or a package put one. */
#define DIO_PROFILE_BOARD "/etc/diorama/board.ini"

/**
 * The profile a daemon runs by: the one at `path`; with NULL that of the board, when there is one;
 * else what dio_profile_init() gives. As dio_profile_read().
 */
enum dio_status dio_profile_load(const char *path, struct dio_profile *profile,
				 struct dio_error *error);

/** What a press of the button asks for. */
enum dio_action dio_profile_get_action(const struct dio_profile *profile,
				       const struct dio_button_event *event);

/** Options for the drivers, borrowed from the profile. */
struct dio_buttons_options dio_profile_get_buttons(const struct dio_profile *profile);
struct dio_display_options dio_profile_get_display(const struct dio_profile *profile);

#endif
