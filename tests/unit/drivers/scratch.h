/* A folder of a test's own, gone after it. */
#ifndef SCRATCH_H
#define SCRATCH_H

#include <stddef.h>

/** cmocka set-up and tear-down: *state is the folder's path. */
int scratch_make(void **state);
int scratch_remove(void **state);

/** FOLDER/NAME, good until sixteen more were asked for. */
const char *scratch_path(const char *folder, const char *name);

void scratch_write(const char *path, const void *bytes, size_t size);

/** How many entries a folder has, hidden ones too. */
size_t scratch_count(const char *folder);

#endif
