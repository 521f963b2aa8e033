/* diorama capture: record what a camera sees. */
#include <inttypes.h>
#include <signal.h>
#include <stdio.h>

#include "capture/recording_run.h"
#include "commands.h"
#include "core/json_out.h"
#include "core/log.h"
#include "core/options.h"

static volatile sig_atomic_t stop;

static void on_signal(int number)
{
	(void)number;
	stop = 1;
}

/* The first Ctrl-C ends the recording in good order; the second one ends the program. */
static void catch_signals(void)
{
	struct sigaction action = {.sa_handler = on_signal, .sa_flags = (int)SA_RESETHAND};

	sigemptyset(&action.sa_mask);
	sigaction(SIGINT, &action, NULL);
	sigaction(SIGTERM, &action, NULL);
}

static void print(const char *folder, const struct dio_recording_result *result)
{
	printf("camera    %s, %u x %u %s\n", result->camera.name, result->camera.width,
	       result->camera.height, dio_pixel_format_name(result->camera.format));
	printf("recorded  %" PRIu64 " frames in %.2f s\n", result->frames, result->seconds);
	printf("frames    %" PRIu64 " delivered, %" PRIu64 " passed over for newer ones, %" PRIu64
	       " lost, %" PRIu64 " broken, %u unreadable\n",
	       result->counters.delivered, result->counters.drained, result->counters.lost,
	       result->counters.broken, result->unreadable);
	printf("wrote %s\n", folder);
}

static enum dio_status print_json(const char *folder, const struct dio_recording_result *result,
				  struct dio_error *error)
{
	cJSON *root = cJSON_CreateObject();

	dio_json_add_text(root, "folder", folder);
	dio_json_add_text(root, "camera", result->camera.name);
	dio_json_add_text(root, "format", dio_pixel_format_name(result->camera.format));
	dio_json_add_number(root, "width", result->camera.width, 0);
	dio_json_add_number(root, "height", result->camera.height, 0);
	dio_json_add_number(root, "frames", (double)result->frames, 0);
	dio_json_add_number(root, "seconds", result->seconds, 3);
	dio_json_add_number(root, "delivered", (double)result->counters.delivered, 0);
	dio_json_add_number(root, "drained", (double)result->counters.drained, 0);
	dio_json_add_number(root, "lost", (double)result->counters.lost, 0);
	dio_json_add_number(root, "broken", (double)result->counters.broken, 0);
	dio_json_add_number(root, "unreadable", result->unreadable, 0);
	return dio_json_print(root, error);
}

int dio_command_capture(int argc, char **argv)
{
	struct dio_recording_options recording = {.stop = &stop};
	struct dio_recording_result result = {0};
	const char *out = NULL;
	uint32_t frames = 0;
	bool json = false;
	const struct dio_option table[] = {
		{.name = "out",
		 .kind = DIO_OPTION_TEXT,
		 .value = "FOLDER",
		 .help = "recording to make; the folder must not hold one",
		 .target = &out,
		 .required = true},
		{.name = "frames",
		 .kind = DIO_OPTION_COUNT,
		 .value = "N",
		 .help = "stop after N frames",
		 .target = &frames,
		 .min = 1,
		 .max = 10000000},
		{.name = "seconds",
		 .kind = DIO_OPTION_REAL,
		 .value = "S",
		 .help = "stop after S seconds",
		 .target = &recording.seconds,
		 .min = 0.001,
		 .max = 86400},
		{.name = "width",
		 .kind = DIO_OPTION_COUNT,
		 .value = "N",
		 .help = "picture size asked of the camera",
		 .target = &recording.camera.width,
		 .min = 16,
		 .max = 16384},
		{.name = "height",
		 .kind = DIO_OPTION_COUNT,
		 .value = "N",
		 .help = "the same, rows",
		 .target = &recording.camera.height,
		 .min = 16,
		 .max = 16384},
		{.name = "fps",
		 .kind = DIO_OPTION_REAL,
		 .value = "R",
		 .help = "pictures a second asked of the camera",
		 .target = &recording.camera.frames_per_second,
		 .min = 0.1,
		 .max = 1000},
		{.name = "json",
		 .kind = DIO_OPTION_FLAG,
		 .help = "results as JSON",
		 .target = &json},
	};
	const struct dio_usage usage = {
		.command = "capture",
		.summary = "record what a camera sees",
		.arguments = "CAMERA",
		.details =
			"CAMERA is v4l2:/dev/video0 or sim:table?seed=7. Without --frames and\n"
			"--seconds it records until Ctrl-C. What was recorded before a camera was\n"
			"unplugged is kept.",
		.min_arguments = 1,
		.max_arguments = 1,
		.options = table,
		.option_count = sizeof table / sizeof *table,
	};
	struct dio_error error = {""};
	char **arguments;
	uint32_t count;
	enum dio_options_result parsed = dio_options_parse(&usage, argc, argv, &arguments, &count);
	enum dio_status status;

	if (parsed != DIO_OPTIONS_RUN)
		return dio_options_exit_code(parsed);
	recording.frames = frames;
	catch_signals();
	status = dio_recording_run(arguments[0], out, &recording, &result, &error);
	if (status == DIO_OK && json)
		status = print_json(out, &result, &error);
	else if (result.frames > 0 && !json)
		print(out, &result);
	if (status != DIO_OK) {
		dio_log_error("%s", error.text);
		return DIO_EXIT_FAILED;
	}
	return DIO_EXIT_OK;
}
