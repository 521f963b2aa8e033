#include <ctype.h>
#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/random.h>
#include <sys/stat.h>

#include "dio/atomic_file.h"
#include "dio/file.h"
#include "web/web.h"

#define TOKEN_BYTES    16u
#define TOKEN_FILE_MAX 1024u

static enum dio_status make_token(const char *path, struct dio_error *error)
{
	uint8_t random[TOKEN_BYTES];
	char text[2 * TOKEN_BYTES + 2];
	struct dio_atomic_file *file;
	enum dio_status status;

	if (getrandom(random, sizeof random, 0) != (ssize_t)sizeof random)
		return dio_fail(error, DIO_IO, "%s: no randomness for a token", path);
	for (size_t i = 0; i < TOKEN_BYTES; i++)
		snprintf(text + 2 * i, 3, "%02x", random[i]);
	status = dio_atomic_file_open(path, &file, error);
	if (status != DIO_OK)
		return status;
	if (fchmod(fileno(dio_atomic_file_stream(file)), 0600) != 0 ||
	    fprintf(dio_atomic_file_stream(file), "%s\n", text) < 0) {
		status = dio_fail(error, dio_status_from_errno(errno), "%s: cannot write: %s", path,
				  strerror(errno));
		dio_atomic_file_discard(file);
		return status;
	}
	return dio_atomic_file_commit(file, error);
}

enum dio_status dio_web_read_token(const char *path, char **token, struct dio_error *error)
{
	uint8_t *bytes = NULL;
	size_t size, length;
	enum dio_status status = dio_file_read(path, TOKEN_FILE_MAX, &bytes, &size, error);

	if (status == DIO_NOT_FOUND) {
		status = make_token(path, error);
		if (status == DIO_OK)
			status = dio_file_read(path, TOKEN_FILE_MAX, &bytes, &size, error);
	}
	if (status != DIO_OK)
		return status;
	for (length = 0;
	     isalnum(bytes[length]) || (bytes[length] && strchr("-_.~+/=", bytes[length]));)
		length++;
	if (length < DIO_WEB_TOKEN_MIN || bytes[length + strspn((char *)bytes + length, " \r\n")]) {
		free(bytes);
		return dio_fail(error, DIO_BAD_FILE,
				"%s: no token: at least %u letters and digits in one line; remove "
				"the file and a new one is made",
				path, DIO_WEB_TOKEN_MIN);
	}
	bytes[length] = '\0';
	*token = (char *)bytes;
	return DIO_OK;
}
