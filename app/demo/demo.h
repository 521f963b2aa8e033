/* The demo: the whole way from camera frames to rendered viewpoints, with what it was worth. */
#ifndef DIO_DEMO_DEMO_H
#define DIO_DEMO_DEMO_H

#include <stdbool.h>
#include <stdint.h>

#include "core/session.h"
#include "dio/status.h"

/** Zero-initialised apart from what dio_demo_defaults() fills in. */
struct dio_demo_options {
	const char *input;      /* folder of photos or a recording; NULL: the simulated camera */
	const char *board;      /* specification of the board */
	const char *out;        /* folder for the results */
	uint32_t seed;          /* of the simulated scene */
	uint32_t stands;        /* views of the board to calibrate from (simulated camera) */
	uint32_t frames;        /* pictures of the walk round the scene (simulated camera) */
	uint32_t width, height; /* engine pictures */
	uint32_t context;       /* most context views */
	uint32_t orbit_frames;
	bool quiet; /* no line a stage */
	struct dio_session_options engine;
};

void dio_demo_defaults(struct dio_demo_options *options);

/**
 * Calibrate, capture, pose, reconstruct, render; leave in options->out: camera.yaml, scene.json
 * with images/, scene.safetensors, sheet.png, orbit.mp4, summary.md and summary.json (and, of the
 * simulated camera, its recording in capture/). Earlier results there are replaced.
 *
 * json  NULL, or receives the summary; release with cJSON_free()
 */
enum dio_status dio_demo_run(const struct dio_demo_options *options, char **json,
			     struct dio_error *error);

#endif
