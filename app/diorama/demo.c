/* diorama demo: from camera frames to rendered viewpoints in one go. */
#include <cjson/cJSON.h>
#include <stdio.h>

#include "commands.h"
#include "core/log.h"
#include "core/options.h"
#include "demo/demo.h"
#include "engine_options.h"

static int run(struct dio_demo_options *options, bool as_json)
{
	struct dio_error error = {""};
	char *json = NULL;

	options->quiet = as_json;
	if (dio_demo_run(options, as_json ? &json : NULL, &error) != DIO_OK) {
		dio_log_error("%s", error.text);
		return DIO_EXIT_FAILED;
	}
	if (as_json)
		puts(json);
	else
		printf("wrote %s: see summary.md, sheet.png and orbit.mp4 there\n", options->out);
	cJSON_free(json);
	return DIO_EXIT_OK;
}

int dio_command_demo(int argc, char **argv)
{
	struct dio_demo_options options;
	bool json = false;
	const struct dio_option table[] = {
		{.name = "board",
		 .kind = DIO_OPTION_TEXT,
		 .value = "SPEC",
		 .help = "the board, see diorama calibrate --help;\n"
			 "default charuco:10x7:0.0285:0.0171:DICT_6X6_250",
		 .target = &options.board},
		{.name = "out",
		 .kind = DIO_OPTION_TEXT,
		 .value = "FOLDER",
		 .help = "where the results go, default demo-out",
		 .target = &options.out},
		{.name = "model",
		 .kind = DIO_OPTION_TEXT,
		 .value = "FILE",
		 .help = "weights; default the ones that come with diorama",
		 .target = &options.engine.model},
		{.name = "seed",
		 .kind = DIO_OPTION_COUNT,
		 .value = "N",
		 .help = "which simulated scene, default 6",
		 .target = &options.seed,
		 .max = 4294967295.0},
		{.name = "stands",
		 .kind = DIO_OPTION_COUNT,
		 .value = "N",
		 .help = "views of the board to calibrate from, default 30",
		 .target = &options.stands,
		 .min = 3,
		 .max = 1000},
		{.name = "frames",
		 .kind = DIO_OPTION_COUNT,
		 .value = "N",
		 .help = "pictures of the walk round the scene, default 40",
		 .target = &options.frames,
		 .min = 3,
		 .max = 10000},
		{.name = "context",
		 .kind = DIO_OPTION_COUNT,
		 .value = "N",
		 .help = "most views to reconstruct from, default 8",
		 .target = &options.context,
		 .min = 1,
		 .max = 1000},
		{.name = "orbit-frames",
		 .kind = DIO_OPTION_COUNT,
		 .value = "N",
		 .help = "pictures of the path, default 100",
		 .target = &options.orbit_frames,
		 .min = 1,
		 .max = 100000},
		{.name = "width",
		 .kind = DIO_OPTION_COUNT,
		 .value = "N",
		 .help = "width of the scene's pictures",
		 .target = &options.width,
		 .min = 8,
		 .max = 8192},
		{.name = "height",
		 .kind = DIO_OPTION_COUNT,
		 .value = "N",
		 .help = "height of the scene's pictures",
		 .target = &options.height,
		 .min = 8,
		 .max = 8192},
		{.name = "patch-recon",
		 .kind = DIO_OPTION_PATCH,
		 .value = "P",
		 .help = "stage patch of reconstruction, default auto",
		 .target = &options.engine.patch_recon},
		{.name = "patch-render",
		 .kind = DIO_OPTION_PATCH,
		 .value = "P",
		 .help = "stage patch of rendering, default auto",
		 .target = &options.engine.patch_render},
		{.name = "threads",
		 .kind = DIO_OPTION_COUNT,
		 .value = "N",
		 .help = "threads of the engine, default all",
		 .target = &options.engine.threads,
		 .min = 1,
		 .max = 256},
		DIO_OPTION_CPU(options.engine),
		DIO_OPTION_PRECISION(options.engine),
		DIO_OPTION_DEBLOCKING(options.engine),
		{.name = "json",
		 .kind = DIO_OPTION_FLAG,
		 .help = "print summary.json instead of a line a stage",
		 .target = &json},
	};
	const struct dio_usage usage = {
		.command = "demo",
		.summary = "go the whole way, from camera frames to rendered viewpoints",
		.arguments = "[INPUT]",
		.details = "INPUT is a folder of photos or a recording in which the board lies "
			   "beside or\n"
			   "under the thing; without it the simulated camera is used, and the "
			   "summary\n"
			   "compares with the truth.",
		.max_arguments = 1,
		.options = table,
		.option_count = sizeof table / sizeof *table,
	};
	char **arguments;
	uint32_t count;
	enum dio_options_result parsed;

	dio_demo_defaults(&options);
	parsed = dio_options_parse(&usage, argc, argv, &arguments, &count);
	if (parsed != DIO_OPTIONS_RUN)
		return dio_options_exit_code(parsed);
	if (count == 1)
		options.input = arguments[0];
	return run(&options, json);
}
