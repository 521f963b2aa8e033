/* What viewd tells the outside: the values behind D-Bus properties, overlay and web page. */
#ifndef DIO_VIEWD_STATUS_H
#define DIO_VIEWD_STATUS_H

#include <stdint.h>

#include "viewd/keyframe.h"

/** Flags are int because D-Bus booleans are. Texts are UTF-8. */
struct dio_viewd_status {
	char state[16]; /* of the machine */
	char message[256];
	int alarm;       /* the message tells of a fault */
	char camera[16]; /* "streaming", "no signal", ... */
	char display[128];
	char model[256];
	int calibrated;
	int tracking;      /* the newest picture has a pose */
	uint32_t gathered; /* views of the board */
	double coverage;   /* of the picture by them, [0,1] */
	uint32_t views, views_min, views_max;
	uint32_t skipped[DIO_KEYFRAME_VERDICTS]; /* pictures since the capture began, by verdict */
	char verdict[32];                        /* on the newest picture */
	double progress;                         /* of a reconstruction, [0,1] */
	int scene;                               /* one is open */
	char source[16];                         /* of the viewpoint: "tracked", "orbit", ... */
	double fps, latency_ms, latency_p99_ms, render_ms, track_ms;
	uint32_t patch_px;       /* that pictures are rendered with */
	uint64_t first_shown_us; /* when the first picture of the camera reached the display, by
				  * CLOCK_MONOTONIC; 0: none did */
};

#endif
