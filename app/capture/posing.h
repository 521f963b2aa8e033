/* Poses from a board in view, and the engine's pictures, as `diorama poses` and the demo run it. */
#ifndef DIO_CAPTURE_POSING_H
#define DIO_CAPTURE_POSING_H

#include <cjson/cJSON.h>
#include <stdbool.h>
#include <stdint.h>

#include "capture/input.h"
#include "core/scene_file.h"
#include "dio/board.h"
#include "dio/frame.h"
#include "dio/geometry.h"
#include "dio/pose.h"
#include "dio/status.h"

/** What became of one picture. */
enum dio_posed_use {
	DIO_POSED_CONTEXT,  /* a view to reconstruct from */
	DIO_POSED_TARGET,   /* held back, to compare with */
	DIO_POSED_SPARE,    /* posed and not wanted: there are enough views */
	DIO_POSED_NO_BOARD, /* no board in view */
	DIO_POSED_REFUSED,  /* too few corners, or two poses that cannot be told apart */
	DIO_POSED_OUTLIER,  /* reprojection error far above the others' */
};

/** One picture. */
struct dio_posed_view {
	char *name;
	enum dio_posed_use use;
	char reason[160];                  /* why it has no pose; "" when it has one */
	struct dio_pose_estimate estimate; /* with use CONTEXT, TARGET and SPARE */
	uint64_t timestamp_ns, index;      /* of the frame in its input */
	struct dio_picture picture;        /* the engine's; rgb NULL without a pose */
};

struct dio_posing_options {
	struct dio_camera_options camera; /* wishes about size and rate */
	uint32_t width,
		height;    /* engine pictures; 0: the long side DIO_ENGINE_SIDE_PX, shape kept */
	uint32_t frames;   /* most pictures taken of a stream */
	double seconds;    /* longest time before a camera */
	uint32_t hold_out; /* every n-th posed picture is a target; 0: chosen, see below */
	bool hold_out_none;
	uint32_t context; /* most context views, spread as far apart as can be; 0: all */
};

/** The long side of engine pictures where nothing else is asked. */
#define DIO_ENGINE_SIDE_PX 256u

/** What the command line uses. */
void dio_posing_defaults(struct dio_posing_options *options);

/** Release with dio_posing_deinit(). */
struct dio_posing {
	struct dio_camera_model pinhole; /* of all engine pictures */
	struct dio_posed_view *views;
	uint32_t count, capacity;
	uint32_t posed, context, targets; /* context and targets are among the posed */
	double rms_px;                    /* mean over the posed views */
};

/**
 * Pose every picture of an input (of a stream: up to options->frames, spread over it), undistort
 * it to the engine's size, and choose who is context and who is target: every hold_out-th posed
 * picture is held back (0: every 8th of 16 and more, every third of fewer), the rest is context.
 * Pictures without a board are listed, not guessed.
 *
 * result  zero-initialised; filled when DIO_REFUSED too
 *
 * DIO_REFUSED  no picture shows the board well enough, or none of them is the camera's size
 */
enum dio_status dio_posing_run(const char *input, const struct dio_camera_model *model,
			       const struct dio_board *board,
			       const struct dio_posing_options *options, struct dio_posing *result,
			       struct dio_error *error);
void dio_posing_deinit(struct dio_posing *result);

/** Write scene.json at `path` and the pictures under images/ beside it. */
enum dio_status dio_posing_write(const struct dio_posing *result, const char *name,
				 const char *path, struct dio_error *error);

/** Print every picture and what became of it. */
void dio_posing_print(const struct dio_posing *result);
/** The same as JSON. NULL when memory is short. */
cJSON *dio_posing_json(const struct dio_posing *result);

#endif
