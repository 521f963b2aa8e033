#include "ring/readers.h"

#include <errno.h>
#include <inttypes.h>
#include <stdio.h>
#include <string.h>
#include <sys/epoll.h>
#include <sys/timerfd.h>
#include <time.h>
#include <unistd.h>

#include "dio/clock.h"
#include "ring/listen.h"

#define NS_PER_S      1000000000u
#define HELLO_NS      (2ull * NS_PER_S)
#define TICK_NS       (NS_PER_S / 2)
#define EVENTS_A_CALL 16
/* Room for some twenty messages: who is further behind only needs to know that it is. */
#define SEND_BUFFER_BYTES (16 << 10)

/* What an epoll event speaks of: a connection's number, or one of these. */
enum { EVENT_LISTENER = DIO_RING_READERS_MAX, EVENT_TIMER };

static int watch(struct dio_ring_readers *readers, int operation, int fd, uint32_t events,
		 uint32_t what)
{
	struct epoll_event event = {.events = events, .data.u32 = what};

	return epoll_ctl(readers->epoll, operation, fd, &event);
}

static void set_timer(struct dio_ring_readers *readers, uint64_t in_ns)
{
	const struct itimerspec once = {
		.it_value = {(time_t)(in_ns / NS_PER_S), (long)(in_ns % NS_PER_S)}};

	timerfd_settime(readers->timer, 0, &once, NULL);
}

static void forget(struct dio_ring_connection *connection)
{
	close(connection->fd); /* leaves the epoll set by that */
	*connection = (struct dio_ring_connection){.fd = -1};
}

static void fill_message(const struct dio_ring_readers *readers,
			 const struct dio_ring_connection *connection,
			 enum dio_ring_message_kind kind, struct dio_ring_message *message)
{
	*message = readers->status;
	message->kind = kind;
	message->missed = connection ? connection->missed : 0;
}

/* Send without waiting, with a descriptor unless that is -1. */
static bool send_message(int fd, const struct dio_ring_message *message, int passed_fd)
{
	/* iovec has no const; sendmsg() does not write. */
	union {
		const void *from;
		void *to;
	} bytes = {message};
	struct iovec part = {.iov_base = bytes.to, .iov_len = sizeof(*message)};
	union {
		struct cmsghdr header;
		char room[CMSG_SPACE(sizeof(int))];
	} control;
	struct msghdr envelope = {.msg_iov = &part, .msg_iovlen = 1};

	if (passed_fd >= 0) {
		memset(&control, 0, sizeof(control));
		control.header.cmsg_level = SOL_SOCKET;
		control.header.cmsg_type = SCM_RIGHTS;
		control.header.cmsg_len = CMSG_LEN(sizeof(int));
		memcpy(CMSG_DATA(&control.header), &passed_fd, sizeof(int));
		envelope.msg_control = &control;
		envelope.msg_controllen = sizeof(control);
	}
	return sendmsg(fd, &envelope, MSG_DONTWAIT | MSG_NOSIGNAL) == (ssize_t)sizeof(*message);
}

/* Tell one reader the status; what it cannot take now it is told once its socket drains. A reader
 * that hung up is forgotten by dispatch(), which the hang-up wakes. */
static void tell(struct dio_ring_readers *readers, struct dio_ring_connection *connection)
{
	bool fresh = readers->memory_fd >= 0 && connection->memory_sent != readers->memory_number;
	uint32_t number = (uint32_t)(connection - readers->table);
	struct dio_ring_message message;

	fill_message(readers, connection, fresh ? DIO_RING_MESSAGE_MEMORY : DIO_RING_MESSAGE_STATUS,
		     &message);
	if (send_message(connection->fd, &message, fresh ? readers->memory_fd : -1)) {
		if (fresh)
			connection->memory_sent = readers->memory_number;
		if (connection->owed)
			watch(readers, EPOLL_CTL_MOD, connection->fd, EPOLLIN, number);
		connection->owed = false;
		return;
	}
	connection->missed++;
	readers->missed++;
	if (!connection->owed)
		watch(readers, EPOLL_CTL_MOD, connection->fd, EPOLLIN | EPOLLOUT, number);
	connection->owed = true;
}

static void tell_all(struct dio_ring_readers *readers)
{
	for (size_t i = 0; i < DIO_RING_READERS_MAX; i++)
		if (readers->table[i].fd >= 0 && readers->table[i].greeted)
			tell(readers, &readers->table[i]);
}

static void refuse(struct dio_ring_readers *readers, int fd, const char *why)
{
	struct dio_ring_message message;

	fill_message(readers, NULL, DIO_RING_MESSAGE_REFUSED, &message);
	snprintf(message.text, sizeof(message.text), "%s", why);
	send_message(fd, &message, -1);
	readers->refused++;
}

static pid_t peer_of(int fd)
{
	struct ucred peer = {0};
	socklen_t size = sizeof(peer);

	return getsockopt(fd, SOL_SOCKET, SO_PEERCRED, &peer, &size) == 0 ? peer.pid : 0;
}

