/* diorama poses: poses from a board in view; scene.json and the engine's pictures. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "capture/posing.h"
#include "commands.h"
#include "core/json_out.h"
#include "core/log.h"
#include "core/options.h"
#include "core/path.h"
#include "dio/calibration.h"

struct request {
	const char *input, *camera, *board, *out, *name;
	bool json;
	struct dio_posing_options options;
};

static enum dio_status report(const struct request *request, const struct dio_posing *result,
			      struct dio_error *error)
{
	if (request->json)
		return dio_json_print(dio_posing_json(result), error);
	dio_posing_print(result);
	printf("wrote %s\n", request->out);
	return DIO_OK;
}

/* A scene is called after its input where no name is given. */
static const char *scene_name(const struct request *request)
{
	const char *name = request->name ? request->name : dio_path_name(request->input);

	return *name ? name : "scene";
}

/* A place that cannot be written is better known before the pictures are looked at than after. */
static enum dio_status make_folder_of(const char *path, struct dio_error *error)
{
	char *folder = dio_path_folder(path);
	enum dio_status status = folder ? dio_folder_make(folder, error)
					: dio_fail(error, DIO_NO_MEM, "%s: no memory", path);

	free(folder);
	return status;
}

static enum dio_status pose(const struct request *request, struct dio_error *error)
{
	struct dio_posing result = {0};
	struct dio_camera_model model;
	struct dio_board board;
	enum dio_status status = dio_board_parse(request->board, &board, error);

	if (status == DIO_OK)
		status = dio_camera_model_read(request->camera, &model, error);
	if (status == DIO_OK)
		status = make_folder_of(request->out, error);
	if (status != DIO_OK)
		return status;
	status = dio_posing_run(request->input, &model, &board, &request->options, &result, error);
	if (status == DIO_REFUSED && result.count > 0 && !request->json)
		dio_posing_print(&result);
	if (status == DIO_OK)
		status = dio_posing_write(&result, scene_name(request), request->out, error);
	if (status == DIO_OK)
		status = report(request, &result, error);
	dio_posing_deinit(&result);
	return status;
}

int dio_command_poses(int argc, char **argv)
{
	struct request request = {0};
	struct dio_posing_options *options = &request.options;
	const struct dio_option table[] = {
		{.name = "camera",
		 .kind = DIO_OPTION_TEXT,
		 .value = "FILE",
		 .help = "camera file of diorama calibrate, or ROS camera_info",
		 .target = &request.camera,
		 .required = true},
		{.name = "board",
		 .kind = DIO_OPTION_TEXT,
		 .value = "SPEC",
		 .help = "the board, see diorama calibrate --help",
		 .target = &request.board,
		 .required = true},
		{.name = "out",
		 .kind = DIO_OPTION_TEXT,
		 .value = "FILE",
		 .help = "scene.json to write; pictures go to images/ beside it",
		 .target = &request.out,
		 .required = true},
		{.name = "hold-out",
		 .kind = DIO_OPTION_COUNT,
		 .value = "N",
		 .help = "every N-th posed picture is a target, not a context view;\n"
			 "default 8, or every third when there are few",
		 .target = &options->hold_out,
		 .min = 2,
		 .max = 100000},
		{.name = "no-targets",
		 .kind = DIO_OPTION_FLAG,
		 .help = "every posed picture is a context view",
		 .target = &options->hold_out_none},
		{.name = "context",
		 .kind = DIO_OPTION_COUNT,
		 .value = "N",
		 .help = "most context views, spread as far apart as can be; default all",
		 .target = &options->context,
		 .min = 1,
		 .max = 65536},
		{.name = "width",
		 .kind = DIO_OPTION_COUNT,
		 .value = "N",
		 .help = "width of the scene's pictures; default 256 on the long side",
		 .target = &options->width,
		 .min = 8,
		 .max = 16384},
		{.name = "height",
		 .kind = DIO_OPTION_COUNT,
		 .value = "N",
		 .help = "height of the scene's pictures",
		 .target = &options->height,
		 .min = 8,
		 .max = 16384},
		{.name = "frames",
		 .kind = DIO_OPTION_COUNT,
		 .value = "N",
		 .help = "most pictures taken of a camera or recording, default 60",
		 .target = &options->frames,
		 .min = 1,
		 .max = 65536},
		{.name = "seconds",
		 .kind = DIO_OPTION_REAL,
		 .value = "S",
		 .help = "longest look at a camera, default 60",
		 .target = &options->seconds,
		 .min = 1,
		 .max = 3600},
		{.name = "name",
		 .kind = DIO_OPTION_TEXT,
		 .value = "TEXT",
		 .help = "the scene's name; default after INPUT",
		 .target = &request.name},
		{.name = "json",
		 .kind = DIO_OPTION_FLAG,
		 .help = "results as JSON",
		 .target = &request.json},
	};
	const struct dio_usage usage = {
		.command = "poses",
		.summary = "pose pictures from a board in view; write scene.json",
		.arguments = "INPUT",
		.details =
			"INPUT is a folder of pictures, a recording, or a camera. The scene's\n"
			"pictures are undistorted to a pinhole camera. Pictures without a board\n"
			"are listed, not guessed.",
		.min_arguments = 1,
		.max_arguments = 1,
		.options = table,
		.option_count = sizeof table / sizeof *table,
	};
	struct dio_error error = {""};
	char **arguments;
	uint32_t count;
	enum dio_options_result parsed;

	dio_posing_defaults(options);
	parsed = dio_options_parse(&usage, argc, argv, &arguments, &count);
	if (parsed != DIO_OPTIONS_RUN)
		return dio_options_exit_code(parsed);
	request.input = arguments[0];
	if (pose(&request, &error) != DIO_OK) {
		dio_log_error("%s", error.text);
		return DIO_EXIT_FAILED;
	}
	return DIO_EXIT_OK;
}
