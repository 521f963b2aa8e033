#include "captured/recording.h"

#include <errno.h>
#include <fcntl.h>
#include <inttypes.h>
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/statvfs.h>
#include <time.h>
#include <unistd.h>

#include "core/log.h"
#include "dio/atomic_file.h"
#include "dio/file.h"
#include "dio/recording.h"

#define QUEUE_FRAMES 8u
#define NAME_MAX_    64u
#define MIB          ((uint64_t)1 << 20)
/* A recording that starts shall have room for so long; stored frames are at least half as small. */
#define ROOM_SECONDS 60
#define MARK         ".current"

/* A queued copy of a frame; its memory is kept for the next one. */
struct place {
	struct dio_frame frame;
	uint8_t *bytes;
	size_t capacity;
};

struct dio_recording {
	char *folder, *mark;
	uint64_t reserve_bytes;
	int changed_fd;

	pthread_mutex_t lock; /* guards all below but the recorder */
	pthread_cond_t filled;
	struct dio_recording_status status;
	bool open, ending; /* frames are taken in; the thread is to end */
	struct place queue[QUEUE_FRAMES];
	uint32_t first, count;

	pthread_t thread;
	bool has_thread;
	struct dio_recorder *recorder; /* the thread's while it runs */
};

enum dio_status dio_recording_create(const char *folder, uint32_t reserve_mib, int changed_fd,
				     struct dio_recording **recording, struct dio_error *error)
{
	struct dio_recording *made = calloc(1, sizeof(*made));

	if (made) {
		made->folder = strdup(folder);
		if (asprintf(&made->mark, "%s/%s", folder, MARK) < 0)
			made->mark = NULL;
	}
	if (!made || !made->folder || !made->mark) {
		if (made) {
			free(made->folder);
			free(made->mark);
		}
		free(made);
		return dio_fail(error, DIO_NO_MEM, "no memory for recordings");
	}
	made->reserve_bytes = reserve_mib * MIB;
	made->changed_fd = changed_fd;
	pthread_mutex_init(&made->lock, NULL);
	pthread_cond_init(&made->filled, NULL);
	*recording = made;
	return DIO_OK;
}

static bool is_name(const char *name)
{
	static const char letters[] =
		"abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789._-";

	return name[0] != '\0' && name[0] != '.' && strlen(name) < NAME_MAX_ &&
	       name[strspn(name, letters)] == '\0';
}

static void name_by_time(char *name, size_t size)
{
	time_t now = time(NULL);
	struct tm tm;

	gmtime_r(&now, &tm);
	strftime(name, size, "%Y%m%d-%H%M%S", &tm);
}

static uint64_t free_bytes(const char *folder)
{
	struct statvfs st;

	return statvfs(folder, &st) == 0 ? (uint64_t)st.f_bavail * st.f_frsize : UINT64_MAX;
}

/* A guess at what a minute takes: pictures are stored compressed. */
static uint64_t bytes_needed(const struct dio_camera_info *camera)
{
	double rate = camera->frames_per_second > 0 ? camera->frames_per_second : 30;
	double frame = (double)camera->width * camera->height *
		       (camera->format == DIO_PIXEL_MJPEG ? 0.25 : 1.5);

	return (uint64_t)(frame * rate * ROOM_SECONDS);
}

static enum dio_status check_room(const struct dio_recording *recording,
				  const struct dio_camera_info *camera, struct dio_error *error)
{
	uint64_t left = free_bytes(recording->folder);
	uint64_t needed = recording->reserve_bytes + bytes_needed(camera);

	if (left >= needed)
		return DIO_OK;
	return dio_fail(error, DIO_NO_SPACE,
			"%s: %" PRIu64 " MiB are free, a recording needs %" PRIu64
			" MiB; delete something",
			recording->folder, left / MIB, needed / MIB);
}

static bool make_folder(const char *folder)
{
	return mkdir(folder, 0750) == 0 || errno == EEXIST;
}

