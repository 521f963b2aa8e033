#include "ring/ring_client.h"

#include <errno.h>
#include <poll.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/epoll.h>
#include <sys/timerfd.h>
#include <time.h>
#include <unistd.h>

#include "dio/clock.h"
#include "ring/listen.h"
#include "ring/memory.h"

#define NS_PER_S     1000000000u
#define RETRY_MIN_NS (NS_PER_S / 20)
#define RETRY_MAX_NS (NS_PER_S / 2)

struct dio_ring_client {
	struct sockaddr_un address;
	struct dio_ring_hello hello;
	enum dio_ring_order order;
	int epoll, timer;
	int socket; /* -1: the daemon is away */
	struct dio_ring_memory memory;
	struct dio_ring_client_status status;
	bool greeted;       /* a message has come on this connection */
	bool refused;       /* the last connection ended with a refusal */
	bool state_changed; /* since acquire last returned */
	uint64_t next;      /* index of the frame wanted next */
	uint64_t retry_ns;  /* wait before the next try to connect */
};

static void set_state(struct dio_ring_client *client, enum dio_capture_state state,
		      const char *text)
{
	struct dio_ring_client_status *status = &client->status;
	char kept[sizeof(status->text)] = "";

	memcpy(kept, text, strnlen(text, sizeof(kept) - 1));
	if (status->state == state && strcmp(status->text, kept) == 0)
		return;
	status->state = state;
	memcpy(status->text, kept, sizeof(kept));
	client->state_changed = true;
}

static void retry_later(struct dio_ring_client *client)
{
	const struct itimerspec once = {.it_value = {.tv_nsec = (long)client->retry_ns}};

	timerfd_settime(client->timer, 0, &once, NULL);
	client->retry_ns =
		client->retry_ns * 2 < RETRY_MAX_NS ? client->retry_ns * 2 : RETRY_MAX_NS;
}

/* The memory stays mapped until the next one comes: a frame that was acquired stays readable. */
static void lose(struct dio_ring_client *client, const char *text)
{
	if (client->socket >= 0)
		close(client->socket);
	client->socket = -1;
	client->greeted = false;
	set_state(client, DIO_CAPTURE_ABSENT, text);
	retry_later(client);
}

static void lose_for_errno(struct dio_ring_client *client)
{
	char text[DIO_RING_TEXT_BYTES];

	if (errno == EACCES || errno == EPERM)
		snprintf(text, sizeof(text), "%s: not permitted; add the user to the group of %s",
			 client->address.sun_path, "that socket");
	else if (errno == ENOENT || errno == ECONNREFUSED)
		snprintf(text, sizeof(text), "%s: no capture daemon; is diorama-captured running?",
			 client->address.sun_path);
	else
		snprintf(text, sizeof(text), "%s: %s", client->address.sun_path, strerror(errno));
	lose(client, text);
}

static void find_daemon(struct dio_ring_client *client)
{
	struct epoll_event event = {.events = EPOLLIN};
	const struct sockaddr *address = (const struct sockaddr *)&client->address;

	client->socket = socket(AF_UNIX, SOCK_SEQPACKET | SOCK_CLOEXEC | SOCK_NONBLOCK, 0);
	if (client->socket < 0 || connect(client->socket, address, sizeof(client->address)) != 0 ||
	    epoll_ctl(client->epoll, EPOLL_CTL_ADD, client->socket, &event) != 0 ||
	    send(client->socket, &client->hello, sizeof(client->hello), MSG_NOSIGNAL) !=
		    (ssize_t)sizeof(client->hello))
		lose_for_errno(client);
}

/* The next message and the descriptor with it (-1: none). false: none, and the connection may be
 * lost. */
static bool receive(struct dio_ring_client *client, struct dio_ring_message *message, int *fd)
{
	struct iovec part = {.iov_base = message, .iov_len = sizeof(*message)};
	union {
		struct cmsghdr header;
		char room[CMSG_SPACE(sizeof(int))];
	} control;
	struct msghdr envelope = {.msg_iov = &part,
				  .msg_iovlen = 1,
				  .msg_control = &control,
				  .msg_controllen = sizeof(control)};
	ssize_t bytes;

	do
		bytes = recvmsg(client->socket, &envelope, MSG_DONTWAIT | MSG_CMSG_CLOEXEC);
	while (bytes < 0 && errno == EINTR);
	if (bytes < 0 && errno == EAGAIN)
		return false;
	*fd = -1;
	if (bytes > 0 && envelope.msg_controllen >= CMSG_LEN(sizeof(int)) &&
	    control.header.cmsg_type == SCM_RIGHTS)
		memcpy(fd, CMSG_DATA(&control.header), sizeof(int));
	if (bytes == (ssize_t)sizeof(*message) &&
	    !(envelope.msg_flags & (MSG_TRUNC | MSG_CTRUNC)) && message->magic == DIO_RING_MAGIC &&
	    message->version == DIO_RING_VERSION && message->bytes == sizeof(*message) &&
	    message->text[sizeof(message->text) - 1] == '\0')
		return true;
	if (*fd >= 0)
		close(*fd);
	lose(client, bytes <= 0 ? "the capture daemon went away"
				: "the capture daemon is of another version; install both from one "
				  "release");
	client->refused = bytes > 0;
	return false;
}

