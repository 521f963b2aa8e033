/* What belongs to a capture beside its views: path, scene, and what is saved of it. */
#include <dirent.h>
#include <errno.h>
#include <ftw.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <time.h>
#include <unistd.h>

#include "core/json_out.h"
#include "core/path.h"
#include "dio/atomic_file.h"
#include "viewd/store.h"
#include "viewd/store_private.h"

#define NAME_LENGTH_MAX 64

static enum dio_status fail_memory(struct dio_error *error)
{
	return dio_fail(error, DIO_NO_MEM, "view store: no memory");
}

/* A file of the capture; release with free(). NULL: no capture, or no memory. */
static char *capture_path(const struct dio_store *store, const char *name)
{
	return store->folder ? dio_path_join(store->folder, name) : NULL;
}

static bool is_there(const struct dio_store *store, const char *name)
{
	char *path = capture_path(store, name);
	bool there = path && dio_path_is_file(path);

	free(path);
	return there;
}

char *dio_store_scene_path(const struct dio_store *store)
{
	return capture_path(store, DIO_STORE_SCENE);
}

bool dio_store_has_scene(const struct dio_store *store)
{
	return is_there(store, DIO_STORE_SCENE);
}

bool dio_store_is_due(const struct dio_store *store)
{
	return is_there(store, DIO_STORE_DUE);
}

enum dio_status dio_store_write_path(struct dio_store *store, const struct dio_trajectory *path,
				     struct dio_error *error)
{
	char *name = capture_path(store, DIO_STORE_PATH);
	enum dio_status status = name ? dio_tum_write(name, path, error) : fail_memory(error);

	free(name);
	return status;
}

enum dio_status dio_store_read_path(const struct dio_store *store, struct dio_trajectory *path,
				    struct dio_error *error)
{
	char *name = capture_path(store, DIO_STORE_PATH);
	enum dio_status status = name ? dio_tum_read(name, path, error)
				      : dio_fail(error, DIO_NOT_FOUND, "view store: no capture");

	free(name);
	return status;
}

enum dio_status dio_store_set_due(struct dio_store *store, bool due, struct dio_error *error)
{
	static const char text[] = "A reconstruction of this capture is under way.\n";
	char *path = capture_path(store, DIO_STORE_DUE);
	enum dio_status status = path ? DIO_OK : fail_memory(error);

	if (path && due)
		status = dio_atomic_file_write(path, text, sizeof text - 1, error);
	else if (path && unlink(path) != 0 && errno != ENOENT)
		status = dio_fail(error, dio_status_from_errno(errno), "%s: cannot be removed: %s",
				  path, strerror(errno));
	else if (path)
		status = dio_store_sync_folder(store->folder, error);
	free(path);
	return status;
}

static int remove_entry(const char *path, const struct stat *about, int kind, struct FTW *ftw)
{
	(void)about;
	(void)kind;
	(void)ftw;
	return remove(path);
}

enum dio_status dio_store_remove_tree(const char *path, struct dio_error *error)
{
	if (nftw(path, remove_entry, 8, FTW_DEPTH | FTW_PHYS | FTW_MOUNT) == 0 || errno == ENOENT)
		return DIO_OK;
	return dio_fail(error, dio_status_from_errno(errno), "%s: cannot be removed: %s", path,
			strerror(errno));
}

enum dio_status dio_store_settle(struct dio_store *store, struct dio_error *error)
{
	char *captures = dio_path_join(store->root, DIO_STORE_CAPTURES);
	DIR *list = captures ? opendir(captures) : NULL;
	struct dirent *entry;
	enum dio_status status = list ? dio_store_set_due(store, false, error)
				      : dio_fail(error, DIO_IO, "%s: cannot be read",
						 captures ? captures : store->root);

	while (status == DIO_OK && list && (entry = readdir(list))) {
		bool number =
			strlen(entry->d_name) == 6 && strspn(entry->d_name, "0123456789") == 6;
		char *path;

		if (!number || strtoul(entry->d_name, NULL, 10) >= store->number)
			continue;
		path = dio_path_join(captures, entry->d_name);
		status = path ? dio_store_remove_tree(path, error) : fail_memory(error);
		free(path);
	}
	if (list)
		closedir(list);
	free(captures);
	return status;
}

/* Files that the store wrote are never changed in place, so a second name is a copy. Where the
 * file system has no second names, the bytes are copied. */
static enum dio_status copy_file(const char *from, const char *to, struct dio_error *error)
{
	struct dio_atomic_file *file;
	char bytes[65536];
	FILE *source;
	size_t got;
	enum dio_status status;

	if (link(from, to) == 0)
		return DIO_OK;
	source = fopen(from, "rbe");
	if (!source)
		return dio_fail(error, dio_status_from_errno(errno), "%s: cannot be read: %s", from,
				strerror(errno));
	status = dio_atomic_file_open(to, &file, error);
	while (status == DIO_OK && (got = fread(bytes, 1, sizeof bytes, source)) > 0) {
		if (fwrite(bytes, 1, got, dio_atomic_file_stream(file)) == got)
			continue;
		status = dio_fail(error, dio_status_from_errno(errno), "%s: cannot be written: %s",
				  to, strerror(errno));
		dio_atomic_file_discard(file);
	}
	fclose(source);
	return status == DIO_OK ? dio_atomic_file_commit(file, error) : status;
}

