#include "bench/work.h"

#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <unistd.h>

#include "core/model_choice.h"
#include "core/npy.h"
#include "core/path.h"
#include "core/session.h"
#include "dio/atomic_file.h"

static enum dio_status open_model(const char *path, struct dio_work *work, struct dio_error *error)
{
	struct dvsm_error fault = {0};

	return dio_status_from_engine(
		dvsm_model_open_for(path, work->precision, &work->model, &fault), &fault, error);
}

/* Drawn into memory that has a name for the engine to open, and no place on any disk. */
static enum dio_status draw_model(struct dio_work *work, struct dio_error *error)
{
	int file = memfd_create("drawn.safetensors", MFD_CLOEXEC);
	FILE *stream = file < 0 ? NULL : fdopen(file, "w");
	enum dio_status status;
	char path[64];

	if (!stream) {
		if (file >= 0)
			close(file);
		return dio_fail(error, DIO_NO_MEM, "no memory to draw a model in");
	}
	snprintf(path, sizeof path, "/proc/self/fd/%d", file);
	status = dio_draw_model(&work->size->model, stream, error);
	if (status == DIO_OK)
		status = open_model(path, work, error);
	fclose(stream);
	return status;
}

enum dio_status dio_work_use(struct dio_work *work, enum dvsm_precision precision,
			     struct dio_error *error)
{
	enum dio_status status;

	if (work->model && work->precision == precision)
		return DIO_OK;
	dvsm_model_close(work->model);
	work->model = NULL;
	work->precision = precision;
	status = work->model_path ? open_model(work->model_path, work, error)
				  : draw_model(work, error);
	if (status != DIO_OK)
		return status;
	work->config = *dvsm_model_get_config(work->model);
	snprintf(work->model_sha256, sizeof work->model_sha256, "%s",
		 dvsm_model_get_sha256(work->model));
	return DIO_OK;
}

static enum dio_status read_views(const char *path, struct dio_work *work, struct dio_error *error)
{
	struct dio_scene_file file = {0};
	enum dio_status status = dio_scene_file_read(path, &file, error);

	if (status == DIO_OK)
		status = dio_view_set_load(&file, DIO_LOAD_ALL, &work->views, error);
	if (status == DIO_OK && work->views.target_count == 0)
		status = dio_fail(error, DIO_BAD_ARG,
				  "%s: has no target to render: give frames role \"target\"", path);
	if (status == DIO_OK && !(work->scene_name = strdup(file.name)))
		status = dio_fail(error, DIO_NO_MEM, "%s: no memory", path);
	dio_scene_file_deinit(&file);
	return status;
}

static enum dio_status make_engine_views(struct dio_work *work, struct dio_error *error)
{
	const struct dio_view_set *set = &work->views;
	size_t total = 0;
	float *at;

	for (uint32_t i = 0; i < set->context_count; i++)
		total += (size_t)set->context[i].picture.width * set->context[i].picture.height * 3;
	work->context = calloc(set->context_count + 1u, sizeof *work->context);
	work->pixels = at = calloc(total + 1, sizeof *work->pixels);
	if (!work->context || !work->pixels)
		return dio_fail(error, DIO_NO_MEM, "no memory for %u pictures as floats",
				set->context_count);
	for (uint32_t i = 0; i < set->context_count; i++) {
		const struct dio_view *view = &set->context[i];
		size_t numbers = (size_t)view->picture.width * view->picture.height * 3;

		for (size_t n = 0; n < numbers; n++)
			at[n] = (float)view->picture.rgb[n] / 255.0f;
		work->context[i].camera = dio_view_engine_camera(&view->camera, &view->pose);
		work->context[i].rgb = at;
		at += numbers;
	}
	for (uint32_t i = 0; i < set->target_count; i++)
		work->pictures += set->target[i].picture.rgb != NULL;
	return DIO_OK;
}

enum dio_status dio_work_open(const struct dio_draw_size *size, const char *model,
			      enum dvsm_precision precision, const char *scene, uint32_t views,
			      struct dio_work *work, struct dio_error *error)
{
	enum dio_status status = DIO_OK;

	work->drawn = scene == NULL;
	work->size = size;
	if (model && !(work->model_path = strdup(model)))
		status = dio_fail(error, DIO_NO_MEM, "%s: no memory", model);
	if (status == DIO_OK && model)
		status = dio_model_read_card(model, &work->card, error);
	if (status == DIO_OK)
		status = dio_work_use(work, precision, error);
	if (status == DIO_OK)
		status = scene ? read_views(scene, work, error)
			       : dio_draw_views(size->width, size->height, views, &work->views,
						error);
	if (status == DIO_OK)
		status = make_engine_views(work, error);
	if (status == DIO_OK) {
		work->model_name = strdup(model ? dio_path_name(model) : "drawn weights");
		if (!work->model_name || (!scene && !(work->scene_name = strdup("drawn pictures"))))
			status = dio_fail(error, DIO_NO_MEM, "no memory for a name");
	}
	if (status != DIO_OK)
		dio_work_deinit(work);
	return status;
}

void dio_work_deinit(struct dio_work *work)
{
	dvsm_model_close(work->model);
	dio_view_set_deinit(&work->views);
	free(work->model_path);
	free(work->model_name);
	free(work->scene_name);
	free(work->context);
	free(work->pixels);
	*work = (struct dio_work){0};
}

uint32_t dio_work_pick(const struct dio_work *work, uint32_t views, uint32_t at)
{
	return work->drawn ? at : (uint32_t)((uint64_t)at * work->views.context_count / views);
}

/* Saving */

