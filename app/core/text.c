#include "core/text.h"

#include "dio/file.h"

enum dio_status dio_text_read(const char *path, size_t max_bytes, char **text, size_t *size,
			      struct dio_error *error)
{
	uint8_t *bytes = NULL;
	enum dio_status status = dio_file_read(path, max_bytes, &bytes, size, error);

	if (status == DIO_OK)
		*text = (char *)bytes;
	return status;
}
