#include "core/session.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "core/model_choice.h"
#include "core/progress.h"

struct dio_session {
	char *model_path;
	struct dvsm_model *model;
	struct dvsm_engine *engine;
	struct dvsm_scene *scene;
	struct dio_model_card card;
	uint32_t patch_recon, patch_render;
	bool deblock;
	dvsm_progress_fn *progress; /* NULL: a bar */
	void *progress_context;
};

enum dio_status dio_status_from_engine(enum dvsm_status status, const struct dvsm_error *from,
				       struct dio_error *error)
{
	static const enum dio_status OURS[] = {
		[DVSM_OK] = DIO_OK,
		[DVSM_BAD_ARG] = DIO_BAD_ARG,
		[DVSM_BAD_FILE] = DIO_BAD_FILE,
		[DVSM_IO] = DIO_IO,
		[DVSM_NO_MEM] = DIO_NO_MEM,
		[DVSM_MISMATCH] = DIO_BAD_FILE,
		[DVSM_UNSUPPORTED] = DIO_UNSUPPORTED,
		[DVSM_CANCELLED] = DIO_END,
	};

	if (status == DVSM_OK)
		return DIO_OK;
	return dio_fail(error, OURS[status], "%s",
			*from->text ? from->text : dvsm_status_text(status));
}

static enum dio_status open_engine(struct dio_session *session,
				   const struct dio_session_options *options,
				   struct dio_error *error)
{
	const struct dvsm_engine_options engine = {.threads = options->threads,
						   .cpu_mask = options->cpu_mask,
						   .precision = options->precision,
						   .deblock = session->deblock};
	struct dvsm_error fault = {0};
	enum dvsm_status status = dvsm_model_open_for(session->model_path, options->precision,
						      &session->model, &fault);

	if (status == DVSM_OK)
		status = dvsm_engine_create(session->model, &engine, &session->engine, &fault);
	return dio_status_from_engine(status, &fault, error);
}

enum dio_status dio_session_open(const struct dio_session_options *options,
				 struct dio_session **session, struct dio_error *error)
{
	struct dio_session *made = calloc(1, sizeof *made);
	enum dio_status status = DIO_OK;

	if (!made)
		return dio_fail(error, DIO_NO_MEM, "no memory for a session");
	made->patch_recon = options->patch_recon;
	made->patch_render = options->patch_render;
	if (!options->model)
		status = dio_model_find_shipped(&made->model_path, error);
	else if (!(made->model_path = strdup(options->model)))
		status = dio_fail(error, DIO_NO_MEM, "%s: no memory", options->model);
	if (status == DIO_OK)
		status = dio_model_read_card(made->model_path, &made->card, error);
	made->deblock = options->deblock == DIO_DEBLOCK_AUTO ? made->card.deblock
							     : options->deblock == DIO_DEBLOCK_ON;
	if (status == DIO_OK)
		status = open_engine(made, options, error);
	if (status == DIO_OK)
		*session = made;
	else
		dio_session_close(made);
	return status;
}

void dio_session_close(struct dio_session *session)
{
	if (!session)
		return;
	dvsm_scene_destroy(session->scene);
	dvsm_engine_destroy(session->engine);
	dvsm_model_close(session->model);
	free(session->model_path);
	free(session);
}

const struct dvsm_model *dio_session_get_model(const struct dio_session *session)
{
	return session->model;
}

const struct dvsm_engine *dio_session_get_engine(const struct dio_session *session)
{
	return session->engine;
}

const struct dvsm_scene *dio_session_get_scene(const struct dio_session *session)
{
	return session->scene;
}

const char *dio_session_get_model_path(const struct dio_session *session)
{
	return session->model_path;
}

bool dio_session_get_deblock(const struct dio_session *session)
{
	return session->deblock;
}

static uint32_t choose_patch(const struct dio_session *session, uint32_t wished, uint32_t width,
			     uint32_t height)
{
	const struct dvsm_model_config *config = dvsm_model_get_config(session->model);

	return wished ? wished
		      : dio_model_choose_patch(session->card.tokens_per_view, config->patch_px,
					       width, height);
}

uint32_t dio_session_get_patch_render(const struct dio_session *session,
				      const struct dio_camera_model *camera)
{
	return choose_patch(session, session->patch_render, camera->width, camera->height);
}

uint32_t dio_session_get_patch_recon(const struct dio_session *session,
				     const struct dio_camera_model *camera)
{
	return choose_patch(session, session->patch_recon, camera->width, camera->height);
}

