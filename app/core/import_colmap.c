/* COLMAP's text model: cameras.txt and images.txt. */
#include <ctype.h>
#include <math.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "core/import.h"
#include "core/path.h"
#include "core/text.h"
#include "core/tum.h"

#define CAMERAS_MAX    65536u
#define PARAMETERS_MAX 8

/* Where each of a model's parameters goes in (fx, fy, cx, cy, k1, k2, p1, p2). */
static const struct colmap_model {
	const char *name;
	int count;
	const char
		*order; /* a parameter's letter: f both focals, x fx, y fy, c cx, d cy, 1 2 p q */
} MODELS[] = {
	{"SIMPLE_PINHOLE", 3, "fcd"}, {"PINHOLE", 4, "xycd"},    {"SIMPLE_RADIAL", 4, "fcd1"},
	{"RADIAL", 5, "fcd12"},       {"OPENCV", 8, "xycd12pq"},
};

struct colmap_cameras {
	struct colmap_camera {
		uint64_t id;
		struct dio_camera_model model;
	} * list;
	uint32_t count;
};

/* One text file, cut into lines as it is walked. */
struct lines {
	const char *path;
	char *text, *rest;
	uint32_t number;
	struct dio_error *error;
};

static enum dio_status lines_open(struct lines *lines, const char *path, struct dio_error *error)
{
	enum dio_status status;
	size_t size;

	*lines = (struct lines){.path = path, .error = error};
	status = dio_text_read(path, (size_t)1 << 30, &lines->text, &size, error);
	lines->rest = lines->text;
	return status;
}

static char *next_line(struct lines *lines)
{
	char *line = strsep(&lines->rest, "\n");

	lines->number++;
	if (line)
		line[strcspn(line, "\r")] = '\0';
	return line;
}

/* Past comments and, when `skip_empty`, past empty lines. */
static char *next_data_line(struct lines *lines, bool skip_empty)
{
	char *line;

	do
		line = next_line(lines);
	while (line && (*line == '#' || (skip_empty && !line[strspn(line, " \t")])));
	return line;
}

static enum dio_status refuse(const struct lines *at, enum dio_status status, const char *fault)
{
	return dio_fail(at->error, status, "%s: line %u: %s", at->path, at->number, fault);
}

static bool take_number(char **at, double *value)
{
	char *end;

	*value = strtod(*at, &end);
	if (end == *at || !isfinite(*value))
		return false;
	*at = end;
	return true;
}

/* A word ends at a blank; *at moves behind it. */
static char *take_word(char **at)
{
	char *word;

	*at += strspn(*at, " \t");
	word = strsep(at, " \t");
	if (!*at)
		*at = word + strlen(word);
	return word;
}

static void set_parameter(struct dio_camera_model *model, char letter, double value)
{
	switch (letter) {
	case 'f':
		model->fx = model->fy = value;
		break;
	case 'x':
		model->fx = value;
		break;
	case 'y':
		model->fy = value;
		break;
	case 'c':
		model->cx = value - 0.5; /* COLMAP: the first pixel's centre is at 0.5 */
		break;
	case 'd':
		model->cy = value - 0.5;
		break;
	case '1':
		model->dist[0] = value;
		break;
	case '2':
		model->dist[1] = value;
		break;
	case 'p':
		model->dist[2] = value;
		break;
	default:
		model->dist[3] = value;
		break;
	}
}

/* CAMERA_ID MODEL WIDTH HEIGHT PARAMS[] */
static enum dio_status parse_camera(const struct lines *at, char *line,
				    struct colmap_camera *camera)
{
	const struct colmap_model *model = NULL;
	double id, width, height, value;
	char *name;

