#include "keyboard.h"

#include <errno.h>
#include <fcntl.h>
#include <glob.h>
#include <libevdev/libevdev.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/epoll.h>
#include <sys/inotify.h>
#include <time.h>
#include <unistd.h>

#include "chips.h"
#include "dio/clock.h"
#include "dio/gpio.h"

#define FOLDER      "/dev/input"
#define DEVICES_MAX 16
#define PATH_SIZE   256

struct device {
	struct libevdev *evdev; /* NULL: a free place */
	int fd;
	char path[PATH_SIZE];
};

struct dio_keyboard {
	char where[PATH_SIZE];
	uint32_t keys[DIO_BUTTONS_MAX];
	uint32_t key_count;
	struct device devices[DEVICES_MAX];
	int inotify; /* -1: devices are looked for once */
	int epoll;
};

static bool has_key(const struct dio_keyboard *keyboard, const struct libevdev *evdev)
{
	for (uint32_t i = 0; i < keyboard->key_count; i++)
		if (libevdev_has_event_code(evdev, EV_KEY, keyboard->keys[i]))
			return true;
	return false;
}

static bool is_open(const struct dio_keyboard *keyboard, const char *path)
{
	for (int i = 0; i < DEVICES_MAX; i++)
		if (keyboard->devices[i].evdev && strcmp(keyboard->devices[i].path, path) == 0)
			return true;
	return false;
}

static struct device *find_place(struct dio_keyboard *keyboard)
{
	for (int i = 0; i < DEVICES_MAX; i++)
		if (!keyboard->devices[i].evdev)
			return &keyboard->devices[i];
	return NULL;
}

static void drop(struct device *device)
{
	libevdev_free(device->evdev);
	/* Closing takes it out of the epoll set too. */
	close(device->fd);
	device->evdev = NULL;
}

/* Devices that cannot be opened or have no key of ours are passed over. */
static void add_device(struct dio_keyboard *keyboard, const char *path)
{
	struct device *device = find_place(keyboard);
	struct epoll_event event = {.events = EPOLLIN};

	if (!device || is_open(keyboard, path))
		return;
	device->fd = open(path, O_RDONLY | O_NONBLOCK | O_CLOEXEC);
	if (device->fd < 0)
		return;
	if (libevdev_new_from_fd(device->fd, &device->evdev) < 0) {
		device->evdev = NULL;
		close(device->fd);
		return;
	}
	snprintf(device->path, sizeof(device->path), "%s", path);
	if (!has_key(keyboard, device->evdev) ||
	    libevdev_set_clock_id(device->evdev, CLOCK_MONOTONIC) < 0 ||
	    epoll_ctl(keyboard->epoll, EPOLL_CTL_ADD, device->fd, &event) < 0)
		drop(device);
}

static void look_for_devices(struct dio_keyboard *keyboard)
{
	glob_t found;

	if (strcmp(keyboard->where, "auto") != 0) {
		add_device(keyboard, keyboard->where);
		return;
	}
	if (glob("/dev/input/event*", 0, NULL, &found) != 0)
		return;
	for (size_t i = 0; i < found.gl_pathc; i++)
		add_device(keyboard, found.gl_pathv[i]);
	globfree(&found);
}

/* Folders that devices appear in, by their own names or by udev's. They may come later. */
static void watch_folders(const struct dio_keyboard *keyboard)
{
	char folder[PATH_SIZE];
	char *slash;

	snprintf(folder, sizeof(folder), "%s", keyboard->where);
	slash = strrchr(folder, '/');
	if (slash)
		*slash = '\0';
	/* A node is of use once its owner is set, which is a change of its attributes. */
	inotify_add_watch(keyboard->inotify, FOLDER, IN_CREATE | IN_ATTRIB);
	if (slash && folder[0] && strcmp(folder, FOLDER) != 0)
		inotify_add_watch(keyboard->inotify, folder, IN_CREATE | IN_ATTRIB | IN_MOVED_TO);
}

/* Hear of devices that come. This reaches a service of any sandbox, unlike udevd's messages, which
 * stay in its network namespace. */
static void watch(struct dio_keyboard *keyboard)
{
	struct epoll_event event = {.events = EPOLLIN};

	keyboard->inotify = inotify_init1(IN_NONBLOCK | IN_CLOEXEC);
	if (keyboard->inotify < 0)
		return;
	epoll_ctl(keyboard->epoll, EPOLL_CTL_ADD, keyboard->inotify, &event);
	watch_folders(keyboard);
}