void dio_session_set_patch_render(struct dio_session *session, uint32_t patch_px)
{
	session->patch_render = patch_px;
}

void dio_session_set_progress(struct dio_session *session, dvsm_progress_fn *progress,
			      void *context)
{
	session->progress = progress;
	session->progress_context = context;
}

/* The views as the engine takes them: the floats of all pictures lie in one block. */
static struct dvsm_view *make_engine_views(const struct dio_view *views, uint32_t count,
					   float **block, struct dio_error *error)
{
	struct dvsm_view *made = calloc(count ? count : 1, sizeof *made);
	size_t total = 0, used = 0;

	for (uint32_t i = 0; i < count; i++)
		total += (size_t)views[i].camera.width * views[i].camera.height * 3;
	*block = malloc(total ? total * sizeof **block : 1);
	if (!made || !*block) {
		free(made);
		free(*block);
		dio_fail(error, DIO_NO_MEM, "no memory for %u pictures as floats (%zu MiB)", count,
			 total * sizeof **block >> 20);
		return NULL;
	}
	for (uint32_t i = 0; i < count; i++) {
		size_t numbers = (size_t)views[i].camera.width * views[i].camera.height * 3;
		float *rgb = *block + used;

		for (size_t n = 0; n < numbers; n++)
			rgb[n] = (float)views[i].picture.rgb[n] / 255.0f;
		made[i].camera = dio_view_engine_camera(&views[i].camera, &views[i].pose);
		made[i].rgb = rgb;
		used += numbers;
	}
	return made;
}

enum dio_status dio_session_reconstruct(struct dio_session *session, const struct dio_view *views,
					uint32_t count, struct dvsm_stats *stats,
					struct dio_error *error)
{
	struct dvsm_error fault = {0};
	struct dvsm_scene *scene = NULL;
	struct dio_progress progress;
	struct dvsm_view *made;
	enum dvsm_status status;
	uint32_t patch_px;
	float *block;

	for (uint32_t i = 0; i < count; i++)
		if (!views[i].picture.rgb)
			return dio_fail(error, DIO_BAD_ARG, "view %s: has no picture",
					views[i].name);
	made = make_engine_views(views, count, &block, error);
	if (!made)
		return DIO_NO_MEM;
	patch_px = choose_patch(session, session->patch_recon, count ? views[0].camera.width : 1,
				count ? views[0].camera.height : 1);
	dio_progress_init(&progress, "reconstructing");
	status = dvsm_reconstruct(session->engine, made, count, patch_px,
				  session->progress ? session->progress : dio_progress_engine,
				  session->progress ? session->progress_context : &progress, &scene,
				  stats, &fault);
	dio_progress_done(&progress);
	free(made);
	free(block);
	if (status != DVSM_OK)
		return dio_status_from_engine(status, &fault, error);
	dvsm_scene_destroy(session->scene);
	session->scene = scene;
	return DIO_OK;
}

enum dio_status dio_session_compare(struct dio_session *session, const struct dio_view_set *set,
				    struct dvsm_half_error *errors, struct dio_error *error)
{
	struct dvsm_camera targets[DIO_COMPARE_TARGETS];
	struct dvsm_model *model = NULL;
	struct dvsm_measure_job job = {
		.view_count = set->context_count,
		.targets = targets,
	};
	struct dvsm_error fault = {0};
	struct dvsm_view *views;
	enum dvsm_status status;
	float *block;

	if (set->context_count == 0)
		return dio_fail(error, DIO_BAD_ARG, "the scene has no context view");
	views = make_engine_views(set->context, set->context_count, &block, error);
	if (!views)
		return DIO_NO_MEM;
	for (uint32_t i = 0; i < set->target_count && i < DIO_COMPARE_TARGETS;
	     i++, job.target_count++)
		targets[i] = dio_view_engine_camera(&set->target[i].camera, &set->target[i].pose);
	/* The session's model holds the weights of one precision; this takes two. */
	status = dvsm_model_open(session->model_path, &model, &fault);
	job.model = model;
	job.views = views;
	job.patch_recon = dio_session_get_patch_recon(session, &set->context[0].camera);
	if (job.target_count)
		job.patch_render = dio_session_get_patch_render(session, &set->target[0].camera);
	if (status == DVSM_OK)
		status = dvsm_activations_measure(&job, errors, &fault);
	dvsm_model_close(model);
	free(views);
	free(block);
	return dio_status_from_engine(status, &fault, error);
}

