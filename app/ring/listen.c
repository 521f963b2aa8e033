#include "ring/listen.h"

#include <errno.h>
#include <fcntl.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#define BACKLOG 16

enum dio_status dio_ring_address(const char *path, struct sockaddr_un *address,
				 struct dio_error *error)
{
	size_t length = strlen(path);

	if (length == 0 || length >= sizeof(address->sun_path))
		return dio_fail(error, DIO_BAD_ARG,
				"frame socket %s: a path of 1 to %zu letters is needed", path,
				sizeof(address->sun_path) - 1);
	*address = (struct sockaddr_un){.sun_family = AF_UNIX};
	memcpy(address->sun_path, path, length);
	return DIO_OK;
}

static enum dio_status fail_call(const char *path, const char *what, struct dio_error *error)
{
	int cause = errno;

	return dio_fail(error, dio_status_from_errno(cause), "frame socket %s: cannot %s: %s", path,
			what, strerror(cause));
}

/* A daemon that was killed leaves its socket file: connecting to that is refused. */
static enum dio_status remove_stale(const struct sockaddr_un *address, struct dio_error *error)
{
	const char *path = address->sun_path;
	struct stat st;
	int fd, answer;

	if (lstat(path, &st) != 0)
		return errno == ENOENT ? DIO_OK : fail_call(path, "look at it", error);
	if (!S_ISSOCK(st.st_mode))
		return dio_fail(error, DIO_BUSY,
				"frame socket %s: a file is in its place; remove it", path);
	fd = socket(AF_UNIX, SOCK_SEQPACKET | SOCK_CLOEXEC | SOCK_NONBLOCK, 0);
	if (fd < 0)
		return fail_call(path, "make a socket", error);
	answer = connect(fd, (const struct sockaddr *)address, sizeof(*address));
	if (answer != 0 && errno == ECONNREFUSED)
		answer = unlink(path);
	else
		answer = 1;
	close(fd);
	if (answer == 1)
		return dio_fail(error, DIO_BUSY,
				"frame socket %s: another capture daemon listens there; stop it "
				"first",
				path);
	return answer == 0 ? DIO_OK : fail_call(path, "replace it", error);
}

enum dio_status dio_ring_listen(const char *path, mode_t mode, int *fd, struct dio_error *error)
{
	struct sockaddr_un address;
	enum dio_status status = dio_ring_address(path, &address, error);
	int made;

	if (status == DIO_OK)
		status = remove_stale(&address, error);
	if (status != DIO_OK)
		return status;
	made = socket(AF_UNIX, SOCK_SEQPACKET | SOCK_CLOEXEC | SOCK_NONBLOCK, 0);
	if (made < 0)
		return fail_call(path, "make a socket", error);
	if (bind(made, (const struct sockaddr *)&address, sizeof(address)) != 0) {
		status = fail_call(path, "bind it", error);
		close(made);
		return status;
	}
	/* Nobody can connect before listen(): the mode is right from the first moment. */
	if (chmod(path, mode) != 0 || listen(made, BACKLOG) != 0) {
		status = fail_call(path, "listen", error);
		unlink(path);
		close(made);
		return status;
	}
	*fd = made;
	return DIO_OK;
}

enum dio_status dio_ring_listen_check(int fd, struct dio_error *error)
{
	int type = 0, listens = 0;
	socklen_t size = sizeof(type);
	int flags = fcntl(fd, F_GETFL);

	if (getsockopt(fd, SOL_SOCKET, SO_TYPE, &type, &size) != 0 ||
	    getsockopt(fd, SOL_SOCKET, SO_ACCEPTCONN, &listens, &size) != 0 ||
	    type != SOCK_SEQPACKET || !listens)
		return dio_fail(error, DIO_BAD_ARG,
				"frame socket: descriptor %d is no listening SOCK_SEQPACKET socket",
				fd);
	if (flags < 0 || fcntl(fd, F_SETFL, flags | O_NONBLOCK) != 0)
		return fail_call("handed over", "make it non-blocking", error);
	return DIO_OK;
}
