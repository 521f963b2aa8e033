#include "files/source.h"

#include <errno.h>
#include <fcntl.h>
#include <stdint.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "base/error.h"

enum dvsm_status dvsm_source_open(const char *path, struct dvsm_source *source,
				  struct dvsm_error *error)
{
	/* Not blocking: a FIFO without a writer would hold open() for ever. */
	int fd = open(path, O_RDONLY | O_CLOEXEC | O_NONBLOCK);
	struct stat status;
	if (fd < 0 || fstat(fd, &status) != 0) {
		enum dvsm_status failed = dvsm_fail(error, DVSM_IO, "%s: cannot be opened: %s",
						    dvsm_name_tail(path), strerror(errno));
		if (fd >= 0)
			close(fd);
		return failed;
	}
	if (!S_ISREG(status.st_mode) || (uintmax_t)status.st_size > SIZE_MAX) {
		close(fd);
		return dvsm_fail(error, DVSM_IO, "%s: is not a regular file", dvsm_name_tail(path));
	}
	*source = (struct dvsm_source){
		.name = path,
		.fd = fd,
		.size = (size_t)status.st_size,
		.modified = status.st_mtim,
	};
	return DVSM_OK;
}

void dvsm_source_open_bytes(const void *bytes, size_t size, const char *name,
			    struct dvsm_source *source)
{
	*source = (struct dvsm_source){.name = name, .fd = -1, .bytes = bytes, .size = size};
}

void dvsm_source_close(struct dvsm_source *source)
{
	if (source->fd >= 0)
		close(source->fd);
	source->fd = -1;
}

static enum dvsm_status read_file(struct dvsm_source *source, unsigned char *out, size_t size,
				  struct dvsm_error *error)
{
	while (size > 0) {
		ssize_t got = read(source->fd, out, size);
		if (got < 0 && errno == EINTR)
			continue;
		if (got < 0)
			return dvsm_fail(error, DVSM_IO, "%s: cannot be read at byte %zu: %s",
					 dvsm_name_tail(source->name), source->position,
					 strerror(errno));
		if (got == 0)
			return dvsm_fail(error, DVSM_IO,
					 "%s: ends at byte %zu of %zu: it changed while being read",
					 dvsm_name_tail(source->name), source->position,
					 source->size);
		out += got;
		size -= (size_t)got;
		source->position += (size_t)got;
	}
	return DVSM_OK;
}

enum dvsm_status dvsm_source_read(struct dvsm_source *source, void *out, size_t size,
				  struct dvsm_error *error)
{
	if (source->fd >= 0)
		return read_file(source, out, size, error);
	if (size > source->size - source->position)
		return dvsm_fail(error, DVSM_IO, "%s: ends at byte %zu",
				 dvsm_name_tail(source->name), source->size);
	if (size)
		memcpy(out, source->bytes + source->position, size);
	source->position += size;
	return DVSM_OK;
}

enum dvsm_status dvsm_source_seek(struct dvsm_source *source, size_t position,
				  struct dvsm_error *error)
{
	if (source->fd >= 0 && lseek(source->fd, (off_t)position, SEEK_SET) < 0)
		return dvsm_fail(error, DVSM_IO, "%s: cannot be read at byte %zu: %s",
				 dvsm_name_tail(source->name), position, strerror(errno));
	source->position = position;
	return DVSM_OK;
}

bool dvsm_source_is_unchanged(const struct dvsm_source *source)
{
	const struct timespec *modified = &source->modified;
	struct stat status;

	if (source->fd < 0)
		return true;
	return fstat(source->fd, &status) == 0 && (size_t)status.st_size == source->size &&
	       status.st_mtim.tv_sec == modified->tv_sec &&
	       status.st_mtim.tv_nsec == modified->tv_nsec;
}