/* A free place for a connection of that process, or NULL with the reason. */
static struct dio_ring_connection *find_place(struct dio_ring_readers *readers, pid_t pid,
					      const char **why)
{
	struct dio_ring_connection *place = NULL;
	unsigned same = 0;

	for (size_t i = 0; i < DIO_RING_READERS_MAX; i++) {
		if (readers->table[i].fd < 0)
			place = place ? place : &readers->table[i];
		else
			same += readers->table[i].pid == pid;
	}
	*why = "too many readers are connected; close one";
	if (same < DIO_RING_PER_PROCESS)
		return place;
	*why = "this process has too many connections; close one";
	return NULL;
}

static void admit(struct dio_ring_readers *readers, int fd)
{
	const int send_buffer = SEND_BUFFER_BYTES;
	const pid_t pid = peer_of(fd);
	const char *why;
	struct dio_ring_connection *place = find_place(readers, pid, &why);

	if (!place ||
	    watch(readers, EPOLL_CTL_ADD, fd, EPOLLIN, (uint32_t)(place - readers->table)) != 0) {
		refuse(readers, fd, why);
		close(fd);
		return;
	}
	setsockopt(fd, SOL_SOCKET, SO_SNDBUF, &send_buffer, sizeof(send_buffer));
	*place = (struct dio_ring_connection){
		.fd = fd, .pid = pid, .deadline_ns = dio_clock_ns() + HELLO_NS};
	set_timer(readers, TICK_NS);
}

static void accept_some(struct dio_ring_readers *readers)
{
	for (unsigned i = 0; i < EVENTS_A_CALL; i++) {
		int fd = accept4(readers->listener, NULL, NULL, SOCK_CLOEXEC | SOCK_NONBLOCK);

		if (fd >= 0) {
			admit(readers, fd);
			continue;
		}
		if (errno == EMFILE || errno == ENFILE || errno == ENOMEM || errno == ENOBUFS) {
			/* The queue stays readable: without a pause we would spin on it. */
			readers->paused = true;
			watch(readers, EPOLL_CTL_MOD, readers->listener, 0, EVENT_LISTENER);
			set_timer(readers, TICK_NS);
		}
		if (errno != ECONNABORTED && errno != EINTR)
			return;
	}
}

static void copy_name(char *to, const char *from)
{
	size_t i = 0;

	for (; i + 1 < DIO_RING_NAME_BYTES && from[i]; i++)
		to[i] = from[i] > ' ' && from[i] < 0x7f ? from[i] : '?';
	to[i] = '\0';
}

static void greet(struct dio_ring_readers *readers, struct dio_ring_connection *connection,
		  const struct dio_ring_hello *hello, ssize_t bytes)
{
	char why[DIO_RING_TEXT_BYTES];

	if (bytes >= 12 && hello->magic == DIO_RING_MAGIC && hello->version != DIO_RING_VERSION) {
		snprintf(why, sizeof(why),
			 "the daemon speaks version %u of the frame ring, this program %u; install "
			 "both from one release",
			 DIO_RING_VERSION, hello->version);
		refuse(readers, connection->fd, why);
		forget(connection);
		return;
	}
	if (bytes != (ssize_t)sizeof(*hello) || hello->magic != DIO_RING_MAGIC ||
	    hello->bytes != sizeof(*hello)) {
		refuse(readers, connection->fd, "not a greeting of the frame ring");
		forget(connection);
		return;
	}
	copy_name(connection->name, hello->name);
	connection->greeted = true;
	tell(readers, connection);
}

static void hear(struct dio_ring_readers *readers, struct dio_ring_connection *connection)
{
	struct dio_ring_hello hello = {0};
	/* recv() and not recvmsg(): descriptors that come along are dropped by the kernel. */
	ssize_t bytes = recv(connection->fd, &hello, sizeof(hello), MSG_DONTWAIT | MSG_TRUNC);

	if (bytes < 0 && (errno == EAGAIN || errno == EINTR))
		return;
	if (bytes <= 0) {
		forget(connection);
	} else if (connection->greeted) {
		refuse(readers, connection->fd, "a reader has nothing to say after its greeting");
		forget(connection);
	} else {
		greet(readers, connection, &hello, bytes);
	}
}

static void tick(struct dio_ring_readers *readers)
{
	uint64_t expirations, now = dio_clock_ns();
	bool pending = false;

	if (read(readers->timer, &expirations, sizeof(expirations)) < 0)
		return;
	for (size_t i = 0; i < DIO_RING_READERS_MAX; i++) {
		struct dio_ring_connection *connection = &readers->table[i];

		if (connection->fd < 0 || connection->greeted)
			continue;
		if (now >= connection->deadline_ns) {
			refuse(readers, connection->fd, "no greeting came in time");
			forget(connection);
		} else {
			pending = true;
		}
	}
	if (readers->paused) {
		readers->paused = false;
		watch(readers, EPOLL_CTL_MOD, readers->listener, EPOLLIN, EVENT_LISTENER);
	}
	if (pending)
		set_timer(readers, TICK_NS);
}

