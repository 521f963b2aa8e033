/*
 * MODEL.md in double, written for reading: what every precision and every kernel is measured
 * against. It shares no arithmetic and no file reader with the engine. Its inputs are taken as
 * checked (the engine refuses what is wrong); when memory runs out it says so and exits.
 */
#ifndef TESTS_SUPPORT_REFERENCE64_H
#define TESTS_SUPPORT_REFERENCE64_H

#include "dvsm/camera.h"
#include "dvsm/model.h"

/** Opaque, thread-bound. */
struct support_reference;

/** Read a model file; NULL with a printed line. Release with support_reference_close(). */
struct support_reference *support_reference_open(const char *path);

/** The same from the bytes of a file, borrowed for the call; `name` is for messages. */
struct support_reference *support_reference_open_bytes(const void *bytes, size_t size,
						       const char *name);
void support_reference_close(struct support_reference *reference);

const struct dvsm_model_config *
support_reference_get_config(const struct support_reference *reference);

/** Largest magnitudes met in all runs since the model was opened. */
struct support_reference_range {
	double residual; /* of the residual stream */
	double score;    /* of an attention score, before softmax */
};
const struct support_reference_range *
support_reference_get_range(const struct support_reference *reference);

/** Opaque: the KV-cache in double, and the rig's frame. */
struct support_reference_scene;

/** Reconstruct from views, [count]; patch_px 0 means the model's. Release with
 * support_reference_scene_free(). */
struct support_reference_scene *
support_reference_reconstruct(const struct support_reference *reference,
			      const struct dvsm_view *views, uint32_t count, uint32_t patch_px);
void support_reference_scene_free(struct support_reference_scene *scene);

/** Tokens of all views, and one block's cross-view keys and values, [heads][tokens][D/heads] each,
 * owned by the scene. */
size_t support_reference_scene_get_tokens(const struct support_reference_scene *scene);
const double *support_reference_scene_get_keys(const struct support_reference_scene *scene,
					       uint32_t layer);
const double *support_reference_scene_get_values(const struct support_reference_scene *scene,
						 uint32_t layer);

/** Render one viewpoint to rgb[height][width][3], unclamped; patch_px 0 means the model's. */
void support_reference_render(const struct support_reference *reference,
			      const struct support_reference_scene *scene,
			      const struct dvsm_camera *camera, uint32_t patch_px, double *rgb);

/** count x size bytes of zeros; exits with a line when there is no memory. */
void *support_reference_allocate(size_t count, size_t size);

#endif
