#include "fixture.h"

#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <ftw.h>
#include <poll.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

#include "dio/clock.h"

#define ARGUMENTS_MAX 24

extern char **environ;

int64_t monotonic_ns(void)
{
	return (int64_t)dio_clock_ns();
}

static void nap(void)
{
	const struct timespec ten_ms = {.tv_nsec = 10000000};

	nanosleep(&ten_ms, NULL);
}

const char *daemon_path(const struct daemon *daemon, const char *name)
{
	static char paths[8][128];
	static unsigned next;
	char *path = paths[next++ % 8];

	snprintf(path, sizeof(paths[0]), "%s/%s", daemon->folder, name);
	return path;
}

static void map_script(struct daemon *daemon)
{
	int fd = open(daemon_path(daemon, "script"), O_RDWR | O_CREAT | O_CLOEXEC, 0600);
	void *memory;

	assert_true(fd >= 0);
	assert_int_equal(ftruncate(fd, sizeof(struct script)), 0);
	memory = mmap(NULL, sizeof(struct script), PROT_READ | PROT_WRITE, MAP_SHARED, fd, 0);
	assert_ptr_not_equal(memory, MAP_FAILED);
	daemon->script = memory;
	close(fd);
}

/* One bus that everybody may use, in the test's folder. */
static void write_bus_configuration(const struct daemon *daemon)
{
	FILE *file = fopen(daemon_path(daemon, "bus.conf"), "w");

	assert_non_null(file);
	fprintf(file,
		"<!DOCTYPE busconfig PUBLIC \"-//freedesktop//DTD D-Bus Bus Configuration 1.0//EN\""
		" \"http://www.freedesktop.org/standards/dbus/1.0/busconfig.dtd\">\n"
		"<busconfig><type>session</type><listen>unix:path=%s</listen>"
		"<policy context=\"default\"><allow send_destination=\"*\"/><allow "
		"eavesdrop=\"false\"/>"
		"<allow own=\"*\"/></policy></busconfig>\n",
		daemon_path(daemon, "bus"));
	assert_int_equal(fclose(file), 0);
}

static pid_t spawn(char **arguments, bool quiet)
{
	pid_t pid = fork();

	assert_true(pid >= 0);
	if (pid > 0)
		return pid;
	if (quiet) {
		int null = open("/dev/null", O_WRONLY);

		dup2(null, STDERR_FILENO);
	}
	execvp(arguments[0], arguments);
	_exit(127);
}

static void start_bus(struct daemon *daemon)
{
	char option[160];
	char *arguments[] = {(char[]){"dbus-daemon"}, (char[]){"--nofork"}, option, NULL};
	const int64_t limit = monotonic_ns() + 10 * SECOND_NS;
	char address[160];

	write_bus_configuration(daemon);
	snprintf(option, sizeof(option), "--config-file=%s", daemon_path(daemon, "bus.conf"));
	snprintf(address, sizeof(address), "unix:path=%s", daemon_path(daemon, "bus"));
	daemon->bus_daemon = spawn(arguments, true);
	while (dio_bus_open(address, &daemon->bus, &daemon->error) != DIO_OK) {
		daemon->bus = NULL;
		/* Not installed: the process has ended at once. */
		if (waitpid(daemon->bus_daemon, NULL, WNOHANG) == daemon->bus_daemon) {
			daemon->bus_daemon = 0;
			return;
		}
		assert_true(monotonic_ns() < limit);
		nap();
	}
}

void daemon_open_notify(struct daemon *daemon)
{
	struct sockaddr_un address = {.sun_family = AF_UNIX};

	daemon->notify = socket(AF_UNIX, SOCK_DGRAM | SOCK_CLOEXEC, 0);
	assert_true(daemon->notify >= 0);
	snprintf(address.sun_path, sizeof(address.sun_path), "%s", daemon_path(daemon, "notify"));
	assert_int_equal(bind(daemon->notify, (const struct sockaddr *)&address, sizeof(address)),
			 0);
	setenv("NOTIFY_SOCKET", address.sun_path, 1);
}

