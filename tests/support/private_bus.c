#include "support/private_bus.h"

#include <poll.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/prctl.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#define START_TIMEOUT_MS 10000

static const char CONFIG[] =
	"<!DOCTYPE busconfig PUBLIC \"-//freedesktop//DTD D-Bus Bus Configuration 1.0//EN\"\n"
	" \"http://www.freedesktop.org/standards/dbus/1.0/busconfig.dtd\">\n"
	"<busconfig>\n<listen>unix:path=%s/socket</listen>\n<auth>EXTERNAL</auth>\n"
	"<policy context=\"default\"><allow user=\"*\"/><allow own=\"*\"/>"
	"<allow send_destination=\"*\" eavesdrop=\"true\"/><allow "
	"eavesdrop=\"true\"/></policy>\n</busconfig>\n";

static bool write_config(const char *folder, char *path, size_t size)
{
	FILE *file;

	snprintf(path, size, "%s/bus.conf", folder);
	file = fopen(path, "w");
	if (!file)
		return false;
	fprintf(file, CONFIG, folder);
	return fclose(file) == 0;
}

/* The daemon prints its address once it listens. */
static bool wait_for_address(int fd)
{
	struct pollfd ready = {.fd = fd, .events = POLLIN};
	char address[256];

	return poll(&ready, 1, START_TIMEOUT_MS) == 1 && read(fd, address, sizeof address) > 0;
}

static pid_t run_daemon(const char *config, int out)
{
	char option[320], print[32];
	pid_t child = fork();

	if (child != 0)
		return child;
	prctl(PR_SET_PDEATHSIG, SIGKILL);
	snprintf(option, sizeof option, "--config-file=%s", config);
	snprintf(print, sizeof print, "--print-address=%d", out);
	execlp("dbus-daemon", "dbus-daemon", "--nofork", "--nopidfile", option, print,
	       (char *)NULL);
	_exit(127);
}

bool support_private_bus_start(struct support_private_bus *bus)
{
	const char *base = getenv("TMPDIR");
	char config[300];
	bool started = false;
	int ends[2];

	*bus = (struct support_private_bus){.daemon = -1};
	snprintf(bus->folder, sizeof bus->folder, "%s/diorama-bus-XXXXXX", base ? base : "/tmp");
	if (!mkdtemp(bus->folder))
		return false;
	/* Other users come in too: tests of permissions are such. */
	if (chmod(bus->folder, 0755) == 0 && write_config(bus->folder, config, sizeof config) &&
	    pipe(ends) == 0) {
		bus->daemon = run_daemon(config, ends[1]);
		close(ends[1]);
		started = bus->daemon > 0 && wait_for_address(ends[0]);
		close(ends[0]);
	}
	if (!started) {
		printf("dbus-daemon cannot be started: is it installed?\n");
		support_private_bus_stop(bus);
		return false;
	}
	snprintf(bus->address, sizeof bus->address, "unix:path=%s/socket", bus->folder);
	setenv("DIORAMA_BUS", bus->address, 1);
	setenv("DBUS_SYSTEM_BUS_ADDRESS", bus->address, 1);
	return true;
}

static void remove_file(const char *folder, const char *name)
{
	char path[300];

	snprintf(path, sizeof path, "%s/%s", folder, name);
	unlink(path);
}

void support_private_bus_stop(struct support_private_bus *bus)
{
	if (bus->daemon > 0) {
		kill(bus->daemon, SIGKILL);
		waitpid(bus->daemon, NULL, 0);
	}
	remove_file(bus->folder, "socket");
	remove_file(bus->folder, "bus.conf");
	rmdir(bus->folder);
	bus->daemon = -1;
}
