/* app/bus on a private D-Bus daemon: publish, change, call, refuse. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>
#include <errno.h>
#include <poll.h>
#include <stdlib.h>
#include <string.h>
#include <sys/wait.h>
#include <unistd.h>

#include "bus/bus.h"
#include "support/private_bus.h"

#define ACTION    "org.diorama.view.control"
#define NOBODY    65534u
#define WAIT_MS   20000
#define ANSWER_MS 10000u

static struct support_private_bus private_bus;

/* A small daemon. */
struct daemon {
	struct dio_bus *bus;
	uint32_t views;
	bool asks; /* Count is for the permitted only */
};

static int on_count(sd_bus_message *message, void *context, sd_bus_error *error)
{
	struct daemon *daemon = context;

	if (daemon->asks) {
		int granted =
			dio_bus_authorise(daemon->bus, message, ACTION, on_count, context, error);

		if (granted <= 0)
			return granted < 0 ? granted : 1;
	}
	daemon->views++;
	dio_bus_mark_changed(daemon->bus, "Views");
	dio_bus_mark_changed(daemon->bus, "Views");
	dio_bus_flush_changes(daemon->bus);
	return sd_bus_reply_method_return(message, "u", daemon->views);
}

static int on_fail(sd_bus_message *message, void *context, sd_bus_error *error)
{
	struct dio_error why = {"the disk is full: free some space"};

	(void)message;
	(void)context;
	return dio_bus_set_error(error, DIO_NO_SPACE, &why);
}

static const sd_bus_vtable VTABLE[] = {
	SD_BUS_VTABLE_START(0),
	SD_BUS_METHOD("Count", "", "u", on_count, SD_BUS_VTABLE_UNPRIVILEGED),
	SD_BUS_METHOD("Fail", "s", "", on_fail, SD_BUS_VTABLE_UNPRIVILEGED),
	SD_BUS_PROPERTY("Views", "u", NULL, offsetof(struct daemon, views),
			SD_BUS_VTABLE_PROPERTY_EMITS_CHANGE),
	SD_BUS_VTABLE_END,
};

/* An authority that answers as the test wants. */
static int on_check(sd_bus_message *message, void *context, sd_bus_error *error)
{
	(void)error;
	return sd_bus_reply_method_return(message, "(bba{ss})", *(int *)context, 0, 0);
}

static const sd_bus_vtable POLKIT_VTABLE[] = {
	SD_BUS_VTABLE_START(0),
	SD_BUS_METHOD("CheckAuthorization", "(sa{sv})sa{ss}us", "(bba{ss})", on_check,
		      SD_BUS_VTABLE_UNPRIVILEGED),
	SD_BUS_VTABLE_END,
};

static void start_daemon(struct daemon *daemon, const char *address)
{
	struct dio_error error = {0};

	assert_int_equal(dio_bus_open(address, &daemon->bus, &error), DIO_OK);
	if (dio_bus_publish(daemon->bus, &DIO_BUS_VIEW, VTABLE, daemon, &error) != DIO_OK)
		fail_msg("%s", error.text);
}

/* Serve up to two connections until the child is over; its exit code. */
static int serve(pid_t child, struct dio_bus *const buses[2])
{
	for (int turn = 0; turn < WAIT_MS / 10; turn++) {
		struct pollfd fds[2];
		int status, timeout[2] = {-1, -1};

		for (int i = 0; i < 2; i++) {
			struct dio_error error = {0};

			fds[i].fd = -1;
			if (!buses[i])
				continue;
			assert_int_equal(dio_bus_process(buses[i], &error), DIO_OK);
			dio_bus_prepare(buses[i], &fds[i], &timeout[i]);
		}
		if (waitpid(child, &status, WNOHANG) == child)
			return WIFEXITED(status) ? WEXITSTATUS(status) : -1;
		if (timeout[0] != 0 && timeout[1] != 0)
			poll(fds, 2, 10);
	}
	fail_msg("the client did not end");
	return -1;
}