enum dio_status dio_session_open_scene(struct dio_session *session, const char *path,
				       struct dio_error *error)
{
	struct dvsm_error fault = {0};
	struct dvsm_scene *scene = NULL;
	enum dvsm_status status = dvsm_scene_open(path, session->model, &scene, &fault);

	if (status != DVSM_OK)
		return dio_status_from_engine(status, &fault, error);
	dvsm_scene_destroy(session->scene);
	session->scene = scene;
	return DIO_OK;
}

enum dio_status dio_session_save_scene(const struct dio_session *session, const char *path,
				       struct dio_error *error)
{
	struct dvsm_error fault = {0};

	return dio_status_from_engine(dvsm_scene_save(session->scene, path, &fault), &fault, error);
}

enum dio_status dio_session_render(struct dio_session *session,
				   const struct dio_camera_model *camera,
				   const struct dio_pose *pose, float *rgb,
				   struct dvsm_stats *stats, struct dio_error *error)
{
	struct dvsm_camera engine_camera = dio_view_engine_camera(camera, pose);
	struct dvsm_error fault = {0};

	return dio_status_from_engine(dvsm_render(session->engine, session->scene, &engine_camera,
						  dio_session_get_patch_render(session, camera),
						  rgb, stats, &fault),
				      &fault, error);
}

void dio_picture_from_float(const float *rgb, struct dio_picture *picture)
{
	size_t numbers = (size_t)picture->width * picture->height * 3;

	for (size_t i = 0; i < numbers; i++) {
		/* In double the product is exact: dvsm_render_rgb8() gives the same bytes. */
		double value = (double)rgb[i] * 255 + 0.5;

		/* The first test also sends a number that is not finite to black. */
		picture->rgb[i] = !(value > 0) ? 0 : value >= 255 ? 255 : (uint8_t)value;
	}
}

/* Pictures of a batch wait for each other. */
#define BATCH_BYTES ((size_t)32 << 20)

uint32_t dio_session_batch_size(const struct dio_session *session,
				const struct dio_camera_model *camera)
{
	const struct dvsm_camera engine_camera = {.width = camera->width, .height = camera->height};
	const size_t most = BATCH_BYTES / ((size_t)camera->width * camera->height * 3 + 1);
	uint32_t size = dvsm_render_batch_size(session->engine, &engine_camera,
					       dio_session_get_patch_render(session, camera));

	size = size < most ? size : (uint32_t)most;
	size = size < DIO_BATCH_MAX ? size : DIO_BATCH_MAX;
	return size > 0 ? size : 1;
}

static enum dio_status fit_picture(struct dio_picture *picture,
				   const struct dio_camera_model *camera, struct dio_error *error)
{
	enum dio_status status;

	if (picture->width == camera->width && picture->height == camera->height)
		return DIO_OK;
	dio_picture_deinit(picture);
	status = dio_picture_init(picture, camera->width, camera->height);
	return status == DIO_OK ? DIO_OK
				: dio_fail(error, status, "no memory for a %ux%u picture",
					   camera->width, camera->height);
}

enum dio_status dio_session_render_batch(struct dio_session *session,
					 const struct dio_camera_model *const *cameras,
					 const struct dio_pose *const *poses, uint32_t count,
					 struct dio_picture *pictures, struct dvsm_stats *stats,
					 struct dio_error *error)
{
	struct dvsm_camera engine_cameras[DIO_BATCH_MAX];
	struct dvsm_picture_out out[DIO_BATCH_MAX];
	struct dvsm_error fault = {0};
	enum dio_status status = DIO_OK;

	for (uint32_t i = 0; status == DIO_OK && i < count; i++) {
		engine_cameras[i] = dio_view_engine_camera(cameras[i], poses[i]);
		status = fit_picture(&pictures[i], cameras[i], error);
		out[i] = (struct dvsm_picture_out){.bytes = pictures[i].rgb};
	}
	if (status != DIO_OK)
		return status;
	return dio_status_from_engine(
		dvsm_render_batch(session->engine, session->scene, engine_cameras, count,
				  dio_session_get_patch_render(session, cameras[0]), out, stats,
				  &fault),
		&fault, error);
}

enum dio_status dio_session_render_picture(struct dio_session *session,
					   const struct dio_camera_model *camera,
					   const struct dio_pose *pose, struct dio_picture *picture,
					   struct dvsm_stats *stats, struct dio_error *error)
{
	return dio_session_render_batch(session, &camera, &pose, 1, picture, stats, error);
}
