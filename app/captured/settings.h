/* What the capture daemon was told: a board's profile, and the command line over it. */
#ifndef DIO_CAPTURED_SETTINGS_H
#define DIO_CAPTURED_SETTINGS_H

#include <stdbool.h>
#include <stdint.h>

#include "dio/camera.h"
#include "dio/status.h"

struct dio_captured_settings {
	char camera[256]; /* as dio_camera_open() takes it */
	struct dio_camera_options options;
	struct dio_camera_wish
		wish;        /* exposure, gain and flicker; hold: at the start of a stream */
	uint32_t settle_ms;  /* longest wait before holding */
	uint32_t stalled_ms; /* without a frame for so long the stream counts as stalled */
	uint32_t ring_slots;
	char socket[108];     /* of the frame ring */
	char recordings[272]; /* folder of the recordings */
	uint32_t reserve_mib; /* disk space never filled */
	char bus[256];        /* as dio_bus_open() takes it; "": its default; "none": no bus */
};

enum dio_settings_result {
	DIO_SETTINGS_RUN,
	DIO_SETTINGS_HELP,  /* --help or --version was printed: exit 0 */
	DIO_SETTINGS_WRONG, /* one line was printed: exit 2 */
	DIO_SETTINGS_FAILED /* one line was printed: exit 1 */
};

/** Read argv and the profile it names; without --profile the default one, if there is one. */
enum dio_settings_result dio_captured_settings_read(struct dio_captured_settings *settings,
						    int argc, char **argv);

#endif
