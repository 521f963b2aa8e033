#include "dio/recording.h"

#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>
#include <zlib.h>

#include "dio/atomic_file.h"
#include "recording_index.h"

struct dio_recorder {
	char *folder;
	char *journal_path;
	int journal;
	off_t journal_bytes;
	struct dio_recording_index index;
	struct dio_picture picture; /* reused from frame to frame */
};

static void release(struct dio_recorder *recorder)
{
	if (recorder->journal >= 0)
		close(recorder->journal);
	dio_recording_index_deinit(&recorder->index);
	dio_picture_deinit(&recorder->picture);
	free(recorder->journal_path);
	free(recorder->folder);
	free(recorder);
}

static enum dio_status fail_write(const char *path, struct dio_error *error)
{
	int cause = errno;

	return dio_fail(error, dio_status_from_errno(cause), "recording %s: cannot write: %s", path,
			strerror(cause));
}

static enum dio_status make_folders(struct dio_recorder *recorder, struct dio_error *error)
{
	const char *folder = recorder->folder;
	char *frames;
	int made;

	if (mkdir(folder, 0777) != 0 && errno != EEXIST)
		return fail_write(folder, error);
	if (asprintf(&frames, "%s/frames", folder) < 0)
		return dio_fail(error, DIO_NO_MEM, "recording %s: out of memory", folder);
	made = mkdir(frames, 0777);
	free(frames);
	if (made == 0)
		return DIO_OK;
	if (errno == EEXIST)
		return dio_fail(error, DIO_BAD_ARG,
				"recording %s: there is one already; choose another folder",
				folder);
	return fail_write(folder, error);
}

/* An object with its folder's names and no journal open. */
static enum dio_status create(const char *folder, const struct dio_camera_info *camera,
			      struct dio_recorder **recorder, struct dio_error *error)
{
	struct dio_recorder *made = calloc(1, sizeof(*made));

	if (made) {
		made->journal = -1;
		made->index.camera = *camera;
		made->folder = strdup(folder);
		if (asprintf(&made->journal_path, "%s/%s", folder, DIO_RECORDING_JOURNAL_FILE) < 0)
			made->journal_path = NULL;
	}
	if (!made || !made->folder || !made->journal_path) {
		if (made)
			release(made);
		return dio_fail(error, DIO_NO_MEM, "recording %s: out of memory", folder);
	}
	*recorder = made;
	return DIO_OK;
}

enum dio_status dio_recorder_open(const char *folder, const struct dio_camera_info *camera,
				  struct dio_recorder **recorder, struct dio_error *error)
{
	struct dio_recorder *made;
	enum dio_status status = create(folder, camera, &made, error);

	if (status != DIO_OK)
		return status;
	status = make_folders(made, error);
	if (status == DIO_OK)
		status = dio_recording_index_write(folder, &made->index, error);
	if (status != DIO_OK)
		goto fail;
	made->journal = open(made->journal_path, O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0666);
	if (made->journal < 0) {
		status = fail_write(made->journal_path, error);
		goto fail;
	}
	*recorder = made;
	return DIO_OK;
fail:
	release(made);
	return status;
}

/* All frames as a journal, written beside and renamed. */
static enum dio_status rewrite_journal(struct dio_recorder *recorder, struct dio_error *error)
{
	struct dio_atomic_file *file;
	enum dio_status status = dio_atomic_file_open(recorder->journal_path, &file, error);

	if (status != DIO_OK)
		return status;
	for (size_t i = 0; i < recorder->index.count; i++) {
		char *line = dio_recording_entry_line(&recorder->index.entries[i]);

		/* A write that fails shows at the commit. */
		if (line)
			fputs(line, dio_atomic_file_stream(file));
		else
			status = DIO_NO_MEM;
		free(line);
	}
	if (status != DIO_OK) {
		dio_atomic_file_discard(file);
		return dio_fail(error, status, "recording %s: out of memory", recorder->folder);
	}
	return dio_atomic_file_commit(file, error);
}

/* From here on the frames are the journal's: the list is emptied only once that is on the disk,
 * since a journal beside a list with frames is not read. */
static enum dio_status reopen(struct dio_recorder *recorder, const struct dio_camera_info *camera,
			      struct dio_error *error)
{
	struct dio_recording_index empty = {.camera = *camera};
	enum dio_status status =
		dio_recording_index_read(recorder->folder, &recorder->index, error);

