#include "core/scene_file.h"

#include <cjson/cJSON.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "core/json_out.h"
#include "core/path.h"

#define SIZE_MAX_PX     16384
#define RIGID_TOLERANCE 1e-3
#define FIRST_ROOM      16u

/* Room doubles, so that appending n frames stays linear; counts are powers of two times 16. */
static bool grow(struct dio_scene_file *scene)
{
	uint32_t count = scene->frame_count;
	struct dio_scene_frame *frames;

	if (count != 0 && (count < FIRST_ROOM || (count & (count - 1)) != 0))
		return true;
	frames = realloc(scene->frames, sizeof *frames * (count ? 2 * count : FIRST_ROOM));
	if (!frames)
		return false;
	scene->frames = frames;
	return true;
}

enum dio_status dio_scene_file_append(struct dio_scene_file *scene, const char *file,
				      enum dio_scene_role role,
				      const struct dio_camera_model *camera,
				      const struct dio_pose *pose, struct dio_error *error)
{
	char *copy = file ? strdup(file) : NULL;

	if (scene->frame_count >= DIO_SCENE_FRAMES_MAX) {
		free(copy);
		return dio_fail(error, DIO_BAD_FILE, "scene %s: more than %u frames",
				scene->name ? scene->name : "", DIO_SCENE_FRAMES_MAX);
	}
	if ((file && !copy) || !grow(scene)) {
		free(copy);
		return dio_fail(error, DIO_NO_MEM, "scene: no memory for another frame");
	}
	scene->frames[scene->frame_count++] = (struct dio_scene_frame){
		.file = copy, .role = role, .camera = *camera, .pose = *pose};
	return DIO_OK;
}

uint32_t dio_scene_file_count(const struct dio_scene_file *scene, enum dio_scene_role role)
{
	uint32_t count = 0;

	for (uint32_t i = 0; i < scene->frame_count; i++)
		count += scene->frames[i].role == role;
	return count;
}

char *dio_scene_file_picture_path(const struct dio_scene_file *scene, uint32_t frame)
{
	const char *file = scene->frames[frame].file;

	return file ? dio_path_join(scene->folder ? scene->folder : ".", file) : NULL;
}

void dio_scene_file_deinit(struct dio_scene_file *scene)
{
	for (uint32_t i = 0; i < scene->frame_count; i++)
		free(scene->frames[i].file);
	free(scene->frames);
	free(scene->name);
	free(scene->folder);
	*scene = (struct dio_scene_file){0};
}

static const char *check_camera(const struct dio_camera_model *camera)
{
	if (camera->width < 1 || camera->height < 1 || camera->width > SIZE_MAX_PX ||
	    camera->height > SIZE_MAX_PX)
		return "camera width or height is not within 1 to 16384 pixels";
	if (!isfinite(camera->fx) || !isfinite(camera->fy) || !isfinite(camera->cx) ||
	    !isfinite(camera->cy))
		return "camera has a number that is not finite";
	if (camera->fx <= 0 || camera->fy <= 0)
		return "camera focal length fx or fy is not above zero";
	for (int i = 0; i < 5; i++)
		if (!isfinite(camera->dist[i]))
			return "camera dist has a number that is not finite";
	return NULL;
}

static double determinant(const double m[16])
{
	return m[0] * (m[5] * m[10] - m[6] * m[9]) - m[1] * (m[4] * m[10] - m[6] * m[8]) +
	       m[2] * (m[4] * m[9] - m[5] * m[8]);
}

/* Largest difference of R R^T from the identity. */
static double orthonormal_error(const double m[16])
{
	double worst = 0;

	for (int i = 0; i < 3; i++)
		for (int j = 0; j < 3; j++) {
			double dot = 0;

			for (int k = 0; k < 3; k++)
				dot += m[4 * i + k] * m[4 * j + k];
			worst = fmax(worst, fabs(dot - (i == j)));
		}
	return worst;
}

