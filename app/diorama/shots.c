#include "shots.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "core/orbit.h"
#include "core/path.h"

static enum dio_status take_targets(const struct dio_view_set *set, struct shots *shots,
				    struct dio_error *error)
{
	if (!set)
		return dio_fail(error, DIO_BAD_ARG,
				"--path targets: a scene cache holds no targets: give --scene too");
	if (set->target_count == 0)
		return dio_fail(error, DIO_BAD_ARG,
				"the scene has no frame with role \"target\": use --path orbit");
	shots->list = calloc(set->target_count, sizeof *shots->list);
	if (!shots->list)
		return dio_fail(error, DIO_NO_MEM, "no memory for %u targets", set->target_count);
	for (uint32_t i = 0; i < set->target_count; i++) {
		const struct dio_view *view = &set->target[i];

		shots->list[i] = (struct shot){
			.name = strdup(view->name), .camera = view->camera, .pose = view->pose};
		shots->count++;
		if (!shots->list[i].name)
			return dio_fail(error, DIO_NO_MEM, "no memory for %u targets",
					set->target_count);
	}
	return DIO_OK;
}

/* All frames of a path are seen through one camera: the first of the context. */
static enum dio_status take_path(const struct dio_trajectory *path,
				 const struct dio_camera_model *camera, struct shots *shots,
				 struct dio_error *error)
{
	shots->is_path = true;
	shots->list = calloc(path->count, sizeof *shots->list);
	if (!shots->list)
		return dio_fail(error, DIO_NO_MEM, "no memory for %u poses", path->count);
	for (uint32_t i = 0; i < path->count; i++) {
		struct shot *shot = &shots->list[i];

		*shot = (struct shot){.camera = *camera, .pose = path->poses[i]};
		shots->count++;
		if (asprintf(&shot->name, "%05u", i) < 0) {
			shot->name = NULL;
			return dio_fail(error, DIO_NO_MEM, "no memory for %u poses", path->count);
		}
	}
	return DIO_OK;
}

static struct dio_camera_model camera_of(const struct dvsm_camera *camera)
{
	return (struct dio_camera_model){
		.width = camera->width,
		.height = camera->height,
		.fx = camera->fx,
		.fy = camera->fy,
		.cx = camera->cx,
		.cy = camera->cy,
	};
}

static enum dio_status make_orbit(const struct shots_wish *wish, const struct dvsm_scene *scene,
				  struct dio_trajectory *path, struct dio_error *error)
{
	uint32_t count = dvsm_scene_get_view_count(scene);
	const struct dvsm_camera *cameras = dvsm_scene_get_cameras(scene);
	struct dio_pose *poses = calloc(count, sizeof *poses);
	enum dio_status status = poses ? DIO_OK : DIO_NO_MEM;

	for (uint32_t i = 0; poses && i < count; i++)
		memcpy(poses[i].world_from_camera, cameras[i].world_from_camera,
		       sizeof poses[i].world_from_camera);
	if (status == DIO_OK)
		status = dio_orbit_path(poses, count, wish->frames, wish->frames_per_second, path);
	free(poses);
	return status == DIO_OK ? DIO_OK : dio_fail(error, status, "no memory for the orbit");
}

enum dio_status shots_make(const struct shots_wish *wish, const struct dvsm_scene *scene,
			   const struct dio_view_set *set, struct shots *shots,
			   struct dio_error *error)
{
	bool have_targets = set && set->target_count > 0;
	const char *wished = wish->path ? wish->path : have_targets ? "targets" : "orbit";
	struct dio_camera_model camera = camera_of(dvsm_scene_get_cameras(scene));
	struct dio_trajectory path = {0};
	enum dio_status status;

	if (strcmp(wished, "targets") == 0)
		return take_targets(set, shots, error);
	if (strcmp(wished, "orbit") == 0)
		status = make_orbit(wish, scene, &path, error);
	else
		status = dio_tum_read(wished, &path, error);
	if (status == DIO_OK)
		status = take_path(&path, &camera, shots, error);
	shots->name = dio_path_name(wished);
	dio_trajectory_deinit(&path);
	return status;
}

void shots_deinit(struct shots *shots)
{
	for (uint32_t i = 0; i < shots->count; i++)
		free(shots->list[i].name);
	free(shots->list);
	*shots = (struct shots){0};
}