/* The exit code of a caller of Count, run as `user`: the status that it got. */
static pid_t call_count_as(uid_t user)
{
	pid_t child = fork();

	assert_true(child >= 0);
	if (child == 0) {
		struct dio_error error = {0};
		struct dio_bus *bus = NULL;
		enum dio_status status;

		if (setresuid(user, user, user) != 0)
			_exit(99);
		status = dio_bus_open("system", &bus, &error);
		if (status == DIO_OK)
			status = dio_bus_call(bus, &DIO_BUS_VIEW, "Count", ANSWER_MS, NULL, &error,
					      "");
		_exit((int)status);
	}
	return child;
}

static void no_daemon_is_said_plainly(void **state)
{
	struct dio_error error = {0};
	struct dio_bus *bus;

	(void)state;
	assert_int_equal(dio_bus_open(NULL, &bus, &error), DIO_OK);
	assert_int_equal(dio_bus_call(bus, &DIO_BUS_CAPTURE, "Lock", ANSWER_MS, NULL, &error, ""),
			 DIO_NOT_FOUND);
	assert_non_null(strstr(error.text, "diorama-captured is not running"));
	assert_non_null(strstr(error.text, "systemctl start diorama-captured"));
	dio_bus_close(bus);
}

static void no_bus_is_said_plainly(void **state)
{
	struct dio_error error = {0};
	struct dio_bus *bus;

	(void)state;
	assert_int_equal(dio_bus_open("unix:path=/nowhere/socket", &bus, &error), DIO_NOT_FOUND);
	assert_non_null(strstr(error.text, "/nowhere/socket"));
	assert_int_equal(dio_bus_open("nonsense", &bus, &error), DIO_NOT_FOUND);
	assert_non_null(strstr(error.text, "nonsense"));
}

static void second_daemon_is_refused(void **state)
{
	struct dio_error error = {0};
	struct daemon first = {0}, second = {0};

	(void)state;
	start_daemon(&first, NULL);
	assert_int_equal(dio_bus_open(NULL, &second.bus, &error), DIO_OK);
	assert_int_equal(dio_bus_publish(second.bus, &DIO_BUS_VIEW, VTABLE, &second, &error),
			 DIO_BUSY);
	assert_non_null(strstr(error.text, "another diorama-viewd"));
	dio_bus_close(second.bus);
	dio_bus_close(first.bus);
}

static int on_changed(sd_bus_message *message, void *context, sd_bus_error *error)
{
	(void)message;
	(void)error;
	++*(int *)context;
	return 0;
}

/* In a child: call, read the property, count the signals. */
static int use_daemon(void)
{
	struct dio_error error = {0};
	struct dio_bus *bus;
	sd_bus_message *reply = NULL;
	uint32_t count = 0;
	int signals = 0;

	if (dio_bus_open(NULL, &bus, &error) != DIO_OK ||
	    sd_bus_match_signal(dio_bus_get_connection(bus), NULL, DIO_BUS_VIEW.name,
				DIO_BUS_VIEW.path, "org.freedesktop.DBus.Properties",
				"PropertiesChanged", on_changed, &signals) < 0)
		return 1;
	if (dio_bus_call(bus, &DIO_BUS_VIEW, "Count", ANSWER_MS, &reply, &error, "") != DIO_OK ||
	    sd_bus_message_read(reply, "u", &count) < 0 || count != 1)
		return 2;
	sd_bus_message_unref(reply);
	if (dio_bus_call(bus, &DIO_BUS_VIEW, "Fail", ANSWER_MS, NULL, &error, "s", "x") !=
		    DIO_NO_SPACE ||
	    strcmp(error.text, "diorama-viewd: the disk is full: free some space") != 0)
		return 3;
	if (dio_bus_get_properties(bus, &DIO_BUS_VIEW, &reply, &error) != DIO_OK)
		return 4;
	sd_bus_message_unref(reply);
	if (dio_bus_process(bus, &error) != DIO_OK || signals != 1)
		return 5;
	dio_bus_close(bus);
	return 0;
}