	if (!take_number(&line, &id) || id < 0)
		return refuse(at, DIO_BAD_FILE, "no camera number");
	name = take_word(&line);
	for (size_t i = 0; i < sizeof MODELS / sizeof *MODELS; i++)
		if (strcmp(name, MODELS[i].name) == 0)
			model = &MODELS[i];
	if (!model)
		return dio_fail(at->error, DIO_UNSUPPORTED,
				"%s: line %u: camera model %.40s is not read (SIMPLE_PINHOLE, "
				"PINHOLE, SIMPLE_RADIAL, RADIAL, OPENCV are): undistort with "
				"colmap image_undistorter first",
				at->path, at->number, name);
	if (!take_number(&line, &width) || !take_number(&line, &height) ||
	    !(width >= 1 && width <= 16384 && height >= 1 && height <= 16384))
		return refuse(at, DIO_BAD_FILE, "width or height is not within 1 to 16384 pixels");
	*camera = (struct colmap_camera){
		.id = (uint64_t)id,
		.model = {.width = (uint32_t)width, .height = (uint32_t)height}};
	for (int i = 0; i < model->count; i++) {
		if (!take_number(&line, &value))
			return refuse(at, DIO_BAD_FILE, "too few camera parameters");
		set_parameter(&camera->model, model->order[i], value);
	}
	if (line[strspn(line, " \t")])
		return refuse(at, DIO_BAD_FILE, "too many camera parameters");
	return DIO_OK;
}

static enum dio_status read_cameras(const char *path, struct colmap_cameras *cameras,
				    struct dio_error *error)
{
	struct lines lines;
	enum dio_status status = lines_open(&lines, path, error);
	char *line;

	while (status == DIO_OK && (line = next_data_line(&lines, true))) {
		struct colmap_camera *list =
			realloc(cameras->list, sizeof *list * (cameras->count + 1));

		if (!list || cameras->count == CAMERAS_MAX) {
			status = refuse(&lines, DIO_NO_MEM, "too many cameras, or no memory");
			cameras->list = list ? list : cameras->list;
			break;
		}
		cameras->list = list;
		status = parse_camera(&lines, line, &list[cameras->count]);
		cameras->count += status == DIO_OK;
	}
	free(lines.text);
	return status;
}

/* The inverse of a rigid T_cam_world, given as quaternion (w x y z) and translation. */
static void invert_rigid(const double quaternion_wxyz[4], const double translation[3],
			 struct dio_pose *pose)
{
	const double q[4] = {-quaternion_wxyz[1], -quaternion_wxyz[2], -quaternion_wxyz[3],
			     quaternion_wxyz[0]};
	const double zero[3] = {0};
	double *m = pose->world_from_camera;

	dio_pose_from_quaternion(q, zero, pose);
	for (int i = 0; i < 3; i++)
		m[4 * i + 3] = -(m[4 * i] * translation[0] + m[4 * i + 1] * translation[1] +
				 m[4 * i + 2] * translation[2]);
}

/* IMAGE_ID QW QX QY QZ TX TY TZ CAMERA_ID NAME; a name may hold blanks. */
static enum dio_status parse_image(const struct lines *at, char *line, struct dio_pose *pose,
				   uint64_t *camera_id, const char **name)
{
	double numbers[9], norm = 0;

	for (int i = 0; i < 9; i++)
		if (!take_number(&line, &numbers[i]))
			return refuse(at, DIO_BAD_FILE,
				      "IMAGE_ID QW QX QY QZ TX TY TZ CAMERA_ID NAME is wanted");
	for (int i = 1; i < 5; i++)
		norm += numbers[i] * numbers[i];
	norm = sqrt(norm);
	if (fabs(norm - 1) > 1e-2)
		return refuse(at, DIO_BAD_FILE, "the quaternion is not of length 1");
	for (int i = 1; i < 5; i++)
		numbers[i] /= norm;
	invert_rigid(numbers + 1, numbers + 5, pose);
	if (numbers[8] < 0)
		return refuse(at, DIO_BAD_FILE, "no camera number");
	*camera_id = (uint64_t)numbers[8];
	*name = line + strspn(line, " \t");
	if (!**name)
		return refuse(at, DIO_BAD_FILE, "the picture has no name");
	return DIO_OK;
}

