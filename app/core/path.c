#include "core/path.h"

#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

char *dio_path_join(const char *folder, const char *name)
{
	char *path;

	if (*name == '/' || *folder == '\0')
		return strdup(name);
	bool slash = folder[strlen(folder) - 1] == '/';

	return asprintf(&path, "%s%s%s", folder, slash ? "" : "/", name) < 0 ? NULL : path;
}

char *dio_path_folder(const char *path)
{
	const char *slash = strrchr(path, '/');

	if (!slash)
		return strdup(".");
	return strndup(path, slash == path ? 1 : (size_t)(slash - path));
}

const char *dio_path_name(const char *path)
{
	const char *slash = strrchr(path, '/');

	return slash ? slash + 1 : path;
}

/* How much of two absolute paths is the same, in whole parts. */
static size_t common_length(const char *a, const char *b)
{
	size_t same = 0, i = 0;

	for (; a[i] && a[i] == b[i]; i++)
		if (a[i] == '/')
			same = i;
	if ((a[i] == '\0' || a[i] == '/') && (b[i] == '\0' || b[i] == '/'))
		same = i;
	return same;
}

static const char UP[3] = {'.', '.', '/'};

char *dio_path_relative(const char *folder, const char *to)
{
	char *from = realpath(folder, NULL), *target = realpath(to, NULL), *relative = NULL;

	if (from && target) {
		size_t same = strcmp(from, "/") == 0 ? 0 : common_length(from, target);
		size_t ups = 0;

		for (const char *at = from + same; *at; at++)
			ups += *at == '/' && at[1] != '\0';
		const char *rest = target + same + (target[same] == '/');

		relative = calloc(1, ups * sizeof UP + strlen(rest) + 1);
		if (relative) {
			char *at = relative;

			for (size_t i = 0; i < ups; i++)
				at = mempcpy(at, UP, sizeof UP);
			mempcpy(at, rest, strlen(rest));
		}
	}
	free(from);
	free(target);
	return relative;
}

bool dio_path_is_folder(const char *path)
{
	struct stat about;

	return stat(path, &about) == 0 && S_ISDIR(about.st_mode);
}

bool dio_path_is_file(const char *path)
{
	struct stat about;

	return stat(path, &about) == 0 && S_ISREG(about.st_mode);
}

enum dio_status dio_folder_make(const char *path, struct dio_error *error)
{
	char *part = strdup(path);
	enum dio_status status = DIO_OK;

	if (!part)
		return dio_fail(error, DIO_NO_MEM, "%s: no memory", path);
	for (char *at = part + 1; status == DIO_OK; at++) {
		char kept = *at;

		if (kept != '/' && kept != '\0')
			continue;
		*at = '\0';
		if (mkdir(part, 0777) != 0 && errno != EEXIST)
			status = dio_fail(error, dio_status_from_errno(errno),
					  "%s: cannot be made: %s", path, strerror(errno));
		*at = kept;
		if (kept == '\0')
			break;
	}
	free(part);
	if (status == DIO_OK && !dio_path_is_folder(path))
		return dio_fail(error, DIO_BAD_ARG, "%s: is not a folder", path);
	return status;
}
