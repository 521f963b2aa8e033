/* What a measurement works on: a model, posed pictures, viewpoints, and what should come out. */
#ifndef DIO_BENCH_WORK_H
#define DIO_BENCH_WORK_H

#include <stdbool.h>

#include "bench/draw.h"
#include "core/model_choice.h"
#include "core/view.h"
#include "dvsm/dvsm.h"

/** Release with dio_work_deinit(). */
struct dio_work {
	struct dvsm_model *model; /* opened for `precision` alone, whose peak is measured */
	enum dvsm_precision precision;
	struct dvsm_model_config config;
	char model_sha256[65];
	char *model_path;                 /* NULL: drawn, as `size` says */
	const struct dio_draw_size *size; /* static */
	char *model_name;                 /* for people */
	char *scene_name;
	struct dio_model_card card; /* of model_path; of its deblocking nothing is measured */
	struct dio_view_set views;
	struct dvsm_view *context; /* the same for the engine, [views.context_count] */
	float *pixels;             /* of all context pictures */
	uint32_t pictures;         /* targets that have one */
	bool drawn;                /* the pictures are, and already in the order to take them */
};

/**
 * Open what the user named and draw the rest.
 *
 * size       sizes of what is drawn
 * model      a file, or NULL: drawn
 * precision  for which the model is opened
 * scene      scene.json or its folder, or NULL: `views` pictures are drawn
 * work       zero-initialised
 */
enum dio_status dio_work_open(const struct dio_draw_size *size, const char *model,
			      enum dvsm_precision precision, const char *scene, uint32_t views,
			      struct dio_work *work, struct dio_error *error);

/**
 * Have the model opened for a precision, in place of another; no engine may be left on that.
 *
 * DIO_UNSUPPORTED  the precision does not take the model; the next call may ask for one that does
 */
enum dio_status dio_work_use(struct dio_work *work, enum dvsm_precision precision,
			     struct dio_error *error);
void dio_work_deinit(struct dio_work *work);

/** Index of the context view that takes place `at` when `views` of them are used: a scene's are
 * spread evenly. */
uint32_t dio_work_pick(const struct dio_work *work, uint32_t views, uint32_t at);

/**
 * Leave the same work for other programs: `folder`/model.safetensors when the model was drawn, and
 * for each number of views `folder`/vV/scene.json with those context views and all targets, the
 * pictures beside it in `folder`/images.
 */
enum dio_status dio_work_save(const struct dio_work *work, const struct dio_draw_size *size,
			      bool model_drawn, const uint32_t *views, uint32_t count,
			      const char *folder, struct dio_error *error);

/**
 * What float64 makes of the work: folder/vV_pP.npy, [targets][height][width][3], the scene's
 * targets in order or the first of them; NULL when there is no such file. Release with free().
 *
 * DIO_BAD_FILE  the file is not the one for these targets
 */
enum dio_status dio_work_read_reference(const struct dio_work *work, const char *folder,
					uint32_t views, uint32_t patch_px, double **rgb,
					uint32_t *targets, struct dio_error *error);

#endif
