/* scene.json: posed pictures of one scene (MODEL.md section 7), read with every fault named. */
#ifndef DIO_APP_SCENE_FILE_H
#define DIO_APP_SCENE_FILE_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "dio/geometry.h"
#include "dio/status.h"

enum dio_scene_role { DIO_ROLE_CONTEXT, DIO_ROLE_TARGET };

/** One posed picture. */
struct dio_scene_frame {
	char *file; /* as written in scene.json, relative to its folder; NULL: a target without
		       picture */
	enum dio_scene_role role;
	struct dio_camera_model camera;
	struct dio_pose pose;
};

/** A scene; all strings and frames are owned. Release with dio_scene_file_deinit(). */
struct dio_scene_file {
	char *name;
	char *folder; /* where scene.json lies: picture files are relative to it */
	struct dio_scene_frame *frames;
	uint32_t frame_count;
};

/** Longest list of frames and largest scene.json taken. */
#define DIO_SCENE_FRAMES_MAX 65536u
#define DIO_SCENE_BYTES_MAX  (64u << 20)

/**
 * Read and check scene.json. A missing picture, a pose that is not rigid (> 1e-3 off), a focal
 * length that is not > 0, a number that is not finite, an unknown role, a missing key, no context
 * view: each is refused with one line that names the file, the frame and the fault.
 *
 * path   scene.json, or the folder that holds one
 * scene  zero-initialised
 *
 * DIO_NOT_FOUND, DIO_IO, DIO_NO_MEM, DIO_BAD_FILE
 */
enum dio_status dio_scene_file_read(const char *path, struct dio_scene_file *scene,
				    struct dio_error *error);

/** The same on text in memory, without looking for the pictures; `path` is for messages. */
enum dio_status dio_scene_file_parse(const char *text, size_t size, const char *path,
				     struct dio_scene_file *scene, struct dio_error *error);

/** Check a scene made in memory as a read one would be (pictures apart). */
enum dio_status dio_scene_file_check(const struct dio_scene_file *scene, const char *path,
				     struct dio_error *error);

/**
 * Write scene.json beside, sync, rename. A camera shared by all frames is written once. Refuses
 * what dio_scene_file_read() would refuse.
 */
enum dio_status dio_scene_file_write(const struct dio_scene_file *scene, const char *path,
				     struct dio_error *error);

/** Append a frame (file is copied, may be NULL). */
enum dio_status dio_scene_file_append(struct dio_scene_file *scene, const char *file,
				      enum dio_scene_role role,
				      const struct dio_camera_model *camera,
				      const struct dio_pose *pose, struct dio_error *error);

/** The same size, intrinsics and distortion to the last bit. */
bool dio_camera_model_equal(const struct dio_camera_model *a, const struct dio_camera_model *b);

/** Number of frames with a role. */
uint32_t dio_scene_file_count(const struct dio_scene_file *scene, enum dio_scene_role role);

/** Path of a frame's picture; release with free(). NULL when memory is short or there is no file.
 */
char *dio_scene_file_picture_path(const struct dio_scene_file *scene, uint32_t frame);

void dio_scene_file_deinit(struct dio_scene_file *scene);

#endif
