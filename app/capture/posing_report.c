#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "capture/posing.h"
#include "core/json_out.h"
#include "core/path.h"

static const char *use_text(enum dio_posed_use use)
{
	switch (use) {
	case DIO_POSED_CONTEXT:
		return "context";
	case DIO_POSED_TARGET:
		return "target";
	case DIO_POSED_SPARE:
		return "spare";
	case DIO_POSED_NO_BOARD:
		return "no board";
	case DIO_POSED_REFUSED:
		return "no pose";
	case DIO_POSED_OUTLIER:
		return "removed";
	}
	return "unknown";
}

static bool in_scene(const struct dio_posed_view *view)
{
	return view->use == DIO_POSED_CONTEXT || view->use == DIO_POSED_TARGET;
}

/* A view's picture in the scene: its place in the list, so that a listing leads to it. */
static void write_file_name(char *name, size_t size, uint32_t view)
{
	snprintf(name, size, "images/%03u.png", view);
}

void dio_posing_print(const struct dio_posing *result)
{
	printf("posed     %u of %u pictures, %.3f px mean reprojection error\n", result->posed,
	       result->count, result->rms_px);
	for (uint32_t i = 0; i < result->count; i++) {
		const struct dio_posed_view *view = &result->views[i];
		char file[32];

		write_file_name(file, sizeof file, i);
		printf("  %-24s %-9s", view->name, use_text(view->use));
		if (*view->reason)
			printf(" %s\n", view->reason);
		else
			printf(" %4u corners  %7.3f px  %s\n", view->estimate.corners,
			       view->estimate.rms_px, in_scene(view) ? file : "");
	}
	printf("scene     %u context views, %u targets, %u x %u pixels\n", result->context,
	       result->targets, result->pinhole.width, result->pinhole.height);
}

cJSON *dio_posing_json(const struct dio_posing *result)
{
	cJSON *root = cJSON_CreateObject();
	cJSON *list = cJSON_AddArrayToObject(root, "views");

	if (!list) {
		cJSON_Delete(root);
		return NULL;
	}
	dio_json_add_number(root, "pictures", result->count, 0);
	dio_json_add_number(root, "posed", result->posed, 0);
	dio_json_add_number(root, "context", result->context, 0);
	dio_json_add_number(root, "targets", result->targets, 0);
	dio_json_add_number(root, "rms_px", result->rms_px, 4);
	cJSON_AddItemToObject(root, "camera", dio_json_camera(&result->pinhole));
	for (uint32_t i = 0; i < result->count; i++) {
		const struct dio_posed_view *view = &result->views[i];
		cJSON *item = cJSON_CreateObject();
		char file[32];

		write_file_name(file, sizeof file, i);
		dio_json_add_text(item, "name", view->name);
		dio_json_add_text(item, "use", use_text(view->use));
		if (in_scene(view))
			dio_json_add_text(item, "file", file);
		dio_json_add_number(item, "corners", view->estimate.corners, 0);
		if (*view->reason)
			dio_json_add_text(item, "reason", view->reason);
		else
			dio_json_add_number(item, "rms_px", view->estimate.rms_px, 4);
		cJSON_AddItemToArray(list, item);
	}
	return root;
}

static enum dio_status write_pictures(const struct dio_posing *result, const char *folder,
				      struct dio_scene_file *scene, struct dio_error *error)
{
	enum dio_status status = DIO_OK;

	for (uint32_t i = 0; i < result->count && status == DIO_OK; i++) {
		const struct dio_posed_view *view = &result->views[i];
		char name[32];
		char *path;

		if (!in_scene(view))
			continue;
		write_file_name(name, sizeof name, i);
		path = dio_path_join(folder, name);
		if (!path)
			return dio_fail(error, DIO_NO_MEM, "%s: no memory", folder);
		status = dio_picture_write(path, &view->picture, error);
		free(path);
		if (status == DIO_OK)
			status = dio_scene_file_append(
				scene, name,
				view->use == DIO_POSED_TARGET ? DIO_ROLE_TARGET : DIO_ROLE_CONTEXT,
				&result->pinhole, &view->estimate.pose, error);
	}
	return status;
}

enum dio_status dio_posing_write(const struct dio_posing *result, const char *name,
				 const char *path, struct dio_error *error)
{
	struct dio_scene_file scene = {0};
	char *folder = dio_path_folder(path);
	char *images = folder ? dio_path_join(folder, "images") : NULL;
	enum dio_status status;

	scene.name = strdup(name);
	scene.folder = folder ? strdup(folder) : NULL;
	if (!images || !scene.name || !scene.folder)
		status = dio_fail(error, DIO_NO_MEM, "%s: no memory", path);
	else
		status = dio_folder_make(images, error);
	if (status == DIO_OK)
		status = write_pictures(result, folder, &scene, error);
	if (status == DIO_OK)
		status = dio_scene_file_write(&scene, path, error);
	dio_scene_file_deinit(&scene);
	free(images);
	free(folder);
	return status;
}
