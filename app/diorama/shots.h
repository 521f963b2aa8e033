/* The viewpoints that `render` renders: targets of a scene, an orbit, or a trajectory. */
#ifndef DIO_DIORAMA_SHOTS_H
#define DIO_DIORAMA_SHOTS_H

#include <stdbool.h>

#include "core/session.h"

/** One viewpoint; `name` is owned, without folder and ending. */
struct shot {
	char *name;
	struct dio_camera_model camera;
	struct dio_pose pose;
};

/** Zero-initialised; release with shots_deinit(). */
struct shots {
	struct shot *list;
	uint32_t count;
	bool is_path;     /* frames of a film, all of one camera */
	const char *name; /* of the film: "orbit", or the trajectory's file; borrowed */
};

struct shots_wish {
	const char *path; /* "orbit", "targets", a TUM file, or NULL: targets if there are any */
	uint32_t frames;  /* of an orbit */
	double frames_per_second;
};

/**
 * Choose viewpoints. The context cameras are the scene's own; `set` adds the targets of a
 * scene.json and is NULL when only a scene cache is at hand.
 */
enum dio_status shots_make(const struct shots_wish *wish, const struct dvsm_scene *scene,
			   const struct dio_view_set *set, struct shots *shots,
			   struct dio_error *error);
void shots_deinit(struct shots *shots);

#endif