int daemon_setup(void **state)
{
	struct daemon *daemon = calloc(1, sizeof(*daemon));
	const char *base = getenv("TMPDIR");

	if (!daemon)
		return -1;
	/* Socket addresses are short: a long TMPDIR would not fit. */
	if (!base || strlen(base) > 30)
		base = "/tmp";
	snprintf(daemon->folder, sizeof(daemon->folder), "%s/dio-capd-XXXXXX", base);
	if (!mkdtemp(daemon->folder))
		return -1;
	map_script(daemon);
	start_bus(daemon);
	daemon->notify = -1;
	*state = daemon;
	return 0;
}

static int remove_entry(const char *path, const struct stat *st, int type, struct FTW *walk)
{
	(void)st;
	(void)type;
	(void)walk;
	return remove(path);
}

int daemon_teardown(void **state)
{
	struct daemon *daemon = *state;

	dio_ring_client_close(daemon->reader);
	if (daemon->pid)
		daemon_end(daemon, SIGKILL);
	dio_bus_close(daemon->bus);
	if (daemon->bus_daemon) {
		kill(daemon->bus_daemon, SIGKILL);
		waitpid(daemon->bus_daemon, NULL, 0);
	}
	if (daemon->notify >= 0)
		close(daemon->notify);
	unsetenv("NOTIFY_SOCKET");
	munmap(daemon->script, sizeof(*daemon->script));
	nftw(daemon->folder, remove_entry, 8, FTW_DEPTH | FTW_PHYS);
	free(daemon);
	return 0;
}

void daemon_start(struct daemon *daemon, ...)
{
	char program[256], socket[128], bus[160];
	char *arguments[ARGUMENTS_MAX + 1] = {
		program, (char[]){"--camera"}, (char[]){"script"}, (char[]){"--socket"},
		socket,  (char[]){"--state"},  daemon->folder,     (char[]){"--bus"},
		bus};
	size_t n = 9;
	va_list more;

	snprintf(program, sizeof(program), "%s/captured_scripted", getenv("DIO_BIN_DIR"));
	snprintf(socket, sizeof(socket), "%s", daemon_path(daemon, "frames"));
	if (daemon->bus_daemon)
		snprintf(bus, sizeof(bus), "unix:path=%s", daemon_path(daemon, "bus"));
	else
		snprintf(bus, sizeof(bus), "none");
	va_start(more, daemon);
	while (n < ARGUMENTS_MAX && (arguments[n] = va_arg(more, char *)))
		n++;
	va_end(more);
	setenv(SCRIPT_VARIABLE, daemon_path(daemon, "script"), 1);
	daemon->pid = spawn(arguments, getenv("DIO_TEST_LOUD") == NULL);
}

int daemon_end(struct daemon *daemon, int signal_number)
{
	int status = -1;

	kill(daemon->pid, signal_number);
	assert_int_equal(waitpid(daemon->pid, &status, 0), daemon->pid);
	daemon->pid = 0;
	return status;
}

void script_set(struct daemon *daemon, enum script_mode mode)
{
	atomic_store(&daemon->script->mode, (uint32_t)mode);
}

void daemon_read(struct daemon *daemon, enum dio_ring_order order)
{
	const struct dio_ring_client_options options = {
		.path = daemon_path(daemon, "frames"), .name = "test", .order = order};

	if (dio_ring_client_open(&options, &daemon->reader, &daemon->error) != DIO_OK)
		fail_msg("%s", daemon->error.text);
}

static enum dio_capture_state state_now(const struct daemon *daemon)
{
	struct dio_ring_client_status status;

	dio_ring_client_get_status(daemon->reader, &status);
	return status.state;
}

int64_t daemon_await_state(struct daemon *daemon, enum dio_capture_state state, int64_t limit_ns)
{
	const int64_t start = monotonic_ns();
	int64_t now = start;

	/* The clock is read first: a test that was held up itself has one more look. */
	while (state_now(daemon) != state) {
		if (now > start + limit_ns)
			fail_msg("'%s' after %d ms, '%s' was expected",
				 dio_capture_state_name(state_now(daemon)),
				 (int)((now - start) / 1000000), dio_capture_state_name(state));
		now = monotonic_ns();
		dio_ring_client_acquire(daemon->reader, &daemon->frame, SECOND_NS / 10,
					&daemon->error);
	}
	return monotonic_ns() - start;
}