/* `fault` receives what is wrong with a pose. */
static bool check_pose(const struct dio_pose *pose, char *fault, size_t size)
{
	const double *m = pose->world_from_camera;
	const double last[4] = {0, 0, 0, 1};
	double off;

	for (int i = 0; i < 16; i++)
		if (!isfinite(m[i])) {
			snprintf(fault, size,
				 "world_from_camera has a number that is not finite (at %d)", i);
			return false;
		}
	for (int i = 0; i < 4; i++)
		if (fabs(m[12 + i] - last[i]) > RIGID_TOLERANCE) {
			snprintf(fault, size, "world_from_camera's last row is not 0 0 0 1");
			return false;
		}
	off = orthonormal_error(m);
	if (fabs(determinant(m)) < RIGID_TOLERANCE)
		snprintf(fault, size, "world_from_camera is singular: its 3x3 part has no inverse");
	else if (off > RIGID_TOLERANCE)
		snprintf(fault, size,
			 "world_from_camera is not orthonormal: R R^T is %.3g off (%.3g allowed); "
			 "is there a scale in it?",
			 off, RIGID_TOLERANCE);
	else if (determinant(m) < 0)
		snprintf(fault, size,
			 "world_from_camera mirrors (determinant -1): is an axis flipped?");
	else
		return true;
	return false;
}

enum dio_status dio_scene_file_check(const struct dio_scene_file *scene, const char *path,
				     struct dio_error *error)
{
	for (uint32_t i = 0; i < scene->frame_count; i++) {
		const struct dio_scene_frame *frame = &scene->frames[i];
		const char *fault = check_camera(&frame->camera);
		char text[192];

		if (!fault && !check_pose(&frame->pose, text, sizeof text))
			fault = text;
		if (!fault && !frame->file && frame->role == DIO_ROLE_CONTEXT)
			fault = "a context view has no file";
		if (fault)
			return dio_fail(error, DIO_BAD_FILE, "%s: frame %u (%s): %s", path, i,
					frame->file ? frame->file : "no file", fault);
	}
	if (dio_scene_file_count(scene, DIO_ROLE_CONTEXT) == 0)
		return dio_fail(error, DIO_BAD_FILE,
				"%s: no context view among %u frames: at least one frame needs "
				"role \"context\"",
				path, scene->frame_count);
	return DIO_OK;
}

bool dio_camera_model_equal(const struct dio_camera_model *a, const struct dio_camera_model *b)
{
	for (int i = 0; i < 5; i++)
		if (a->dist[i] != b->dist[i])
			return false;
	return a->width == b->width && a->height == b->height && a->fx == b->fx && a->fy == b->fy &&
	       a->cx == b->cx && a->cy == b->cy;
}

static cJSON *make_frame(const struct dio_scene_frame *frame, const struct dio_camera_model *common)
{
	cJSON *object = cJSON_CreateObject();

	if (frame->file)
		cJSON_AddStringToObject(object, "file", frame->file);
	cJSON_AddStringToObject(object, "role",
				frame->role == DIO_ROLE_TARGET ? "target" : "context");
	cJSON_AddItemToObject(object, "world_from_camera",
			      dio_json_numbers(frame->pose.world_from_camera, 16));
	if (!dio_camera_model_equal(&frame->camera, common))
		cJSON_AddItemToObject(object, "camera", dio_json_camera(&frame->camera));
	return object;
}

enum dio_status dio_scene_file_write(const struct dio_scene_file *scene, const char *path,
				     struct dio_error *error)
{
	enum dio_status status = dio_scene_file_check(scene, path, error);
	cJSON *root, *frames;

	if (status != DIO_OK)
		return status;
	root = cJSON_CreateObject();
	cJSON_AddStringToObject(root, "name", scene->name ? scene->name : "scene");
	cJSON_AddItemToObject(root, "camera", dio_json_camera(&scene->frames[0].camera));
	frames = cJSON_AddArrayToObject(root, "frames");
	for (uint32_t i = 0; i < scene->frame_count; i++)
		cJSON_AddItemToArray(frames,
				     make_frame(&scene->frames[i], &scene->frames[0].camera));
	status = dio_json_write(root, path, error);
	cJSON_Delete(root);
	return status;
}
