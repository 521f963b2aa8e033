#include "core/view.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "core/path.h"
#include "dio/pose.h"

/* Undistorters made so far, one a camera model: a set of a hundred pictures has one or two. */
struct lenses {
	struct lens {
		struct dio_camera_model model, pinhole;
		struct dio_undistorter *undistorter;
	} * list;
	uint32_t count;
};

static void lenses_deinit(struct lenses *lenses)
{
	for (uint32_t i = 0; i < lenses->count; i++)
		dio_undistorter_destroy(lenses->list[i].undistorter);
	free(lenses->list);
}

static bool is_distorted(const struct dio_camera_model *model)
{
	for (int i = 0; i < 5; i++)
		if (model->dist[i] != 0)
			return true;
	return false;
}

static enum dio_status find_lens(struct lenses *lenses, const struct dio_camera_model *model,
				 const struct lens **found, struct dio_error *error)
{
	enum dio_status status;
	struct lens *list;

	for (uint32_t i = 0; i < lenses->count; i++) {
		if (dio_camera_model_equal(&lenses->list[i].model, model)) {
			*found = &lenses->list[i];
			return DIO_OK;
		}
	}
	list = realloc(lenses->list, sizeof *list * (lenses->count + 1));
	if (!list)
		return dio_fail(error, DIO_NO_MEM, "no memory to undistort");
	lenses->list = list;
	list += lenses->count;
	list->model = *model;
	status = dio_undistorter_create(model, model->width, model->height, &list->pinhole,
					&list->undistorter, error);
	if (status != DIO_OK)
		return status;
	lenses->count++;
	*found = list;
	return DIO_OK;
}

static enum dio_status load_picture(const struct dio_scene_file *scene, uint32_t index,
				    const struct lens *lens, struct dio_picture *picture,
				    struct dio_error *error)
{
	const struct dio_scene_frame *frame = &scene->frames[index];
	char *path = dio_scene_file_picture_path(scene, index);
	struct dio_picture raw = {0};
	enum dio_status status;

	if (!path)
		return dio_fail(error, DIO_NO_MEM, "%s: no memory", frame->file);
	status = dio_picture_read(path, &raw, error);
	if (status == DIO_OK &&
	    (raw.width != frame->camera.width || raw.height != frame->camera.height))
		status = dio_fail(error, DIO_BAD_FILE,
				  "%s: frame %u: the picture is %ux%u, its camera says %ux%u", path,
				  index, raw.width, raw.height, frame->camera.width,
				  frame->camera.height);
	free(path);
	if (status == DIO_OK && lens)
		status = dio_undistorter_apply(lens->undistorter, &raw, picture, error);
	else if (status == DIO_OK)
		*picture = raw;
	if (status != DIO_OK || lens)
		dio_picture_deinit(&raw);
	return status;
}

/* Picture name without folder and ending; a target without picture is called by its number. */
static char *base_name(const char *file, uint32_t number)
{
	const char *name = file ? dio_path_name(file) : "", *dot = strrchr(name, '.');
	char *made;

	if (*name)
		return strndup(name, dot && dot != name ? (size_t)(dot - name) : strlen(name));
	return asprintf(&made, "target_%03u", number) < 0 ? NULL : made;
}

/* Pictures of two folders may share a name: the later one gets its number behind it. */
static char *unique_name(const struct dio_view *views, uint32_t count, const char *file)
{
	char *name = base_name(file, count), *longer;

	for (uint32_t i = 0; name && i < count; i++) {
		if (strcmp(views[i].name, name) != 0)
			continue;
		if (asprintf(&longer, "%s_%u", name, count) < 0)
			longer = NULL;
		free(name);
		name = longer;
		i = UINT32_MAX; /* from the start: the longer name may be taken too */
	}
	return name;
}

static enum dio_status load_view(const struct dio_scene_file *scene, uint32_t index, bool picture,
				 struct lenses *lenses, struct dio_view *views, uint32_t *count,
				 struct dio_error *error)
{
	const struct dio_scene_frame *frame = &scene->frames[index];
	struct dio_view *view = &views[*count];
	const struct lens *lens = NULL;
	enum dio_status status = DIO_OK;

