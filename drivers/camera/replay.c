/* Replay: the pictures of a folder, or a recording with its own timestamps. */
#include "backend.h"

#include <errno.h>
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>
#include <zlib.h>

#include "dio/clock.h"
#include "dio/file.h"
#include "folder.h"
#include "pace.h"
#include "recording_index.h"

#define NS_PER_S 1000000000.0
/* Pictures of a folder carry no time: they are stamped as if taken at this rate unless told. */
#define FOLDER_RATE     30.0
#define FRAME_BYTES_MAX ((size_t)1 << 30)

struct replay {
	struct dio_camera base; /* first */
	char *folder;
	bool is_recording, is_paced;
	char **names; /* of a folder; count of them */
	struct dio_recording_index index;
	size_t count, next;
	uint64_t epoch_ns; /* when frame 0 is due */
	char *path;        /* of the frame taken last */
	struct dio_picture picture;
	uint8_t *bytes; /* of an MJPEG frame */
};

static struct replay *self(struct dio_camera *camera)
{
	return (struct replay *)camera;
}

/* When a recorded frame was taken; of a folder, time from its first picture. */
static uint64_t timestamp_of(const struct replay *replay, size_t i)
{
	double rate = replay->base.options.frames_per_second;

	if (replay->is_recording)
		return replay->index.entries[i].timestamp_ns;
	return (uint64_t)((double)i * NS_PER_S / (rate > 0 ? rate : FOLDER_RATE));
}

/* Time from the first frame; clocks that step back in a recording make no frame due earlier. */
static uint64_t offset_of(const struct replay *replay, size_t i)
{
	uint64_t first = timestamp_of(replay, 0), this = timestamp_of(replay, i);

	return this > first ? this - first : 0;
}

static enum dio_status replay_start(struct dio_camera *camera, struct dio_error *error)
{
	struct replay *replay = self(camera);

	(void)error;
	/* Goes on where it was stopped. */
	if (replay->next < replay->count)
		replay->epoch_ns = dio_clock_ns() - offset_of(replay, replay->next);
	return DIO_OK;
}

static enum dio_status replay_stop(struct dio_camera *camera, struct dio_error *error)
{
	(void)camera;
	(void)error;
	return DIO_OK;
}

static void replay_close(struct dio_camera *camera)
{
	struct replay *replay = self(camera);

	if (replay->names)
		dio_folder_free(replay->names, replay->count);
	dio_recording_index_deinit(&replay->index);
	dio_picture_deinit(&replay->picture);
	free(replay->bytes);
	free(replay->path);
	free(replay->folder);
	free(replay);
}

static void count_gap(struct replay *replay, size_t i)
{
	const struct dio_recording_entry *entries = replay->index.entries;

	if (replay->is_recording && i > 0 && entries[i].sequence > entries[i - 1].sequence + 1)
		replay->base.counters.lost += entries[i].sequence - entries[i - 1].sequence - 1;
}

static enum dio_status check_entry(const struct dio_recording_entry *entry, const char *path,
				   const uint8_t *bytes, size_t size, struct dio_error *error)
{
	if (size != entry->size_bytes)
		return dio_fail(error, DIO_BAD_FILE,
				"%s: %zu bytes where %" PRIu64
				" were recorded; the file is damaged",
				path, size, entry->size_bytes);
	if (crc32_z(0, bytes, size) != entry->crc32)
		return dio_fail(error, DIO_BAD_FILE,
				"%s: its checksum is not the recorded one; the file is damaged",
				path);
	return DIO_OK;
}

/* A frame of MJPEG goes out as it came in, as the camera would have delivered it. */
static bool is_jpeg_entry(const struct dio_recording_entry *entry)
{
	const char *dot = strrchr(entry->file, '.');

	return dot && strcmp(dot, ".jpg") == 0;
}

static enum dio_status load_entry(struct replay *replay, const struct dio_recording_entry *entry,
				  struct dio_frame *frame, struct dio_error *error)
{
	struct dio_picture picture;
	uint8_t *bytes;
	size_t size;
	enum dio_status status = dio_file_read(replay->path, FRAME_BYTES_MAX, &bytes, &size, error);

	if (status != DIO_OK)
		return status == DIO_NOT_FOUND ? DIO_BAD_FILE : status;
	status = check_entry(entry, replay->path, bytes, size, error);
	if (status == DIO_OK && is_jpeg_entry(entry)) {
		free(replay->bytes);
		replay->bytes = bytes;
		*frame = (struct dio_frame){
			.format = DIO_PIXEL_MJPEG,
			.width = replay->base.info.width,
			.height = replay->base.info.height,
			.data = bytes,
			.size_bytes = size,
		};
		return DIO_OK;
	}
	if (status == DIO_OK)
		status = dio_picture_decode(bytes, size, replay->path, &picture, error);
	free(bytes);
	if (status != DIO_OK)
		return status;
	dio_picture_deinit(&replay->picture);
	replay->picture = picture;
	*frame = dio_frame_from_picture(&replay->picture);
	return DIO_OK;
}

static enum dio_status load_picture(struct replay *replay, struct dio_frame *frame,
				    struct dio_error *error)
{
	struct dio_picture picture;
	enum dio_status status = dio_picture_read(replay->path, &picture, error);

	if (status == DIO_OK) {
		dio_picture_deinit(&replay->picture);
		replay->picture = picture;
		*frame = dio_frame_from_picture(&replay->picture);
	}
	/* Removed between listing and reading, or not permitted: one picture less. */
	return status == DIO_NOT_FOUND || status == DIO_IO ? DIO_BAD_FILE : status;
}

