/* diorama calibrate: intrinsics of a camera from pictures of a board. */
#include <stdio.h>
#include <stdlib.h>

#include "capture/calibrating.h"
#include "commands.h"
#include "core/json_out.h"
#include "core/log.h"
#include "core/options.h"
#include "dio/atomic_file.h"

struct request {
	const char *input, *board, *out, *ros;
	bool json;
	struct dio_calibrating_options options;
};

/* A file that cannot be written is better known before the camera is looked at than after. */
static enum dio_status probe(const char *path, struct dio_error *error)
{
	struct dio_atomic_file *file;
	enum dio_status status = path ? dio_atomic_file_open(path, &file, error) : DIO_OK;

	if (path && status == DIO_OK)
		dio_atomic_file_discard(file);
	return status;
}

static enum dio_status write_files(const struct request *request,
				   const struct dio_calibration *calibration,
				   struct dio_error *error)
{
	enum dio_status status = dio_camera_model_write(request->out, DIO_CAMERA_FILE_OPENCV,
							&calibration->model, calibration, error);

	if (status == DIO_OK && request->ros)
		status = dio_camera_model_write(request->ros, DIO_CAMERA_FILE_ROS,
						&calibration->model, calibration, error);
	if (status == DIO_OK && !request->json) {
		printf("wrote %s\n", request->out);
		if (request->ros)
			printf("wrote %s\n", request->ros);
	}
	return status;
}

static enum dio_status report(const struct request *request, const struct dio_calibrating *result,
			      const char *refused, struct dio_error *error)
{
	if (request->json)
		return dio_json_print(dio_calibrating_json(result, refused), error);
	dio_calibrating_print(result, refused != NULL);
	return DIO_OK;
}

static enum dio_status calibrate(const struct request *request, struct dio_error *error)
{
	struct dio_calibrating result = {0};
	struct dio_error why = {""};
	struct dio_board board;
	enum dio_status status = dio_board_parse(request->board, &board, error);

	if (status == DIO_OK)
		status = probe(request->out, error);
	if (status == DIO_OK)
		status = probe(request->ros, error);
	if (status != DIO_OK)
		return status;
	status = dio_calibrating_run(request->input, &board, &request->options, &result, error);
	if (status == DIO_REFUSED && result.views.frames > 0)
		/* What was seen helps to do better; the reason is the error's to say. */
		(void)report(request, &result, error->text, &why);
	if (status == DIO_OK)
		status = report(request, &result, NULL, error);
	if (status == DIO_OK)
		status = write_files(request, &result.calibration, error);
	dio_calibrating_deinit(&result);
	return status;
}

int dio_command_calibrate(int argc, char **argv)
{
	struct request request = {0};
	struct dio_calibrating_options *options = &request.options;
	const struct dio_option table[] = {
		{.name = "board",
		 .kind = DIO_OPTION_TEXT,
		 .value = "SPEC",
		 .help = "the board, see below",
		 .target = &request.board,
		 .required = true},
		{.name = "out",
		 .kind = DIO_OPTION_TEXT,
		 .value = "FILE",
		 .help = "camera file to write, OpenCV YAML",
		 .target = &request.out,
		 .required = true},
		{.name = "ros",
		 .kind = DIO_OPTION_TEXT,
		 .value = "FILE",
		 .help = "write ROS camera_info YAML too",
		 .target = &request.ros},
		{.name = "frames",
		 .kind = DIO_OPTION_COUNT,
		 .value = "N",
		 .help = "views wanted of a camera or recording, default 30",
		 .target = &options->gather.views,
		 .min = 3,
		 .max = 1000},
		{.name = "seconds",
		 .kind = DIO_OPTION_REAL,
		 .value = "S",
		 .help = "longest look at a camera, default 120",
		 .target = &options->gather.seconds,
		 .min = 1,
		 .max = 3600},
		{.name = "width",
		 .kind = DIO_OPTION_COUNT,
		 .value = "N",
		 .help = "picture size asked of a camera",
		 .target = &options->camera.width,
		 .min = 16,
		 .max = 16384},
		{.name = "height",
		 .kind = DIO_OPTION_COUNT,
		 .value = "N",
		 .help = "the same, rows",
		 .target = &options->camera.height,
		 .min = 16,
		 .max = 16384},
		{.name = "fps",
		 .kind = DIO_OPTION_REAL,
		 .value = "R",
		 .help = "pictures a second asked of a camera",
		 .target = &options->camera.frames_per_second,
		 .min = 0.1,
		 .max = 1000},
		{.name = "fix-k3",
		 .kind = DIO_OPTION_FLAG,
		 .help = "leave k3 at 0, for few views",
		 .target = &options->fit.fix_k3},
		{.name = "json",
		 .kind = DIO_OPTION_FLAG,
		 .help = "results as JSON",
		 .target = &request.json},
	};
	const struct dio_usage usage = {
		.command = "calibrate",
		.summary = "find a camera's intrinsics from pictures of a board",
		.arguments = "INPUT",
		.details = "INPUT is a folder of pictures, a recording, or a camera "
			   "(v4l2:/dev/video0,\n"
			   "sim:table?seed=7). SPEC is "
			   "charuco:COLSxROWS:SQUARE_M:MARKER_M:DICTIONARY[:legacy]\n"
			   "or chessboard:COLSxROWS:SQUARE_M (inner corners). Show the board close "
			   "and\n"
			   "far, tilted, and in all corners of the picture; the simulated camera "
			   "does so by\n"
			   "itself.",
		.min_arguments = 1,
		.max_arguments = 1,
		.options = table,
		.option_count = sizeof table / sizeof *table,
	};
	struct dio_error error = {""};
	char **arguments;
	uint32_t count;
	enum dio_options_result parsed;

	dio_calibrating_defaults(options);
	parsed = dio_options_parse(&usage, argc, argv, &arguments, &count);
	if (parsed != DIO_OPTIONS_RUN)
		return dio_options_exit_code(parsed);
	request.input = arguments[0];
	if (calibrate(&request, &error) != DIO_OK) {
		dio_log_error("%s", error.text);
		return DIO_EXIT_FAILED;
	}
	return DIO_EXIT_OK;
}