/* Take the oldest frame out, or wait for one. false: the end was asked and nothing is left. */
static bool take_place(struct dio_recording *recording, struct place *place)
{
	bool got;

	pthread_mutex_lock(&recording->lock);
	while (recording->count == 0 && !recording->ending)
		pthread_cond_wait(&recording->filled, &recording->lock);
	got = recording->count > 0;
	/* The memory changes hands: the frame is written without the lock. */
	if (got) {
		*place = recording->queue[recording->first];
		recording->queue[recording->first] = (struct place){0};
	}
	pthread_mutex_unlock(&recording->lock);
	return got;
}

/* Give the memory back, and count. */
static void return_place(struct dio_recording *recording, struct place *place, bool written)
{
	pthread_mutex_lock(&recording->lock);
	recording->queue[recording->first] = *place;
	recording->first = (recording->first + 1) % QUEUE_FRAMES;
	recording->count--;
	recording->status.frames += written;
	pthread_mutex_unlock(&recording->lock);
}

static enum dio_status write_frame(struct dio_recording *recording, const struct place *place,
				   struct dio_error *error)
{
	if (free_bytes(recording->folder) < recording->reserve_bytes + place->frame.size_bytes)
		return dio_fail(error, DIO_NO_SPACE,
				"%s: the disk is full but for the reserve; the recording is "
				"closed, nothing of it is lost",
				recording->folder);
	return dio_recorder_append(recording->recorder, &place->frame, error);
}

/* The recording ended by itself: say so, and take no more frames. */
static void end_by_itself(struct dio_recording *recording, const char *text)
{
	const uint64_t one = 1;

	dio_log_error("%s", text);
	pthread_mutex_lock(&recording->lock);
	recording->open = false;
	snprintf(recording->status.text, sizeof(recording->status.text), "%s", text);
	pthread_mutex_unlock(&recording->lock);
	if (write(recording->changed_fd, &one, sizeof(one)) < 0)
		dio_log_warn("recording: eventfd: %s", strerror(errno));
}

static void *run(void *context)
{
	struct dio_recording *recording = context;
	struct dio_error error;
	struct place place;
	bool good = true;

	pthread_setname_np(pthread_self(), "recorder");
	while (take_place(recording, &place)) {
		bool written = good && write_frame(recording, &place, &error) == DIO_OK;

		if (good && !written)
			end_by_itself(recording, error.text);
		good = written;
		return_place(recording, &place, written);
	}
	return NULL;
}

/* Make or open the recording, note its name, and let the thread run. */
static enum dio_status begin(struct dio_recording *recording, const char *name,
			     const struct dio_camera_info *camera, struct dio_error *error)
{
	struct dio_recording_status *status = &recording->status;
	uint64_t frames = 0;
	enum dio_status result;

	snprintf(status->path, sizeof(status->path), "%s/%s", recording->folder, name);
	result = dio_recorder_resume(status->path, camera, &recording->recorder, &frames, error);
	if (result == DIO_NOT_FOUND)
		result = dio_recorder_open(status->path, camera, &recording->recorder, error);
	if (result != DIO_OK)
		return result;
	result = dio_atomic_file_write(recording->mark, name, strlen(name), error);
	if (result == DIO_OK) {
		recording->open = true;
		recording->ending = false;
		status->frames = frames;
		status->dropped = 0;
		status->text[0] = '\0';
		recording->has_thread =
			pthread_create(&recording->thread, NULL, run, recording) == 0;
		if (!recording->has_thread)
			result = dio_fail(error, DIO_NO_MEM, "cannot make the recorder's thread");
	}
	if (result != DIO_OK) {
		recording->open = false;
		dio_recorder_close(recording->recorder, NULL);
		recording->recorder = NULL;
	}
	return result;
}

