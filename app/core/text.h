/* A text file in memory. */
#ifndef DIO_APP_TEXT_H
#define DIO_APP_TEXT_H

#include <stddef.h>

#include "dio/status.h"

/** dio_file_read() (dio/file.h) for text: a zero byte ends it. Release *text with free(). */
enum dio_status dio_text_read(const char *path, size_t max_bytes, char **text, size_t *size,
			      struct dio_error *error);

#endif
