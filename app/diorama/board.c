/* diorama board: a calibration board for the printer, at its true size; a look at a profile. */
#include <stdio.h>
#include <string.h>
#include <strings.h>

#include "capture/board_page.h"
#include "capture/board_print.h"
#include "commands.h"
#include "core/log.h"
#include "core/options.h"
#include "profile/check.h"

static bool ends_with(const char *text, const char *end)
{
	size_t n = strlen(text), m = strlen(end);

	return n >= m && strcasecmp(text + n - m, end) == 0;
}

static enum dio_status print(const char *spec, const char *paper_name, uint32_t dpi,
			     const char *out, struct dio_error *error)
{
	struct dio_board_page page = {0};
	struct dio_board board;
	struct dio_paper paper;
	bool pdf = ends_with(out, ".pdf");
	enum dio_status status;

	if (!pdf && !ends_with(out, ".png"))
		return dio_fail(error, DIO_BAD_ARG, "%s: the name must end in .pdf or .png", out);
	status = dio_board_parse(spec, &board, error);
	if (status == DIO_OK)
		status = dio_paper_parse(paper_name, &paper, error);
	if (status == DIO_OK)
		status = dio_board_page_init(&page, &board, &paper, error);
	if (status != DIO_OK)
		return status;
	status = pdf ? dio_board_print_pdf(&page, out, error)
		     : dio_board_print_png(&page, dpi, out, error);
	if (status == DIO_OK)
		printf("wrote %s: %s, %.1f x %.1f mm page\n", out, page.text, page.width_mm,
		       page.height_mm);
	dio_board_page_deinit(&page);
	return status;
}

static int run_print(int argc, char **argv)
{
	const char *out = NULL, *paper = "A4";
	uint32_t dpi = 300;
	const struct dio_option options[] = {
		{.name = "out",
		 .kind = DIO_OPTION_TEXT,
		 .value = "FILE",
		 .help = "board.pdf (vector) or board.png",
		 .target = &out,
		 .required = true},
		{.name = "paper",
		 .kind = DIO_OPTION_TEXT,
		 .value = "NAME",
		 .help = "A0 to A5, letter, legal, tabloid; default A4",
		 .target = &paper},
		{.name = "dpi",
		 .kind = DIO_OPTION_COUNT,
		 .value = "N",
		 .help = "dots per inch of a PNG, default 300",
		 .target = &dpi,
		 .min = DIO_PRINT_DPI_MIN,
		 .max = DIO_PRINT_DPI_MAX},
	};
	const struct dio_usage usage = {
		.command = "board print",
		.summary = "draw a calibration board for the printer, at its true size",
		.arguments = "SPEC",
		.details =
			"SPEC is charuco:COLSxROWS:SQUARE_M:MARKER_M:DICTIONARY[:legacy] or\n"
			"chessboard:COLSxROWS:SQUARE_M (inner corners). Print at 100 %, without\n"
			"fitting to the page, and measure the ruler under the board.",
		.min_arguments = 1,
		.max_arguments = 1,
		.options = options,
		.option_count = sizeof options / sizeof *options,
	};
	struct dio_error error = {""};
	char **arguments;
	uint32_t count;
	enum dio_options_result parsed = dio_options_parse(&usage, argc, argv, &arguments, &count);

	if (parsed != DIO_OPTIONS_RUN)
		return dio_options_exit_code(parsed);
	if (print(arguments[0], paper, dpi, out, &error) != DIO_OK) {
		dio_log_error("%s", error.text);
		return DIO_EXIT_FAILED;
	}
	return DIO_EXIT_OK;
}

/* Every fault, in the order of the file. */
static void list_faults(const char *path, const struct dio_profile_report *report)
{
	for (size_t i = 0; i < report->fault_count; i++) {
		const struct dio_profile_fault *fault = &report->faults[i];

		if (fault->line)
			dio_log_error("%s:%u: %s", path, fault->line, fault->text);
		else
			dio_log_error("%s: %s", path, fault->text);
	}
}

static int check(const char *path, bool look)
{
	struct dio_profile_report report = {0};
	struct dio_profile profile;
	struct dio_error error = {""};
	enum dio_status status = dio_profile_read(path, &profile, &report, &error);

	if (status == DIO_OK)
		dio_profile_check(&profile, look, &report);
	if (status == DIO_OK && report.fault_count == 0)
		printf("%s: %s: good (camera %s, display %s, %u buttons, %u LEDs)\n", path,
		       profile.name, profile.camera.source, profile.display.output,
		       profile.button_count, profile.led_count);
	else if (report.fault_count)
		list_faults(path, &report);
	else
		dio_log_error("%s", error.text);
	status = report.fault_count ? DIO_BAD_FILE : status;
	dio_profile_report_deinit(&report);
	return status == DIO_OK ? DIO_EXIT_OK : DIO_EXIT_FAILED;
}

static int run_check(int argc, char **argv)
{
	bool elsewhere = false;
	const struct dio_option options[] = {
		{.name = "elsewhere",
		 .kind = DIO_OPTION_FLAG,
		 .help = "the profile is for another machine: do not look for its devices",
		 .target = &elsewhere},
	};
	const struct dio_usage usage = {
		.command = "board check",
		.summary = "find the faults of a board's profile, and devices that are missing",
		.arguments = "FILE",
		.min_arguments = 1,
		.max_arguments = 1,
		.options = options,
		.option_count = sizeof options / sizeof *options,
	};
	char **arguments;
	uint32_t count;
	enum dio_options_result parsed = dio_options_parse(&usage, argc, argv, &arguments, &count);

	if (parsed != DIO_OPTIONS_RUN)
		return dio_options_exit_code(parsed);
	return check(arguments[0], !elsewhere);
}

int dio_command_board(int argc, char **argv)
{
	if (argc >= 2 && strcmp(argv[1], "print") == 0)
		return run_print(argc - 1, argv + 1);
	if (argc >= 2 && strcmp(argv[1], "check") == 0)
		return run_check(argc - 1, argv + 1);
	if (argc >= 2 && (strcmp(argv[1], "--help") == 0 || strcmp(argv[1], "-h") == 0)) {
		puts("diorama board: calibration boards, and the profiles of machines\n\n"
		     "usage: diorama board print SPEC --out FILE [options]\n"
		     "       diorama board check FILE [--elsewhere]\n\n"
		     "  print   draw a board for the printer; see diorama board print --help\n"
		     "  check   find a profile's faults; see diorama board check --help");
		return DIO_EXIT_OK;
	}
	if (argc >= 2)
		dio_log_error("board: %s: no such word; see diorama board --help", argv[1]);
	else
		dio_log_error("board: print or check is missing; see diorama board --help");
	return DIO_EXIT_USAGE;
}
