/* Model, engine and scene of one run, with the app's types on the outside. */
#ifndef DIO_APP_SESSION_H
#define DIO_APP_SESSION_H

#include <stdint.h>

#include "core/view.h"
#include "dio/frame.h"
#include "dvsm/dvsm.h"

/** Opaque, thread-bound. */
struct dio_session;

/** Whether steps between patches are evened out (engine.h); auto: as the model's card says. */
enum dio_deblock { DIO_DEBLOCK_AUTO, DIO_DEBLOCK_ON, DIO_DEBLOCK_OFF };

/** Zero-initialised: the shipped model, every core and tier, stage patches chosen. */
struct dio_session_options {
	const char *model; /* safetensors file, or NULL for the shipped one */
	uint32_t threads;  /* 0: all */
	uint32_t cpu_mask; /* 0: all tiers */
	enum dvsm_precision precision;
	uint32_t patch_recon;  /* stage patches in pixels; 0: chosen from the picture's size, */
	uint32_t patch_render; /* see dio_model_choose_patch() */
	enum dio_deblock deblock;
};

enum dio_status dio_session_open(const struct dio_session_options *options,
				 struct dio_session **session, struct dio_error *error);
/** NULL is fine. */
void dio_session_close(struct dio_session *session);

/** What is inside, owned by the session; the scene is NULL until there is one. */
const struct dvsm_model *dio_session_get_model(const struct dio_session *session);
const struct dvsm_engine *dio_session_get_engine(const struct dio_session *session);
const struct dvsm_scene *dio_session_get_scene(const struct dio_session *session);
const char *dio_session_get_model_path(const struct dio_session *session);

/** Reconstruct from views with pictures; shows a progress bar. stats: NULL or filled. */
enum dio_status dio_session_reconstruct(struct dio_session *session, const struct dio_view *views,
					uint32_t count, struct dvsm_stats *stats,
					struct dio_error *error);
/**
 * Report reconstructions to `progress` instead of drawing a bar; when it says false they end with
 * DIO_END. NULL: the bar again.
 */
void dio_session_set_progress(struct dio_session *session, dvsm_progress_fn *progress,
			      void *context);
/** Targets of a scene that dio_session_compare() renders at most. */
#define DIO_COMPARE_TARGETS 4u

/**
 * Compare what fixed computes with what float32 does, layer by layer: the set's context
 * reconstructed, its first targets rendered (they need no picture).
 *
 * errors   receives [2 layers of the model]
 */
enum dio_status dio_session_compare(struct dio_session *session, const struct dio_view_set *set,
				    struct dvsm_half_error *errors, struct dio_error *error);

/** Open or save the scene file. */
enum dio_status dio_session_open_scene(struct dio_session *session, const char *path,
				       struct dio_error *error);
enum dio_status dio_session_save_scene(const struct dio_session *session, const char *path,
				       struct dio_error *error);

/**
 * Render one viewpoint.
 *
 * camera   pinhole
 * rgb      [height][width][3] float, caller's memory, unclamped
 */
enum dio_status dio_session_render(struct dio_session *session,
				   const struct dio_camera_model *camera,
				   const struct dio_pose *pose, float *rgb,
				   struct dvsm_stats *stats, struct dio_error *error);

/** The same as an 8-bit picture, clamped and rounded; `picture` zero-initialised or reused. */
enum dio_status dio_session_render_picture(struct dio_session *session,
					   const struct dio_camera_model *camera,
					   const struct dio_pose *pose, struct dio_picture *picture,
					   struct dvsm_stats *stats, struct dio_error *error);

/** Most viewpoints of dio_session_render_batch(). */
#define DIO_BATCH_MAX 16u

/**
 * How many viewpoints of a camera's size are best rendered at once: as many as the engine gains
 * from, dvsm_render_batch_size(), whose pictures take up to 32 MiB; at least 1.
 */
uint32_t dio_session_batch_size(const struct dio_session *session,
				const struct dio_camera_model *camera);

/**
 * Render several viewpoints of one size as 8-bit pictures: the same bytes as one by one.
 *
 * cameras, poses  [count], count 1..DIO_BATCH_MAX
 * pictures        [count], each zero-initialised or reused
 * stats           NULL, or of all of them together
 */
enum dio_status dio_session_render_batch(struct dio_session *session,
					 const struct dio_camera_model *const *cameras,
					 const struct dio_pose *const *poses, uint32_t count,
					 struct dio_picture *pictures, struct dvsm_stats *stats,
					 struct dio_error *error);

/** Clamp to [0,1] and round to 8 bits. `picture` has its size already. */
void dio_picture_from_float(const float *rgb, struct dio_picture *picture);

/** The stage patch a render of this size takes. */
uint32_t dio_session_get_patch_render(const struct dio_session *session,
				      const struct dio_camera_model *camera);

/** The same of a reconstruction from pictures of this size. */
uint32_t dio_session_get_patch_recon(const struct dio_session *session,
				     const struct dio_camera_model *camera);
/** Whether rendered pictures are deblocked. */
bool dio_session_get_deblock(const struct dio_session *session);
/** Render with another stage patch from now on; 0: chosen from the picture's size. */
void dio_session_set_patch_render(struct dio_session *session, uint32_t patch_px);

/** Our status and text for the engine's. */
enum dio_status dio_status_from_engine(enum dvsm_status status, const struct dvsm_error *from,
				       struct dio_error *error);

#endif
