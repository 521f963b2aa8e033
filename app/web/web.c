#include "web/web.h"

#include <arpa/inet.h>
#include <errno.h>
#include <netinet/in.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <unistd.h>

#include "web/web_private.h"

#define CONNECTIONS_MAX    32u
#define CONNECTION_BYTES   (32u << 10)
#define CONNECTION_TIME_S  20u
#define CONNECTIONS_QUEUED 16
#define TURNS_MAX          32 /* of the server in one turn of the loop */

/* microhttpd calls this once with the headers, once for each piece of the body, once at the end. */
static enum MHD_Result on_request(void *context, struct MHD_Connection *connection, const char *url,
				  const char *method, const char *version, const char *data,
				  size_t *size, void **state)
{
	struct dio_web_request *request = *state;

	(void)version;
	if (!request) {
		request = calloc(1, sizeof *request);
		*state = request;
		return request ? MHD_YES : MHD_NO;
	}
	if (*size > 0) {
		if (*size > DIO_WEB_BODY_MAX - request->size)
			request->too_long = true;
		else
			memcpy(request->body + request->size, data, *size);
		request->size += request->too_long ? 0 : *size;
		*size = 0;
		return MHD_YES;
	}
	if (request->too_long)
		return dio_web_answer_fault(connection, MHD_HTTP_CONTENT_TOO_LARGE,
					    "the request is too long");
	return dio_web_answer(context, connection, method, url, request);
}

/* Paths are compared as they came: none of ours has anything to unescape. */
static size_t keep_escapes(void *context, struct MHD_Connection *connection, char *text)
{
	(void)context;
	(void)connection;
	return strlen(text);
}

static void on_completed(void *context, struct MHD_Connection *connection, void **state,
			 enum MHD_RequestTerminationCode code)
{
	(void)context;
	(void)connection;
	(void)code;
	free(*state);
	*state = NULL;
}

/* "127.0.0.1" or "::1". */
static enum dio_status parse_address(const struct dio_web_options *options,
				     struct sockaddr_storage *address, socklen_t *size,
				     struct dio_error *error)
{
	struct sockaddr_in *v4 = (struct sockaddr_in *)address;
	struct sockaddr_in6 *v6 = (struct sockaddr_in6 *)address;

	*address = (struct sockaddr_storage){0};
	if (inet_pton(AF_INET, options->address, &v4->sin_addr) == 1) {
		v4->sin_family = AF_INET;
		v4->sin_port = htons(options->port);
		*size = sizeof *v4;
		return DIO_OK;
	}
	if (inet_pton(AF_INET6, options->address, &v6->sin6_addr) == 1) {
		v6->sin6_family = AF_INET6;
		v6->sin6_port = htons(options->port);
		*size = sizeof *v6;
		return DIO_OK;
	}
	return dio_fail(error, DIO_BAD_ARG,
			"web page: '%s' is no address: 127.0.0.1 is this machine alone, 0.0.0.0 "
			"every network",
			options->address);
}

static enum dio_status listen_at(const struct dio_web_options *options, int *fd,
				 struct dio_error *error)
{
	struct sockaddr_storage address;
	socklen_t size = 0;
	const int yes = 1;
	enum dio_status status = parse_address(options, &address, &size, error);
	int made;

	if (status != DIO_OK)
		return status;
	made = socket(address.ss_family, SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0);
	if (made >= 0 && setsockopt(made, SOL_SOCKET, SO_REUSEADDR, &yes, sizeof yes) == 0 &&
	    bind(made, (struct sockaddr *)&address, size) == 0 &&
	    listen(made, CONNECTIONS_QUEUED) == 0) {
		*fd = made;
		return DIO_OK;
	}
	status = dio_fail(error,
			  errno == EADDRINUSE ? DIO_BUSY
			  : errno == EACCES   ? DIO_REFUSED
					      : dio_status_from_errno(errno),
			  "web page: cannot listen at %s port %u: %s", options->address,
			  options->port, strerror(errno));
	if (made >= 0)
		close(made);
	return status;
}

enum dio_status dio_web_open(const struct dio_web_options *options, struct dio_web **web,
			     struct dio_error *error)
{
	struct dio_web *made;
	enum dio_status status;

	if (strlen(options->token) < DIO_WEB_TOKEN_MIN)
		return dio_fail(error, DIO_BAD_ARG, "web page: a token of %u letters is needed",
				DIO_WEB_TOKEN_MIN);
	made = calloc(1, sizeof *made);
	if (!made || !(made->token = strdup(options->token))) {
		free(made);
		return dio_fail(error, DIO_NO_MEM, "web page: no memory");
	}
	made->host = options->host;
	status = listen_at(options, &made->fd, error);
	if (status == DIO_OK) {
		made->daemon = MHD_start_daemon(
			MHD_USE_EPOLL, 0, NULL, NULL, on_request, made, MHD_OPTION_LISTEN_SOCKET,
			made->fd, MHD_OPTION_CONNECTION_LIMIT, CONNECTIONS_MAX,
			MHD_OPTION_CONNECTION_TIMEOUT, CONNECTION_TIME_S,
			MHD_OPTION_CONNECTION_MEMORY_LIMIT, (size_t)CONNECTION_BYTES,
			MHD_OPTION_UNESCAPE_CALLBACK, keep_escapes, NULL,
			MHD_OPTION_NOTIFY_COMPLETED, on_completed, NULL, MHD_OPTION_END);
		if (!made->daemon) {
			close(made->fd);
			status = dio_fail(error, DIO_IO, "web page: the server does not start");
		}
	}
	if (status != DIO_OK) {
		free(made->token);
		free(made);
		return status;
	}
	*web = made;
	return DIO_OK;
}

void dio_web_close(struct dio_web *web)
{
	if (!web)
		return;
	/* The server closes the listening socket. */
	MHD_stop_daemon(web->daemon);
	explicit_bzero(web->token, strlen(web->token));
	free(web->token);
	free(web);
}

uint16_t dio_web_get_port(const struct dio_web *web)
{
	union {
		struct sockaddr any;
		struct sockaddr_in v4;
		struct sockaddr_in6 v6;
	} address = {.v6 = {0}};
	socklen_t size = sizeof address;

	if (getsockname(web->fd, &address.any, &size) != 0)
		return 0;
	return ntohs(address.any.sa_family == AF_INET6 ? address.v6.sin6_port
						       : address.v4.sin_port);
}

int dio_web_get_fd(const struct dio_web *web)
{
	return MHD_get_daemon_info(web->daemon, MHD_DAEMON_INFO_EPOLL_FD)->epoll_fd;
}

void dio_web_dispatch(struct dio_web *web)
{
	MHD_UNSIGNED_LONG_LONG timeout_ms;

	/* What the server has read already no descriptor tells of. */
	for (int turn = 0; turn < TURNS_MAX; turn++) {
		MHD_run(web->daemon);
		if (MHD_get_timeout(web->daemon, &timeout_ms) != MHD_YES || timeout_ms > 0)
			break;
	}
}
