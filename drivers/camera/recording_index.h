/* The index of a recording: recording.json, and the journal of frames that it does not list yet. */
#ifndef DIO_CAMERA_RECORDING_INDEX_H
#define DIO_CAMERA_RECORDING_INDEX_H

#include <stddef.h>
#include <stdint.h>

#include "dio/camera.h"

#define DIO_RECORDING_INDEX_FILE   "recording.json"
#define DIO_RECORDING_JOURNAL_FILE "recording.journal"

struct dio_recording_entry {
	char file[64]; /* relative to the recording's folder: "frames/000000.png" */
	uint64_t timestamp_ns, sequence, size_bytes;
	uint32_t crc32; /* zlib's, over the whole file */
	struct dio_frame_metadata metadata;
};

/** Owned by whoever initialised it to zero; released with dio_recording_index_deinit(). */
struct dio_recording_index {
	struct dio_camera_info camera;
	struct dio_recording_entry *entries;
	size_t count, capacity;
};

void dio_recording_index_deinit(struct dio_recording_index *index);
enum dio_status dio_recording_index_append(struct dio_recording_index *index,
					   const struct dio_recording_entry *entry,
					   struct dio_error *error);

/** Read the index of a folder, with the journal of a recording that was cut off. */
enum dio_status dio_recording_index_read(const char *folder, struct dio_recording_index *index,
					 struct dio_error *error);

/** Write recording.json beside, sync, rename. */
enum dio_status dio_recording_index_write(const char *folder,
					  const struct dio_recording_index *index,
					  struct dio_error *error);

/** One line of the journal, with its newline; release with free(). NULL when memory is short. */
char *dio_recording_entry_line(const struct dio_recording_entry *entry);

#endif