/* `must`: a file that is missing is a fault. */
static enum dio_status take_along(const struct dio_store *store, const char *name,
				  const char *folder, bool must, struct dio_error *error)
{
	char *from = capture_path(store, name), *to = dio_path_join(folder, name);
	enum dio_status status = DIO_OK;

	if (!from || !to)
		status = fail_memory(error);
	else if (must || dio_path_is_file(from))
		status = copy_file(from, to, error);
	free(from);
	free(to);
	return status;
}

/* view.png, view.tum and view.json: what was seen, from where, with which camera. */
static enum dio_status write_shot(const struct dio_store_shot *shot, const char *folder,
				  struct dio_error *error)
{
	struct dio_trajectory trajectory = {0};
	char *png = dio_path_join(folder, "view.png"), *tum = dio_path_join(folder, "view.tum");
	char *json = dio_path_join(folder, "view.json");
	cJSON *root = cJSON_CreateObject();
	enum dio_status status =
		png && tum && json && root ? dio_trajectory_init(&trajectory, 1) : DIO_NO_MEM;

	if (status != DIO_OK)
		fail_memory(error);
	if (status == DIO_OK)
		status = dio_picture_write(png, shot->picture, error);
	if (status == DIO_OK) {
		trajectory.poses[0] = shot->pose;
		status = dio_tum_write(tum, &trajectory, error);
	}
	if (status == DIO_OK) {
		cJSON_AddItemToObject(root, "camera", dio_json_camera(shot->camera));
		cJSON_AddItemToObject(root, "world_from_camera",
				      dio_json_numbers(shot->pose.world_from_camera, 16));
		status = dio_json_write(root, json, error);
	}
	cJSON_Delete(root);
	dio_trajectory_deinit(&trajectory);
	free(png);
	free(tum);
	free(json);
	return status;
}

static enum dio_status fill_saved(const struct dio_store *store, const struct dio_store_shot *shot,
				  const char *folder, struct dio_error *error)
{
	char *images = dio_path_join(folder, DIO_STORE_IMAGES);
	enum dio_status status = images ? dio_folder_make(images, error) : fail_memory(error);

	for (uint32_t i = 0; status == DIO_OK && i < store->journal.count; i++)
		status = take_along(store, store->journal.entries[i].file, folder, true, error);
	if (status == DIO_OK)
		status = take_along(store, DIO_STORE_LIST, folder, true, error);
	if (status == DIO_OK)
		status = take_along(store, DIO_STORE_SCENE, folder, false, error);
	if (status == DIO_OK)
		status = take_along(store, DIO_STORE_PATH, folder, false, error);
	if (status == DIO_OK && shot)
		status = write_shot(shot, folder, error);
	if (status == DIO_OK)
		status = dio_store_sync_folder(images, error);
	if (status == DIO_OK)
		status = dio_store_sync_folder(folder, error);
	free(images);
	return status;
}

static enum dio_status choose_name(const char *wished, char *name, size_t size,
				   struct dio_error *error)
{
	static const char letters[] =
		"abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789._-";
	time_t now = time(NULL);
	struct tm parts;

	if (!*wished) {
		strftime(name, size, "%Y%m%d-%H%M%S", gmtime_r(&now, &parts));
		return DIO_OK;
	}
	if (strlen(wished) > NAME_LENGTH_MAX || wished[strspn(wished, letters)] != '\0' ||
	    wished[0] == '.')
		return dio_fail(error, DIO_BAD_ARG,
				"'%.80s' is no name to save under: letters, digits, '.', '-' and "
				"'_', at most %d, no '.' at the start",
				wished, NAME_LENGTH_MAX);
	snprintf(name, size, "%s", wished);
	return DIO_OK;
}

/* Where it is to be, and where it is made: neither is there yet. */
static enum dio_status saved_paths(const struct dio_store *store, const char *wished, char **path,
				   char **part, struct dio_error *error)
{
	char *scenes = dio_path_join(store->root, DIO_STORE_SCENES);
	char name[NAME_LENGTH_MAX + 1];
	enum dio_status status = choose_name(wished, name, sizeof name, error);

	if (status == DIO_OK)
		status = scenes ? dio_folder_make(scenes, error) : fail_memory(error);
	if (status == DIO_OK && (asprintf(path, "%s/%s", scenes, name) < 0 ||
				 asprintf(part, "%s/.%s.part", scenes, name) < 0))
		status = fail_memory(error);
	if (status == DIO_OK && access(*path, F_OK) == 0)
		status = dio_fail(error, DIO_BAD_ARG, "%s: is there already: choose another name",
				  *path);
	free(scenes);
	return status;
}

enum dio_status dio_store_save(const struct dio_store *store, const char *name,
			       const struct dio_store_shot *shot, char **folder,
			       struct dio_error *error)
{
	char *path = NULL, *part = NULL, *scenes = NULL;
	enum dio_status status;

	if (dio_store_get_count(store) == 0)
		return dio_fail(error, DIO_BAD_ARG, "view store: there is no view to save");
	status = saved_paths(store, name, &path, &part, error);
	if (status == DIO_OK)
		status = dio_store_remove_tree(part, error);
	if (status == DIO_OK) {
		status = fill_saved(store, shot, part, error);
		if (status == DIO_OK && rename(part, path) != 0)
			status = dio_fail(error, dio_status_from_errno(errno),
					  "%s: cannot be put in place: %s", path, strerror(errno));
		if (status != DIO_OK)
			dio_store_remove_tree(part, NULL);
	}
	if (status == DIO_OK) {
		scenes = dio_path_folder(path);
		status = scenes ? dio_store_sync_folder(scenes, error) : fail_memory(error);
	}
	free(scenes);
	free(part);
	if (status == DIO_OK)
		*folder = path;
	else
		free(path);
	return status;
}
