#include "dio/file.h"

#include <errno.h>
#include <fcntl.h>
#include <glob.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

static enum dio_status read_all(int fd, const char *path, uint8_t *bytes, size_t size,
				struct dio_error *error)
{
	size_t have = 0;

	while (have < size) {
		ssize_t n = read(fd, bytes + have, size - have);

		if (n < 0 && errno == EINTR)
			continue;
		if (n < 0)
			return dio_fail(error, dio_status_from_errno(errno), "%s: cannot read: %s",
					path, strerror(errno));
		if (n == 0)
			return dio_fail(
				error, DIO_BAD_FILE,
				"%s: became shorter while it was read; is it still being written?",
				path);
		have += (size_t)n;
	}
	return DIO_OK;
}

enum dio_status dio_file_read(const char *path, size_t max_bytes, uint8_t **bytes, size_t *size,
			      struct dio_error *error)
{
	/* O_NONBLOCK: a FIFO without a writer must not hold us up before fstat() refuses it. */
	int fd = open(path, O_RDONLY | O_CLOEXEC | O_NONBLOCK);
	struct stat st;
	uint8_t *memory = NULL;
	enum dio_status status;

	if (fd < 0)
		return dio_fail(error, dio_status_from_errno(errno), "%s: cannot open: %s", path,
				strerror(errno));
	if (fstat(fd, &st) != 0) {
		status = dio_fail(error, DIO_IO, "%s: cannot stat: %s", path, strerror(errno));
		goto out;
	}
	if (!S_ISREG(st.st_mode)) {
		status = dio_fail(error, DIO_BAD_FILE, "%s: not a file%s", path,
				  S_ISDIR(st.st_mode) ? " but a folder" : "");
		goto out;
	}
	if ((uintmax_t)st.st_size > max_bytes || (uintmax_t)st.st_size >= SIZE_MAX) {
		status = dio_fail(error, DIO_BAD_FILE,
				  "%s: %jd bytes, more than the %zu expected of such a file", path,
				  (intmax_t)st.st_size, max_bytes);
		goto out;
	}
	memory = malloc((size_t)st.st_size + 1);
	if (!memory) {
		status = dio_fail(error, DIO_NO_MEM, "%s: no memory for %jd bytes", path,
				  (intmax_t)st.st_size);
		goto out;
	}
	status = read_all(fd, path, memory, (size_t)st.st_size, error);
	if (status != DIO_OK)
		goto out;
	memory[st.st_size] = 0;
	*bytes = memory;
	*size = (size_t)st.st_size;
	memory = NULL;
out:
	free(memory);
	close(fd);
	return status;
}

bool dio_file_match(const char *pattern, uint32_t index, char *path, size_t path_size)
{
	glob_t found;
	bool there;

	if (glob(pattern, 0, NULL, &found) != 0)
		return false;
	there = index < found.gl_pathc;
	if (there)
		snprintf(path, path_size, "%s", found.gl_pathv[index]);
	globfree(&found);
	return there;
}
