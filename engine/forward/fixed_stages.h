/* Both stages of the fixed-point path, from checked arguments on. Private to the engine. */
#ifndef DVSM_FORWARD_FIXED_STAGES_H
#define DVSM_FORWARD_FIXED_STAGES_H

#include "dvsm/engine.h"
#include "fixed/run.h"
#include "scene/scene_internal.h"

/** Fill scene->fixed; DVSM_CANCELLED when the caller's progress function asks to stop. */
enum dvsm_status dvsm_fixed_reconstruct(const struct dvsm_fixed_run *run, struct dvsm_scene *scene,
					const struct dvsm_view *views, dvsm_progress_fn *progress,
					void *progress_context, struct dvsm_error *error);

/**
 * Render the views of a group, which are all there are; floats are multiples of 2^-16, up to 128.
 *
 * cameras, out  [group->views]
 */
void dvsm_fixed_render(const struct dvsm_fixed_run *run, const struct dvsm_scene *scene,
		       const struct dvsm_group *group, const struct dvsm_camera *cameras,
		       uint32_t patch_px, const struct dvsm_picture_out *out);

#endif