static void calls_properties_signals_and_errors_arrive(void **state)
{
	struct daemon daemon = {0};
	pid_t child;

	(void)state;
	start_daemon(&daemon, NULL);
	child = fork();
	assert_true(child >= 0);
	if (child == 0)
		_exit(use_daemon());
	assert_int_equal(serve(child, (struct dio_bus *const[2]){daemon.bus, NULL}), 0);
	assert_int_equal(daemon.views, 1);
	dio_bus_close(daemon.bus);
}

static void strangers_are_let_in_by_polkit_alone(void **state)
{
	struct daemon daemon = {.asks = true};
	struct dio_error error = {0};
	struct dio_bus *polkit;
	int allowed = 0;

	(void)state;
	if (getuid() != 0) {
		printf("skipped: a second user is needed, so root\n");
		skip();
	}
	start_daemon(&daemon, "system");
	/* No authority: nobody but root. */
	assert_int_equal(serve(call_count_as(NOBODY), (struct dio_bus *const[2]){daemon.bus, NULL}),
			 DIO_REFUSED);
	assert_int_equal(serve(call_count_as(0), (struct dio_bus *const[2]){daemon.bus, NULL}),
			 DIO_OK);
	assert_int_equal(dio_bus_open("system", &polkit, &error), DIO_OK);
	assert_true(sd_bus_add_object_vtable(dio_bus_get_connection(polkit), NULL,
					     "/org/freedesktop/PolicyKit1/Authority",
					     "org.freedesktop.PolicyKit1.Authority", POLKIT_VTABLE,
					     &allowed) >= 0);
	assert_true(sd_bus_request_name(dio_bus_get_connection(polkit),
					"org.freedesktop.PolicyKit1", 0) >= 0);
	assert_int_equal(
		serve(call_count_as(NOBODY), (struct dio_bus *const[2]){daemon.bus, polkit}),
		DIO_REFUSED);
	assert_int_equal(daemon.views, 1);
	allowed = 1;
	assert_int_equal(
		serve(call_count_as(NOBODY), (struct dio_bus *const[2]){daemon.bus, polkit}),
		DIO_OK);
	assert_int_equal(daemon.views, 2);
	dio_bus_close(polkit);
	dio_bus_close(daemon.bus);
}

static void bus_that_goes_away_is_an_answer(void **state)
{
	struct support_private_bus own;
	struct daemon daemon = {0};
	struct dio_error error = {0};
	enum dio_status status = DIO_OK;

	(void)state;
	assert_true(support_private_bus_start(&own));
	start_daemon(&daemon, own.address);
	support_private_bus_stop(&own);
	for (int turn = 0; status == DIO_OK && turn < WAIT_MS / 10; turn++) {
		struct pollfd fd;
		int timeout;

		dio_bus_prepare(daemon.bus, &fd, &timeout);
		poll(&fd, 1, 10);
		status = dio_bus_process(daemon.bus, &error);
	}
	assert_int_equal(status, DIO_GONE);
	dio_bus_close(daemon.bus);
}

int main(void)
{
	const struct CMUnitTest tests[] = {
		cmocka_unit_test(no_daemon_is_said_plainly),
		cmocka_unit_test(no_bus_is_said_plainly),
		cmocka_unit_test(second_daemon_is_refused),
		cmocka_unit_test(calls_properties_signals_and_errors_arrive),
		cmocka_unit_test(strangers_are_let_in_by_polkit_alone),
		cmocka_unit_test(bus_that_goes_away_is_an_answer),
	};
	int failed;

	if (!support_private_bus_start(&private_bus))
		return 77;
	failed = cmocka_run_group_tests(tests, NULL, NULL);
	support_private_bus_stop(&private_bus);
	return failed;
}