	*view = (struct dio_view){.camera = frame->camera, .pose = frame->pose};
	view->name = unique_name(views, *count, frame->file);
	if (!view->name)
		return dio_fail(error, DIO_NO_MEM, "scene %s: no memory", scene->name);
	*count += 1;
	if (is_distorted(&frame->camera)) {
		status = find_lens(lenses, &frame->camera, &lens, error);
		if (status != DIO_OK)
			return status;
		view->camera = lens->pinhole;
	}
	if (picture && frame->file)
		status = load_picture(scene, index, lens, &view->picture, error);
	return status;
}

enum dio_status dio_view_set_load(const struct dio_scene_file *scene, enum dio_view_load load,
				  struct dio_view_set *set, struct dio_error *error)
{
	struct dio_view_set made = {0};
	struct lenses lenses = {0};
	enum dio_status status = DIO_OK;

	made.context = calloc(scene->frame_count + 1u, sizeof *made.context);
	made.target = calloc(scene->frame_count + 1u, sizeof *made.target);
	if (!made.context || !made.target)
		status = dio_fail(error, DIO_NO_MEM, "scene %s: no memory", scene->name);
	for (uint32_t i = 0; status == DIO_OK && i < scene->frame_count; i++) {
		bool context = scene->frames[i].role == DIO_ROLE_CONTEXT;

		status = load_view(scene, i, load & (context ? DIO_LOAD_CONTEXT : DIO_LOAD_TARGET),
				   &lenses, context ? made.context : made.target,
				   context ? &made.context_count : &made.target_count, error);
	}
	lenses_deinit(&lenses);
	if (status == DIO_OK)
		*set = made;
	else
		dio_view_set_deinit(&made);
	return status;
}

static void free_views(struct dio_view *views, uint32_t count)
{
	for (uint32_t i = 0; i < count; i++) {
		free(views[i].name);
		dio_picture_deinit(&views[i].picture);
	}
	free(views);
}

void dio_view_set_deinit(struct dio_view_set *set)
{
	free_views(set->context, set->context_count);
	free_views(set->target, set->target_count);
	*set = (struct dio_view_set){0};
}

struct dvsm_camera dio_view_engine_camera(const struct dio_camera_model *camera,
					  const struct dio_pose *pose)
{
	struct dvsm_camera made = {
		.width = camera->width,
		.height = camera->height,
		.fx = camera->fx,
		.fy = camera->fy,
		.cx = camera->cx,
		.cy = camera->cy,
	};

	memcpy(made.world_from_camera, pose->world_from_camera, sizeof made.world_from_camera);
	return made;
}

static double centre_distance(const struct dio_pose *a, const struct dio_pose *b)
{
	double sum = 0;

	for (int i = 3; i < 12; i += 4) {
		double d = a->world_from_camera[i] - b->world_from_camera[i];

		sum += d * d;
	}
	return sqrt(sum);
}

static double angle_between(const struct dio_pose *a, const struct dio_pose *b)
{
	double trace = 0;

	for (int i = 0; i < 3; i++)
		for (int j = 0; j < 3; j++)
			trace += a->world_from_camera[4 * i + j] * b->world_from_camera[4 * i + j];
	return acos(fmin(fmax((trace - 1) / 2, -1), 1));
}

uint32_t dio_view_nearest(const struct dio_view_set *set, const struct dio_pose *target)
{
	double mean = 0, best = INFINITY;
	uint32_t nearest = 0;

	for (uint32_t i = 0; i < set->context_count; i++)
		mean += centre_distance(&set->context[i].pose, target) / set->context_count;
	for (uint32_t i = 0; i < set->context_count; i++) {
		const struct dio_pose *pose = &set->context[i].pose;
		double off =
			centre_distance(pose, target) / (mean + 1e-9) + angle_between(pose, target);

		if (off < best) {
			best = off;
			nearest = i;
		}
	}
	return nearest;
}
