/* The thread that looks: newest frame of the ring, board, pose, the engine's picture. */
#ifndef DIO_VIEWD_TRACKER_H
#define DIO_VIEWD_TRACKER_H

#include <stdbool.h>
#include <stdint.h>

#include "dio/board.h"
#include "dio/frame.h"
#include "dio/geometry.h"
#include "dio/pose.h"
#include "dio/status.h"
#include "ring/state.h"
#include "viewd/keyframe.h"

/** How much is made of a frame. Each does what those before it do. */
enum dio_tracker_task {
	DIO_TRACKER_LOOK,    /* the picture */
	DIO_TRACKER_FIND,    /* corners of the board */
	DIO_TRACKER_TRACK,   /* pose of the camera, once it is calibrated */
	DIO_TRACKER_CAPTURE, /* the engine's picture, and what it is worth */
};

/** What became of the newest frame. Zero-initialise; release with dio_tracked_deinit(). */
struct dio_tracked {
	enum dio_capture_state camera;
	char camera_text[200];
	enum dio_tracker_task task; /* that was done */
	bool fresh;                 /* there is a new picture; false: the camera's state is all */
	uint64_t timestamp_ns, index;
	struct dio_picture picture; /* as captured */
	struct dio_corners corners;
	bool pose_known;
	struct dio_pose_estimate estimate;
	bool undistorted_known;
	struct dio_camera_model pinhole;
	struct dio_picture undistorted; /* of camera `pinhole` */
	struct dio_keyframe_quality quality;
	uint64_t work_ns; /* from the frame's arrival to all this */
	char fault[200];  /* why a frame could not be used; "" */
};

struct dio_tracker_options {
	const char *socket;            /* of the ring; NULL: where the daemon listens by default */
	const struct dio_board *board; /* NULL: none is known; nothing is found then */
};

/** Opaque; every function is for the loop's thread. */
struct dio_tracker;

/** Start the thread. The capture daemon need not be there yet. */
enum dio_status dio_tracker_start(const struct dio_tracker_options *options,
				  struct dio_tracker **tracker, struct dio_error *error);
/** Ends within a frame's work. NULL is fine. */
void dio_tracker_stop(struct dio_tracker *tracker);

void dio_tracker_set_task(struct dio_tracker *tracker, enum dio_tracker_task task);

/**
 * The calibrated camera, and the size of the engine's pictures; NULL: it is not calibrated.
 *
 * layout   of the board, as the calibration decided it
 */
void dio_tracker_set_camera(struct dio_tracker *tracker, const struct dio_camera_model *camera,
			    uint32_t width, uint32_t height, enum dio_board_layout layout);

/** Readable when dio_tracker_take() has something. */
int dio_tracker_get_fd(const struct dio_tracker *tracker);

/**
 * Take what is newest in exchange for an earlier result, whose memory is used again. Nothing waits
 * for this: a result that was not taken gives way to the next.
 *
 * false: nothing since the last call; `tracked` is untouched
 */
bool dio_tracker_take(struct dio_tracker *tracker, struct dio_tracked *tracked);
void dio_tracked_deinit(struct dio_tracked *tracked);

#endif
