/* What the KMS display needs of the kernel, as a table: kms_drm.c fills it over libdrm, tests put a
 * scripted card behind it. */
#ifndef DIO_DISPLAY_KMS_H
#define DIO_DISPLAY_KMS_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <xf86drmMode.h>

#include "backend.h"

#define DIO_KMS_CONNECTORS_MAX 16
#define DIO_KMS_MODES_MAX      64

struct dio_kms_connector {
	uint32_t id;
	char name[32]; /* "HDMI-A-1" */
	bool connected;
	uint32_t possible_crtcs; /* bit i: the card's crtc number i */
	int current_crtc;        /* number, -1: none */
	uint32_t mode_count;
	drmModeModeInfo modes[DIO_KMS_MODES_MAX];
};

/** What a card has at the moment. */
struct dio_kms_outputs {
	uint32_t connector_count, crtc_count;
	struct dio_kms_connector connectors[DIO_KMS_CONNECTORS_MAX];
};

/** A way to a screen. */
struct dio_kms_route {
	uint32_t connector_id;
	char connector_name[32];
	uint32_t crtc; /* number */
	drmModeModeInfo mode;
};

/** Scan-out memory, XRGB8888. */
struct dio_kms_buffer {
	uint32_t fb, handle;
	size_t pitch_bytes, size_bytes;
	uint8_t *pixels;
};

/** A flip that happened. */
struct dio_kms_flip {
	uint64_t cookie;
	uint64_t time_ns; /* CLOCK_MONOTONIC of the vertical blank */
};

/** A virtual terminal's owner wants it back, or gives it. */
enum dio_kms_terminal {
	DIO_KMS_TERMINAL_SAME,
	DIO_KMS_TERMINAL_LEAVES,
	DIO_KMS_TERMINAL_COMES,
};

/** Functions that return int give -1 and set errno; `context` is handed through. */
struct dio_kms_system {
	void *context;
	/** Path of card number `index`; false past the last. */
	bool (*list)(void *context, uint32_t index, char *path, size_t path_size);
	/** EBUSY: another program is master. EOPNOTSUPP: nothing to scan out from here. */
	int (*open)(void *context, const char *path, void **card);
	/** Put back what was on the screens when the card was opened. */
	void (*restore)(void *context, void *card);
	void (*close)(void *context, void *card);
	int (*probe)(void *context, void *card, struct dio_kms_outputs *outputs);
	int (*create_buffer)(void *context, void *card, uint32_t width, uint32_t height,
			     struct dio_kms_buffer *buffer);
	void (*destroy_buffer)(void *context, void *card, struct dio_kms_buffer *buffer);
	/** Bring a route up with a buffer on it; waits until it is. */
	int (*set_mode)(void *context, void *card, const struct dio_kms_route *route,
			const struct dio_kms_buffer *buffer);
	/** Show a buffer from the next vertical blank; does not wait. EBUSY: one is on its way. */
	int (*flip)(void *context, void *card, const struct dio_kms_route *route,
		    const struct dio_kms_buffer *buffer, uint64_t cookie);
	void (*turn_off)(void *context, void *card, const struct dio_kms_route *route);
	/** Readable when one of the three below has news. */
	int (*get_fd)(void *context, void *card);
	/** The next flip: 1, none: 0. */
	int (*read_flip)(void *context, void *card, struct dio_kms_flip *flip);
	/** Has something been plugged or unplugged since the last call? */
	bool (*read_hotplug)(void *context, void *card);
	enum dio_kms_terminal (*read_terminal)(void *context, void *card);
	/** Let another program have the screen; take it back. */
	void (*release)(void *context, void *card);
	int (*reclaim)(void *context, void *card);
	uint64_t (*now_ns)(void *context); /* CLOCK_MONOTONIC */
};

/** The kernel, through libdrm. */
extern const struct dio_kms_system dio_kms_kernel;

/** Over a system of the caller's choice, which must outlive the display. */
enum dio_status dio_display_open_kms_on(const struct dio_kms_system *system, const char *card,
					const struct dio_display_mode *mode,
					const struct dio_display_options *options,
					struct dio_display **display, struct dio_error *error);

/** What was wished of a screen. */
struct dio_kms_wish {
	char connector[64]; /* "": any that is connected */
	struct dio_display_mode mode;
};

double dio_kms_refresh_hz(const drmModeModeInfo *mode);

/**
 * Choose connector, crtc and mode: the wished ones, else the first screen and the mode it prefers.
 * A mode that the screen does not offer is passed over for the one it prefers.
 *
 * refused  bit i: mode i of that connector was tried in vain
 * mode     receives the index of the mode chosen
 *
 * false: no screen to show on
 */
bool dio_kms_choose(const struct dio_kms_outputs *outputs, const struct dio_kms_wish *wish,
		    uint64_t refused, struct dio_kms_route *route, uint32_t *mode);

/** Is an errno that of a program which is not master of the card? */
bool dio_kms_is_refused(int cause);

/**
 * Open the card at a path, or with "" the first that has a screen as wished, else the first that
 * could have one.
 *
 * opened, path, outputs  receive the card, its path and what it has
 */
enum dio_status dio_kms_open_card(const struct dio_kms_system *system, const char *card,
				  const struct dio_kms_wish *wish, void **opened, char *path,
				  size_t path_size, struct dio_kms_outputs *outputs,
				  struct dio_error *error);

#endif
