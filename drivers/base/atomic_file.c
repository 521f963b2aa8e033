#include "dio/atomic_file.h"

#include <errno.h>
#include <fcntl.h>
#include <libgen.h>
#include <stdatomic.h>
#include <stdbool.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

struct dio_atomic_file {
	FILE *stream;
	char *path; /* where it shall be in the end */
	char *part; /* where it is written; equal to path when straight */
	bool straight;
};

static void release(struct dio_atomic_file *file)
{
	if (file->stream)
		fclose(file->stream);
	free(file->path);
	free(file->part);
	free(file);
}

static enum dio_status fail_write(const char *path, int errno_value, struct dio_error *error)
{
	enum dio_status status = dio_status_from_errno(errno_value);

	if (status == DIO_NO_SPACE)
		return dio_fail(error, status,
				"%s: the disk is full; free some space and try again", path);
	return dio_fail(error, status, "%s: cannot write: %s", path, strerror(errno_value));
}

/* Opens the part exclusively, so that two writers of one path never share it. */
static int open_part(struct dio_atomic_file *file)
{
	static atomic_uint next;

	for (unsigned tries = 0; tries < 100; tries++) {
		char *name;
		int fd;

		if (asprintf(&name, "%s.%ld-%u.part", file->path, (long)getpid(),
			     atomic_fetch_add(&next, 1)) < 0) {
			errno = ENOMEM;
			return -1;
		}
		fd = open(name, O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0666);
		if (fd >= 0) {
			file->part = name;
			return fd;
		}
		free(name);
		if (errno != EEXIST)
			return -1;
	}
	return -1;
}

static int open_target(struct dio_atomic_file *file, const char *path)
{
	struct stat st;

	if (stat(path, &st) == 0) {
		if (S_ISDIR(st.st_mode)) {
			errno = EISDIR;
			return -1;
		}
		file->straight = !S_ISREG(st.st_mode);
		file->path = file->straight ? strdup(path) : realpath(path, NULL);
	} else {
		file->path = strdup(path);
	}
	if (!file->path)
		return -1;
	if (!file->straight)
		return open_part(file);
	file->part = strdup(path);
	return file->part ? open(path, O_WRONLY | O_CLOEXEC) : -1;
}

enum dio_status dio_atomic_file_open(const char *path, struct dio_atomic_file **file,
				     struct dio_error *error)
{
	struct dio_atomic_file *made = calloc(1, sizeof(*made));
	enum dio_status status;
	int fd;

	if (!made)
		return dio_fail(error, DIO_NO_MEM, "%s: out of memory", path);
	fd = open_target(made, path);
	if (fd < 0) {
		status = fail_write(path, errno, error);
		release(made);
		return status;
	}
	made->stream = fdopen(fd, "wb");
	if (!made->stream) {
		status = fail_write(path, errno, error);
		close(fd);
		if (!made->straight)
			unlink(made->part);
		release(made);
		return status;
	}
	*file = made;
	return DIO_OK;
}

FILE *dio_atomic_file_stream(struct dio_atomic_file *file)
{
	return file->stream;
}

const char *dio_atomic_file_part_path(const struct dio_atomic_file *file)
{
	return file->part;
}

/* The new name must reach the disk too. File systems that cannot sync a folder say EINVAL. */
static int sync_folder_of(const char *path)
{
	char *copy = strdup(path);
	int fd, result = 0;

	if (!copy)
		return -1;
	fd = open(dirname(copy), O_RDONLY | O_DIRECTORY | O_CLOEXEC);
	free(copy);
	/* A folder one may write but not read cannot be opened: the rename stands all the same. */
	if (fd < 0)
		return errno == EACCES ? 0 : -1;
	if (fsync(fd) != 0 && errno != EINVAL)
		result = -1;
	close(fd);
	return result;
}

static int finish(struct dio_atomic_file *file)
{
	FILE *stream = file->stream;

	if (fflush(stream) != 0)
		return -1;
	if (ferror(stream)) {
		errno = EIO;
		return -1;
	}
	if (fsync(fileno(stream)) != 0 && !(file->straight && (errno == EINVAL || errno == EROFS)))
		return -1;
	file->stream = NULL;
	if (fclose(stream) != 0)
		return -1;
	if (file->straight)
		return 0;
	if (rename(file->part, file->path) != 0)
		return -1;
	return sync_folder_of(file->path);
}

enum dio_status dio_atomic_file_commit(struct dio_atomic_file *file, struct dio_error *error)
{
	enum dio_status status = DIO_OK;

	if (finish(file) != 0) {
		status = fail_write(file->path, errno, error);
		if (!file->straight)
			unlink(file->part);
	}
	release(file);
	return status;
}

void dio_atomic_file_discard(struct dio_atomic_file *file)
{
	if (!file)
		return;
	if (!file->straight)
		unlink(file->part);
	release(file);
}

enum dio_status dio_atomic_file_write(const char *path, const void *bytes, size_t size,
				      struct dio_error *error)
{
	struct dio_atomic_file *file;
	enum dio_status status = dio_atomic_file_open(path, &file, error);

	if (status != DIO_OK)
		return status;
	if (size > 0 && fwrite(bytes, 1, size, file->stream) != size) {
		status = fail_write(path, errno, error);
		dio_atomic_file_discard(file);
		return status;
	}
	return dio_atomic_file_commit(file, error);
}