void dio_ring_readers_dispatch(struct dio_ring_readers *readers)
{
	struct epoll_event events[EVENTS_A_CALL];
	int n = epoll_wait(readers->epoll, events, EVENTS_A_CALL, 0);

	for (int i = 0; i < n; i++) {
		uint32_t what = events[i].data.u32;

		/* Taken and released for each: publishing never waits for the whole round. */
		pthread_mutex_lock(&readers->lock);
		if (what == EVENT_LISTENER)
			accept_some(readers);
		else if (what == EVENT_TIMER)
			tick(readers);
		else if (readers->table[what].fd >= 0 && (events[i].events & EPOLLOUT))
			tell(readers, &readers->table[what]);
		if (what < EVENT_LISTENER && readers->table[what].fd >= 0 &&
		    (events[i].events & (EPOLLIN | EPOLLHUP | EPOLLERR)))
			hear(readers, &readers->table[what]);
		pthread_mutex_unlock(&readers->lock);
	}
}

void dio_ring_readers_set_memory(struct dio_ring_readers *readers, int memory_fd)
{
	pthread_mutex_lock(&readers->lock);
	readers->memory_fd = memory_fd;
	readers->memory_number++;
	pthread_mutex_unlock(&readers->lock);
}

void dio_ring_readers_wake(struct dio_ring_readers *readers, uint64_t published)
{
	pthread_mutex_lock(&readers->lock);
	readers->status.published = published;
	tell_all(readers);
	pthread_mutex_unlock(&readers->lock);
}

void dio_ring_readers_set_state(struct dio_ring_readers *readers, enum dio_capture_state state,
				const char *text)
{
	struct dio_ring_message *status = &readers->status;
	char kept[sizeof(status->text)] = "";

	memcpy(kept, text, strnlen(text, sizeof(kept) - 1));
	pthread_mutex_lock(&readers->lock);
	if (status->state != (uint32_t)state || strcmp(status->text, kept) != 0) {
		status->state = (uint32_t)state;
		memcpy(status->text, kept, sizeof(kept));
		tell_all(readers);
	}
	pthread_mutex_unlock(&readers->lock);
}

static enum dio_status open_listener(struct dio_ring_readers *readers,
				     const struct dio_ring_server_options *options,
				     struct dio_error *error)
{
	enum dio_status status;

	if (options->listen_fd >= 0) {
		status = dio_ring_listen_check(options->listen_fd, error);
		if (status == DIO_OK)
			readers->listener = options->listen_fd;
		return status;
	}
	status = dio_ring_listen(options->path, options->mode ? options->mode : 0660,
				 &readers->listener, error);
	if (status == DIO_OK)
		snprintf(readers->path, sizeof(readers->path), "%s", options->path);
	return status;
}

enum dio_status dio_ring_readers_init(struct dio_ring_readers *readers,
				      const struct dio_ring_server_options *options,
				      struct dio_error *error)
{
	enum dio_status status;

	*readers = (struct dio_ring_readers){
		.lock = PTHREAD_MUTEX_INITIALIZER,
		.listener = -1,
		.memory_fd = -1,
		.status = {.magic = DIO_RING_MAGIC,
			   .version = DIO_RING_VERSION,
			   .bytes = sizeof(struct dio_ring_message)},
	};
	for (size_t i = 0; i < DIO_RING_READERS_MAX; i++)
		readers->table[i].fd = -1;
	readers->timer = timerfd_create(CLOCK_MONOTONIC, TFD_CLOEXEC | TFD_NONBLOCK);
	readers->epoll = epoll_create1(EPOLL_CLOEXEC);
	if (readers->timer < 0 || readers->epoll < 0)
		return dio_fail(error, DIO_IO, "frame ring: out of descriptors: %s",
				strerror(errno));
	status = open_listener(readers, options, error);
	if (status != DIO_OK)
		return status;
	if (watch(readers, EPOLL_CTL_ADD, readers->listener, EPOLLIN, EVENT_LISTENER) != 0 ||
	    watch(readers, EPOLL_CTL_ADD, readers->timer, EPOLLIN, EVENT_TIMER) != 0)
		return dio_fail(error, DIO_IO, "frame ring: epoll: %s", strerror(errno));
	return DIO_OK;
}

void dio_ring_readers_deinit(struct dio_ring_readers *readers)
{
	for (size_t i = 0; i < DIO_RING_READERS_MAX; i++)
		if (readers->table[i].fd >= 0)
			forget(&readers->table[i]);
	if (readers->path[0])
		unlink(readers->path);
	if (readers->listener >= 0)
		close(readers->listener);
	if (readers->timer >= 0)
		close(readers->timer);
	if (readers->epoll >= 0)
		close(readers->epoll);
	pthread_mutex_destroy(&readers->lock);
}