static enum dio_status load(struct replay *replay, size_t i, struct dio_frame *frame,
			    struct dio_error *error)
{
	const char *name = replay->is_recording ? replay->index.entries[i].file : replay->names[i];
	char *path;

	if (asprintf(&path, "%s/%s", replay->folder, name) < 0)
		return dio_fail(error, DIO_NO_MEM, "%s/%s: out of memory", replay->folder, name);
	free(replay->path);
	replay->path = path;
	replay->base.frame_name = path + strlen(replay->folder) + 1;
	if (replay->is_recording)
		return load_entry(replay, &replay->index.entries[i], frame, error);
	return load_picture(replay, frame, error);
}

static enum dio_status replay_acquire(struct dio_camera *camera, struct dio_frame *frame,
				      int64_t timeout_ns, struct dio_error *error)
{
	struct replay *replay = self(camera);
	struct dio_frame loaded;
	enum dio_status status;
	size_t i;

	if (replay->next >= replay->count)
		return dio_fail(error, DIO_END, "%s: all %zu frames were delivered", replay->folder,
				replay->count);
	if (replay->is_paced) {
		if (!dio_pace_wait(replay->epoch_ns + offset_of(replay, replay->next), timeout_ns))
			return dio_fail(error, DIO_AGAIN, "%s: frame %zu is not due yet",
					replay->folder, replay->next);
		while (!camera->options.every_frame && replay->next + 1 < replay->count &&
		       replay->epoch_ns + offset_of(replay, replay->next + 1) <= dio_clock_ns()) {
			count_gap(replay, replay->next++);
			camera->counters.drained++;
		}
	}
	i = replay->next++;
	count_gap(replay, i);
	status = load(replay, i, &loaded, error);
	if (status != DIO_OK) {
		camera->counters.broken++;
		return status;
	}
	loaded.timestamp_ns = timestamp_of(replay, i);
	if (!replay->is_recording && replay->is_paced)
		loaded.timestamp_ns += replay->epoch_ns; /* as if taken when it was due */
	loaded.sequence = replay->is_recording ? replay->index.entries[i].sequence : i;
	if (replay->is_recording)
		loaded.metadata = replay->index.entries[i].metadata;
	*frame = loaded;
	return DIO_OK;
}

static const struct dio_camera_ops ops = {
	.start = replay_start,
	.stop = replay_stop,
	.acquire = replay_acquire,
	.close = replay_close,
};

static enum dio_status open_recording(struct replay *replay, struct dio_error *error)
{
	struct dio_camera_info *info = &replay->base.info;
	enum dio_status status = dio_recording_index_read(replay->folder, &replay->index, error);

	if (status != DIO_OK)
		return status;
	*info = replay->index.camera;
	/* All but MJPEG was stored as PNG and comes back as RGB. */
	if (info->format != DIO_PIXEL_MJPEG)
		info->format = DIO_PIXEL_RGB24;
	replay->is_recording = true;
	replay->count = replay->index.count;
	replay->is_paced = !replay->base.options.as_fast_as_possible;
	return DIO_OK;
}

/* The size of a folder's pictures is that of the first that can be read. */
static enum dio_status open_pictures(struct replay *replay, struct dio_error *error)
{
	const struct dio_camera_options *options = &replay->base.options;
	struct dio_camera_info *info = &replay->base.info;
	enum dio_status status =
		dio_folder_list(replay->folder, &replay->names, &replay->count, error);

	if (status != DIO_OK)
		return status;
	for (size_t i = 0; i < replay->count; i++) {
		struct dio_error unreadable;
		struct dio_frame frame;

		status = load(replay, i, &frame, i == 0 ? error : &unreadable);
		if (status == DIO_OK) {
			info->width = frame.width;
			info->height = frame.height;
			break;
		}
	}
	replay->base.frame_name = "";
	snprintf(info->name, sizeof(info->name), "%s", replay->folder);
	info->format = DIO_PIXEL_RGB24;
	info->frames_per_second = options->frames_per_second;
	replay->is_paced = options->frames_per_second > 0 && !options->as_fast_as_possible;
	return status;
}

enum dio_status dio_replay_open(const char *path, const struct dio_camera_options *options,
				struct dio_camera **camera, struct dio_error *error)
{
	struct replay *replay;
	enum dio_status status;
	struct stat st;
	char *index;

	if (stat(path, &st) != 0)
		return dio_fail(error, dio_status_from_errno(errno), "replay %s: %s", path,
				strerror(errno));
	if (!S_ISDIR(st.st_mode))
		return dio_fail(error, DIO_BAD_ARG,
				"replay %s: not a folder; give the folder of the pictures", path);
	replay = calloc(1, sizeof(*replay));
	if (!replay || !(replay->folder = strdup(path)) ||
	    asprintf(&index, "%s/%s", path, DIO_RECORDING_INDEX_FILE) < 0) {
		if (replay)
			free(replay->folder);
		free(replay);
		return dio_fail(error, DIO_NO_MEM, "replay %s: out of memory", path);
	}
	replay->base.ops = &ops;
	replay->base.options = *options;
	replay->base.frame_name = "";
	status = access(index, F_OK) == 0 ? open_recording(replay, error)
					  : open_pictures(replay, error);
	free(index);
	if (status != DIO_OK) {
		replay_close(&replay->base);
		return status;
	}
	replay->base.info.frame_count = replay->count;
	*camera = &replay->base;
	return DIO_OK;
}
