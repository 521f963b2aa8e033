/* What the files of jobs share. */
#ifndef DIO_VIEWD_JOBS_H
#define DIO_VIEWD_JOBS_H

#include "viewd/viewd.h"

/** Zeroed memory for a job; NULL: memory is short, and the message says so. */
void *dio_viewd_allocate_job(struct dio_viewd *viewd, size_t size);

/** job->owner becomes the daemon. */
void dio_viewd_post(struct dio_viewd *viewd, struct dio_worker *worker, struct dio_job *job,
		    enum dio_status (*run)(struct dio_job *, struct dio_error *),
		    void (*done)(struct dio_job *));

/** What the loop wants to know of a scene. */
struct dio_viewd_rig {
	struct dio_camera_model camera; /* of its first view */
	struct dio_pose *poses;         /* [count] of all; release with free() */
	uint32_t count;
};

/** For any thread; false: memory is short. */
bool dio_viewd_copy_rig(const struct dvsm_scene *scene, struct dio_viewd_rig *rig);

/**
 * A scene is open: fit the viewpoint to it.
 *
 * path   to play, taken over when it has poses
 */
bool dio_viewd_adopt_scene(struct dio_viewd *viewd, const struct dio_viewd_rig *rig,
			   struct dio_trajectory *path);

#endif