void daemon_await_frame(struct daemon *daemon)
{
	const int64_t limit = monotonic_ns() + 5 * SECOND_NS;

	while (dio_ring_client_acquire(daemon->reader, &daemon->frame, SECOND_NS / 10,
				       &daemon->error) != DIO_OK)
		if (monotonic_ns() > limit)
			fail_msg("no frame: %s", daemon->error.text);
}

void daemon_need_bus(struct daemon *daemon)
{
	const int64_t limit = monotonic_ns() + 10 * SECOND_NS;
	sd_bus_message *reply = NULL;

	if (!daemon->bus) {
		print_message("skipped: dbus-daemon is not installed\n");
		skip();
	}
	while (dio_bus_get_properties(daemon->bus, &DIO_BUS_CAPTURE, &reply, &daemon->error) !=
	       DIO_OK) {
		if (monotonic_ns() > limit)
			fail_msg("%s", daemon->error.text);
		nap();
	}
	sd_bus_message_unref(reply);
}

char *daemon_get_text(struct daemon *daemon, const char *property)
{
	char *text = NULL;

	assert_true(sd_bus_get_property_string(dio_bus_get_connection(daemon->bus),
					       DIO_BUS_CAPTURE.name, DIO_BUS_CAPTURE.path,
					       DIO_BUS_CAPTURE.name, property, NULL, &text) >= 0);
	return text;
}

uint64_t daemon_get_number(struct daemon *daemon, const char *property)
{
	uint64_t number = 0;

	assert_true(sd_bus_get_property_trivial(dio_bus_get_connection(daemon->bus),
						DIO_BUS_CAPTURE.name, DIO_BUS_CAPTURE.path,
						DIO_BUS_CAPTURE.name, property, NULL, 't',
						&number) >= 0);
	return number;
}

void daemon_await_text(struct daemon *daemon, const char *property, const char *value)
{
	const int64_t limit = monotonic_ns() + 5 * SECOND_NS;

	for (;;) {
		char *text = daemon_get_text(daemon, property);
		bool same = strcmp(text, value) == 0;

		if (!same && monotonic_ns() > limit)
			fail_msg("%s is '%s', '%s' was expected", property, text, value);
		free(text);
		if (same)
			return;
		nap();
	}
}

void daemon_await_number(struct daemon *daemon, const char *property, uint64_t least)
{
	const int64_t limit = monotonic_ns() + 5 * SECOND_NS;
	uint64_t number;

	while ((number = daemon_get_number(daemon, property)) < least) {
		if (monotonic_ns() > limit)
			fail_msg("%s is %llu, %llu was expected", property,
				 (unsigned long long)number, (unsigned long long)least);
		nap();
	}
}

bool daemon_next_notice(struct daemon *daemon, char *text, size_t size, int timeout_ms)
{
	struct pollfd fd = {.fd = daemon->notify, .events = POLLIN};
	ssize_t n;

	if (poll(&fd, 1, timeout_ms) <= 0)
		return false;
	n = recv(daemon->notify, text, size - 1, 0);
	assert_true(n >= 0);
	text[n] = '\0';
	return true;
}

unsigned daemon_count(const struct daemon *daemon, const char *name)
{
	char path[64];
	unsigned n = 0;
	DIR *folder;

	snprintf(path, sizeof(path), "/proc/%d/%s", (int)daemon->pid, name);
	folder = opendir(path);
	assert_non_null(folder);
	while (readdir(folder))
		n++;
	closedir(folder);
	return n;
}

void daemon_await_count(const struct daemon *daemon, const char *name, unsigned count)
{
	const int64_t limit = monotonic_ns() + 5 * SECOND_NS;

	while (daemon_count(daemon, name) != count) {
		if (monotonic_ns() > limit)
			fail_msg("%u of %s, %u were expected", daemon_count(daemon, name), name,
				 count);
		nap();
	}
}