static enum dio_status save_model(const struct dio_draw_size *size, const char *folder,
				  struct dio_error *error)
{
	char *path = dio_path_join(folder, "model.safetensors");
	struct dio_atomic_file *file = NULL;
	enum dio_status status;

	if (!path)
		return dio_fail(error, DIO_NO_MEM, "%s: no memory", folder);
	status = dio_atomic_file_open(path, &file, error);
	free(path);
	if (status == DIO_OK)
		status = dio_draw_model(&size->model, dio_atomic_file_stream(file), error);
	if (status == DIO_OK)
		return dio_atomic_file_commit(file, error);
	dio_atomic_file_discard(file);
	return status;
}

/* The picture's name as a scene.json in `folder`/vV states it; written when it is new. */
static enum dio_status save_picture(const struct dio_view *view, enum dio_scene_role role,
				    const char *folder, char **name, struct dio_error *error)
{
	enum dio_status status = DIO_OK;
	char *path = NULL;

	*name = NULL;
	if (!view->picture.rgb)
		return DIO_OK;
	if (asprintf(name, "../images/%s-%s.png", role == DIO_ROLE_TARGET ? "target" : "context",
		     view->name) < 0) {
		*name = NULL;
		return dio_fail(error, DIO_NO_MEM, "%s: no memory", view->name);
	}
	path = dio_path_join(folder, *name + strlen("../"));
	if (!path)
		status = dio_fail(error, DIO_NO_MEM, "%s: no memory", view->name);
	else if (!dio_path_is_file(path))
		status = dio_picture_write(path, &view->picture, error);
	free(path);
	return status;
}

static enum dio_status append(struct dio_scene_file *file, const struct dio_view *view,
			      enum dio_scene_role role, const char *folder, struct dio_error *error)
{
	char *name;
	enum dio_status status = save_picture(view, role, folder, &name, error);

	if (status == DIO_OK)
		status = dio_scene_file_append(file, name, role, &view->camera, &view->pose, error);
	free(name);
	return status;
}

static enum dio_status save_scene(const struct dio_work *work, uint32_t views, const char *folder,
				  struct dio_error *error)
{
	struct dio_scene_file file = {.name = strdup(work->scene_name)};
	char *place = NULL, *path = NULL, number[16];
	enum dio_status status = DIO_OK;

	snprintf(number, sizeof number, "v%u", views);
	place = dio_path_join(folder, number);
	path = place ? dio_path_join(place, "scene.json") : NULL;
	if (!path || !file.name)
		status = dio_fail(error, DIO_NO_MEM, "%s: no memory", folder);
	else
		status = dio_folder_make(place, error);
	for (uint32_t i = 0; status == DIO_OK && i < views; i++)
		status = append(&file, &work->views.context[dio_work_pick(work, views, i)],
				DIO_ROLE_CONTEXT, folder, error);
	for (uint32_t i = 0; status == DIO_OK && i < work->views.target_count; i++)
		status = append(&file, &work->views.target[i], DIO_ROLE_TARGET, folder, error);
	if (status == DIO_OK)
		status = dio_scene_file_write(&file, path, error);
	dio_scene_file_deinit(&file);
	free(place);
	free(path);
	return status;
}

enum dio_status dio_work_save(const struct dio_work *work, const struct dio_draw_size *size,
			      bool model_drawn, const uint32_t *views, uint32_t count,
			      const char *folder, struct dio_error *error)
{
	char *images = dio_path_join(folder, "images");
	enum dio_status status = images ? dio_folder_make(images, error)
					: dio_fail(error, DIO_NO_MEM, "%s: no memory", folder);

	free(images);
	if (status == DIO_OK && model_drawn)
		status = save_model(size, folder, error);
	for (uint32_t i = 0; status == DIO_OK && i < count; i++)
		status = save_scene(work, views[i], folder, error);
	return status;
}

/* The reference */

static enum dio_status check_reference(const struct dio_work *work, const struct dio_npy_array *all,
				       const char *path, struct dio_error *error)
{
	const struct dio_view_set *set = &work->views;
	const struct dio_camera_model *camera = &set->target[0].camera;

	for (uint32_t i = 1; i < set->target_count; i++)
		if (set->target[i].camera.width != camera->width ||
		    set->target[i].camera.height != camera->height)
			return dio_fail(error, DIO_BAD_ARG,
					"%s: the targets differ in size, so no one array holds "
					"them",
					path);
	if (all->rank != 4 || all->shape[0] < 1 || all->shape[0] > set->target_count ||
	    all->shape[1] != camera->height || all->shape[2] != camera->width || all->shape[3] != 3)
		return dio_fail(error, DIO_BAD_FILE,
				"%s: is not [1 to %u][%u][%u][3], the pictures measured here", path,
				set->target_count, camera->height, camera->width);
	return DIO_OK;
}

enum dio_status dio_work_read_reference(const struct dio_work *work, const char *folder,
					uint32_t views, uint32_t patch_px, double **rgb,
					uint32_t *targets, struct dio_error *error)
{
	struct dio_npy_array all = {0};
	enum dio_status status = DIO_OK;
	char *path;

	*rgb = NULL;
	*targets = 0;
	if (asprintf(&path, "%s/v%u_p%u.npy", folder, views, patch_px) < 0)
		return dio_fail(error, DIO_NO_MEM, "%s: no memory", folder);
	if (dio_path_is_file(path)) {
		status = dio_npy_read(path, &all, error);
		if (status == DIO_OK)
			status = check_reference(work, &all, path, error);
		if (status == DIO_OK) {
			*rgb = all.values;
			*targets = (uint32_t)all.shape[0];
		} else {
			dio_npy_array_deinit(&all);
		}
	}
	free(path);
	return status;
}