static enum dio_status add_image(const struct lines *at, char *line,
				 const struct colmap_cameras *cameras, const char *pictures,
				 struct dio_scene_file *scene)
{
	const struct colmap_camera *camera = NULL;
	struct dio_pose pose;
	const char *name = NULL;
	uint64_t id = 0;
	enum dio_status status = parse_image(at, line, &pose, &id, &name);

	if (status != DIO_OK)
		return status;
	for (uint32_t i = 0; i < cameras->count; i++)
		if (cameras->list[i].id == id)
			camera = &cameras->list[i];
	if (!camera)
		return refuse(at, DIO_BAD_FILE, "its camera is not in cameras.txt");
	char *path = dio_path_join(pictures, name);
	char *relative = path ? dio_path_relative(scene->folder, path) : NULL;

	if (relative)
		status = dio_scene_file_append(scene, relative, DIO_ROLE_CONTEXT, &camera->model,
					       &pose, at->error);
	else
		status = dio_fail(at->error, DIO_BAD_FILE,
				  "%s: line %u: the picture %s is missing in %s: name its folder "
				  "with --images",
				  at->path, at->number, name, pictures);
	free(relative);
	free(path);
	return status;
}

static enum dio_status read_images(const char *path, const struct colmap_cameras *cameras,
				   const char *pictures, struct dio_scene_file *scene,
				   struct dio_error *error)
{
	struct lines lines;
	enum dio_status status = lines_open(&lines, path, error);
	char *line;

	while (status == DIO_OK && (line = next_data_line(&lines, true))) {
		status = add_image(&lines, line, cameras, pictures, scene);
		/* The second line lists the points seen; it may be empty. */
		if (status == DIO_OK)
			next_line(&lines);
	}
	free(lines.text);
	return status;
}

static int compare_frames(const void *a, const void *b)
{
	const struct dio_scene_frame *x = a, *y = b;

	return strcmp(x->file, y->file);
}

/* `images` beside the model, or one or two levels above (images/ and sparse/0/). */
static char *find_pictures(const char *folder)
{
	static const char *const PLACES[] = {"images", "../images", "../../images"};

	for (size_t i = 0; i < sizeof PLACES / sizeof *PLACES; i++) {
		char *path = dio_path_join(folder, PLACES[i]);

		if (path && dio_path_is_folder(path))
			return path;
		free(path);
	}
	return NULL;
}

static enum dio_status read_model(const char *folder, const char *pictures,
				  struct dio_scene_file *scene, struct dio_error *error)
{
	char *cameras_path = dio_path_join(folder, "cameras.txt");
	char *images_path = dio_path_join(folder, "images.txt");
	struct colmap_cameras cameras = {0};
	enum dio_status status;

	if (!cameras_path || !images_path)
		status = dio_fail(error, DIO_NO_MEM, "%s: no memory", folder);
	else
		status = read_cameras(cameras_path, &cameras, error);
	if (status == DIO_OK)
		status = read_images(images_path, &cameras, pictures, scene, error);
	/* COLMAP lists pictures in the order it registered them. */
	if (status == DIO_OK && scene->frame_count > 0)
		qsort(scene->frames, scene->frame_count, sizeof *scene->frames, compare_frames);
	if (status == DIO_OK)
		status = dio_scene_file_check(scene, images_path, error);
	free(cameras.list);
	free(cameras_path);
	free(images_path);
	return status;
}

enum dio_status dio_import_colmap(const char *folder, const char *pictures, const char *out_folder,
				  struct dio_scene_file *scene, struct dio_error *error)
{
	struct dio_scene_file made = {.name = strdup("scene"), .folder = strdup(out_folder)};
	char *place = pictures ? strdup(pictures) : find_pictures(folder);
	enum dio_status status;

	if (!made.name || !made.folder)
		status = dio_fail(error, DIO_NO_MEM, "%s: no memory", folder);
	else if (!place)
		status = dio_fail(error, DIO_NOT_FOUND,
				  "%s: no folder images beside or above it: name one with --images",
				  folder);
	else
		status = read_model(folder, place, &made, error);
	free(place);
	if (status == DIO_OK)
		*scene = made;
	else
		dio_scene_file_deinit(&made);
	return status;
}
