/* What the files of the store share. */
#ifndef DIO_VIEWD_STORE_PRIVATE_H
#define DIO_VIEWD_STORE_PRIVATE_H

#include "viewd/store.h"
#include "viewd/store_journal.h"

#define DIO_STORE_CAPTURES "captures"
#define DIO_STORE_SCENES   "scenes"
#define DIO_STORE_IMAGES   "images"
#define DIO_STORE_JOURNAL  "views.journal"
#define DIO_STORE_LIST     "scene.json"
#define DIO_STORE_PATH     "path.tum"
#define DIO_STORE_SCENE    "scene.safetensors"
#define DIO_STORE_DUE      "reconstruct.due"

struct dio_store {
	char *root;
	char *folder; /* the capture, NULL before there is one */
	uint32_t number;
	uint64_t reserve_bytes;
	struct dio_journal journal;
	struct dio_pose *poses; /* [journal.count], as many as there is room for in the journal */
	uint32_t pose_room;
};

/** The journal's views as a scene; zero-initialised, release with dio_scene_file_deinit(). */
enum dio_status dio_store_list_views(const struct dio_store *store, struct dio_scene_file *scene,
				     struct dio_error *error);

/** Sync a folder, so that the names in it last. */
enum dio_status dio_store_sync_folder(const char *path, struct dio_error *error);

/** Remove a folder with all that is in it; one that is not there is fine. */
enum dio_status dio_store_remove_tree(const char *path, struct dio_error *error);

#endif
