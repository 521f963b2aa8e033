/* transforms.json of nerfstudio, instant-ngp and the Blender sets. */
#include <cjson/cJSON.h>
#include <math.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "core/import.h"
#include "core/path.h"
#include "core/text.h"
#include "dio/frame.h"

/* Where we are, for messages. */
struct place {
	const char *path, *folder, *out_folder;
	const cJSON *root, *frame;
	uint32_t index;
	const char *file; /* file_path of the frame */
	struct dio_error *error;
};

static enum dio_status refuse(const struct place *at, enum dio_status status, const char *fault)
{
	if (!at->frame)
		return dio_fail(at->error, status, "%s: %s", at->path, fault);
	return dio_fail(at->error, status, "%s: frame %u (%.120s): %s", at->path, at->index,
			at->file ? at->file : "no file_path", fault);
}

/* A number of the frame, or else of the file. */
static bool get_number(const struct place *at, const char *key, double *value)
{
	const cJSON *item = cJSON_GetObjectItemCaseSensitive(at->frame, key);

	if (!item)
		item = cJSON_GetObjectItemCaseSensitive(at->root, key);
	if (!cJSON_IsNumber(item))
		return false;
	*value = item->valuedouble;
	return true;
}

/* file_path may lack its ending (the Blender sets): the first picture that is there. */
static char *find_picture(const struct place *at)
{
	static const char *const ENDINGS[] = {"", ".png", ".jpg", ".jpeg", ".PNG", ".JPG", ".JPEG"};
	char *base = dio_path_join(at->folder, at->file);

	for (size_t i = 0; base && i < sizeof ENDINGS / sizeof *ENDINGS; i++) {
		char *path;

		if (asprintf(&path, "%s%s", base, ENDINGS[i]) < 0)
			break;
		if (dio_path_is_file(path)) {
			free(base);
			return path;
		}
		free(path);
	}
	free(base);
	return NULL;
}

/* Width and height, from the picture itself where the file does not state them. */
static enum dio_status read_size(const struct place *at, const char *picture_path,
				 struct dio_camera_model *camera)
{
	struct dio_picture picture = {0};
	enum dio_status status;
	double w, h;

	if (get_number(at, "w", &w) && get_number(at, "h", &h)) {
		if (!(w >= 1 && w <= 16384 && h >= 1 && h <= 16384))
			return refuse(at, DIO_BAD_FILE, "w or h is not within 1 to 16384 pixels");
		camera->width = (uint32_t)w;
		camera->height = (uint32_t)h;
		return DIO_OK;
	}
	status = dio_picture_read(picture_path, &picture, at->error);
	if (status != DIO_OK)
		return status;
	camera->width = picture.width;
	camera->height = picture.height;
	dio_picture_deinit(&picture);
	return DIO_OK;
}

static double focal_from_angle(double angle_rad, uint32_t pixels)
{
	return 0.5 * pixels / tan(0.5 * angle_rad);
}

static enum dio_status read_focal(const struct place *at, struct dio_camera_model *camera)
{
	double angle;

	if (!get_number(at, "fl_x", &camera->fx)) {
		if (!get_number(at, "camera_angle_x", &angle))
			return refuse(at, DIO_BAD_FILE, "has neither fl_x nor camera_angle_x");
		if (!(angle > 0 && angle < 3.14))
			return refuse(at, DIO_BAD_FILE,
				      "camera_angle_x is not an angle in radians below pi");
		camera->fx = focal_from_angle(angle, camera->width);
	}
	if (!get_number(at, "fl_y", &camera->fy)) {
		camera->fy = camera->fx;
		if (get_number(at, "camera_angle_y", &angle) && angle > 0 && angle < 3.14)
			camera->fy = focal_from_angle(angle, camera->height);
	}
	return DIO_OK;
}

static enum dio_status read_distortion(const struct place *at, struct dio_camera_model *camera)
{
	static const char *const TERMS[] = {"k1", "k2", "p1", "p2", "k3"};
	static const char *const FOREIGN[] = {"k4", "k5", "k6"};
	const cJSON *model = cJSON_GetObjectItemCaseSensitive(at->root, "camera_model");
	double value = 0;

	if (cJSON_IsTrue(cJSON_GetObjectItemCaseSensitive(at->root, "is_fisheye")) ||
	    (cJSON_IsString(model) && strcmp(model->valuestring, "OPENCV") != 0 &&
	     strcmp(model->valuestring, "PINHOLE") != 0 &&
	     strcmp(model->valuestring, "SIMPLE_PINHOLE") != 0))
		return refuse(at, DIO_UNSUPPORTED,
			      "the camera model is neither PINHOLE nor OPENCV: undistort the "
			      "pictures first");
	for (size_t i = 0; i < sizeof FOREIGN / sizeof *FOREIGN; i++)
		if (get_number(at, FOREIGN[i], &value) && value != 0)
			return refuse(at, DIO_UNSUPPORTED,
				      "distortion beyond k1 k2 p1 p2 k3: undistort the pictures "
				      "first");
	for (size_t i = 0; i < sizeof TERMS / sizeof *TERMS; i++)
		if (get_number(at, TERMS[i], &value))
			camera->dist[i] = value;
	return DIO_OK;
}

