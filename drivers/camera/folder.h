/* The pictures of a folder in natural order. */
#ifndef DIO_CAMERA_FOLDER_H
#define DIO_CAMERA_FOLDER_H

#include <stddef.h>

#include "dio/status.h"

/** Compare as people count: "view2.png" comes before "view10.png". Total order, as strcmp(). */
int dio_natural_compare(const char *a, const char *b);

/**
 * Names (not paths) of the PNG and JPEG files in a folder, judged by their ending, hidden ones left
 * out; release each and the list with dio_folder_free().
 *
 * DIO_NOT_FOUND  no such folder, or no picture in it
 */
enum dio_status dio_folder_list(const char *folder, char ***names, size_t *count,
				struct dio_error *error);
void dio_folder_free(char **names, size_t count);

#endif
