/* The journal of a capture: one line a view, each with its own checksum. */
#ifndef DIO_VIEWD_STORE_JOURNAL_H
#define DIO_VIEWD_STORE_JOURNAL_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "dio/geometry.h"
#include "dio/status.h"

/** One view. */
struct dio_journal_entry {
	char file[32]; /* "images/000.png" */
	uint64_t size_bytes, timestamp_ns;
	uint32_t crc32; /* of the file's bytes */
	struct dio_pose pose;
};

/** All of a journal; zero-initialise, release with dio_journal_deinit(). */
struct dio_journal {
	struct dio_camera_model camera;
	struct dio_journal_entry *entries;
	uint32_t count, capacity;
	bool torn; /* lines behind the last whole one were left out */
};

/** DIO_NOT_FOUND; DIO_BAD_FILE: not even the first line, which holds the camera, is whole. */
enum dio_status dio_journal_read(const char *path, struct dio_journal *journal,
				 struct dio_error *error);
/** Write all of it beside, sync, rename. */
enum dio_status dio_journal_write(const char *path, const struct dio_journal *journal,
				  struct dio_error *error);
/** Append one line to the file and sync it; a line that does not fit is taken back. */
enum dio_status dio_journal_append(const char *path, const struct dio_journal_entry *entry,
				   struct dio_error *error);

/** Append to the list in memory. */
enum dio_status dio_journal_add(struct dio_journal *journal, const struct dio_journal_entry *entry,
				struct dio_error *error);
void dio_journal_deinit(struct dio_journal *journal);

#endif
