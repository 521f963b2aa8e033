#include "profile/check.h"

#include <arpa/inet.h>
#include <errno.h>
#include <stdio.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/sysmacros.h>
#include <unistd.h>

#include "dio/board.h"
#include "dio/camera.h"

#define V4L2_MAJOR 81

struct checker {
	const struct dio_profile *profile;
	struct dio_profile_report *report;
	bool look;
};

static void blame(const struct checker *checker, const char *section, const char *key,
		  const char *text)
{
	uint32_t line = dio_profile_report_line(checker->report, section, key);

	/* A default that does not fit here has no line of its own. */
	if (!line)
		line = dio_profile_report_line(checker->report, section, NULL);
	dio_profile_report_fault(checker->report, line, "%s: %s", key, text);
}

static enum dio_status look_for_v4l2(const char *path, struct dio_error *error)
{
	struct stat st;

	if (stat(path, &st) != 0)
		return dio_fail(error, dio_status_from_errno(errno),
				"camera %s: %s; v4l2-ctl --list-devices lists what is there", path,
				strerror(errno));
	if (!S_ISCHR(st.st_mode) || major(st.st_rdev) != V4L2_MAJOR)
		return dio_fail(error, DIO_BAD_FILE, "camera %s: not a video device", path);
	if (access(path, R_OK | W_OK) != 0)
		return dio_fail(error, DIO_IO,
				"camera %s: %s; add the user to group video or run as root", path,
				strerror(errno));
	return DIO_OK;
}

/* A device is only looked at: opening it would take it from who uses it. */
static enum dio_status check_source(const char *source, bool look, struct dio_error *error)
{
	struct dio_camera *camera = NULL;
	enum dio_status status;

	if (strncmp(source, "v4l2:", 5) == 0)
		return look ? look_for_v4l2(source + 5, error) : DIO_OK;
	if (strncmp(source, "/dev/", 5) == 0)
		return look ? look_for_v4l2(source, error) : DIO_OK;
	if (!look && strncmp(source, "sim:", 4) != 0)
		return DIO_OK;
	status = dio_camera_open(source, NULL, &camera, error);
	dio_camera_close(camera);
	/* In use is there. */
	return status == DIO_BUSY ? DIO_OK : status;
}

static void check_camera(const struct checker *checker)
{
	const struct dio_profile_camera *camera = &checker->profile->camera;
	struct dio_error error = {""};

	if (check_source(camera->source, checker->look, &error) != DIO_OK)
		blame(checker, "camera", "source", error.text);
	if ((camera->width == 0) != (camera->height == 0))
		blame(checker, "camera", camera->width ? "width" : "height",
		      "give both width and height, or neither");
}

static void check_capture(const struct checker *checker)
{
	struct dio_error error = {""};
	struct dio_board board;

	if (checker->profile->capture.board[0] &&
	    dio_board_parse(checker->profile->capture.board, &board, &error) != DIO_OK)
		blame(checker, "capture", "board", error.text);
}

static void check_display(const struct checker *checker)
{
	const struct dio_display_options options = dio_profile_get_display(checker->profile);
	const struct dio_display_options plain = {0};
	struct dio_display_options mode = {.mode = options.mode};
	const char *output = checker->profile->display.output;
	struct dio_error error = {""};

	if (dio_display_check(output, &plain, checker->look, &error) != DIO_OK) {
		blame(checker, "display", "output", error.text);
		return;
	}
	if (dio_display_check(output, &mode, false, &error) != DIO_OK)
		blame(checker, "display", "mode", error.text);
	mode = (struct dio_display_options){.connector = options.connector};
	if (dio_display_check(output, &mode, checker->look, &error) != DIO_OK)
		blame(checker, "display", "connector", error.text);
}

static void check_line(const struct checker *checker, const char *kind, const char *name,
		       const struct dio_gpio_line *line)
{
	struct dio_error error = {""};
	char section[80];

	if (!checker->look || (!line->chip[0] && !line->name[0]) ||
	    dio_gpio_line_check(line, &error) == DIO_OK)
		return;
	snprintf(section, sizeof(section), "%s %s", kind, name);
	blame(checker, section, "line", error.text);
}

static void check_file(const struct checker *checker, const char *section, const char *key,
		       const char *path)
{
	struct dio_error error = {""};

	if (!checker->look || path[0] != '/' || access(path, R_OK) == 0)
		return;
	dio_fail(&error, DIO_NOT_FOUND, "%s: %s", path, strerror(errno));
	blame(checker, section, key, error.text);
}

static void check_web(const struct checker *checker)
{
	const char *address = checker->profile->web.address;
	struct in6_addr parsed;

	if (inet_pton(AF_INET, address, &parsed) != 1 && inet_pton(AF_INET6, address, &parsed) != 1)
		blame(checker, "web", "address",
		      "not an IP address; say 127.0.0.1, or 0.0.0.0 to be reached from outside");
}

void dio_profile_check(const struct dio_profile *profile, bool look,
		       struct dio_profile_report *report)
{
	const struct checker checker = {.profile = profile, .report = report, .look = look};

	check_camera(&checker);
	check_capture(&checker);
	check_display(&checker);
	for (uint32_t i = 0; i < profile->button_count; i++)
		check_line(&checker, "button", profile->buttons[i].name, &profile->buttons[i].line);
	for (uint32_t i = 0; i < profile->led_count; i++)
		check_line(&checker, "led", profile->leds[i].name, &profile->leds[i].line);
	check_file(&checker, "engine", "model", profile->engine.model);
	check_file(&checker, "buttons", "keyboard", profile->keyboard);
	check_web(&checker);
	dio_profile_report_sort(report);
}
