/* The view store: captured posed views on disk, in order, whole or not there. */
#ifndef DIO_VIEWD_STORE_H
#define DIO_VIEWD_STORE_H

#include <stdbool.h>
#include <stdint.h>

#include "core/tum.h"
#include "core/view.h"
#include "dio/frame.h"
#include "dio/geometry.h"
#include "dio/status.h"

/**
 * A store is a folder:
 *
 *	captures/000003/views.journal      the truth: one line a view, with checksums
 *	                images/000.png     pinhole pictures
 *	                scene.json         the same views for every other program
 *	                path.tum           where the camera went meanwhile
 *	                scene.safetensors  what the engine made of them
 *	                reconstruct.due    a reconstruction is under way
 *	scenes/NAME/                       what was saved on request
 *
 * A picture is written beside, synced and renamed before its line is appended and synced: a power
 * cut loses at most the view in flight. Captures go when a later one has a scene; what is under
 * scenes/ is never touched again.
 *
 * Opaque; one thread at a time.
 */
struct dio_store;

/** What opening found wrong and put right; "" when all was well. */
struct dio_store_report {
	uint32_t views_lost; /* views whose picture is missing or damaged */
	bool tail_lost;      /* the last line was cut off */
	char text[256];
};

/**
 * Open a store, or make one, and take up its newest capture that has views.
 *
 * reserve_bytes  disk space that the store leaves free
 * report         NULL, or filled
 *
 * DIO_IO  the folder cannot be made or read
 */
enum dio_status dio_store_open(const char *folder, uint64_t reserve_bytes, struct dio_store **store,
			       struct dio_store_report *report, struct dio_error *error);
/** NULL is fine. */
void dio_store_close(struct dio_store *store);

/** Begin a new capture of views of one pinhole camera. */
enum dio_status dio_store_begin(struct dio_store *store, const struct dio_camera_model *camera,
				struct dio_error *error);

/**
 * Keep a view.
 *
 * DIO_BAD_ARG   no capture was begun, or the picture is not of its camera's size
 * DIO_NO_SPACE  refused before anything is written, or the disk filled up; views before are safe
 */
enum dio_status dio_store_append(struct dio_store *store, const struct dio_picture *picture,
				 const struct dio_pose *pose, uint64_t timestamp_ns,
				 struct dio_error *error);

uint32_t dio_store_get_count(const struct dio_store *store);
/** Poses of the views, [count], owned by the store until the next append. */
const struct dio_pose *dio_store_get_poses(const struct dio_store *store);
/** The camera of all views; NULL before there is a capture. */
const struct dio_camera_model *dio_store_get_camera(const struct dio_store *store);
/** Where the capture lies, NULL before there is one; owned by the store. */
const char *dio_store_get_folder(const struct dio_store *store);

/** The capture's views with their pictures, as copies. `set` is zero-initialised. */
enum dio_status dio_store_load(const struct dio_store *store, struct dio_view_set *set,
			       struct dio_error *error);

/** Keep and read the path of the camera; DIO_NOT_FOUND when none was kept. */
enum dio_status dio_store_write_path(struct dio_store *store, const struct dio_trajectory *path,
				     struct dio_error *error);
enum dio_status dio_store_read_path(const struct dio_store *store, struct dio_trajectory *path,
				    struct dio_error *error);

/** Where the capture's scene belongs; release with free(). NULL: no capture, or no memory. */
char *dio_store_scene_path(const struct dio_store *store);
bool dio_store_has_scene(const struct dio_store *store);

/** Note that a reconstruction is under way, so that it is taken up again after a power cut. */
enum dio_status dio_store_set_due(struct dio_store *store, bool due, struct dio_error *error);
bool dio_store_is_due(const struct dio_store *store);

/** The scene is written: clear the note, remove captures before this one. */
enum dio_status dio_store_settle(struct dio_store *store, struct dio_error *error);

/** DIO_NO_SPACE: the disk would have less than the reserve left after `bytes` more. */
enum dio_status dio_store_check_space(const struct dio_store *store, uint64_t bytes,
				      struct dio_error *error);

/** What was on the display, to be saved with a scene. */
struct dio_store_shot {
	const struct dio_picture *picture;
	const struct dio_camera_model *camera;
	struct dio_pose pose;
};

/**
 * Save the capture as scenes/NAME: views, scene and path, and view.png with view.tum and
 * view.json when there is a shot. All of it is there, or nothing.
 *
 * name    letters, digits, '.', '-' and '_'; "" for one made of the time
 * shot    NULL: nothing is shown
 * folder  receives its path; release with free()
 *
 * DIO_BAD_ARG  the name; or it is taken; or there is no view
 */
enum dio_status dio_store_save(const struct dio_store *store, const char *name,
			       const struct dio_store_shot *shot, char **folder,
			       struct dio_error *error);

#endif
