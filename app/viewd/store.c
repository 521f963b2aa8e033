#include "viewd/store.h"

#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/statvfs.h>
#include <unistd.h>
#include <zlib.h>

#include "core/path.h"
#include "dio/atomic_file.h"
#include "viewd/store_private.h"

#define NUMBER_MAX 999999u

/* A PNG of noise is a little larger than its pixels. */
#define PICTURE_SPACE(width, height) ((uint64_t)(width) * (height)*3 * 11 / 10 + 65536)

static enum dio_status fail_memory(struct dio_error *error)
{
	return dio_fail(error, DIO_NO_MEM, "view store: no memory");
}

enum dio_status dio_store_sync_folder(const char *path, struct dio_error *error)
{
	int fd = open(path, O_RDONLY | O_DIRECTORY | O_CLOEXEC), result;

	if (fd < 0)
		return dio_fail(error, dio_status_from_errno(errno), "%s: cannot be opened: %s",
				path, strerror(errno));
	/* File systems that cannot sync a folder say EINVAL. */
	result = fsync(fd) == 0 || errno == EINVAL ? 0 : errno;
	close(fd);
	if (result != 0)
		return dio_fail(error, dio_status_from_errno(result), "%s: cannot be synced: %s",
				path, strerror(result));
	return DIO_OK;
}

/* Poses lie in the journal's entries; callers want them in a row. */
static enum dio_status line_up_poses(struct dio_store *store, struct dio_error *error)
{
	if (store->pose_room < store->journal.capacity) {
		struct dio_pose *grown =
			reallocarray(store->poses, store->journal.capacity, sizeof *grown);

		if (!grown)
			return fail_memory(error);
		store->poses = grown;
		store->pose_room = store->journal.capacity;
	}
	for (uint32_t i = 0; i < store->journal.count; i++)
		store->poses[i] = store->journal.entries[i].pose;
	return DIO_OK;
}

enum dio_status dio_store_list_views(const struct dio_store *store, struct dio_scene_file *scene,
				     struct dio_error *error)
{
	enum dio_status status = DIO_OK;
	char name[32];

	snprintf(name, sizeof name, "capture-%06u", store->number);
	scene->name = strdup(name);
	scene->folder = strdup(store->folder);
	if (!scene->name || !scene->folder)
		status = fail_memory(error);
	for (uint32_t i = 0; status == DIO_OK && i < store->journal.count; i++)
		status = dio_scene_file_append(scene, store->journal.entries[i].file,
					       DIO_ROLE_CONTEXT, &store->journal.camera,
					       &store->journal.entries[i].pose, error);
	return status;
}

static enum dio_status write_list(const struct dio_store *store, struct dio_error *error)
{
	char *path = dio_path_join(store->folder, DIO_STORE_LIST);
	struct dio_scene_file scene = {0};
	enum dio_status status =
		path ? dio_store_list_views(store, &scene, error) : fail_memory(error);

	if (status == DIO_OK && scene.frame_count > 0)
		status = dio_scene_file_write(&scene, path, error);
	dio_scene_file_deinit(&scene);
	free(path);
	return status;
}

/* Is a view's picture there, to the last bit? */
static bool is_picture_whole(const struct dio_store *store, const struct dio_journal_entry *entry)
{
	char *path = dio_path_join(store->folder, entry->file);
	FILE *file = path ? fopen(path, "rbe") : NULL;
	uLong crc = crc32(0, NULL, 0);
	uint64_t total = 0;
	uint8_t bytes[16384];
	size_t got;

	free(path);
	if (!file)
		return false;
	while ((got = fread(bytes, 1, sizeof bytes, file)) > 0) {
		crc = crc32(crc, bytes, (uInt)got);
		total += got;
	}
	fclose(file);
	return total == entry->size_bytes && crc == entry->crc32;
}

static void drop_damaged(struct dio_store *store, struct dio_store_report *report)
{
	struct dio_journal *journal = &store->journal;
	uint32_t kept = 0;

	for (uint32_t i = 0; i < journal->count; i++) {
		if (is_picture_whole(store, &journal->entries[i]))
			journal->entries[kept++] = journal->entries[i];
		else
			report->views_lost++;
	}
	journal->count = kept;
}

/* What a kill left half written. */
static void remove_parts(const char *folder)
{
	DIR *list = opendir(folder);
	struct dirent *entry;

	while (list && (entry = readdir(list))) {
		size_t length = strlen(entry->d_name);

		if (length > 5 && strcmp(entry->d_name + length - 5, ".part") == 0)
			unlinkat(dirfd(list), entry->d_name, 0);
	}
	if (list)
		closedir(list);
}

static void forget_capture(struct dio_store *store)
{
	dio_journal_deinit(&store->journal);
	free(store->folder);
	store->folder = NULL;
}

static char *capture_folder(const struct dio_store *store, uint32_t number)
{
	char *path;

	return asprintf(&path, "%s/%s/%06u", store->root, DIO_STORE_CAPTURES, number) < 0 ? NULL
											  : path;
}

