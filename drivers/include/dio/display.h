/* Displays behind one interface: KMS (bare screen), a window, a video file, none. */
#ifndef DIO_DISPLAY_H
#define DIO_DISPLAY_H

#include <stdbool.h>
#include <stdint.h>

#include "dio/frame.h"
#include "dio/status.h"

#ifdef __cplusplus
extern "C" {
#endif

/**
 * Which display, and how. Every text may be NULL or "".
 *
 * connector  KMS: "HDMI-A-1"; empty: the first that is connected
 * mode       KMS: "1920x1080", "1920x1080@60"; empty: the one the screen prefers.
 *            Window, file, none: "1280x720"; empty: 1280x720
 * smooth     scale pictures bilinearly; otherwise the nearest pixel
 */
struct dio_display_options {
	const char *connector;
	const char *mode;
	const char *title;        /* of a window */
	double frames_per_second; /* of a video file, and the pace of none; 0: 30 */
	bool smooth;
};

enum dio_display_state {
	DIO_DISPLAY_ON,
	DIO_DISPLAY_OFF,  /* no connector has a screen, or it was switched off */
	DIO_DISPLAY_AWAY, /* another program or virtual terminal has the screen */
};

struct dio_display_info {
	char name[128];         /* "kms /dev/dri/card0 HDMI-A-1", for messages */
	uint32_t width, height; /* of the picture area in use; 0 while there is none */
	double refresh_hz;      /* 0: none or unknown */
	enum dio_display_state state;
};

struct dio_display_counters {
	uint64_t shown;    /* pictures that reached the screen */
	uint64_t replaced; /* pictures passed over for a newer one before they were shown */
	uint64_t lost;     /* pictures that were on their way when the display went off */
};

enum dio_display_event_kind {
	DIO_DISPLAY_FLIPPED, /* the picture with `tag` is on the screen since `time_ns` */
	DIO_DISPLAY_CHANGED, /* state or size is another: dio_display_get_info() */
	DIO_DISPLAY_KEY,     /* window: a key went down or up */
	DIO_DISPLAY_QUIT,    /* window: closed */
};

struct dio_display_event {
	enum dio_display_event_kind kind;
	uint64_t time_ns; /* CLOCK_MONOTONIC; KMS: the vertical blank as the kernel stamped it */
	uint64_t tag;     /* flipped: as given to dio_display_show() */
	uint32_t key;     /* code of linux/input-event-codes.h */
	bool pressed;
};

/** Opaque, thread-bound. */
struct dio_display;

/**
 * Open a display. One that is off is opened all the same and comes on when it can.
 *
 * spec   "kms" (the first card with a screen) or "kms:/dev/dri/card0"; "window";
 *        "file:PATH.mp4"; "none" (keeps time, shows nothing)
 *
 * DIO_BAD_ARG (the text says which word), DIO_NOT_FOUND, DIO_BUSY (another program is master of
 * the card), DIO_UNSUPPORTED (the card cannot scan out XRGB8888, or this build has no such display)
 */
enum dio_status dio_display_open(const char *spec, const struct dio_display_options *options,
				 struct dio_display **display, struct dio_error *error);

/**
 * Are the words right and, with `look`, is the device there? Nothing is opened or changed.
 *
 * DIO_BAD_ARG, DIO_NOT_FOUND
 */
enum dio_status dio_display_check(const char *spec, const struct dio_display_options *options,
				  bool look, struct dio_error *error);

/** Puts back what was on the screen before; finishes a file. NULL is fine. */
enum dio_status dio_display_close(struct dio_display *display, struct dio_error *error);

/** Readable (POLLIN) when dio_display_poll() has work; stays the same for the object's life. */
int dio_display_get_fd(const struct dio_display *display);

/**
 * Show a picture: as large as fits with its proportions kept, black around. Never waits for the
 * screen: three slots are pending, queued and on the screen, and a picture that is still pending
 * is replaced by the newer one.
 *
 * picture   any size; one of the display's own size is copied pixel by pixel
 * tag       comes back in the event when the picture is on the screen
 *
 * DIO_NO_SIGNAL  the display is off or away: a state, the picture is not kept
 */
enum dio_status dio_display_show(struct dio_display *display, const struct dio_picture *picture,
				 uint64_t tag, struct dio_error *error);

/**
 * Take the next event; waits up to timeout_ns (0: not at all) for one.
 *
 * DIO_AGAIN  none in time; DIO_GONE  the card was removed: close
 */
enum dio_status dio_display_poll(struct dio_display *display, int64_t timeout_ns,
				 struct dio_display_event *event, struct dio_error *error);

void dio_display_get_info(const struct dio_display *display, struct dio_display_info *info);
void dio_display_get_counters(const struct dio_display *display,
			      struct dio_display_counters *counters);

#ifdef __cplusplus
}
#endif
#endif