	if (status == DIO_OK)
		status = rewrite_journal(recorder, error);
	if (status == DIO_OK)
		status = dio_recording_index_write(recorder->folder, &empty, error);
	if (status != DIO_OK)
		return status;
	recorder->index.camera = *camera;
	recorder->journal = open(recorder->journal_path, O_WRONLY | O_CLOEXEC);
	if (recorder->journal >= 0)
		recorder->journal_bytes = lseek(recorder->journal, 0, SEEK_END);
	if (recorder->journal < 0 || recorder->journal_bytes < 0)
		return fail_write(recorder->journal_path, error);
	return DIO_OK;
}

enum dio_status dio_recorder_resume(const char *folder, const struct dio_camera_info *camera,
				    struct dio_recorder **recorder, uint64_t *frames,
				    struct dio_error *error)
{
	struct dio_recorder *made;
	enum dio_status status = create(folder, camera, &made, error);

	if (status != DIO_OK)
		return status;
	status = reopen(made, camera, error);
	if (status != DIO_OK) {
		release(made);
		return status;
	}
	if (frames)
		*frames = made->index.count;
	*recorder = made;
	return DIO_OK;
}

/* One line, whole or not at all. */
static enum dio_status journal_append(struct dio_recorder *recorder,
				      const struct dio_recording_entry *entry,
				      struct dio_error *error)
{
	char *line = dio_recording_entry_line(entry);
	enum dio_status status = DIO_OK;
	size_t size;
	ssize_t n;

	if (!line)
		return dio_fail(error, DIO_NO_MEM, "recording %s: out of memory", recorder->folder);
	size = strlen(line);
	do
		n = write(recorder->journal, line, size);
	while (n < 0 && errno == EINTR);
	free(line);
	if (n == (ssize_t)size && fdatasync(recorder->journal) == 0) {
		recorder->journal_bytes += n;
		return DIO_OK;
	}
	if (n >= 0 && n < (ssize_t)size)
		errno = ENOSPC;
	status = fail_write(recorder->journal_path, error);
	/* The half line would end the journal for a reader: take it back. */
	if (ftruncate(recorder->journal, recorder->journal_bytes) == 0)
		lseek(recorder->journal, recorder->journal_bytes, SEEK_SET);
	return status;
}

/* The frame as a file's bytes: MJPEG as it came, others as PNG in memory of its own (`owned`). */
static enum dio_status frame_to_bytes(struct dio_recorder *recorder, const struct dio_frame *frame,
				      const char *path, uint8_t **owned, const uint8_t **bytes,
				      size_t *size, struct dio_error *error)
{
	enum dio_status status;

	*owned = NULL;
	if (frame->format == DIO_PIXEL_MJPEG) {
		*bytes = frame->data;
		*size = frame->size_bytes;
		return DIO_OK;
	}
	status = dio_frame_to_rgb(frame, &recorder->picture, error);
	if (status != DIO_OK)
		return status;
	status = dio_picture_encode(path, &recorder->picture, owned, size, error);
	*bytes = *owned;
	return status;
}

enum dio_status dio_recorder_append(struct dio_recorder *recorder, const struct dio_frame *frame,
				    struct dio_error *error)
{
	struct dio_recording_entry entry = {
		.timestamp_ns = frame->timestamp_ns,
		.sequence = frame->sequence,
		.metadata = frame->metadata,
	};
	uint8_t *owned;
	const uint8_t *bytes;
	char *path;
	size_t size;
	enum dio_status status;

	snprintf(entry.file, sizeof(entry.file), "frames/%06zu.%s", recorder->index.count,
		 frame->format == DIO_PIXEL_MJPEG ? "jpg" : "png");
	if (asprintf(&path, "%s/%s", recorder->folder, entry.file) < 0)
		return dio_fail(error, DIO_NO_MEM, "recording %s: out of memory", recorder->folder);
	status = frame_to_bytes(recorder, frame, path, &owned, &bytes, &size, error);
	if (status != DIO_OK)
		goto out;
	entry.size_bytes = size;
	entry.crc32 = (uint32_t)crc32_z(0, bytes, size);
	status = dio_atomic_file_write(path, bytes, size, error);
	if (status == DIO_OK)
		status = journal_append(recorder, &entry, error);
	if (status == DIO_OK)
		status = dio_recording_index_append(&recorder->index, &entry, error);
	free(owned);
out:
	free(path);
	return status;
}

enum dio_status dio_recorder_close(struct dio_recorder *recorder, struct dio_error *error)
{
	enum dio_status status;

	if (!recorder)
		return DIO_OK;
	status = dio_recording_index_write(recorder->folder, &recorder->index, error);
	/* Only a complete index makes the journal superfluous. */
	if (status == DIO_OK)
		unlink(recorder->journal_path);
	release(recorder);
	return status;
}
