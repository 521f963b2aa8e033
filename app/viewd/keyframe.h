/* Which tracked pictures are worth keeping: sharp, well exposed, from a new viewpoint. */
#ifndef DIO_VIEWD_KEYFRAME_H
#define DIO_VIEWD_KEYFRAME_H

#include <stdbool.h>
#include <stdint.h>

#include "dio/frame.h"
#include "dio/geometry.h"

/** What became of a picture. */
enum dio_keyframe_verdict {
	DIO_KEYFRAME_KEPT,
	DIO_KEYFRAME_NO_BOARD, /* none in view */
	DIO_KEYFRAME_NO_POSE,  /* too little of it, or two poses that cannot be told apart */
	DIO_KEYFRAME_DARK,     /* underexposed */
	DIO_KEYFRAME_BRIGHT,   /* overexposed */
	DIO_KEYFRAME_BLURRED,  /* far less sharp than the pictures around it */
	DIO_KEYFRAME_MOVING,   /* the camera moves too fast for a sharp picture */
	DIO_KEYFRAME_KNOWN,    /* adds no viewpoint to those kept */
	DIO_KEYFRAME_FULL,     /* there are as many as a reconstruction takes */
	DIO_KEYFRAME_VERDICTS, /* how many verdicts there are */
};

/** A word or two: "blurred", "no new viewpoint". */
const char *dio_keyframe_verdict_name(enum dio_keyframe_verdict verdict);

/** What a picture is worth by itself. */
struct dio_keyframe_quality {
	bool board_seen;  /* not measured: the caller's */
	double sharpness; /* energy of the Laplacian over the variance of the luma; 0 when flat */
	double dark;      /* share of pixels at the bottom of the range */
	double bright;    /* share of pixels clipped at the top */
};

void dio_keyframe_measure(const struct dio_picture *picture, struct dio_keyframe_quality *quality);

struct dio_keyframe_options {
	double new_view_rad;    /* a view that looks from so far beside all others is new */
	double new_view_share;  /* so is one moved by this share of its distance to the centre */
	double clipped_max;     /* more dark or bright pixels than this: badly exposed */
	double sharpness_share; /* of the best around it; below: blurred */
	double speed_max;       /* radians, or shares of the distance, a second */
	uint32_t views_max;
};

/** What the appliance uses; `new_view_deg` and `views_max` are the profile's. */
void dio_keyframe_defaults(double new_view_deg, uint32_t views_max,
			   struct dio_keyframe_options *options);

/** Pictures whose sharpness is remembered. */
#define DIO_KEYFRAME_MEMORY 30

/** The chooser; zero-initialise, then set the options. Release with dio_keyframe_deinit(). */
struct dio_keyframes {
	struct dio_keyframe_options options;
	double (*kept)[16]; /* [count] poses of the views kept */
	uint32_t count, capacity;
	double recent[DIO_KEYFRAME_MEMORY]; /* sharpness of the last pictures, a ring */
	uint32_t recent_count;
	double last_pose[16]; /* of the picture before */
	uint64_t last_ns;     /* 0: none */
	uint32_t verdicts[DIO_KEYFRAME_VERDICTS];
};

/**
 * Judge a picture; nothing is kept yet. Counts the verdict.
 *
 * pose      NULL: none was found; of `quality` board_seen alone is looked at then
 * centre    what the cameras stand round, world frame
 */
enum dio_keyframe_verdict dio_keyframe_judge(struct dio_keyframes *keyframes,
					     const struct dio_keyframe_quality *quality,
					     const struct dio_pose *pose, const double centre[3],
					     uint64_t timestamp_ns);

/** Note a view that is kept; false: memory is short. */
bool dio_keyframe_keep(struct dio_keyframes *keyframes, const struct dio_pose *pose);

/** Forget all views and counts; the options stay. */
void dio_keyframe_clear(struct dio_keyframes *keyframes);
void dio_keyframe_deinit(struct dio_keyframes *keyframes);

#endif
