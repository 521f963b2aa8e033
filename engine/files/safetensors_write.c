#include "files/safetensors.h"

#include <errno.h>
#include <fcntl.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "base/error.h"

/* The header is padded to this, so that the tensors start aligned. */
#define HEADER_ALIGN 8

/* Names tried for the file beside; a crash may have left some behind. */
#define MAX_TRIES 100

/* Most that one write() takes on Linux is a little below 2 GiB. */
#define MAX_WRITE_BYTES ((size_t)1 << 30)

static enum dvsm_status fail_system(const char *path, const char *what, int number,
				    struct dvsm_error *error)
{
	const char *remedy =
		number == ENOSPC || number == EDQUOT ? ": free space or write elsewhere" : "";
	return dvsm_fail(error, DVSM_IO, "%s: cannot %s: %s%s", dvsm_name_tail(path), what,
			 strerror(number), remedy);
}

static void put_string(FILE *out, const char *text)
{
	fputc('"', out);
	for (; *text; text++) {
		unsigned char c = (unsigned char)*text;
		if (c == '"' || c == '\\')
			fprintf(out, "\\%c", c);
		else if (c < ' ')
			fprintf(out, "\\u%04x", c);
		else
			fputc(c, out);
	}
	fputc('"', out);
}

static void put_tensor(FILE *out, const struct dvsm_tensor_out *tensor, size_t begin)
{
	put_string(out, tensor->name);
	fprintf(out, ":{\"dtype\":\"%s\",\"shape\":[", dvsm_dtype_name(tensor->dtype));
	for (uint32_t i = 0; i < tensor->rank; i++)
		fprintf(out, "%s%llu", i ? "," : "", (unsigned long long)tensor->shape[i]);
	fprintf(out, "],\"data_offsets\":[%zu,%zu]}", begin, begin + tensor->size);
}

/* The header with its length in front; release with free(). NULL when there is no memory. */
static char *make_header(const struct dvsm_metadata_out *metadata, size_t metadata_count,
			 const struct dvsm_tensor_out *tensors, size_t tensor_count, size_t *size)
{
	char *header = NULL;
	FILE *out = open_memstream(&header, size);
	if (!out)
		return NULL;
	fwrite("\0\0\0\0\0\0\0\0", 1, 8, out);
	fputs("{\"__metadata__\":{", out);
	for (size_t i = 0; i < metadata_count; i++) {
		if (i)
			fputc(',', out);
		put_string(out, metadata[i].key);
		fputc(':', out);
		put_string(out, metadata[i].value);
	}
	fputc('}', out);
	size_t begin = 0;
	for (size_t i = 0; i < tensor_count; i++) {
		fputc(',', out);
		put_tensor(out, &tensors[i], begin);
		begin += tensors[i].size;
	}
	fputc('}', out);
	for (long end = ftell(out); end % HEADER_ALIGN; end++)
		fputc(' ', out);

	bool failed = ferror(out) != 0;
	if (fclose(out) != 0 || failed) {
		free(header);
		return NULL;
	}
	uint64_t length = *size - 8;
	for (int i = 0; i < 8; i++)
		header[i] = (char)(length >> (8 * i));
	return header;
}

/* Create PATH.part-PID-N; its name is to be freed. -1 with errno set on failure. */
static int create_beside(const char *path, char **beside)
{
	for (int i = 0; i < MAX_TRIES; i++) {
		if (asprintf(beside, "%s.part-%ld-%d", path, (long)getpid(), i) < 0) {
			*beside = NULL;
			errno = ENOMEM;
			return -1;
		}
		int fd = open(*beside, O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0666);
		if (fd >= 0)
			return fd;
		int number = errno;
		free(*beside);
		*beside = NULL;
		errno = number;
		if (number != EEXIST)
			return -1;
	}
	return -1;
}

static bool write_all(int fd, const void *bytes, size_t size)
{
	const char *from = bytes;
	while (size > 0) {
		ssize_t done = write(fd, from, size < MAX_WRITE_BYTES ? size : MAX_WRITE_BYTES);
		if (done < 0 && errno == EINTR)
			continue;
		if (done < 0)
			return false;
		from += done;
		size -= (size_t)done;
	}
	return true;
}

/* Make the rename itself last: without this a power cut may bring the old name back. */
static bool sync_folder_of(const char *path)
{
	const char *slash = strrchr(path, '/');
	char *folder =
		slash ? strndup(path, slash == path ? 1 : (size_t)(slash - path)) : strdup(".");
	if (!folder)
		return false;
	int fd = open(folder, O_RDONLY | O_DIRECTORY | O_CLOEXEC);
	free(folder);
	if (fd < 0)
		return false;
	/* EINVAL: this file system has no such notion. */
	bool ok = fsync(fd) == 0 || errno == EINVAL;
	int number = errno;
	close(fd);
	errno = number;
	return ok;
}

/* Renaming over a device or a folder would destroy or fail late; say so before writing. */
static enum dvsm_status check_target(const char *path, struct dvsm_error *error)
{
	struct stat status;
	if (stat(path, &status) == 0 && !S_ISREG(status.st_mode))
		return dvsm_fail(error, DVSM_IO, "%s: is there and is not a regular file",
				 dvsm_name_tail(path));
	return DVSM_OK;
}

enum dvsm_status dvsm_safetensors_write(const char *path, const struct dvsm_metadata_out *metadata,
					size_t metadata_count,
					const struct dvsm_tensor_out *tensors, size_t tensor_count,
					struct dvsm_error *error)
{
	enum dvsm_status status = check_target(path, error);
	if (status != DVSM_OK)
		return status;
	size_t header_size;
	char *header = make_header(metadata, metadata_count, tensors, tensor_count, &header_size);
	if (!header)
		return dvsm_fail(error, DVSM_NO_MEM, "%s: no memory to write it",
				 dvsm_name_tail(path));

	char *beside = NULL;
	int fd = create_beside(path, &beside);
	if (fd < 0) {
		status = fail_system(path, "be created", errno, error);
		goto out;
	}
	bool ok = write_all(fd, header, header_size);
	for (size_t i = 0; i < tensor_count && ok; i++)
		ok = write_all(fd, tensors[i].bytes, tensors[i].size);
	if (!ok || fsync(fd) != 0)
		status = fail_system(path, "be written", errno, error);
	if (close(fd) != 0 && status == DVSM_OK)
		status = fail_system(path, "be written", errno, error);
	if (status == DVSM_OK && rename(beside, path) != 0)
		status = fail_system(path, "be put in place", errno, error);
	if (status != DVSM_OK) {
		unlink(beside);
		goto out;
	}
	if (!sync_folder_of(path))
		status = fail_system(path, "be synced to its folder", errno, error);
out:
	free(beside);
	free(header);
	return status;
}