enum dio_status dio_keyboard_open(const char *where, const uint32_t *keys, uint32_t count,
				  struct dio_keyboard **keyboard, struct dio_error *error)
{
	struct dio_keyboard *made;

	if ((strcmp(where, "auto") != 0 && where[0] != '/') || strlen(where) >= PATH_SIZE ||
	    count > DIO_BUTTONS_MAX)
		return dio_fail(error, DIO_BAD_ARG,
				"keyboard '%s': say auto or a path such as "
				"/dev/input/by-id/NAME-event-kbd",
				where);
	made = calloc(1, sizeof(*made));
	if (!made)
		return dio_fail(error, DIO_NO_MEM, "keyboard: out of memory");
	made->epoll = epoll_create1(EPOLL_CLOEXEC);
	if (made->epoll < 0) {
		free(made);
		return dio_fail(error, dio_status_from_errno(errno),
				"keyboard: cannot wait for keys: %s", strerror(errno));
	}
	snprintf(made->where, sizeof(made->where), "%s", where);
	memcpy(made->keys, keys, count * sizeof(*keys));
	made->key_count = count;
	/* Watch first, so that none slips in between. */
	watch(made);
	look_for_devices(made);
	*keyboard = made;
	return DIO_OK;
}

void dio_keyboard_close(struct dio_keyboard *keyboard)
{
	if (!keyboard)
		return;
	for (int i = 0; i < DEVICES_MAX; i++)
		if (keyboard->devices[i].evdev)
			drop(&keyboard->devices[i]);
	if (keyboard->inotify >= 0)
		close(keyboard->inotify);
	close(keyboard->epoll);
	free(keyboard);
}

int dio_keyboard_get_fd(const struct dio_keyboard *keyboard)
{
	return keyboard->epoll;
}

static bool is_ours(const struct dio_keyboard *keyboard, uint32_t key)
{
	for (uint32_t i = 0; i < keyboard->key_count; i++)
		if (keyboard->keys[i] == key)
			return true;
	return false;
}

/* False when the device is gone. */
static bool drain_device(const struct dio_keyboard *keyboard, struct device *device,
			 dio_keyboard_fn *report, void *context)
{
	unsigned flag = LIBEVDEV_READ_FLAG_NORMAL;

	for (;;) {
		struct input_event event;
		int result = libevdev_next_event(device->evdev, flag, &event);

		if (result == -EAGAIN && flag == LIBEVDEV_READ_FLAG_SYNC) {
			flag = LIBEVDEV_READ_FLAG_NORMAL;
			continue;
		}
		if (result < 0)
			return result == -EAGAIN || result == -EINTR;
		/* After a lost event libevdev tells what changed meanwhile. */
		if (result == LIBEVDEV_READ_STATUS_SYNC)
			flag = LIBEVDEV_READ_FLAG_SYNC;
		/* A value of 2 is the keyboard's own repetition. */
		if (event.type == EV_KEY && event.value < 2 && is_ours(keyboard, event.code))
			report(context, event.code, event.value == 1,
			       (uint64_t)event.input_event_sec * 1000000000u +
				       (uint64_t)event.input_event_usec * 1000u);
	}
}

/* What was held on a device that went away is held no longer. */
static void release_keys(const struct dio_keyboard *keyboard, const struct device *device,
			 dio_keyboard_fn *report, void *context)
{
	for (uint32_t i = 0; i < keyboard->key_count; i++)
		if (libevdev_get_event_value(device->evdev, EV_KEY, keyboard->keys[i]) == 1)
			report(context, keyboard->keys[i], false, dio_clock_ns());
}

/* Something changed where devices are. */
static bool has_news(const struct dio_keyboard *keyboard)
{
	_Alignas(struct inotify_event) char events[4096];
	bool some = false;

	while (keyboard->inotify >= 0 && read(keyboard->inotify, events, sizeof(events)) > 0)
		some = true;
	return some;
}

void dio_keyboard_drain(struct dio_keyboard *keyboard, dio_keyboard_fn *report, void *context)
{
	bool changed = has_news(keyboard);

	for (int i = 0; i < DEVICES_MAX; i++) {
		struct device *device = &keyboard->devices[i];

		if (device->evdev && !drain_device(keyboard, device, report, context)) {
			release_keys(keyboard, device, report, context);
			drop(device);
			/* Its name may be another's already. */
			changed = true;
		}
	}
	if (changed) {
		watch_folders(keyboard);
		look_for_devices(keyboard);
	}
}
