/* diorama: from camera frames to a rendered scene, one sub-command a step. */
#include <stdio.h>
#include <string.h>

#include "commands.h"
#include "core/log.h"
#include "core/options.h"

/* In the order in which a scene comes to be. */
static const struct {
	const char *name;
	int (*run)(int argc, char **argv);
	const char *summary;
} COMMANDS[] = {
	{"board", dio_command_board, "draw a calibration board for the printer; check a profile"},
	{"capture", dio_command_capture, "record what a camera sees"},
	{"calibrate", dio_command_calibrate, "find a camera's intrinsics from pictures of a board"},
	{"poses", dio_command_poses, "pose pictures from a board in view; write scene.json"},
	{"import", dio_command_import,
	 "turn transforms.json or a COLMAP text model into scene.json"},
	{"reconstruct", dio_command_reconstruct, "turn posed pictures into a scene (a KV-cache)"},
	{"render", dio_command_render, "render viewpoints of a scene"},
	{"eval", dio_command_eval, "score rendered targets against their true pictures"},
	{"view", dio_command_view, "look at a scene in a window"},
	{"info", dio_command_info, "say what a file holds"},
	{"quantize", dio_command_quantize, "write a model in int8"},
	{"bench", dio_command_bench, "measure time, memory and error on this machine"},
	{"ctl", dio_command_ctl, "speak to the daemons of a box"},
	{"demo", dio_command_demo, "go the whole way, from camera frames to rendered viewpoints"},
};

static void print_help(void)
{
	puts("diorama: posed pictures in, any viewpoint out\n\n"
	     "usage: diorama COMMAND [options]\n\ncommands:");
	for (size_t i = 0; i < sizeof COMMANDS / sizeof *COMMANDS; i++)
		printf("  %-13s%s\n", COMMANDS[i].name, COMMANDS[i].summary);
	puts("\nEach command has --help. Exit status: 0 done, 1 failed, 2 wrong usage.");
}

/* What was printed must have arrived: a full disk behind `>` is a failure too. */
static int finish(int code)
{
	if (fflush(stdout) == 0 && !ferror(stdout))
		return code;
	dio_log_error("standard output: cannot be written: is the disk full?");
	return DIO_EXIT_FAILED;
}

int main(int argc, char **argv)
{
	dio_log_set_program("diorama");
	if (argc < 2) {
		dio_log_error("a command is missing; see diorama --help");
		return DIO_EXIT_USAGE;
	}
	if (strcmp(argv[1], "--help") == 0 || strcmp(argv[1], "-h") == 0 ||
	    strcmp(argv[1], "help") == 0) {
		print_help();
		return finish(DIO_EXIT_OK);
	}
	if (strcmp(argv[1], "--version") == 0) {
		puts("diorama " DIO_VERSION);
		return finish(DIO_EXIT_OK);
	}
	for (size_t i = 0; i < sizeof COMMANDS / sizeof *COMMANDS; i++)
		if (strcmp(argv[1], COMMANDS[i].name) == 0)
			return finish(COMMANDS[i].run(argc - 1, argv + 1));
	dio_log_error("%s: no such command; see diorama --help", argv[1]);
	return DIO_EXIT_USAGE;
}
