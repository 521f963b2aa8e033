/* Paths and folders. */
#ifndef DIO_APP_PATH_H
#define DIO_APP_PATH_H

#include <stdbool.h>

#include "dio/status.h"

/** Make a folder and its parents; one that exists is fine. */
enum dio_status dio_folder_make(const char *path, struct dio_error *error);

/** `folder`/`name` (or name alone when it is absolute); release with free(), NULL: no memory. */
char *dio_path_join(const char *folder, const char *name);
/** The folder part of a path, "." when there is none; release with free(). */
char *dio_path_folder(const char *path);
/** The last part of a path, borrowed from it. */
const char *dio_path_name(const char *path);
/** `to` as seen from `folder` ("../images/0.png"), both must exist; release with free(). */
char *dio_path_relative(const char *folder, const char *to);
bool dio_path_is_folder(const char *path);
bool dio_path_is_file(const char *path);

#endif
