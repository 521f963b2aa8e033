/* From where the scene is shown: the tracked camera, an orbit, a recorded path, or a hand. */
#ifndef DIO_VIEWD_VIEWPOINT_H
#define DIO_VIEWD_VIEWPOINT_H

#include <stdbool.h>
#include <stdint.h>

#include "core/eye.h"
#include "core/tum.h"

enum dio_viewpoint_source {
	DIO_VIEWPOINT_TRACKED, /* where the camera is */
	DIO_VIEWPOINT_ORBIT,   /* tracking is lost: round the scene */
	DIO_VIEWPOINT_PATH,    /* a recorded path is played */
	DIO_VIEWPOINT_HAND,    /* somebody turned the scene */
};

/** "tracked", "orbit", "path", "hand". */
const char *dio_viewpoint_source_name(enum dio_viewpoint_source source);

/** A camera not seen again for so long is lost. */
#define DIO_VIEWPOINT_LOST_NS UINT64_C(1000000000)

/** Zero-initialise; release with dio_viewpoint_deinit(). */
struct dio_viewpoint {
	struct dio_trajectory orbit, path;
	struct dio_eye eye;
	bool by_hand, playing;
	struct dio_pose tracked;
	uint64_t taken_ns;   /* timestamp of the picture that showed it */
	uint64_t tracked_ns; /* when that was known; 0: never */
	uint64_t began_ns;   /* of orbit or path: their time 0 */
};

/** A new scene: fit the orbit to its cameras; forget path, hand and tracking. */
enum dio_status dio_viewpoint_set_scene(struct dio_viewpoint *viewpoint,
					const struct dio_pose *poses, uint32_t count,
					struct dio_error *error);

/** The path to play; taken over. Without one the orbit is played. */
void dio_viewpoint_set_path(struct dio_viewpoint *viewpoint, struct dio_trajectory *path);

/** Play the path from its start, or follow the camera again. */
void dio_viewpoint_play(struct dio_viewpoint *viewpoint, bool play, uint64_t now_ns);

/** The camera was here when it took the picture of `taken_ns`. */
void dio_viewpoint_track(struct dio_viewpoint *viewpoint, const struct dio_pose *pose,
			 uint64_t taken_ns, uint64_t now_ns);

/** Turn by hand (radians, notches); from then on the hand has it until dio_viewpoint_follow(). */
void dio_viewpoint_turn(struct dio_viewpoint *viewpoint, double azimuth, double elevation,
			double notches);
void dio_viewpoint_follow(struct dio_viewpoint *viewpoint);

/**
 * Where to look from now. A scene must be set.
 *
 * taken_ns  receives the timestamp of the picture that the pose comes from; 0: from none
 */
enum dio_viewpoint_source dio_viewpoint_get(struct dio_viewpoint *viewpoint, uint64_t now_ns,
					    struct dio_pose *pose, uint64_t *taken_ns);

void dio_viewpoint_deinit(struct dio_viewpoint *viewpoint);

#endif