static void take_memory(struct dio_ring_client *client, int fd)
{
	struct dio_ring_memory made;
	struct dio_error error;

	if (dio_ring_memory_open(&made, fd, &error) != DIO_OK) {
		close(fd);
		lose(client, error.text);
		client->refused = true;
		return;
	}
	dio_ring_memory_close(&client->memory);
	client->memory = made;
}

static void heed(struct dio_ring_client *client, const struct dio_ring_message *message, int fd)
{
	if (message->kind == DIO_RING_MESSAGE_REFUSED) {
		if (fd >= 0)
			close(fd);
		lose(client, message->text);
		client->refused = true;
		return;
	}
	if (!client->greeted) {
		client->greeted = true;
		client->refused = false;
		client->retry_ns = RETRY_MIN_NS;
		client->status.connections++;
		/* What came before is not ours, and the memory is of a daemon that is gone. */
		dio_ring_memory_close(&client->memory);
		client->next = message->published;
	}
	if (fd >= 0)
		take_memory(client, fd);
	if (client->socket >= 0)
		set_state(client,
			  message->state < DIO_CAPTURE_ABSENT
				  ? (enum dio_capture_state)message->state
				  : DIO_CAPTURE_STARTING,
			  message->text);
}

/* All that has arrived, and a new try for the daemon when one is due. Never waits. */
static void catch_up(struct dio_ring_client *client)
{
	struct dio_ring_message message;
	uint64_t expirations;
	int fd;

	if (client->socket < 0 &&
	    read(client->timer, &expirations, sizeof(expirations)) == sizeof(expirations))
		find_daemon(client);
	while (client->socket >= 0 && receive(client, &message, &fd))
		heed(client, &message, fd);
}

/* Read a slot's header; what it says is checked, since it goes into pointers and sizes. */
static bool read_slot(const struct dio_ring_client *client, uint64_t index,
		      struct dio_ring_frame *out)
{
	const struct dio_ring_slot *slot = dio_ring_memory_slot(&client->memory, index);
	struct dio_ring_frame frame = {.index = index};
	uint32_t format, state;

	if (!dio_ring_slot_holds(slot, index))
		return false;
	format = slot->format;
	state = slot->state;
	frame.published_ns = slot->published_ns;
	frame.state = (enum dio_capture_state)state;
	frame.frame = (struct dio_frame){
		.format = (enum dio_pixel_format)format,
		.width = slot->width,
		.height = slot->height,
		.pitch_bytes = slot->pitch_bytes,
		.timestamp_ns = slot->timestamp_ns,
		.sequence = slot->sequence,
		.data = slot->data,
		.size_bytes = slot->size_bytes,
		.metadata = {slot->exposure_us, slot->gain, slot->white_balance_k, slot->red_gain,
			     slot->blue_gain, slot->locked},
	};
	if (!dio_ring_slot_still_holds(slot, index) || format > DIO_PIXEL_MJPEG ||
	    state >= DIO_CAPTURE_ABSENT ||
	    frame.frame.size_bytes > client->memory.header->data_bytes)
		return false;
	*out = frame;
	return true;
}

static bool take(struct dio_ring_client *client, struct dio_ring_frame *frame)
{
	const struct dio_ring_header *header = client->memory.header;

	/* The writer may pass us while we look: look again then, but not for ever. */
	for (unsigned tries = 0; header && tries < 8; tries++) {
		uint64_t published = atomic_load_explicit(&header->published, memory_order_acquire);
		uint64_t index = client->next > header->first ? client->next : header->first;
		uint64_t oldest = published > header->slot_count - 1
					  ? published - (header->slot_count - 1)
					  : 0;

		if (published <= index)
			return false;
		if (client->order == DIO_RING_NEWEST)
			index = published - 1;
		else if (index < oldest)
			index = oldest;
		if (!read_slot(client, index, frame))
			continue;
		client->status.dropped += index - client->next;
		client->status.taken++;
		client->next = index + 1;
		return true;
	}
	return false;
}

static enum dio_status fail_nothing(const struct dio_ring_client *client, struct dio_error *error)
{
	const struct dio_ring_client_status *status = &client->status;

	return dio_fail(error, client->refused ? DIO_UNSUPPORTED : DIO_AGAIN, "camera %s%s%s",
			dio_capture_state_name(status->state), status->text[0] ? ": " : "",
			status->text);
}