enum dio_status dio_recording_start(struct dio_recording *recording, const char *name,
				    const struct dio_camera_info *camera, struct dio_error *error)
{
	char by_time[NAME_MAX_];
	enum dio_status status;

	if (recording->has_thread)
		return dio_fail(error, DIO_BUSY, "%s: a recording is under way; stop it first",
				recording->status.path);
	name_by_time(by_time, sizeof(by_time));
	if (name[0] == '\0')
		name = by_time;
	if (!is_name(name))
		return dio_fail(error, DIO_BAD_ARG,
				"recording '%s': a name is 1 to %u letters, digits, dots, dashes "
				"and underscores, and has no dot in front",
				name, NAME_MAX_ - 1);
	if (!make_folder(recording->folder))
		return dio_fail(error, dio_status_from_errno(errno), "%s: cannot be made: %s",
				recording->folder, strerror(errno));
	status = check_room(recording, camera, error);
	if (status != DIO_OK)
		return status;
	pthread_mutex_lock(&recording->lock);
	status = begin(recording, name, camera, error);
	recording->status.active = status == DIO_OK;
	pthread_mutex_unlock(&recording->lock);
	if (status == DIO_OK)
		dio_log_note("recording %s", recording->status.path);
	return status;
}

/* Write what is queued, then close. */
static enum dio_status finish(struct dio_recording *recording, struct dio_error *error)
{
	enum dio_status status;

	pthread_mutex_lock(&recording->lock);
	recording->open = false;
	recording->ending = true;
	pthread_cond_signal(&recording->filled);
	pthread_mutex_unlock(&recording->lock);
	pthread_join(recording->thread, NULL);
	recording->has_thread = false;
	status = dio_recorder_close(recording->recorder, error);
	recording->recorder = NULL;
	pthread_mutex_lock(&recording->lock);
	recording->status.active = false;
	pthread_mutex_unlock(&recording->lock);
	dio_log_note("recorded %s: %" PRIu64 " frames, %" PRIu64 " dropped", recording->status.path,
		     recording->status.frames, recording->status.dropped);
	return status;
}

enum dio_status dio_recording_stop(struct dio_recording *recording, struct dio_error *error)
{
	enum dio_status status;

	if (!recording->has_thread)
		return dio_fail(error, DIO_NOT_FOUND, "no recording is under way");
	status = finish(recording, error);
	unlink(recording->mark);
	return status;
}

void dio_recording_get_interrupted(struct dio_recording *recording, char *name, size_t size)
{
	uint8_t *bytes;
	size_t length;

	name[0] = '\0';
	if (dio_file_read(recording->mark, NAME_MAX_, &bytes, &length, NULL) != DIO_OK)
		return;
	if (is_name((const char *)bytes) && strlen((const char *)bytes) == length)
		snprintf(name, size, "%s", (const char *)bytes);
	free(bytes);
}

static bool store(struct place *place, const struct dio_frame *frame)
{
	if (place->capacity < frame->size_bytes) {
		uint8_t *grown = realloc(place->bytes, frame->size_bytes);

		if (!grown)
			return false;
		place->bytes = grown;
		place->capacity = frame->size_bytes;
	}
	memcpy(place->bytes, frame->data, frame->size_bytes);
	place->frame = *frame;
	place->frame.data = place->bytes;
	return true;
}

void dio_recording_offer(struct dio_recording *recording, const struct dio_frame *frame)
{
	pthread_mutex_lock(&recording->lock);
	if (recording->open) {
		uint32_t at = (recording->first + recording->count) % QUEUE_FRAMES;

		if (recording->count < QUEUE_FRAMES && store(&recording->queue[at], frame)) {
			recording->count++;
			pthread_cond_signal(&recording->filled);
		} else {
			recording->status.dropped++;
		}
	}
	pthread_mutex_unlock(&recording->lock);
}

void dio_recording_get_status(struct dio_recording *recording, struct dio_recording_status *status)
{
	pthread_mutex_lock(&recording->lock);
	*status = recording->status;
	pthread_mutex_unlock(&recording->lock);
}

void dio_recording_destroy(struct dio_recording *recording)
{
	struct dio_error error;

	if (!recording)
		return;
	if (recording->has_thread && finish(recording, &error) != DIO_OK)
		dio_log_error("%s", error.text);
	for (size_t i = 0; i < QUEUE_FRAMES; i++)
		free(recording->queue[i].bytes);
	pthread_cond_destroy(&recording->filled);
	pthread_mutex_destroy(&recording->lock);
	free(recording->mark);
	free(recording->folder);
	free(recording);
}
