#include "support/golden_case.h"

#include <cjson/cJSON.h>
#include <dirent.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

#include "support/files.h"

static double number_in(const cJSON *object, const char *name)
{
	const cJSON *item = cJSON_GetObjectItemCaseSensitive(object, name);

	return cJSON_IsNumber(item) ? item->valuedouble : 0;
}

static int read_camera(const cJSON *shared, const cJSON *frame, struct dvsm_camera *camera)
{
	const cJSON *own = cJSON_GetObjectItemCaseSensitive(frame, "camera");
	const cJSON *pose = cJSON_GetObjectItemCaseSensitive(frame, "world_from_camera");
	const cJSON *from = own ? own : shared;

	if (!cJSON_IsObject(from) || cJSON_GetArraySize(pose) != 16)
		return -1;
	camera->width = (uint32_t)number_in(from, "width");
	camera->height = (uint32_t)number_in(from, "height");
	camera->fx = number_in(from, "fx");
	camera->fy = number_in(from, "fy");
	camera->cx = number_in(from, "cx");
	camera->cy = number_in(from, "cy");
	for (int i = 0; i < 16; i++)
		camera->world_from_camera[i] = cJSON_GetArrayItem(pose, i)->valuedouble;
	return 0;
}

static int read_view(const char *folder, const cJSON *frame, struct dvsm_view *view)
{
	const cJSON *file = cJSON_GetObjectItemCaseSensitive(frame, "file");
	uint32_t width = 0, height = 0;
	char path[1280];

	if (!cJSON_IsString(file))
		return -1;
	snprintf(path, sizeof(path), "%s/%s", folder, file->valuestring);
	view->rgb = support_read_png(path, &width, &height);
	return view->rgb && width == view->camera.width && height == view->camera.height ? 0 : -1;
}

static int read_frames(const char *folder, const cJSON *json, struct support_case *item)
{
	const cJSON *shared = cJSON_GetObjectItemCaseSensitive(json, "camera");
	const cJSON *frames = cJSON_GetObjectItemCaseSensitive(json, "frames");
	const cJSON *frame;
	size_t count = (size_t)cJSON_GetArraySize(frames);

	item->views = calloc(count + 1, sizeof(item->views[0]));
	item->targets = calloc(count + 1, sizeof(item->targets[0]));
	if (!item->views || !item->targets)
		return -1;
	cJSON_ArrayForEach(frame, frames)
	{
		const cJSON *role = cJSON_GetObjectItemCaseSensitive(frame, "role");
		struct dvsm_camera camera;

		if (read_camera(shared, frame, &camera) != 0)
			return -1;
		if (cJSON_IsString(role) && strcmp(role->valuestring, "target") == 0) {
			item->targets[item->target_count++] = camera;
			continue;
		}

		struct dvsm_view *view = &item->views[item->view_count++];

		view->camera = camera;
		if (read_view(folder, frame, view) != 0)
			return -1;
	}
	return 0;
}

static int read_scene(const char *folder, struct support_case *item)
{
	char path[1280];
	size_t size;
	unsigned char *text;
	cJSON *json;
	int result = -1;

	snprintf(path, sizeof(path), "%s/scene.json", folder);
	text = support_read_file(path, &size);
	json = text ? cJSON_Parse((const char *)text) : NULL;
	if (json)
		result = read_frames(folder, json, item);
	if (result != 0)
		fprintf(stderr, "%s: not a scene this test can read\n", path);
	cJSON_Delete(json);
	free(text);
	return result;
}

static int read_expected(const char *folder, struct support_case *item)
{
	char path[1280];
	struct support_array p1 = {0}, p2 = {0};
	int result = -1;

	snprintf(path, sizeof(path), "%s/expected.npz", folder);
	if (support_npz_read(path, "render", &item->render) == 0 &&
	    support_npz_read(path, "k0", &item->k0) == 0 &&
	    support_npz_read(path, "v0", &item->v0) == 0 &&
	    support_npz_read(path, "kL", &item->kl) == 0 &&
	    support_npz_read(path, "vL", &item->vl) == 0 &&
	    support_npz_read(path, "p1", &p1) == 0 && support_npz_read(path, "p2", &p2) == 0) {
		item->recon_patch_px = (uint32_t)p1.data[0];
		item->render_patch_px = (uint32_t)p2.data[0];
		result = 0;
	}
	support_array_free(&p1);
	support_array_free(&p2);
	return result;
}

struct support_case *support_case_read(const char *folder)
{
	struct support_case *item = calloc(1, sizeof(*item));
	const char *slash = strrchr(folder, '/');

	if (!item)
		return NULL;
	snprintf(item->name, sizeof(item->name), "%s", slash ? slash + 1 : folder);
	snprintf(item->model_path, sizeof(item->model_path), "%.1000s/model.safetensors", folder);
	if (read_scene(folder, item) != 0 || read_expected(folder, item) != 0) {
		support_case_free(item);
		return NULL;
	}
	return item;
}

void support_case_free(struct support_case *item)
{
	if (!item)
		return;
	for (uint32_t i = 0; i < item->view_count; i++) {
		void *rgb;

		/* The view borrows its picture as const; here it is owned. */
		memcpy(&rgb, &item->views[i].rgb, sizeof(rgb));
		free(rgb);
	}
	free(item->views);
	free(item->targets);
	support_array_free(&item->render);
	support_array_free(&item->k0);
	support_array_free(&item->v0);
	support_array_free(&item->kl);
	support_array_free(&item->vl);
	free(item);
}

static int is_case(const struct dirent *entry)
{
	return entry->d_name[0] != '.';
}

size_t support_case_list(char folders[SUPPORT_MAX_CASES][1024])
{
	char golden[512], path[1024];
	struct dirent **entries;
	size_t count = 0;
	int found;

	if (!support_shared_path("golden", golden, sizeof(golden)))
		return 0;
	found = scandir(golden, &entries, is_case, alphasort);
	for (int i = 0; i < found; i++) {
		struct stat status;

		snprintf(path, sizeof(path), "%s/%s/expected.npz", golden, entries[i]->d_name);
		if (count < SUPPORT_MAX_CASES && stat(path, &status) == 0)
			snprintf(folders[count++], 1024, "%s/%s", golden, entries[i]->d_name);
		free(entries[i]);
	}
	if (found >= 0)
		free(entries);
	return count;
}