enum dio_status dio_ring_client_acquire(struct dio_ring_client *client,
					struct dio_ring_frame *frame, int64_t timeout_ns,
					struct dio_error *error)
{
	const uint64_t start = dio_clock_ns(), wait = timeout_ns > 0 ? (uint64_t)timeout_ns : 0;

	for (;;) {
		struct pollfd fd = {.fd = client->epoll, .events = POLLIN};
		struct timespec left = {0};
		uint64_t spent;

		catch_up(client);
		if (take(client, frame)) {
			client->state_changed = false;
			return DIO_OK;
		}
		spent = dio_clock_ns() - start;
		if (client->state_changed || spent >= wait) {
			client->state_changed = false;
			return fail_nothing(client, error);
		}
		left.tv_sec = (time_t)((wait - spent) / NS_PER_S);
		left.tv_nsec = (long)((wait - spent) % NS_PER_S);
		if (ppoll(&fd, 1, &left, NULL) < 0 && errno == EINTR)
			return fail_nothing(client, error);
	}
}

bool dio_ring_client_is_whole(struct dio_ring_client *client, const struct dio_ring_frame *frame)
{
	const struct dio_ring_slot *slot;
	bool whole;

	if (!client->memory.header)
		return false;
	slot = dio_ring_memory_slot(&client->memory, frame->index);
	whole = slot->data == frame->frame.data && dio_ring_slot_still_holds(slot, frame->index);
	if (!whole)
		client->status.overtaken++;
	return whole;
}

enum dio_status dio_ring_client_copy(struct dio_ring_client *client, struct dio_ring_frame *frame,
				     void *bytes, size_t size, struct dio_error *error)
{
	if (frame->frame.size_bytes > size)
		return dio_fail(error, DIO_BAD_ARG,
				"frame ring: %zu bytes of room for a frame of %zu", size,
				frame->frame.size_bytes);
	memcpy(bytes, frame->frame.data, frame->frame.size_bytes);
	if (!dio_ring_client_is_whole(client, frame))
		return dio_fail(error, DIO_AGAIN, "frame ring: the reader was overtaken");
	frame->frame.data = bytes;
	return DIO_OK;
}

void dio_ring_client_get_status(const struct dio_ring_client *client,
				struct dio_ring_client_status *status)
{
	*status = client->status;
}

int dio_ring_client_get_fd(const struct dio_ring_client *client)
{
	return client->epoll;
}

static enum dio_status fill_in(struct dio_ring_client *client,
			       const struct dio_ring_client_options *options,
			       struct dio_error *error)
{
	const char *name = options->name ? options->name : "reader";

	client->hello = (struct dio_ring_hello){.magic = DIO_RING_MAGIC,
						.version = DIO_RING_VERSION,
						.bytes = sizeof(client->hello)};
	if (strlen(name) >= sizeof(client->hello.name))
		return dio_fail(error, DIO_BAD_ARG, "frame ring: the name %s is too long", name);
	memcpy(client->hello.name, name, strlen(name));
	client->order = options->order;
	return dio_ring_address(options->path ? options->path : DIO_RING_SOCKET_DEFAULT,
				&client->address, error);
}

enum dio_status dio_ring_client_open(const struct dio_ring_client_options *options,
				     struct dio_ring_client **client, struct dio_error *error)
{
	struct epoll_event event = {.events = EPOLLIN};
	struct dio_ring_client *made = calloc(1, sizeof(*made));
	enum dio_status status;

	if (!made)
		return dio_fail(error, DIO_NO_MEM, "frame ring: out of memory");
	made->socket = -1;
	made->memory.fd = -1;
	made->retry_ns = RETRY_MIN_NS;
	made->status.state = DIO_CAPTURE_ABSENT;
	made->timer = timerfd_create(CLOCK_MONOTONIC, TFD_CLOEXEC | TFD_NONBLOCK);
	made->epoll = epoll_create1(EPOLL_CLOEXEC);
	status = fill_in(made, options, error);
	if (status == DIO_OK && (made->timer < 0 || made->epoll < 0 ||
				 epoll_ctl(made->epoll, EPOLL_CTL_ADD, made->timer, &event) != 0))
		status = dio_fail(error, DIO_IO, "frame ring: out of descriptors: %s",
				  strerror(errno));
	if (status != DIO_OK) {
		dio_ring_client_close(made);
		return status;
	}
	find_daemon(made);
	*client = made;
	return DIO_OK;
}

void dio_ring_client_close(struct dio_ring_client *client)
{
	if (!client)
		return;
	dio_ring_memory_close(&client->memory);
	if (client->socket >= 0)
		close(client->socket);
	if (client->timer >= 0)
		close(client->timer);
	if (client->epoll >= 0)
		close(client->epoll);
	free(client);
}