/* Open capture `number` and put right what is not whole. DIO_NOT_FOUND: it holds no view. */
static enum dio_status open_capture(struct dio_store *store, uint32_t number,
				    struct dio_store_report *report, struct dio_error *error)
{
	struct dio_store_report found = {0};
	char *journal_path = NULL, *images = NULL;
	enum dio_status status = DIO_OK;

	forget_capture(store);
	store->number = number;
	store->folder = capture_folder(store, number);
	journal_path = store->folder ? dio_path_join(store->folder, DIO_STORE_JOURNAL) : NULL;
	images = store->folder ? dio_path_join(store->folder, DIO_STORE_IMAGES) : NULL;
	if (!journal_path || !images)
		status = fail_memory(error);
	if (status == DIO_OK)
		status = dio_journal_read(journal_path, &store->journal, error);
	if (status == DIO_OK) {
		remove_parts(store->folder);
		remove_parts(images);
		drop_damaged(store, &found);
		found.tail_lost = store->journal.torn;
		if (found.tail_lost || found.views_lost > 0)
			status = dio_journal_write(journal_path, &store->journal, error);
	}
	if (status == DIO_OK && store->journal.count == 0)
		status = dio_fail(error, DIO_NOT_FOUND, "%s: holds no view", store->folder);
	if (status == DIO_OK)
		status = write_list(store, error);
	if (status == DIO_OK)
		status = line_up_poses(store, error);
	if (status == DIO_OK && (found.tail_lost || found.views_lost > 0))
		snprintf(found.text, sizeof found.text,
			 "capture %06u: %u views were damaged and left out, %u are whole", number,
			 found.views_lost + found.tail_lost, store->journal.count);
	if (status == DIO_OK)
		*report = found;
	free(journal_path);
	free(images);
	return status;
}

static int is_number(const struct dirent *entry)
{
	return strlen(entry->d_name) == 6 && strspn(entry->d_name, "0123456789") == 6;
}

/* The newest capture that has views; `number` is that of the newest folder. */
static enum dio_status open_newest(struct dio_store *store, struct dio_store_report *report,
				   struct dio_error *error)
{
	char *path = dio_path_join(store->root, DIO_STORE_CAPTURES);
	struct dirent **names = NULL;
	uint32_t newest = 0;
	enum dio_status status = path ? dio_folder_make(path, error) : fail_memory(error);
	int count = status == DIO_OK ? scandir(path, &names, is_number, alphasort) : 0;

	if (count < 0)
		status = dio_fail(error, dio_status_from_errno(errno), "%s: cannot be read: %s",
				  path, strerror(errno));
	for (int i = count; status == DIO_OK && i-- > 0;) {
		uint32_t number = (uint32_t)strtoul(names[i]->d_name, NULL, 10);
		struct dio_error why = {""};
		enum dio_status opened = open_capture(store, number, report, &why);

		newest = number > newest ? number : newest;
		if (opened == DIO_OK)
			break;
		forget_capture(store);
		/* A capture that was cut off before its first view is no fault. */
		if (opened != DIO_NOT_FOUND && opened != DIO_BAD_FILE)
			status = dio_fail(error, opened, "%s", why.text);
		else if (opened == DIO_BAD_FILE)
			snprintf(report->text, sizeof report->text, "%.250s", why.text);
	}
	store->number = newest;
	for (int i = 0; i < count; i++)
		free(names[i]);
	free(names);
	free(path);
	return status;
}

enum dio_status dio_store_open(const char *folder, uint64_t reserve_bytes, struct dio_store **store,
			       struct dio_store_report *report, struct dio_error *error)
{
	struct dio_store *made = calloc(1, sizeof *made);
	struct dio_store_report found = {0};
	enum dio_status status;

	if (!made || !(made->root = strdup(folder))) {
		free(made);
		return fail_memory(error);
	}
	made->reserve_bytes = reserve_bytes;
	status = open_newest(made, &found, error);
	if (status != DIO_OK) {
		dio_store_close(made);
		return status;
	}
	if (report)
		*report = found;
	*store = made;
	return DIO_OK;
}

void dio_store_close(struct dio_store *store)
{
	if (!store)
		return;
	forget_capture(store);
	free(store->poses);
	free(store->root);
	free(store);
}

enum dio_status dio_store_check_space(const struct dio_store *store, uint64_t bytes,
				      struct dio_error *error)
{
	struct statvfs about;
	uint64_t free_bytes;

	if (statvfs(store->root, &about) != 0)
		return dio_fail(error, dio_status_from_errno(errno), "%s: cannot be asked: %s",
				store->root, strerror(errno));
	free_bytes = (uint64_t)about.f_bavail * about.f_frsize;
	if (free_bytes >= bytes && free_bytes - bytes >= store->reserve_bytes)
		return DIO_OK;
	return dio_fail(error, DIO_NO_SPACE,
			"%s: the disk has %llu MiB left, %llu MiB are needed and %llu MiB stay "
			"free: free some space",
			store->root, (unsigned long long)(free_bytes >> 20),
			(unsigned long long)((bytes + (1 << 20) - 1) >> 20),
			(unsigned long long)(store->reserve_bytes >> 20));
}

