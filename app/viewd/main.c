/* diorama-viewd: the display daemon. */
#include <signal.h>
#include <string.h>
#include <systemd/sd-daemon.h>

#include "core/log.h"
#include "viewd/settings.h"
#include "viewd/viewd.h"

/* Signals end the loop, and systemd's watchdog is fed by its turns. */
static enum dio_status prepare(sd_event *loop, struct dio_error *error)
{
	int result = sd_event_add_signal(loop, NULL, SIGTERM, NULL, NULL);

	if (result >= 0)
		result = sd_event_add_signal(loop, NULL, SIGINT, NULL, NULL);
	if (result >= 0)
		result = sd_event_set_watchdog(loop, 1);
	if (result < 0)
		return dio_fail(error, DIO_IO, "event loop: %s", strerror(-result));
	return DIO_OK;
}

static enum dio_status run(const struct dio_viewd_options *options, sd_event *loop,
			   struct dio_error *error)
{
	static struct dio_viewd viewd;
	enum dio_status status = prepare(loop, error);

	if (status == DIO_OK)
		status = dio_viewd_open(options, loop, &viewd, error);
	if (status == DIO_OK) {
		sd_notify(0, "READY=1");
		if (sd_event_loop(loop) < 0)
			status = dio_fail(error, DIO_IO, "the event loop broke");
		sd_notify(0, "STOPPING=1");
		if (viewd.power_off)
			dio_viewd_power_off(&viewd);
	}
	dio_viewd_close(&viewd);
	return status;
}

int main(int argc, char **argv)
{
	static struct dio_viewd_settings settings;
	struct dio_viewd_options options;
	struct dio_error error = {""};
	sd_event *loop = NULL;
	enum dio_status status;
	sigset_t handled;
	int result;

	dio_log_set_program("diorama-viewd");
	result = dio_viewd_settings_read(&settings, argc, argv);
	if (result != DIO_VIEWD_RUN)
		return result;
	/* Blocked before any thread is made: the loop alone takes them. */
	sigemptyset(&handled);
	sigaddset(&handled, SIGTERM);
	sigaddset(&handled, SIGINT);
	sigprocmask(SIG_BLOCK, &handled, NULL);
	signal(SIGPIPE, SIG_IGN);
	options = (struct dio_viewd_options){.profile = &settings.profile, .bus = settings.bus};
	status = sd_event_default(&loop) >= 0 ? run(&options, loop, &error)
					      : dio_fail(&error, DIO_IO, "no event loop");
	sd_event_unref(loop);
	if (status == DIO_OK)
		return 0;
	dio_log_error("%s", error.text);
	return 1;
}