static enum dio_status read_camera(const struct place *at, const char *picture_path,
				   struct dio_camera_model *camera)
{
	enum dio_status status;

	*camera = (struct dio_camera_model){0};
	if ((status = read_size(at, picture_path, camera)) != DIO_OK ||
	    (status = read_focal(at, camera)) != DIO_OK ||
	    (status = read_distortion(at, camera)) != DIO_OK)
		return status;
	/* From the picture's corner to the centre of its first pixel. */
	if (!get_number(at, "cx", &camera->cx))
		camera->cx = 0.5 * camera->width;
	if (!get_number(at, "cy", &camera->cy))
		camera->cy = 0.5 * camera->height;
	camera->cx -= 0.5;
	camera->cy -= 0.5;
	return DIO_OK;
}

/* OpenGL's camera looks along -z with y up: the second and third column change sign. */
static enum dio_status read_pose(const struct place *at, struct dio_pose *pose)
{
	const cJSON *matrix = cJSON_GetObjectItemCaseSensitive(at->frame, "transform_matrix");
	const cJSON *row, *item;
	int i = 0, rows = cJSON_GetArraySize(matrix);

	if (!cJSON_IsArray(matrix) || (rows != 4 && rows != 3))
		return refuse(at, DIO_BAD_FILE, "transform_matrix is not a list of four rows");
	cJSON_ArrayForEach(row, matrix)
	{
		if (!cJSON_IsArray(row) || cJSON_GetArraySize(row) != 4)
			return refuse(at, DIO_BAD_FILE,
				      "transform_matrix has a row that is not four numbers");
		cJSON_ArrayForEach(item, row)
		{
			if (!cJSON_IsNumber(item))
				return refuse(at, DIO_BAD_FILE,
					      "transform_matrix has an entry that is not a number");
			bool turned = i < 12 && (i % 4 == 1 || i % 4 == 2);

			pose->world_from_camera[i++] =
				turned ? -item->valuedouble : item->valuedouble;
		}
	}
	for (; i < 16; i++)
		pose->world_from_camera[i] = i == 15;
	return DIO_OK;
}

static enum dio_status read_frame(struct place *at, struct dio_scene_file *scene)
{
	const cJSON *file = cJSON_GetObjectItemCaseSensitive(at->frame, "file_path");
	struct dio_camera_model camera;
	struct dio_pose pose;
	enum dio_status status;
	char *picture, *relative;

	at->file = cJSON_IsString(file) ? file->valuestring : NULL;
	if (!at->file)
		return refuse(at, DIO_BAD_FILE, "has no file_path");
	picture = find_picture(at);
	if (!picture)
		return refuse(at, DIO_BAD_FILE, "the picture is missing");
	relative = dio_path_relative(at->out_folder, picture);
	if (!relative)
		status = dio_fail(at->error, DIO_NOT_FOUND, "%s: no such folder", at->out_folder);
	else if ((status = read_camera(at, picture, &camera)) == DIO_OK &&
		 (status = read_pose(at, &pose)) == DIO_OK)
		status = dio_scene_file_append(scene, relative, DIO_ROLE_CONTEXT, &camera, &pose,
					       at->error);
	free(relative);
	free(picture);
	return status;
}

static enum dio_status read_root(const char *path, const char *out_folder, const cJSON *root,
				 struct dio_scene_file *scene, struct dio_error *error)
{
	const cJSON *frames = cJSON_GetObjectItemCaseSensitive(root, "frames");
	char *folder = dio_path_folder(path);
	struct place at = {.path = path,
			   .folder = folder,
			   .out_folder = out_folder,
			   .root = root,
			   .error = error};
	enum dio_status status = DIO_OK;

	if (!folder)
		return dio_fail(error, DIO_NO_MEM, "%s: no memory", path);
	if (!cJSON_IsArray(frames))
		status = refuse(&at, DIO_BAD_FILE, "has no list \"frames\"");
	for (at.frame = frames ? frames->child : NULL; status == DIO_OK && at.frame;
	     at.frame = at.frame->next, at.index++)
		status = read_frame(&at, scene);
	free(folder);
	return status;
}

enum dio_status dio_import_transforms(const char *path, const char *out_folder,
				      struct dio_scene_file *scene, struct dio_error *error)
{
	struct dio_scene_file made = {.name = strdup("scene"), .folder = strdup(out_folder)};
	enum dio_status status;
	char *text = NULL;
	cJSON *root = NULL;
	size_t size;

	status = made.name && made.folder ? DIO_OK : DIO_NO_MEM;
	if (status != DIO_OK)
		dio_fail(error, status, "%s: no memory", path);
	else
		status = dio_text_read(path, DIO_SCENE_BYTES_MAX, &text, &size, error);
	if (status == DIO_OK && !(root = cJSON_ParseWithLength(text, size)))
		status = dio_fail(error, DIO_BAD_FILE, "%s: is not JSON", path);
	if (status == DIO_OK)
		status = read_root(path, out_folder, root, &made, error);
	if (status == DIO_OK)
		status = dio_scene_file_check(&made, path, error);
	cJSON_Delete(root);
	free(text);
	if (status == DIO_OK)
		*scene = made;
	else
		dio_scene_file_deinit(&made);
	return status;
}