enum dio_status dio_store_begin(struct dio_store *store, const struct dio_camera_model *camera,
				struct dio_error *error)
{
	char *images = NULL, *journal_path = NULL;
	enum dio_status status =
		dio_store_check_space(store, PICTURE_SPACE(camera->width, camera->height), error);

	if (status != DIO_OK)
		return status;
	if (store->number >= NUMBER_MAX)
		return dio_fail(error, DIO_REFUSED, "%s/%s: all %u numbers are used: clear it",
				store->root, DIO_STORE_CAPTURES, NUMBER_MAX);
	forget_capture(store);
	store->number++;
	store->folder = capture_folder(store, store->number);
	store->journal.camera = *camera;
	if (store->folder) {
		images = dio_path_join(store->folder, DIO_STORE_IMAGES);
		journal_path = dio_path_join(store->folder, DIO_STORE_JOURNAL);
	}
	status = images && journal_path ? dio_folder_make(images, error) : fail_memory(error);
	if (status == DIO_OK)
		status = dio_journal_write(journal_path, &store->journal, error);
	if (status != DIO_OK)
		forget_capture(store);
	free(images);
	free(journal_path);
	return status;
}

/* Write the picture, then say in `entry` what was written. */
static enum dio_status write_picture(const struct dio_store *store,
				     const struct dio_picture *picture,
				     struct dio_journal_entry *entry, struct dio_error *error)
{
	char *path = dio_path_join(store->folder, entry->file);
	uint8_t *bytes = NULL;
	size_t size;
	enum dio_status status =
		path ? dio_picture_encode(entry->file, picture, &bytes, &size, error)
		     : fail_memory(error);

	if (status == DIO_OK)
		status = dio_atomic_file_write(path, bytes, size, error);
	if (status == DIO_OK) {
		entry->size_bytes = size;
		entry->crc32 = (uint32_t)crc32(0, bytes, (uInt)size);
	}
	free(bytes);
	free(path);
	return status;
}

/* The number behind the last view's: numbers of damaged views are not used again. */
static uint32_t next_number(const struct dio_journal *journal)
{
	const char *last = journal->count ? journal->entries[journal->count - 1].file : NULL;

	return last ? (uint32_t)strtoul(last + strlen("images/"), NULL, 10) + 1 : 0;
}

enum dio_status dio_store_append(struct dio_store *store, const struct dio_picture *picture,
				 const struct dio_pose *pose, uint64_t timestamp_ns,
				 struct dio_error *error)
{
	struct dio_journal_entry entry = {.pose = *pose, .timestamp_ns = timestamp_ns};
	char *path;
	enum dio_status status;

	if (!store->folder)
		return dio_fail(error, DIO_BAD_ARG, "view store: no capture was begun");
	if (picture->width != store->journal.camera.width ||
	    picture->height != store->journal.camera.height)
		return dio_fail(error, DIO_BAD_ARG,
				"view store: the picture has %u x %u pixels, its camera %u x %u",
				picture->width, picture->height, store->journal.camera.width,
				store->journal.camera.height);
	status =
		dio_store_check_space(store, PICTURE_SPACE(picture->width, picture->height), error);
	if (status != DIO_OK)
		return status;
	snprintf(entry.file, sizeof entry.file, "images/%03u.png", next_number(&store->journal));
	path = dio_path_join(store->folder, DIO_STORE_JOURNAL);
	status = path ? write_picture(store, picture, &entry, error) : fail_memory(error);
	if (status == DIO_OK)
		status = dio_journal_append(path, &entry, error);
	free(path);
	if (status == DIO_OK)
		status = dio_journal_add(&store->journal, &entry, error);
	if (status == DIO_OK)
		status = line_up_poses(store, error);
	if (status == DIO_OK)
		status = write_list(store, error);
	return status;
}

uint32_t dio_store_get_count(const struct dio_store *store)
{
	return store->folder ? store->journal.count : 0;
}

const struct dio_pose *dio_store_get_poses(const struct dio_store *store)
{
	return store->poses;
}

const struct dio_camera_model *dio_store_get_camera(const struct dio_store *store)
{
	return store->folder ? &store->journal.camera : NULL;
}

const char *dio_store_get_folder(const struct dio_store *store)
{
	return store->folder;
}

enum dio_status dio_store_load(const struct dio_store *store, struct dio_view_set *set,
			       struct dio_error *error)
{
	struct dio_scene_file scene = {0};
	enum dio_status status;

	if (dio_store_get_count(store) == 0)
		return dio_fail(error, DIO_REFUSED, "view store: there are no views");
	status = dio_store_list_views(store, &scene, error);
	if (status == DIO_OK)
		status = dio_view_set_load(&scene, DIO_LOAD_ALL, set, error);
	dio_scene_file_deinit(&scene);
	return status;
}
